//! How long `plumb` takes for recordings, and how much memory: each time the whole program is run,
//! from the trials' packets on disk to its output.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::{Figures, figures_of, get};
use crate::command::{Task, target_directory};
use crate::setup;

/// The number of runs of each: in the first, files may not yet be cached in memory.
const RUNS: usize = 3;

/// What each row measures, with its bound, and the arguments of `plumb`, which runs in the folder
/// of the trials.
const ROWS: [(&str, &[&str]); 5] = [
    ("a study of 28 trials of a minute (at most 2 s): `plumb study`", &["study", "trials.toml"]),
    ("the same study of tables (at most 2 s)", &["study", "tables.toml"]),
    ("an hour's figures (at most 5 s): `plumb analyze`", &["analyze", "hour"]),
    (
        "an hour's report (at most 5 s): `plumb report`",
        &["report", "hour", "--force", "--out", "hour.html"],
    ),
    (
        "an hour's tables, made again (at most 5 s): `plumb replay --tables`",
        &["replay", "hour", "--tables"],
    ),
];

/// The table.
pub fn table() -> Result<String> {
    setup::ensure(&[setup::TIME])?;
    let folder = target_directory().join("bench-trials");
    if folder.exists() {
        // Left by a run that was interrupted.
        fs::remove_dir_all(&folder).context(format!("{}", folder.display()))?;
    }
    let release = |what: &[&str]| {
        let package = ["build", "--release", "--package", "plumb"];
        Task::cargo().args(package).args(what).run()
    };
    release(&["--bin", "plumb"])?;
    release(&["--example", "recorded_trials"])?;
    let programs = target_directory().join("release");
    Task::new(programs.join("examples/recorded_trials")).args([&folder]).run()?;
    let mut table = String::from(
        "| recordings of two targets at 60 Hz | seconds, median / worst | memory at its peak, MiB |\n\
         |---|---:|---:|\n",
    );
    for (name, arguments) in ROWS {
        let runs = (0..RUNS).map(|_| measure(&programs.join("plumb"), &folder, arguments));
        table += &row(name, &runs.collect::<Result<Vec<_>>>()?)?;
    }
    // About 200 MB that are of no further use.
    fs::remove_dir_all(&folder).context(format!("{}", folder.display()))?;
    Ok(table)
}

/// One run: the time in seconds, and the largest resident set in KiB.
fn measure(plumb: &Path, folder: &Path, arguments: &[&str]) -> Result<Figures> {
    let timed = Task::new("time")
        .args(["--format", "seconds\\t%e\npeak_kib\\t%M"])
        .args([plumb])
        .args(arguments)
        .current_dir(folder);
    figures_of(|each_line| timed.run_and_read(each_line))
}

fn row(name: &str, runs: &[Figures]) -> Result<String> {
    let sorted = |figure: &str| -> Result<Vec<f64>> {
        let numbers = runs.iter().map(|run| Ok(get(run, figure)?.parse::<f64>()?));
        let mut numbers = numbers.collect::<Result<Vec<_>>>()?;
        numbers.sort_by(f64::total_cmp);
        Ok(numbers)
    };
    let at = |sorted: &[f64], at: usize| sorted.get(at).copied().context("no run");
    let (seconds, kib) = (sorted("seconds")?, sorted("peak_kib")?);
    let (median, worst) = (at(&seconds, RUNS / 2)?, at(&seconds, RUNS - 1)?);
    let peak_mib = at(&kib, RUNS - 1)? / 1024.0;
    Ok(format!("| {name} | {median:.2} / {worst:.2} | {peak_mib:.0} |\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_median_and_the_worst_of_its_runs() {
        let run = |seconds: &str, peak_kib: &str| {
            Figures::from(
                [("seconds", seconds), ("peak_kib", peak_kib)]
                    .map(|(name, value)| (name.to_owned(), value.to_owned())),
            )
        };
        let runs = [run("2.50", "2048"), run("0.41", "10240"), run("0.40", "1024")];
        assert_eq!(row("a study", &runs).unwrap(), "| a study | 0.41 / 2.50 | 10 |\n");
        assert!(row("a study", &[]).is_err());
        let error = row("a study", &[Figures::new()]).unwrap_err().to_string();
        assert!(error.contains("seconds"), "{error}");
    }

    #[test]
    fn a_program_is_measured_as_a_whole() {
        if !setup::are_there(setup::TIME) {
            eprintln!("skipped: there is no GNU time");
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let script = "pwd; sleep 0.3";
        let run = measure("sh".as_ref(), folder.path(), &["-c", script]).unwrap();
        let number = |figure: &str| get(&run, figure).unwrap().parse::<f64>().unwrap();
        // A shell takes a few MiB; its time depends on how busy the machine is.
        assert!((0.3..30.0).contains(&number("seconds")), "{run:?}");
        assert!((200.0..100_000.0).contains(&number("peak_kib")), "{run:?}");
    }
}
