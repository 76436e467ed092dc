//! `plumb cohort check`: whether a cohort is whole.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_cohort::check::check;
use plumbline_cohort::folder::Cohort;
use plumbline_files::counting::counted;

use crate::ui::progress::Progress;

/// Check that a cohort is whole.
///
/// Reads every trial's points, and compares them with the table of trials and with the table of
/// figures, which is computed again: each value must be the same, bit by bit. Names what is absent,
/// what differs, and files that belong to no trial. The exit code is 1 if anything is amiss.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  plumb cohort check cohort/")]
pub struct Arguments {
    /// The cohort's folder
    cohort: PathBuf,
}

/// Runs the subcommand. Gives whether all is there.
///
/// # Errors
/// When the cohort cannot be read at all.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let cohort = Cohort::open(&arguments.cohort)?;
    let rows = cohort.rows()?;
    let progress = Progress::of_trials("checking", rows.len());
    let checked = check(&cohort, &rows, &|| progress.advance());
    progress.finish();
    let faults = checked?;
    for fault in &faults {
        eprintln!("{fault}");
    }
    let trials = counted(rows.len(), "trial");
    let found = match faults.len() {
        0 => "all is there".to_owned(),
        faults => counted(faults, "fault"),
    };
    let _ = writeln!(std::io::stdout(), "{}: {trials}, {found}", arguments.cohort.display());
    Ok(faults.is_empty())
}
