//! When a frame was captured, and which frames never came.
//!
//! A driver says with its stamps what they mark. Start of exposure is taken at
//! its word. Its "end of frame" is the reception of the last pixel (the kernel
//! takes it in software a little after that): exposure, read-out and transport
//! lie before it, so that it is a [`MarkedInstant::FrameArrival`] and not the
//! end of the exposure. Stamps of another clock than CLOCK_MONOTONIC, from the
//! future, or older than a frame can lie in a queue cannot be compared with
//! this machine's time: the instant at which the frame was taken off the queue
//! stands in for them.

use std::time::{Duration, Instant};

use plumbline::packet::MarkedInstant;
use v4l::v4l_sys::{
    V4L2_BUF_FLAG_TIMESTAMP_MASK, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, V4L2_BUF_FLAG_TSTAMP_SRC_MASK,
    V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
};

/// No frame waits longer: at 1 Hz, the slowest rate, this is more than all
/// buffers of a queue. Clocks that are not ours are off by more.
const AGE_MAX: Duration = Duration::from_secs(40);

/// The capture time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// CLOCK_MONOTONIC.
    pub capture_time_ns: u64,
    /// What it marks.
    pub instant: MarkedInstant,
    /// The same instant on this program's clock.
    pub ready_at: Instant,
}

/// One instant on both clocks.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// CLOCK_MONOTONIC.
    pub monotonic_ns: u64,
    /// This program's clock.
    pub instant: Instant,
}

impl Stamp {
    /// From the driver's stamp and the flags of its buffer.
    pub fn new(flags: u32, seconds: i64, microseconds: i64, now: Now) -> Self {
        let monotonic = flags & V4L2_BUF_FLAG_TIMESTAMP_MASK == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        let capture =
            nanoseconds(seconds, microseconds).filter(|_| monotonic).and_then(|stamp_ns| {
                let age = Duration::from_nanos(now.monotonic_ns.checked_sub(stamp_ns)?);
                let ready_at = now.instant.checked_sub(age)?;
                (age <= AGE_MAX).then_some((stamp_ns, ready_at))
            });
        let Some((capture_time_ns, ready_at)) = capture else {
            return Self {
                capture_time_ns: now.monotonic_ns,
                instant: MarkedInstant::FrameArrival,
                ready_at: now.instant,
            };
        };
        let instant = match flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK {
            V4L2_BUF_FLAG_TSTAMP_SRC_SOE => MarkedInstant::ExposureStart,
            _ => MarkedInstant::FrameArrival,
        };
        Self { capture_time_ns, instant, ready_at }
    }
}

fn nanoseconds(seconds: i64, microseconds: i64) -> Option<u64> {
    let microseconds = u64::try_from(microseconds).ok()?;
    let whole_us = u64::try_from(seconds).ok()?.checked_mul(1_000_000)?;
    whole_us.checked_add(microseconds)?.checked_mul(1000)
}

/// Follows the driver's frame numbers.
#[derive(Debug, Default)]
pub struct Sequence {
    last: Option<u32>,
}

impl Sequence {
    /// How many frames are missing before this one.
    ///
    /// The first number may be any. Numbers wrap; one that stands still or goes
    /// back is a driver that does not count, or that starts anew.
    pub fn missed_before(&mut self, number: u32) -> u64 {
        let step = self.last.map_or(1, |last| number.wrapping_sub(last));
        self.last = Some(number);
        match step {
            1..=0x7fff_ffff => u64::from(step - 1),
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use v4l::v4l_sys::V4L2_BUF_FLAG_TIMESTAMP_COPY;

    use super::*;

    const NOW_NS: u64 = 100_000_000_000;

    fn now() -> Now {
        // Far enough from the machine's start that every age below fits.
        Now { monotonic_ns: NOW_NS, instant: Instant::now() + Duration::from_secs(1000) }
    }

    #[test]
    fn a_monotonic_stamp_is_used_as_it_is() {
        let now = now();
        let stamp = Stamp::new(V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, 99, 990_000, now);
        let expected = Stamp {
            capture_time_ns: 99_990_000_000,
            instant: MarkedInstant::FrameArrival,
            ready_at: now.instant - Duration::from_millis(10),
        };
        assert_eq!(stamp, expected);
        let exposure = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        let stamp = Stamp::new(exposure, 99, 990_000, now);
        assert_eq!(stamp, Stamp { instant: MarkedInstant::ExposureStart, ..expected });
    }

    #[test]
    fn a_stamp_that_cannot_be_compared_gives_way_to_the_arrival() {
        let now = now();
        let arrival = Stamp {
            capture_time_ns: NOW_NS,
            instant: MarkedInstant::FrameArrival,
            ready_at: now.instant,
        };
        let exposure = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        let cases = [
            ("of an unknown clock", V4L2_BUF_FLAG_TSTAMP_SRC_SOE, 99, 0),
            ("copied", V4L2_BUF_FLAG_TIMESTAMP_COPY | V4L2_BUF_FLAG_TSTAMP_SRC_SOE, 99, 0),
            ("from the future", exposure, 100, 1),
            ("too old", exposure, 59, 999_999),
            ("never set", exposure, 0, 0),
            ("negative", exposure, -1, 0),
            ("negative below a second", exposure, 99, -1),
            ("beyond all bounds", exposure, i64::MAX, i64::MAX),
            ("beyond the nanoseconds", exposure, i64::MAX / 1_000_000, 0),
        ];
        for (what, flags, seconds, microseconds) in cases {
            assert_eq!(Stamp::new(flags, seconds, microseconds, now), arrival, "{what}");
        }
        // The oldest and the youngest that are believed.
        for (seconds, microseconds) in [(60, 0), (100, 0)] {
            let stamp = Stamp::new(exposure, seconds, microseconds, now);
            assert_eq!(stamp.instant, MarkedInstant::ExposureStart, "{seconds}");
        }
    }

    #[test]
    fn gaps_in_the_numbers_are_missed_frames() {
        let cases: [(&[u32], u64); 8] = [
            (&[0, 1, 2, 3], 0),
            (&[7, 8], 0),
            (&[0, 2], 1),
            (&[5, 6, 10, 11, 13], 4),
            (&[u32::MAX - 1, u32::MAX, 0, 1], 0),
            (&[u32::MAX - 1, 1], 2),
            (&[0, 0, 0], 0),
            (&[9, 3, 4, 6], 1),
        ];
        for (numbers, expected) in cases {
            let mut sequence = Sequence::default();
            let missed: u64 = numbers.iter().map(|&number| sequence.missed_before(number)).sum();
            assert_eq!(missed, expected, "{numbers:?}");
        }
    }
}
