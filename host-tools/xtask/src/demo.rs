//! `cargo xtask demo`.

use std::ffi::OsString;

use anyhow::Result;

use crate::command::Task;
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
    Task::cargo()
        .args(["run", "--quiet", "--release", "--package", "plumb", "--", "demo"])
        .args(&arguments.passed_on)
        .run()
}
