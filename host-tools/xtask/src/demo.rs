//! `cargo xtask demo`.

use std::ffi::OsString;

use anyhow::Result;

use crate::command::{Task, target_directory};
use crate::setup;

/// The arguments of `cargo xtask demo`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Passed on to `plumb demo`; `cargo xtask demo -- --help` lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "PLUMB DEMO'S OWN")]
    passed_on: Vec<OsString>,
}

/// Builds both release programs and runs the demo.
pub fn run(arguments: &Arguments) -> Result<()> {
    setup::ensure(&[setup::LINKER, setup::VIDEO])?;
    // `plumb demo` starts the box's program, which lies in the same directory.
    let packages = ["--package", "plumb", "--package", "plumbline-board"];
    Task::cargo().args(["build", "--release"]).args(packages).run()?;
    // Not by `cargo run`: for one package alone, cargo compiles crates with other features, anew.
    let plumb = target_directory().join("release/plumb");
    Task::new(plumb).args(["demo"]).args(&arguments.passed_on).run()
}
