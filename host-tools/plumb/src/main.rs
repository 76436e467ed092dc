//! `plumb`, the host program.

use std::process::ExitCode;

fn main() -> ExitCode {
    plumb::cli::run()
}
