//! What both boards have: the stored files, the static pipeline, and where the stack is.
//!
//! Output and the end of the run are semihosting: the emulator prints for the program, and ends
//! with its exit code. The exit code of a panic is 101, and a fault of the processor is a panic
//! too.
// Start-up code cannot be written in safe Rust.
#![allow(unsafe_code)]

use core::fmt;

use plumbline::pipeline::Pipeline;
use semihosting::io::{self, Write as _};
use semihosting::process;
use static_cell::ConstStaticCell;

use crate::watch;

#[cfg_attr(target_arch = "aarch64", path = "board/virt.rs")]
#[cfg_attr(target_arch = "arm", path = "board/mps2_an500.rs")]
mod start;

// PLUMBLINE_STORED must be set for the build: rendered frames are not in the repository.
static BLOB: &[u8] = include_bytes!(concat!(env!("PLUMBLINE_STORED"), "/box.plb"));
static RECORDING: &[u8] = include_bytes!(concat!(env!("PLUMBLINE_STORED"), "/frames.y4m"));

static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());

unsafe extern "C" {
    // The stack's two ends, from `link/`.
    safe static mut stack_bottom: u32;
    safe static stack_top: u32;
}

/// The program, once the processor is ready.
fn run() -> ! {
    let stack = (&raw mut stack_bottom).expose_provenance()..(&raw const stack_top).addr();
    let mut out = Out(io::stdout().expect("the emulator has an output"));
    watch::run(stack, PIPELINE.take(), BLOB, RECORDING, &mut out).expect("a table");
    process::exit(0)
}

/// The emulator's output, for formatted text.
struct Out(io::Stdout);

impl fmt::Write for Out {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write_all(text.as_bytes()).map_err(|_| fmt::Error)
    }
}
