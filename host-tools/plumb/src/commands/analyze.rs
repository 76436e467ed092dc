//! `plumb analyze`: the sway figures of a trial.

use std::path::PathBuf;

use clap::Args;
use plumbline_files::{BadInput, write_all};
use plumbline_study::analysis::{Analysis, tables};
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;

use crate::arguments::method::Method;
use crate::arguments::table::TableColumns;
use crate::ui::stdout;

/// The sway figures of a trial: path length, extent, ellipse, frequencies, and more.
///
/// Where a mark or the stand onset has set t = 0, the figures are of the time from then on,
/// otherwise of all; --span chooses another time. The table and the JSON state what was used. The
/// positions are filtered as in the paper (Savitzky-Golay, second order, 0.5 s) or with another
/// --filter, and again left as they are: both are in the JSON. Nothing is interpolated over gaps. A
/// time bin of which less than 90 % was measured has no path length; --covered-min sets another
/// share.
///
/// The ± of a figure is its standard uncertainty from the noise of the poses, from frame to frame,
/// and nothing else; each path comes with the length that this noise alone would give. Print,
/// calibration and the other causes are added by `plumb budget`.
///
/// A table of another system, such as a force plate, gets the same figures with --table.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["trial", "table"])))]
#[command(after_help = "Examples:\n  plumb analyze trials/p01-control\n  \
    plumb analyze trials/p01-control --bins 0-30,30-60 --json p01.json\n  \
    plumb analyze trials/p01-control --filter butterworth:10 --span all\n  \
    plumb analyze --table plate.txt --columns 'time=Time[s],ap=COPx[cm],ml=COPy[cm]' --unit cm \\\n      \
    --delimiter tab --json plate.json")]
pub struct Arguments {
    /// The trial's folder
    trial: Option<PathBuf>,

    /// A table of positions instead (text; .gz is unpacked)
    #[arg(long, value_name = "FILE", requires_all = ["columns", "unit"])]
    table: Option<PathBuf>,

    /// What its columns are.
    #[command(flatten)]
    columns: TableColumns,

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
            let Some(table) = arguments.columns.of(path)? else {
                unreachable!("--table requires both");
            };
            Points::of_table(&table)?
        }
        (None, Some(folder)) => {
            if let Some(option) = arguments.columns.given() {
                let found = "an option of a table, but no table is given";
                let remedy = "name its file with --table, or leave it out";
                return Err(BadInput::new(folder.display(), option, found, remedy).into());
            }
            Points::of_trial(folder, arguments.zero)?
        }
        (None, None) => unreachable!("one of both is required"),
    };
    let analysis = Analysis::of(&points, &arguments.method.settings(&points))?;
    for warning in &analysis.warnings {
        eprintln!("warning: {warning}");
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&analysis)? + "\n";
        write_all(&[(path.clone(), text.into_bytes())], arguments.force)?;
    }
    stdout::print(&tables::text(&analysis))?;
    Ok(())
}
