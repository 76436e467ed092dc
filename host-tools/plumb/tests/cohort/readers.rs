//! DuckDB, Polars, pyarrow and pandas read a cohort as it is, and SQL finds plumb's figures.

use std::path::Path;
use std::process::Command;

use plumbline_test_support::python;
use serde_json::Value;

use super::{add, plumb, record, trials};

#[test]
fn every_reader_finds_the_same_and_sql_computes_plumbs_figures() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("trials")).unwrap();
    // Codes and conditions that are easily misread.
    for (participant, condition, seed) in
        [("007", "50 % / eyes", 1), ("007", "calm", 2), ("P=1", "calm", 3)]
    {
        let path = folder.path().join(format!("trials/{seed}"));
        record(&path, participant, condition, 12, seed);
    }
    let table = "participant_id\tage\tsex\nsub-007\t41.5\tF\n";
    std::fs::write(folder.path().join("participants.tsv"), table).unwrap();
    let finished = add(folder.path(), &[]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let names = trials(folder.path());
    for (name, more) in [("paper.csv", &[][..]), ("none.csv", &["--filter", "none"])] {
        let mut arguments = vec!["figures", "--out", name];
        arguments.extend(names.iter().map(String::as_str));
        arguments.extend(more);
        assert_eq!(plumb(folder.path(), &arguments).code, Some(0));
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cohort/read.py");
    let done = Command::new(python).arg(script).current_dir(folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{said}");
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let trials = found["trials"]["duckdb"].as_array().unwrap();
    let keys: Vec<String> = trials.iter().map(|it| format!("{}|{}", it[0], it[2])).collect();
    assert_eq!(keys, ["\"007\"|\"50 % / eyes\"", "\"007\"|\"calm\"", "\"P=1\"|\"calm\""]);
    assert_eq!(trials[0][5], 41.5);
    for reader in ["polars", "pyarrow", "pandas"] {
        assert_eq!(found["trials"][reader], found["trials"]["duckdb"], "{reader}");
        assert_eq!(found["points"][reader], found["points"]["duckdb"], "{reader}");
    }
    // From the positions alone, to rounding; and the table of figures, to the last digit.
    assert_eq!(found["sql"]["compared"], 3 * 2 * 2);
    assert!(found["sql"]["worst"].as_f64().unwrap() < 1e-11, "{}", found["sql"]);
    assert_eq!(found["figures"]["differ"], 0);
    assert!(found["figures"]["rows"].as_u64().unwrap() > 600, "{}", found["figures"]);
}
