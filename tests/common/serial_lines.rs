//! Serial lines, which QEMU's user mode does not have.

/// Whether a serial line can be opened. In the emulator of `cargo xtask test arm` the
/// request that sets a line's rate (TCSETS2) is not known; the tests that use a line
/// skip there and say so. The tests that boot the box have a line on that processor.
pub fn can_be_opened() -> bool {
    let emulated = std::env::var_os("PLUMBLINE_RUNNER").is_some();
    if emulated {
        eprintln!("skipped: the emulator does not know how to set a serial line's rate");
    }
    !emulated
}
