//! Cohorts on a cluster of Apache Spark, which runs on this computer. What these tests need is large and
//! slow: they run when they are asked for, as the part `cluster` of `cargo xtask test`.

use std::fs;
use std::path::PathBuf;

use plumbline_test_support::{Absent, skip};

use crate::bench::Bench;
use crate::trials::write_trial;

/// Names the Python that has Spark; `cargo xtask test cluster` installs it.
const PYTHON: &str = "PLUMBLINE_SPARK";

/// Enough that the work, and not the start of a task, takes the time that is measured.
const PARTICIPANTS: u32 = 64;
const CONDITIONS: [&str; 2] = ["control", "foam"];

/// A minute.
const FRAMES: u32 = 3600;

/// What is asked of the cohort, twice: of participants who are complete, and of all.
fn study(title: &str, more: &str) -> String {
    format!(
        "title = \"{title}\"\ntrials = [\"elsewhere/*\"]\nconditions = [\"control\", \"foam\"]\n\
         bins_s = [[0, 18], [18, 36], [36, 54]]\nfigures = \"all\"\n{more}"
    )
}

/// Makes the trials, a cohort of them, and what `plumb` computes; `None` without Spark.
fn prepared() -> Option<Bench> {
    let Some(python) = std::env::var_os(PYTHON).map(PathBuf::from) else {
        skip(Absent::Tool, "PLUMBLINE_SPARK does not say which Python has Spark");
        return None;
    };
    let bench = Bench::with(python)?;
    fs::create_dir(bench.path("trials")).unwrap();
    let mut folders = Vec::new();
    for at in 1..=PARTICIPANTS {
        let who = format!("p{at:02}");
        for (what, more) in CONDITIONS.into_iter().zip([0.0, 0.4]) {
            // One stood for half the time only, and cannot be compared at all times.
            let frames = if (at, what) == (PARTICIPANTS, "foam") { FRAMES / 2 } else { FRAMES };
            write_trial(&bench, [&who, what], frames, at, more + 0.01 * f64::from(at * at % 7));
            folders.push(format!("trials/{who}-{what}"));
        }
    }
    let folders: Vec<&str> = folders.iter().map(String::as_str).collect();
    // Twice, as it grows: the one table is then in two files.
    let (first, others) = folders.split_at(8);
    for some in [first, others] {
        bench.plumb(&[&["cohort", "add", "--to", "cohort"], some].concat());
    }
    bench.plumb(&[&["figures"], &folders[..], &["--out", "figures.csv"]].concat());
    for (name, text) in [
        ("strict", study("Everybody", "")),
        ("study", study("The complete", &format!("drop_incomplete = true\n{}", but_the_last()))),
        ("dropping", study("Whoever is complete", "drop_incomplete = true\n")),
    ] {
        fs::write(bench.path(&format!("{name}.toml")), text).unwrap();
    }
    for name in ["study", "dropping"] {
        let files = [format!("{name}.toml"), format!("{name}.json")];
        bench.plumb(&["study", "--cohort", "cohort", &files[0], "--json", &files[1]]);
    }
    Some(bench)
}

/// The section that chooses all participants but the last.
fn but_the_last() -> String {
    let all: Vec<String> = (1..PARTICIPANTS).map(|at| format!("\"p{at:02}\"")).collect();
    format!("[choose]\nparticipants = [{}]\n", all.join(", "))
}

#[test]
#[ignore = "starts a cluster of Spark: cargo xtask test cluster"]
fn a_cluster_computes_what_one_computer_does_also_when_a_worker_dies() {
    let Some(bench) = prepared() else { return };
    // What it measures is seen while it runs.
    let status = bench.script("spark/study.py").status().unwrap();
    assert!(status.success(), "{status}");
    assert!(fs::read(bench.path("cluster.png")).unwrap().starts_with(b"\x89PNG"));
}
