//! What the tests of several packages share, and `cargo xtask test` with them.
//!
//! - [`data`]: photographs and other people's recordings, which are not in the repository.
//! - [`skip`]: how a test says that it cannot run here. A test that returns early counts as passed;
//!   the reason that it gives through this function is listed at the end of the run.
//! - [`command`], [`serial_lines`], [`program`], [`board_beside`]: this project's programs, in an
//!   emulator too.
//! - [`recording`]: rendered frames with known poses, in files.
//! - [`python`], [`chromium`]: programs of other people.
//! - [`free_port`], [`free_address`], [`free_ports`], [`listens_at`]: where a program can listen, and
//!   whether it does.
//! - [`mutations`]: damaged versions of a good file.
//! - [`evidence`], [`repetitions`], [`seed`]: what is tried many times, and what was found.
//! - [`fuzz`]: what `cargo xtask fuzz` tries.
//!
//! Variables of the environment, which `cargo xtask test` sets and anyone may set:
//!
//! | variable | is |
//! |---|---|
//! | [`DATA`] | where the data are; relative to the root of the checkout |
//! | [`RUNNER`] | the emulator that runs programs of another processor |
//! | [`PYTHON`] | the Python that has other people's packages |
//! | [`SKIPS`] | the file that skips are appended to |
//! | [`PROGRAMS`] | where this project's programs are built |
//! | [`RECORDINGS`] | where the rendered recordings are |
//! | [`SEED`] | the seed of what is tried at random |
//! | [`SHARE`] | the share of the repetitions that is done |

mod evidence;
pub mod fuzz;
mod mutations;
mod others;
mod ports;
mod recordings;
mod skips;

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

pub use evidence::{SEED, SHARE, evidence, repetitions, seed};
pub use mutations::mutations;
pub use others::{PYTHON, chromium, python};
pub use ports::{free_address, free_port, free_ports, listens_at};
pub use recordings::{
    CONFIG_FILE, FRAMES_FILE, PERSON, PERSON_FRAMES, PROGRAMS, RECORDINGS, STANDARD,
    STANDARD_FRAMES, TRUTH_FILE, VGA,
};
pub use recordings::{make_recordings, program, recording};
pub use skips::{Absent, SKIPS, Skip, read_skips, skip};

/// Names the directory with photographs and recordings by others.
pub const DATA: &str = "PLUMBLINE_DATA";

/// Names the emulator that runs this project's programs where they are built for another processor:
/// the tests then run in an emulator themselves, and cannot start a program without it.
pub const RUNNER: &str = "PLUMBLINE_RUNNER";

/// The root of the checkout.
pub fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).expect("the package lies two directories deep")
}

/// The directory with the data, which need not exist.
pub fn data_directory() -> PathBuf {
    root().join(env::var_os(DATA).unwrap_or_else(|| "../shared/data".into()))
}

/// A file or folder of the data. `None`, with the test recorded as skipped, where it is absent.
pub fn data(name: &str) -> Option<PathBuf> {
    let path = data_directory().join(name);
    if path.exists() {
        return Some(path);
    }
    skip(Absent::Data, &format!("there is no {} ({DATA} names another place)", path.display()));
    None
}

/// Whether the tests run in an emulator of another processor.
pub fn is_emulated() -> bool {
    env::var_os(RUNNER).is_some()
}

/// A command that starts `program` on any processor; the caller adds its arguments. What it keeps
/// for its user is kept in a temporary directory, apart from what the user who runs the tests has.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = match env::var_os(RUNNER) {
        Some(runner) => {
            let mut command = Command::new(runner);
            command.arg(program);
            command
        }
        None => Command::new(program),
    };
    command.env("XDG_DATA_HOME", env::temp_dir().join("plumbline-tests"));
    command
}

/// Whether a serial line can be opened; where it cannot, the test is recorded as skipped. The
/// emulator does not know the request that sets a line's rate (TCSETS2). The tests that boot the
/// box use a serial line on that processor.
pub fn serial_lines() -> bool {
    if is_emulated() {
        skip(Absent::Emulator, "the emulator cannot set a serial line's rate");
    }
    !is_emulated()
}

/// The box's program, which lies beside `plumb`. `None`, with the test recorded as skipped, where
/// it is not built: a package's own tests do not build the programs of another.
pub fn board_beside(plumb: &str) -> Option<PathBuf> {
    let board = Path::new(plumb).with_file_name("plumbline-board");
    if board.exists() {
        return Some(board);
    }
    let reason = format!("{} is not built: test the whole workspace", board.display());
    skip(Absent::Build, &reason);
    None
}
