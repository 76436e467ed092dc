//! QEMU's `virt`: a 64-bit ARM processor at exception level 1.
//!
//! The crate `aarch64-rt` enables the floating-point unit and the MMU. Without the MMU all memory
//! would count as device memory, which cannot be accessed unaligned.

use aarch64_rt::{
    ExceptionHandlers, InitialPagetable, entry, exception_handlers, initial_pagetable,
};

/// 160 KiB: more than is ever used, as the measurement shows.
const STACK_PAGES: usize = 40;

/// A valid block of memory, marked as already accessed.
const VALID: usize = 1 | 1 << 10;

/// The second kind of memory in the crate's list: cached. The first is device memory.
const CACHED: usize = 1 << 2;

/// Memory that all of the processor's cores share.
const SHAREABLE: usize = 3 << 8;

const GIB: usize = 1 << 30;

// The devices' GiB is not mapped, for semihosting needs none: an access through a null
// pointer is a fault.
initial_pagetable!({
    let mut blocks = [0; 512];
    blocks[1] = GIB | VALID | CACHED | SHAREABLE;
    InitialPagetable(blocks)
});

/// No exception is expected: the crate's own handlers panic.
struct Exceptions;

impl ExceptionHandlers for Exceptions {}

exception_handlers!(Exceptions);

entry!(start, STACK_PAGES);

fn start(_: u64, _: u64, _: u64, _: u64) -> ! {
    super::run()
}
