//! The core as the only program of a board: no operating system, no allocator.
//!
//! On a board it is firmware with a configuration and a frame in it. On this machine it takes
//! them from the directory that it is given. It prints the poses, in clear and sealed, and the depth
//! of its stack. Given a file with what a board has printed as well, it opens the packets there
//! instead, as a host does, and prints the table of what they say.
//! `cargo xtask test bare-metal` runs it everywhere, and compares.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(not(target_os = "none"))]
mod opened;
mod watch;

/// Prints the table for a directory, made on a thread whose stack is known.
#[cfg(not(target_os = "none"))]
fn main() -> anyhow::Result<()> {
    use std::{env, fs, path::Path, thread};

    use anyhow::{Context as _, anyhow};
    use plumbline::pipeline::Pipeline;
    use plumbline_bare_metal::{CONFIG_FILE, RECORDING_FILE};

    /// The part of the stack that is painted; the thread gets twice that.
    const WATCHED_BYTES: usize = 256 * 1024;

    let usage = "usage: plumbline-bare-metal DIRECTORY [PRINTED]";
    let directory = env::args_os().nth(1).context(usage)?;
    let read = |name: &str| {
        let path = Path::new(&directory).join(name);
        fs::read(&path).with_context(|| path.display().to_string())
    };
    if let Some(printed) = env::args_os().nth(2) {
        let printed = fs::read_to_string(&printed)?;
        print!("{}", opened::table(&printed, &read(CONFIG_FILE)?)?);
        return Ok(());
    }
    let (blob, recording) = (read(CONFIG_FILE)?, read(RECORDING_FILE)?);
    // Made here, where there is room for it on its way to the heap.
    let mut pipeline = Box::new(Pipeline::new());
    let program = move || {
        let mut out = String::new();
        let top = watch::stack_pointer();
        watch::run(top - WATCHED_BYTES..top, &mut pipeline, &blob, &recording, &mut out)
            .map(|()| out)
    };
    let thread = thread::Builder::new().stack_size(2 * WATCHED_BYTES).spawn(program)?;
    let printed =
        thread.join().expect("it does not panic").map_err(|error| anyhow!("{error:?}"))?;
    print!("{printed}");
    Ok(())
}
