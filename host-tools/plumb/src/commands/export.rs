//! `plumb export`: a trial for other programs.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_files::counting::counted;
use plumbline_trial::Trial;
use plumbline_trial::export::{Format, export};
use plumbline_trial::manifest::Zero;

/// A trial for other programs: the trunk points over time.
///
/// Each frame is a row, also one that never came. Where a point was not seen, cells are empty
/// (CSV), null (Parquet), NaN (TRC) or n/a (BIDS), and a point has the residual -1 (C3D).
/// No gap is filled. t = 0 is that of `plumb analyze`.
///
/// A camera with a rolling shutter sees each point at a time of its own. A row has the mean of
/// these times, and each point is moved to it, by some milliseconds, with the velocity between the
/// samples beside it. A warning says by how much, and so do Parquet, C3D and BIDS themselves.
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
    trial: PathBuf,

    /// What to make
    #[arg(long)]
    format: Format,

    /// The file; for BIDS the folder of a new data set
    #[arg(long, value_name = "PATH")]
    out: PathBuf,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long)]
    zero: Option<Zero>,

    /// Replace the file if it exists; a folder is never replaced
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let trial = Trial::open(&arguments.trial)?;
    let zero = arguments.zero.unwrap_or(trial.manifest.zero);
    let exported = export(&trial, zero, arguments.format, &arguments.out, arguments.force)?;
    for warning in &exported.warnings {
        eprintln!("warning: {warning}");
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(
        std::io::stdout(),
        "{}: {} at {:.3} Hz, t = 0: {}",
        arguments.out.display(),
        counted(exported.rows, "row"),
        exported.rate_hz,
        exported.zero
    );
    Ok(())
}
