//! `plumb export`: a trial for other programs.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_files::counting::counted;
use plumbline_trial::Trial;
use plumbline_trial::export::{Format, Recording, export};
use plumbline_trial::manifest::Zero;

/// A trial for other programs: the trunk points over time.
///
/// Each frame is a row, also one that never came. Where a point was not seen, cells are empty
/// (CSV), null (Parquet), NaN (TRC) or n/a (BIDS), and a point has the residual -1 (C3D).
/// No gap is filled. t = 0 is that of `plumb analyze`. Events (t = 0 and the marks) are in C3D and
/// BIDS; the other formats have no place for them.
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
///
/// CSV, Parquet and BIDS have the orientation of each point's target as well: a unit quaternion w,
/// x, y, z, relative to the scene's board, in the right-handed frame of TRC and C3D: about X the trunk
/// leans to the right, about Y it bends forward, about Z it turns to the left. The first has w >= 0,
/// and no component jumps.
///
/// BIDS: if the folder of --out is a data set, the trial is added to it, as the next run of its
/// participant and its task, which is the trial's condition; otherwise a new data set is made.
/// Nothing else in it is changed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  plumb export trials/p01-control --format c3d --out p01.c3d\n  \
    plumb export trials/p01-control --format bids --out sway-bids\n  \
    plumb export trials/p01-week-4 --format bids --out sway-bids --session week4"
)]
pub struct Arguments {
    /// The trial's folder
    trial: PathBuf,

    /// What to make
    #[arg(long)]
    format: Format,

    /// The file; for BIDS the folder of a data set, new or not
    #[arg(long, value_name = "PATH")]
    out: PathBuf,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long)]
    zero: Option<Zero>,

    /// BIDS: the session, such as `week4`, in a study that has several
    #[arg(long, value_name = "LABEL")]
    session: Option<String>,

    /// BIDS: the number of the run [default: the next one]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    run: Option<u32>,

    /// Replace the file, or this run in the data set, if it exists
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
    let recording = Recording {
        session: arguments.session.as_deref(),
        run: arguments.run,
        force: arguments.force,
    };
    let exported = export(&trial, zero, arguments.format, &arguments.out, &recording)?;
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
