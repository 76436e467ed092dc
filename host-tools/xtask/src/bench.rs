//! `cargo xtask bench`.

use anyhow::{Result, bail};

/// What `cargo xtask bench` takes.
#[derive(clap::Args)]
pub struct Arguments {
    /// Put the figures into README.md, between its markers.
    #[arg(long)]
    write_readme: bool,
}

/// Measures.
pub fn run(arguments: &Arguments) -> Result<()> {
    let _ = arguments.write_readme;
    bail!("the pipeline is not here yet")
}
