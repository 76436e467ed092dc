//! `plumb figures`: all figures of many trials, as one table.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use plumbline_files::counting::counted;
use plumbline_files::{BadInput, Late, write_all};
use plumbline_study::tidy::{self, Found};
use plumbline_trial::manifest::Zero;
use rayon::prelude::*;

use crate::arguments::method::Method;
use crate::ui::progress::Progress;
use crate::ui::stdout;

/// All figures of many trials as one table, for pandas, R and spreadsheets.
///
/// One row for each trial, trunk, segment (T1, T2, ..., and the whole), direction and figure, with
/// its value, its standard uncertainty from the noise of the poses, and its unit; beside them
/// participant, condition, the span, how much of it was measured, the filter and the rate. Every
/// trial has the same rows: where a figure cannot be computed, the value is empty and the column
/// `reason` says why. The values are those of `plumb analyze --json`. A file whose name ends with
/// .parquet becomes Parquet, with the same columns, and null for what is empty; any other CSV.
///
/// A trial that cannot be read is named, and the others are written; the exit code is then 1.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  plumb figures trials/* --out figures.csv\n  \
    plumb figures trials/* --bins 0-30,30-60 --out - | head\n  \
    plumb figures trials/* --span 0-30 --out figures.parquet")]
pub struct Arguments {
    /// The trials' folders
    #[arg(required = true, value_name = "TRIAL")]
    trials: Vec<PathBuf>,

    /// The table: CSV, or Parquet by its name; - writes CSV to standard output
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

    /// How figures are made.
    #[command(flatten)]
    method: Method,

    /// What t = 0 is [default: as each trial.toml says]
    #[arg(long)]
    zero: Option<Zero>,

    /// Replace the table if it exists
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand. Gives whether all trials could be read.
///
/// # Errors
/// When none could be, or the table cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let Arguments { trials, out, method, zero, force } = arguments;
    let is_stdout = out.as_os_str() == "-";
    if !is_stdout {
        // Many trials take a while: whether the table can be written is found out before.
        Late::new(out, *force)?;
    }
    tidy::refuse_twice(trials)?;
    let progress = Progress::of_trials("analysing", trials.len());
    let found: Vec<Result<Found, BadInput>> = trials
        .par_iter()
        .map(|folder| {
            let found = tidy::of_trial(folder, *zero, |points| method.settings(points));
            progress.advance();
            found
        })
        .collect();
    progress.finish();

    let mut table = Vec::new();
    let mut broken = 0;
    for (folder, found) in trials.iter().zip(found) {
        match found {
            Ok(Found { rows, warnings }) => {
                for warning in warnings {
                    eprintln!("warning: {}: {warning}", folder.display());
                }
                table.extend(rows);
            }
            Err(error) => {
                eprintln!("error: {error}");
                broken += 1;
            }
        }
    }
    if table.is_empty() {
        let remedy = "give folders that `plumb receive --out` has made";
        return Err(BadInput::whole("trials", "none of them can be read", remedy).into());
    }
    if is_stdout {
        stdout::print(&String::from_utf8_lossy(&tidy::csv(&table)))?;
    } else {
        let bytes = if is_parquet(out) { tidy::parquet(&table) } else { tidy::csv(&table) };
        write_all(&[(out.clone(), bytes)], *force)?;
        let trials = counted(trials.len() - broken, "trial");
        let _ = writeln!(
            std::io::stdout(),
            "{}: {} of {trials}",
            out.display(),
            counted(table.len(), "row")
        );
    }
    Ok(broken == 0)
}

fn is_parquet(out: &Path) -> bool {
    out.extension().is_some_and(|it| it.eq_ignore_ascii_case("parquet"))
}
