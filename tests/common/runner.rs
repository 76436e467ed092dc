//! Starting this project's programs from a test, on any processor.

use std::env;
use std::ffi::OsStr;
use std::process::Command;

/// What runs the programs where they are of another processor than the machine:
/// the tests run in an emulator then, and cannot start one without it.
/// `cargo xtask test arm` sets it.
pub const RUNNER: &str = "PLUMBLINE_RUNNER";

/// `program`, to be given its arguments and started.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    match env::var_os(RUNNER) {
        Some(runner) => {
            let mut command = Command::new(runner);
            command.arg(program);
            command
        }
        None => Command::new(program),
    }
}
