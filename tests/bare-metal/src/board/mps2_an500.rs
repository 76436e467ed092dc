//! QEMU's `mps2-an500`: a Cortex-M7.
//!
//! The crate `cortex-m-rt` enables the floating-point unit and gives the stack all the memory that
//! the statics leave.

use cortex_m_rt::{ExceptionFrame, entry, exception};

#[entry]
fn start() -> ! {
    super::run()
}

// The crate's own handlers wait for a debugger that nobody has attached.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    panic!("{frame:?}");
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    panic!("exception {number}");
}
