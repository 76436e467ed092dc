//! What both boards have: the stored files, the static pipeline, and a stack that is measured.
//!
//! Output and the end of the run are semihosting: the emulator prints for the program, and
//! ends with its exit code. That of a panic, which a fault of the processor is too, is 101.
// Start-up code, and the look at the stack, are what safe Rust has no words for.
#![allow(unsafe_code)]

use core::arch::asm;
use core::fmt;
use core::ptr;

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline_bare_metal::measure;
use semihosting::io::{self, Write as _};
use semihosting::{println, process};
use static_cell::ConstStaticCell;

#[cfg_attr(target_arch = "aarch64", path = "board/virt.rs")]
#[cfg_attr(target_arch = "arm", path = "board/mps2_an500.rs")]
mod start;

// PLUMBLINE_STORED is given by whoever builds: rendered frames are in no repository.
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
    let top = (&raw const stack_top).addr();
    let (config, decode) = watched(|| Config::decode(BLOB));
    let config = config.expect("a configuration that fits the limits");
    let mut program_bytes = top - decode.end;
    let mut step_bytes = 0;
    let step = |pipeline: &mut Pipeline, frame: &GreyImage<'_>, time_ns: u64| {
        let (report, stack) = watched(|| pipeline.step(frame, time_ns));
        step_bytes = step_bytes.max(stack.start - stack.end);
        program_bytes = program_bytes.max(top - stack.end);
        report
    };
    let mut out = Out(io::stdout().expect("the emulator has an output"));
    measure(PIPELINE.take(), &config, RECORDING, &mut out, step).expect("a table");
    println!("step_stack_bytes\t{step_bytes}");
    println!("program_stack_bytes\t{program_bytes}");
    println!("pipeline_bytes\t{}", size_of::<Pipeline>());
    process::exit(0)
}

/// The part of the stack that a call has used; it grows to lower addresses.
struct Used {
    start: usize,
    end: usize,
}

/// What `call` returns, and what it has used of the stack.
///
/// All of the stack below is filled with a pattern first; where the pattern ends afterwards is
/// the deepest place. A call that leaves nothing of it ends the run.
#[inline(never)]
fn watched<T>(call: impl FnOnce() -> T) -> (T, Used) {
    /// No address of the boards, and no number that measuring leaves behind.
    const PATTERN: u32 = 0xA5C3_96E1;
    const WORD_BYTES: usize = size_of::<u32>();
    let bottom = (&raw mut stack_bottom).expose_provenance();
    let start: usize;
    // SAFETY: reads a register.
    unsafe { asm!("mov {}, sp", out(reg) start, options(nomem, nostack, preserves_flags)) };
    for address in (bottom..start).step_by(WORD_BYTES) {
        // SAFETY: from its bottom to the stack pointer the stack is free: no interrupt is
        // enabled, this is no call, and neither processor's convention has a red zone.
        unsafe { ptr::with_exposed_provenance_mut::<u32>(address).write_volatile(PATTERN) };
    }
    let result = call();
    let is_written = |address: &usize| {
        // SAFETY: as above.
        unsafe { ptr::with_exposed_provenance::<u32>(*address).read_volatile() != PATTERN }
    };
    let end = (bottom..start).step_by(WORD_BYTES).find(is_written).unwrap_or(start);
    assert!(end > bottom, "there is not enough memory for the stack");
    (result, Used { start, end })
}

/// The emulator's output, for formatted text.
struct Out(io::Stdout);

impl fmt::Write for Out {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write_all(text.as_bytes()).map_err(|_| fmt::Error)
    }
}
