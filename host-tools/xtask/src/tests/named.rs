//! The parts that run only when they are named: they take long, want a quiet computer, or need large
//! downloads. Most of them try the programs as users have them.

use std::path::PathBuf;

use plumbline_test_support::{PROGRAMS, SKIPS};

use super::journal::Journal;
use crate::command::{Task, target_directory};
use crate::dist;
use crate::python::{Packages, READERS};

/// How long [`long`] has the streams watched; the desk's tests know it themselves.
const STREAM_SECONDS: (&str, &str) = ("PLUMBLINE_STREAM_SECONDS", "600");

/// Builds programs as users have them; whether that could be done.
pub fn released(journal: &mut Journal, packages: &[&str]) -> bool {
    let packages = packages.iter().flat_map(|package| ["--package", package]);
    let build = ["build", "--release"].into_iter().chain(packages);
    journal.check("build", || Task::cargo().args(build).run())
}

/// Tests that take the released programs, one after the other, since they measure times and memory.
pub fn of_released(journal: &Journal, test: &[&str], which: &[&str]) -> Task {
    let task =
        Task::cargo().args(["test"]).args(test).args(["--", "--nocapture", "--test-threads=1"]);
    let task = task
        .args(which)
        .env(PROGRAMS, &target_directory().join("release").to_string_lossy())
        .env(SKIPS, &journal.skips.to_string_lossy());
    READERS.tells(task)
}

/// The desk and the streams, for ten minutes each.
pub fn long(journal: &mut Journal) {
    if !released(journal, &["plumb", "plumbline-board"]) {
        return;
    }
    let streams = "streams::every_frame_reaches_everybody_and_the_recording_is_whole";
    for (name, program, which) in
        [("desk", "desk", ["--ignored"].as_slice()), ("streams", "link", &["--exact", streams])]
    {
        let task = of_released(journal, &["--workspace", "--test", program], which);
        let task = task.env(STREAM_SECONDS.0, STREAM_SECONDS.1);
        journal.tests(name, |each_line| task.run_and_read(each_line));
    }
}

/// What thousands of trials in a cohort cost.
pub fn cohort(journal: &mut Journal) {
    if !released(journal, &["plumb"]) {
        return;
    }
    let task = of_released(journal, &["--workspace", "--test", "cohort"], &["--ignored"]);
    journal.tests("cohort", |each_line| task.run_and_read(each_line));
}

/// The load of a ward.
pub fn ward(journal: &mut Journal) {
    if !released(journal, &["plumb"]) {
        return;
    }
    let task = of_released(journal, &["--workspace", "--test", "ward"], &["--ignored"]);
    journal.tests("load", |each_line| task.run_and_read(each_line));
}

/// What people download, used where they use it.
pub fn dist(journal: &mut Journal) {
    let out = target_directory().join("dist-tests");
    if !journal.check("dist", || dist::make_for_tests(&out)) {
        return;
    }
    journal.check("debian", || dist::use_in_debian(&out));
    let mut wine = PathBuf::new();
    let has_wine = journal.check("wine", || {
        wine = dist::make_wine()?;
        Ok(())
    });
    if !has_wine {
        return;
    }
    let test = ["test", "--package", "xtask", "--test", "dist"];
    let task = Task::cargo()
        .args(test)
        .args(["--", "--nocapture", "--test-threads=1"])
        .env(dist::VARIABLE, &out.to_string_lossy())
        .env(dist::WINE_VARIABLE, &wine.to_string_lossy())
        .env(SKIPS, &journal.skips.to_string_lossy());
    journal.tests("windows", |each_line| task.run_and_read(each_line));
}

/// The tests of the Python package with this name, with a Python of their own.
pub fn of_python(journal: &mut Journal, name: &str, python: &Packages) {
    let build = ["build", "--package", "plumb", "--package", "plumbline-python"];
    if !journal.check("build", || Task::cargo().args(build).run()) {
        return;
    }
    let test = ["test", "--package", "plumbline-python", "--test", "python"];
    let task = Task::cargo()
        .args(test)
        .args(["--", "--nocapture", "--test-threads=1", "--ignored", name])
        .env(PROGRAMS, &target_directory().join("debug").to_string_lossy())
        .env(SKIPS, &journal.skips.to_string_lossy());
    let task = python.tells(task);
    journal.tests("tests", |each_line| task.run_and_read(each_line));
}
