//! The core as the only program of a board: no operating system, no allocator.
//!
//! On a board it is firmware with a configuration and a frame in it, which prints its poses and
//! the depth of its stack through the emulator. On this machine it prints the poses of the
//! directory that it is given, for comparison. `cargo xtask test bare-metal` runs all of them.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

#[cfg(not(target_os = "none"))]
fn main() -> anyhow::Result<()> {
    use anyhow::Context as _;
    use plumbline::config::Config;
    use plumbline::pipeline::Pipeline;
    use plumbline_bare_metal::{CONFIG_FILE, RECORDING_FILE, measure};

    let directory = std::env::args_os().nth(1).context("usage: plumbline-bare-metal DIRECTORY")?;
    let read = |name: &str| {
        let path = std::path::Path::new(&directory).join(name);
        std::fs::read(&path).with_context(|| path.display().to_string())
    };
    let mut table = String::new();
    let mut pipeline = Box::new(Pipeline::new());
    let config = Config::decode(&read(CONFIG_FILE)?).context(CONFIG_FILE)?;
    measure(&mut pipeline, &config, &read(RECORDING_FILE)?, &mut table, Pipeline::step)
        .map_err(|error| anyhow::anyhow!("{error:?}"))?;
    print!("{table}");
    Ok(())
}
