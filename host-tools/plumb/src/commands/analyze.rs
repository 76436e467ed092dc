//! `plumb analyze`: the sway figures of a trial.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_files::columns::Delimiter;
use plumbline_files::write_all;
use plumbline_study::analysis::{Analysis, tables};
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_trial::positions::{Columns, Table, Unit};

use crate::arguments::method::Method;

/// The sway figures of a trial: path length, extent, ellipse, frequencies, and more.
///
/// The positions are filtered as in the paper (Savitzky-Golay, second order, 0.5 s), and again
/// left as they are: both are in the JSON. Each figure comes with its uncertainty from the
/// poses' covariance, and each path with the length that the noise alone would give. Nothing is
/// interpolated over gaps.
///
/// A table of another system, such as a force plate, gets the same figures with --table.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["trial", "table"])))]
#[command(after_help = "Examples:\n  plumb analyze trials/p01-control\n  \
    plumb analyze trials/p01-control --bins 0-30,30-60 --json p01.json\n  \
    plumb analyze --table plate.txt --columns 'time=Time[s],ap=COPx[cm],ml=COPy[cm]' --unit cm \\\n      \
    --delimiter tab --json plate.json")]
pub struct Arguments {
    /// The trial's folder
    trial: Option<PathBuf>,

    /// A table of positions instead (text; .gz is unpacked)
    #[arg(long, value_name = "FILE", requires_all = ["columns", "unit"])]
    table: Option<PathBuf>,

    /// The table's columns, as its own header names them: time=NAME,ap=NAME,ml=NAME,si=NAME
    #[arg(long, value_parser = Columns::parse, requires = "table")]
    columns: Option<Columns>,

    /// The unit of the table's positions
    #[arg(long, requires = "table")]
    unit: Option<Unit>,

    /// What separates the table's columns [default: the one with which they are found]
    #[arg(long, requires = "table")]
    delimiter: Option<Delimiter>,

    /// How figures are made.
    #[command(flatten)]
    method: Method,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long, conflicts_with = "table")]
    zero: Option<Zero>,

    /// Write all figures, with the settings that they were made with, into this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Replace the file of --json if it exists
    #[arg(long, requires = "json")]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial or the table cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let points = match (&arguments.table, &arguments.trial) {
        (Some(path), _) => {
            let (Some(columns), Some(unit)) = (arguments.columns.clone(), arguments.unit) else {
                unreachable!("--table requires both");
            };
            let delimiter = arguments.delimiter;
            Points::of_table(&Table { path: path.clone(), columns, unit, delimiter })?
        }
        (None, Some(folder)) => Points::of_trial(folder, arguments.zero)?,
        (None, None) => unreachable!("one of both is required"),
    };
    let analysis =
        Analysis::of(&points, arguments.method.filter_s(), &arguments.method.settings())?;
    for warning in &analysis.warnings {
        eprintln!("warning: {warning}");
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&analysis)? + "\n";
        write_all(&[(path.clone(), text.into_bytes())], arguments.force)?;
    }
    // A closed pipe must not hide the result.
    let _ = write!(std::io::stdout(), "{}", tables::text(&analysis));
    Ok(())
}
