//! `plumb export`: a trial for other programs.

use std::io::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::analyze::points::Points;
use crate::trial::Trial;
use crate::trial::manifest::Zero;
use plumbline_files::counting::counted;
use plumbline_files::write_all;

mod bids;
mod c3d;
mod csv;
mod parquet;
mod rows;
mod trc;

use rows::Rows;

/// A trial for other programs: the trunk points over time.
///
/// Each frame is a row, also one that never came. Where a point was not seen, cells are empty
/// (CSV), null (Parquet), NaN (TRC) or n/a (BIDS), and a point has the residual -1 (C3D).
/// Nothing is interpolated. t = 0 is that of `plumb analyze`.
///
/// CSV, Parquet and BIDS have the body's axes under their names: AP forward, ML to the person's
/// right, SI up; all in millimetres. These three are a left-handed frame, and programs that show
/// TRC and C3D take frames to be right-handed: there X is forward (AP), Y is to the LEFT (ML
/// with its sign changed), Z is up (SI). C3D has single precision and no times: its frames are
/// evenly spaced, and PLUMBLINE:T_ZERO says when t = 0 is, in seconds from the first frame.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  plumb export trials/p01-control --format c3d --out p01.c3d\n  \
    plumb export trials/p01-control --format bids --out p01-bids"
)]
pub struct Arguments {
    /// The trial's folder
    pub trial: PathBuf,

    /// What to make
    #[arg(long)]
    pub format: Format,

    /// The file; for BIDS the folder of a new data set
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long)]
    pub zero: Option<Zero>,

    /// Replace the file if it exists; a folder is never replaced
    #[arg(long)]
    pub force: bool,
}

/// What other programs read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// A table, for every program.
    Csv,
    /// A table, for data analysis.
    Parquet,
    /// Track row column, of OpenSim and motion capture.
    Trc,
    /// The Coordinate 3D file of motion capture.
    C3d,
    /// A folder that follows the Brain Imaging Data Structure for motion.
    Bids,
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let trial = Trial::open(&arguments.trial)?;
    let points = Points::of(&trial, arguments.zero.unwrap_or(trial.manifest.zero))?;
    let rows = Rows::of(&points)?;
    let mut warnings = points.warnings.clone();
    let bytes = match arguments.format {
        Format::Csv => Some(csv::bytes(&rows)),
        Format::Parquet => Some(parquet::bytes(&rows, &arguments.out)?),
        Format::Trc => Some(trc::bytes(&rows, &arguments.out)),
        Format::C3d => {
            warnings.extend(rows.unevenness());
            Some(c3d::bytes(&rows, &arguments.out)?)
        }
        Format::Bids => {
            warnings.extend(bids::write(&rows, &trial, &points, &arguments.out)?);
            None
        }
    };
    if let Some(bytes) = bytes {
        write_all(&[(arguments.out.clone(), bytes)], arguments.force)?;
    }
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(
        std::io::stdout(),
        "{}: {} at {:.3} Hz, t = 0: {}",
        arguments.out.display(),
        counted(rows.time_s.len(), "row"),
        rows.rate_hz,
        points.zero
    );
    Ok(())
}

/// AP, ML and SI in the right-handed frame of other programs: X forward, Y to the left, Z up.
fn right_handed([ap, ml, si]: [f64; 3]) -> [f64; 3] {
    [ap, -ml, si]
}

/// That frame in words, for files that have room for them.
const RIGHT_HANDED: &str = "X forward (AP), Y to the left (-ML), Z up (SI)";

/// What the axes of the body are, for files that keep them.
const BODY_AXES: &str = "ap: forward; ml: to the person's right; si: up; millimetres";
