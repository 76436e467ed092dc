//! What disturbs the box from inside its computer: a clock that is set again and again, and other
//! programs that never rest.

use std::hint::black_box;
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, Result};
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, clock_gettime, clock_settime};

use crate::random::Random;

/// The times to which the clock is set: from 1971 to 2105.
const SECONDS: std::ops::Range<u64> = 31_536_000..4_260_000_000;

/// Sets the computer's clock for ever, a few times in a second.
///
/// # Errors
/// When the kernel refuses.
pub fn set_clock(seed: u64) -> Result<()> {
    let mut random = Random::new(seed);
    for times in 1_u64.. {
        sleep(Duration::from_millis(random.in_range(50..500)));
        let to = TimeSpec::new(random.in_range(SECONDS) as i64, 0);
        clock_settime(ClockId::CLOCK_REALTIME, to).context("the clock")?;
        if times.is_multiple_of(10) {
            println!("test: the clock was set {times} times, last to {} s", to.tv_sec());
        }
    }
    Ok(())
}

/// Computes for ever.
pub fn burn() -> Result<()> {
    let mut memory = vec![0_u64; 1 << 18];
    let mut random = Random::new(1);
    loop {
        for word in &mut memory {
            *word = word.wrapping_add(random.in_range(0..1000));
        }
        black_box(&memory);
    }
}

/// The clock of the capture times.
///
/// # Errors
/// When the kernel has none.
pub fn monotonic_ns() -> Result<u64> {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).context("the clock of the capture times")?;
    Ok(now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}
