//! Trials that are kept in a cohort: the same statistics, whatever happens to the program, and read by
//! other people's.

mod bands;
mod killed;
mod readers;

use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::common::finished::{Finished, plumb};
use crate::study::{STUDY, json, record, setting};

/// The trials of a folder by their names, and nothing else that is in it.
fn trials(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder.join("trials")).unwrap();
    let paths: Vec<PathBuf> = entries.map(|it| it.unwrap().path()).collect();
    let mut names: Vec<String> = paths
        .iter()
        .filter(|it| it.join("packets.bin").exists())
        .map(|it| format!("trials/{}", it.file_name().unwrap().to_str().unwrap()))
        .collect();
    names.sort();
    names
}

/// Adds all trials of a folder to its cohort.
fn add(folder: &Path, more: &[&str]) -> Finished {
    let names = trials(folder);
    let mut arguments = vec!["cohort", "add", "--to", "cohort"];
    arguments.extend(names.iter().map(String::as_str));
    arguments.extend(more);
    plumb(folder, &arguments)
}

/// Without the trials' places, which differ.
fn without_places(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.remove("warnings");
            map.remove("reason");
            map.values_mut().for_each(without_places);
        }
        Value::Array(values) => values.iter_mut().for_each(without_places),
        _ => {}
    }
}

fn study_json(folder: &TempDir, arguments: &[&str]) -> String {
    let arguments = [&["study"], arguments, &["--json", "study.json", "--force"]].concat();
    let finished = plumb(folder.path(), &arguments);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let mut found = json(folder, "study.json");
    without_places(&mut found);
    found.to_string()
}

#[test]
fn a_study_of_a_cohort_is_that_of_its_trials_bit_by_bit() {
    let folder = setting();
    let finished = add(folder.path(), &[]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert_eq!(finished.stdout, "cohort: 24 trials added\n");
    assert!(finished.stderr.contains("nothing says the session of 24 trials: it is 1"));
    let again = add(folder.path(), &[]);
    assert_eq!(again.stdout, "cohort: 0 trials added, 24 already there\n");

    let all = "figures = \"all\"\ndrop_incomplete = true\n";
    std::fs::write(folder.path().join("study.toml"), format!("{STUDY}{all}")).unwrap();
    let of_trials = study_json(&folder, &["study.toml"]);
    // The tables have every digit of every statistic.
    assert!(of_trials.len() > 100_000 && of_trials.contains("\"p_holm\""));
    assert_eq!(study_json(&folder, &["study.toml", "--cohort", "cohort"]), of_trials);
    // The study's file can say the same, and choose.
    let of_cohort = STUDY.replace("trials = [\"trials/*\"]", "cohort = \"cohort\"");
    std::fs::write(folder.path().join("kept.toml"), format!("{of_cohort}{all}")).unwrap();
    assert_eq!(study_json(&folder, &["kept.toml"]), of_trials);
    let some = format!("{of_cohort}[choose]\nparticipants = [\"P03\", \"P05\", \"P08\"]\n");
    std::fs::write(folder.path().join("kept.toml"), some).unwrap();
    assert!(
        study_json(&folder, &["kept.toml"]).contains("\"participants\":[\"P03\",\"P05\",\"P08\"]")
    );
    assert_eq!(plumb(folder.path(), &["report", "kept.toml"]).code, Some(0));
    let none = format!("{of_cohort}[choose]\nsessions = [\"2\"]\n");
    std::fs::write(folder.path().join("kept.toml"), none).unwrap();
    let finished = plumb(folder.path(), &["study", "kept.toml"]);
    assert!(
        finished.stderr.contains("none of the 24 trials of ./cohort is chosen; write"),
        "{}",
        finished.stderr
    );

    // What else it tells.
    let run = |arguments: &str| {
        let words: Vec<&str> = arguments.split_whitespace().collect();
        plumb(folder.path(), &words)
    };
    let list = run("cohort list cohort --participant P07").stdout;
    assert!(list.contains("calm") && list.contains("2 trials of 1 participant"), "{list}");
    let counts = run("cohort list cohort --counts").stdout;
    assert!(counts.contains("24 trials of 12 participants"), "{counts}");
    let shown = run("cohort show cohort P07 --condition wild");
    for part in [
        "P07, session 1, wild, run 1",
        "30.0 s, 50.00 Hz, 1501 frames",
        "box",
        "run=1/points.parquet",
    ] {
        assert!(shown.stdout.contains(part), "no {part}: {}", shown.stdout);
    }
    let check = run("cohort check cohort");
    assert_eq!((check.code, &*check.stdout), (Some(0), "cohort: 24 trials, all is there\n"));
    std::fs::remove_dir_all(folder.path().join("cohort/points/participant=P07")).unwrap();
    let check = run("cohort check cohort");
    assert_eq!((check.code, &*check.stdout), (Some(1), "cohort: 24 trials, 2 faults\n"));
    for (arguments, part) in [
        ("cohort list trials", "trials: it is no cohort: it has no cohort.toml"),
        ("cohort show cohort P99", "there is no such trial of \"P99\""),
        ("cohort add --to cohort", "<TRIAL>"),
        (
            "cohort add trials/p01-calm --to cohort --participants trials",
            "there is no participants.tsv",
        ),
    ] {
        let finished = run(arguments);
        assert_eq!(finished.code, Some(2), "{arguments}: {}", finished.stderr);
        assert!(finished.stderr.contains(part), "no {part}: {}", finished.stderr);
    }
}
