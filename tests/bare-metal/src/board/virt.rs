//! QEMU's `virt`: a 64-bit ARM processor at exception level 1.
//!
//! The crate `aarch64-rt` enables the floating-point unit and the MMU. Without the latter all
//! memory would be a device's, which cannot be read unaligned.

use aarch64_rt::{
    ExceptionHandlers, InitialPagetable, entry, exception_handlers, initial_pagetable,
};

/// 160 KiB: more than is ever used, as it is measured.
const STACK_PAGES: usize = 40;

/// A block of memory that is valid, and has been accessed as far as the processor cares.
const VALID: usize = 1 | 1 << 10;

/// The second kind of memory in the crate's list of kinds: cached. The first is a device's.
const CACHED: usize = 1 << 2;

/// What all of the processor's cores see alike.
const SHAREABLE: usize = 3 << 8;

const GIB: usize = 1 << 30;

// The devices' GiB is not mapped, for semihosting needs none: an access through a null
// pointer is a fault.
initial_pagetable!({
    let mut blocks = [0; 512];
    blocks[1] = GIB | VALID | CACHED | SHAREABLE;
    InitialPagetable(blocks)
});

/// Every exception is one too many: the crate's own handlers panic.
struct Exceptions;

impl ExceptionHandlers for Exceptions {}

exception_handlers!(Exceptions);

entry!(start, STACK_PAGES);

fn start(_: u64, _: u64, _: u64, _: u64) -> ! {
    super::run()
}
