//! The computer's monotonic clock, which cameras stamp their frames with.

use nix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC: time since the kernel started, in nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    // This clock is always there, and never before its own zero.
    clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(0, |now| {
        now.tv_sec().cast_unsigned() * 1_000_000_000 + now.tv_nsec().cast_unsigned()
    })
}
