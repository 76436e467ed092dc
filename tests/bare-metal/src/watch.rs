//! The table and the figures of a board or of this machine: the stack is painted before each
//! call that is watched, and looked at afterwards.
// Safe Rust cannot inspect the stack.
#![allow(unsafe_code)]

use core::arch::asm;
use core::fmt::Write;
use core::ops::Range;
use core::ptr;

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline_bare_metal::{NoTable, measure, step};

/// Writes the poses of a configuration and a recording, then the figures: lines of a name, a tab
/// and a value. `stack` is the range of addresses of the program's stack.
pub fn run(
    stack: Range<usize>,
    pipeline: &mut Pipeline,
    blob: &[u8],
    recording: &[u8],
    out: &mut impl Write,
) -> Result<(), NoTable> {
    let (config, decode) = watched(stack.start, || Config::decode(blob));
    let mut program_bytes = stack.end - decode.start;
    let mut step_bytes = 0;
    let watched_step = |pipeline: &mut Pipeline, frame: &GreyImage<'_>, time_ns: u64| {
        let (report, used) = watched(stack.start, || step(pipeline, frame, time_ns));
        step_bytes = step_bytes.max(used.len());
        program_bytes = program_bytes.max(stack.end - used.start);
        report
    };
    measure(pipeline, &config?, recording, out, watched_step)?;
    writeln!(out, "step_stack_bytes\t{step_bytes}")?;
    writeln!(out, "program_stack_bytes\t{program_bytes}")?;
    writeln!(out, "pipeline_bytes\t{}", size_of::<Pipeline>())?;
    Ok(())
}

/// The current end of the stack, which grows towards lower addresses.
#[inline(always)]
pub fn stack_pointer() -> usize {
    let pointer: usize;
    // SAFETY: reads a register.
    #[cfg(not(target_arch = "x86_64"))]
    unsafe {
        asm!("mov {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags));
    }
    // SAFETY: as above.
    #[cfg(target_arch = "x86_64")]
    unsafe {
        asm!("mov {}, rsp", out(reg) pointer, options(nomem, nostack, preserves_flags));
    }
    pointer
}

/// What `call` returns, and the part of the stack that it has used.
///
/// All of the stack from `bottom` on is filled with a pattern first; where the pattern ends
/// afterwards is the deepest place. A call that leaves none of the pattern ends the run.
#[inline(never)]
fn watched<T>(bottom: usize, call: impl FnOnce() -> T) -> (T, Range<usize>) {
    /// Neither an address on the boards nor a number that the measurement leaves behind.
    const PATTERN: u32 = 0xA5C3_96E1;
    const WORD_BYTES: usize = size_of::<u32>();
    let top = stack_pointer();
    for address in (bottom..top).step_by(WORD_BYTES) {
        // SAFETY: from its bottom to the stack pointer the stack is free: no interrupt or
        // signal is handled on it, and a function with calls has no red zone.
        unsafe { ptr::with_exposed_provenance_mut::<u32>(address).write_volatile(PATTERN) };
    }
    let result = call();
    let is_written = |address: &usize| {
        // SAFETY: as above.
        unsafe { ptr::with_exposed_provenance::<u32>(*address).read_volatile() != PATTERN }
    };
    let deepest = (bottom..top).step_by(WORD_BYTES).find(is_written).unwrap_or(top);
    assert!(deepest > bottom, "there is not enough memory for the stack");
    (result, deepest..top)
}
