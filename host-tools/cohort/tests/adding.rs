//! What is added, what is there already, and what is refused.

use std::path::PathBuf;

use plumbline_cohort::check::check;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::given::Said;
use plumbline_stream::fixture::config;
use plumbline_trial::Verdict;
use plumbline_trial::points::Points;
use plumbline_trial::test_trial::Made;
use plumbline_trial::verdict::Grade;

use crate::support::{added, record, tree, trials};

#[test]
fn a_cohort_has_each_trial_once_with_its_points_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let cohort = folder.path().join("new/cohort");
    let given = trials(folder.path(), &["P01-control", "P01-hypo", "P02-control"]);
    let done = added(&cohort, &given[..2], &Said::default()).unwrap();
    assert_eq!((done.added.len(), done.already.len()), (2, 0));
    assert!(done.notes[0].contains("nothing says the session of 2 trials: it is 1"), "{done:?}");

    let done = added(&cohort, &given, &Said::default()).unwrap();
    assert_eq!((done.added.len(), done.already.len()), (1, 2));
    let before = tree(&cohort);
    let done = added(&cohort, &given, &Said::default()).unwrap();
    assert_eq!((done.added.len(), done.already.len()), (0, 3));
    assert_eq!(tree(&cohort), before);

    let cohort = Cohort::open(&cohort).unwrap();
    let rows = cohort.rows().unwrap();
    let keys: Vec<String> = rows.iter().map(|it| it.key.to_string()).collect();
    let expected = ["P01, session 1, control", "P01, session 1, hypo", "P02, session 1, control"];
    assert_eq!(keys, expected.map(|it| format!("{it}, run 1")));
    for (row, folder) in rows.iter().zip(&given) {
        let wanted = Points::of_trial(folder, None).unwrap();
        let found = cohort.points(row).unwrap();
        assert_eq!(found.points.len(), 2);
        for (found, wanted) in found.points.iter().zip(&wanted.points) {
            assert_eq!((&found.name, &found.series), (&wanted.name, &wanted.series));
            assert_eq!(found.frame_time_s, wanted.frame_time_s);
        }
        assert_eq!((found.is_zero_set, found.zero_s), (wanted.is_zero_set, wanted.zero_s));
        assert_eq!((&found.zero, found.usual_span_s()), (&wanted.zero, wanted.usual_span_s()));
        let verdict = wanted.verdict.unwrap();
        assert_eq!(row.verdict.line(), verdict.line());
        assert_eq!((row.frames, row.seen[0].samples, row.seen[1].gaps), (300, 300, 0));
        assert!(row.calibration.as_ref().unwrap().contains(" px, fx "), "{row:?}");
    }
    assert_eq!(check(&cohort, &rows, &|| ()).unwrap(), [""; 0]);
}

#[test]
fn a_verdict_and_a_rolling_shutter_survive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t");
    let mut made = Made::of(&config(), 300);
    // In some frames only one of the two was seen, in some none; and some never came.
    made.each_pose(|mut packet| {
        match packet.sequence {
            40..50 => packet.lower_trunk = None,
            60..63 => (packet.lower_trunk, packet.upper_trunk) = (None, None),
            80..90 => return None,
            _ => {}
        }
        // A row is read every 7 µs, and the target moves.
        for (at, target) in (0..).zip(&mut packet.targets) {
            if let Ok(pose) = &mut target.pose {
                pose.delay_ns = 4_000_000 + 3_000_000 * at + 7000 * (packet.sequence % 9);
            }
        }
        Some(packet)
    });
    made.manifest.verdict = Some(Verdict {
        overruled: Some(Grade::Doubtful),
        by: Some("A.B.".to_owned()),
        why: Some("the door; a cough".to_owned()),
        ..Verdict::default()
    });
    made.write(&path);
    let cohort = folder.path().join("c");
    added(&cohort, std::slice::from_ref(&path), &Said::default()).unwrap();
    let cohort = Cohort::open(&cohort).unwrap();
    let [row] = &cohort.rows().unwrap()[..] else { panic!("one") };
    let (wanted, found) = (Points::of_trial(&path, None).unwrap(), cohort.points(row).unwrap());
    for (found, wanted) in found.points.iter().zip(&wanted.points) {
        assert_ne!(wanted.series.time_s(), wanted.frame_time_s);
        assert_eq!((&found.series, &found.frame_time_s), (&wanted.series, &wanted.frame_time_s));
    }
    assert_eq!((row.seen[0].gaps, row.seen[1].gaps, row.frames), (3, 2, 290));
    let line = row.verdict.line();
    assert_eq!(line, wanted.verdict.unwrap().line());
    assert!(line.starts_with("doubtful, overruled by A.B.: the door; a cough ("), "{line}");
    assert_eq!(check(&cohort, std::slice::from_ref(row), &|| ()).unwrap(), [""; 0]);
}

#[test]
fn what_cannot_be_added_is_named_and_nothing_is_added() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let good = trials(folder.path(), &["P01-control", "P02-control", "P03-control"]);
    record(&at("nobody"), "", "control", "2026-01-01T10:00:00Z");
    record(&at("again"), "P01", "control", "2026-01-01T09:00:00Z");
    record(&at("sub-P09_ses-2_run-3"), "P09", "control", "2026-01-01T09:00:00Z");
    std::fs::create_dir(at("copy")).unwrap();
    for file in ["packets.bin", "trial.toml", "config.plb"] {
        std::fs::copy(good[0].join(file), at("copy").join(file)).unwrap();
    }
    let spoiled = trials(&at("spoiled"), &["P07-control"]).remove(0);
    std::fs::write(spoiled.join("packets.bin"), "not a recording").unwrap();
    std::fs::create_dir(at("full")).unwrap();
    std::fs::write(at("full/notes.txt"), "kept").unwrap();

    let cohort = at("cohort");
    let session = |label: &str| Said { session: Some(label.to_owned()), ..Said::default() };
    let none = Said::default;
    let cases: Vec<(Vec<PathBuf>, Said, &str)> = vec![
        (vec![good[0].clone(), at("gone")], none(), "gone/trial.toml: it is not there"),
        (vec![at("nobody")], none(), "nobody: participant: trial.toml does not say it; write"),
        (
            vec![good[0].clone(), at("again")],
            none(),
            "has the same key; give --run, or --number-runs",
        ),
        (vec![good[0].clone(), at("copy")], none(), "copy: it is a copy of"),
        (vec![good[0].clone(), good[0].clone()], none(), "this trial is given twice"),
        (vec![good[0].clone(), spoiled, good[1].clone()], none(), "P07-control/packets.bin"),
        (vec![good[0].clone()], session("a\nb"), "P01-control: session: it has a character"),
        (
            vec![at("sub-P09_ses-2_run-3")],
            session("1"),
            "session: the folder says 2, and --session 1",
        ),
    ];
    let check_all = |parts: &[&str]| {
        for (trials, said, part) in &cases {
            let before = cohort.exists().then(|| tree(&cohort));
            let error = added(&cohort, trials, said).unwrap_err().to_string();
            assert!(error.contains(part), "no {part}: {error}");
            let after = cohort.exists().then(|| tree(&cohort));
            let rows = |it: &Option<std::collections::BTreeMap<PathBuf, Vec<u8>>>| {
                it.iter().flatten().filter(|(path, _)| path.starts_with("trials")).count()
            };
            assert_eq!(rows(&before), rows(&after), "{error}");
            assert!(!cohort.join(".adding").exists() && !cohort.join(".added").exists());
        }
        for part in parts {
            let error =
                added(&cohort, &[at("nobody"), at("gone")], &none()).unwrap_err().to_string();
            assert!(error.contains(part), "no {part}: {error}");
        }
    };
    check_all(&["2 trials cannot be added:", "nothing was added"]);
    // The same when there is a cohort; only what is in it may be given once more.
    added(&cohort, &good[2..3], &none()).unwrap();
    check_all(&[]);
    added(&cohort, &good[..1], &none()).unwrap();
    let error =
        |trial: &str, said: Said| added(&cohort, &[at(trial)], &said).unwrap_err().to_string();
    let found = error("again", none());
    assert!(found.contains("the cohort has another trial under this key, added from P01-control"));
    let found = error("P01-control", session("2"));
    assert!(
        found.contains("has this trial as P01, session 1, control, run 1, and not as"),
        "{found}"
    );
    let error = added(&at("full"), &good, &none()).unwrap_err().to_string();
    assert!(error.contains("full: it is no cohort, and not empty"), "{error}");
    assert_eq!(tree(&at("full")).len(), 1);
    std::fs::write(cohort.join("cohort.toml"), "format = 2\nmade_with = \"plumb 9\"\n").unwrap();
    let error = Cohort::open(&cohort).unwrap_err().to_string();
    assert!(
        error
            .contains("format: 2, and this program knows 1; use the program that made it, plumb 9")
    );
}

#[test]
fn runs_are_numbered_by_their_beginning_only_if_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let cohort = folder.path().join("cohort");
    let begun = [
        ("b", "2026-01-01T10:05:00Z"),
        ("a", "2026-01-01T10:10:00Z"),
        ("c", "2026-01-01T09:00:00Z"),
    ];
    let given: Vec<PathBuf> = begun
        .into_iter()
        .map(|(name, started)| {
            let path = folder.path().join(name);
            record(&path, "P01", "control", started);
            path
        })
        .collect();
    let said = Said { numbers_runs: true, ..Said::default() };
    added(&cohort, &given[..2], &said).unwrap();
    let runs = || -> Vec<(String, u32)> {
        let rows = Cohort::open(&cohort).unwrap().rows().unwrap();
        rows.into_iter().map(|it| (it.folder, it.key.run)).collect()
    };
    let named = |runs: &[(&str, u32)]| -> Vec<(String, u32)> {
        runs.iter().map(|(name, run)| ((*name).to_owned(), *run)).collect()
    };
    assert_eq!(runs(), named(&[("b", 1), ("a", 2)]));
    // One that is added later comes after those that are there, whenever it began.
    let done = added(&cohort, &given, &said).unwrap();
    assert_eq!((done.added.len(), done.already.len()), (1, 2));
    assert_eq!(runs(), named(&[("b", 1), ("a", 2), ("c", 3)]));
}

#[test]
fn a_damaged_cohort_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-control", "P02-control", "P03-control"]);
    added(&path, &given, &Said::default()).unwrap();
    let cohort = Cohort::open(&path).unwrap();
    let rows = cohort.rows().unwrap();
    let [first, second, third] = [0, 1, 2].map(|at| cohort.points_file(&rows[at]));
    std::fs::remove_file(&first).unwrap();
    std::fs::copy(&third, &second).unwrap();
    let mut bytes = std::fs::read(&third).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&third, bytes).unwrap();
    std::fs::write(path.join("points/stray.parquet"), "").unwrap();
    let faults = check(&cohort, &rows, &|| ()).unwrap();
    for part in [
        "run=1/points.parquet: no such file",
        "participant=P02/session=1/condition=control/run=1/points.parquet: trial: it is of another trial",
        "P03, session 1, control, run 1: its figures are not those of its points",
        "stray.parquet: it belongs to no trial",
    ] {
        let third_may_differ = part.starts_with("P03");
        let is_told = faults.iter().any(|it| it.contains(part))
            || third_may_differ && faults.iter().any(|it| it.contains("participant=P03"));
        assert!(is_told, "no {part}: {faults:?}");
    }
    assert_eq!(faults.len(), 4, "{faults:?}");
}
