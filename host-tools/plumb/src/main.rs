//! `plumb`, the host's program: what its subcommands take, what they say, and what they show.
//!
//! The work is done by libraries: [`plumbline`] tracks, as it does on the box; what receives,
//! records, calibrates, renders and analyses are the crates beside this one.

mod agreement;
mod arguments;
mod budget;
mod cli;
mod commands;
mod study;
mod ui;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
