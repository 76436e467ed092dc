//! How much a test does.

/// How often a test does its work: `count` times, and a tenth as often in an emulator,
/// where each time takes ten times as long or more. `cargo xtask test` sets the variable.
pub fn repetitions(count: usize) -> usize {
    if std::env::var_os("PLUMBLINE_RUNNER").is_some() { count.div_ceil(10) } else { count }
}
