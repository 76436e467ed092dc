//! The computer's clocks, with which cameras stamp their frames.

use nix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC: the time since the kernel's start, without suspension, in nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    read_ns(ClockId::CLOCK_MONOTONIC)
}

/// CLOCK_BOOTTIME: the same, including suspension.
#[must_use]
pub fn boottime_ns() -> u64 {
    read_ns(ClockId::CLOCK_BOOTTIME)
}

fn read_ns(clock: ClockId) -> u64 {
    // These clocks always exist, and are never negative.
    clock_gettime(clock).map_or(0, |now| now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}
