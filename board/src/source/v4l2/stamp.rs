//! When a frame was captured, according to its driver.
//!
//! A driver declares what its time stamps mark. "Start of exposure" is used as it
//! is. "End of frame" is the reception of the last pixel (the kernel reads the
//! clock in software a little later): exposure, readout and transport lie before
//! it, so it is a [`MarkedInstant::FrameArrival`] and not the end of the exposure.
//! Stamps of another clock than CLOCK_MONOTONIC cannot be compared with this
//! machine's time: they are replaced by the instant at which the frame was taken
//! off the queue.

use plumbline::packet::MarkedInstant;
use v4l::v4l_sys::{
    V4L2_BUF_FLAG_TIMESTAMP_MASK, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, V4L2_BUF_FLAG_TSTAMP_SRC_MASK,
    V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
};

use super::super::stamp::{Now, Stamp};

/// The stamp of a frame, from the driver's time and the flags of its buffer.
pub fn stamp(flags: u32, seconds: i64, microseconds: i64, now: Now) -> Stamp {
    let monotonic = flags & V4L2_BUF_FLAG_TIMESTAMP_MASK == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    let instant = match flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK {
        V4L2_BUF_FLAG_TSTAMP_SRC_SOE => MarkedInstant::ExposureStart,
        _ => MarkedInstant::FrameArrival,
    };
    nanoseconds(seconds, microseconds)
        .filter(|_| monotonic)
        .and_then(|stamp_ns| Stamp::at(stamp_ns, instant, now))
        .unwrap_or_else(|| Stamp::arrival(now))
}

fn nanoseconds(seconds: i64, microseconds: i64) -> Option<u64> {
    let microseconds = u64::try_from(microseconds).ok()?;
    let whole_us = u64::try_from(seconds).ok()?.checked_mul(1_000_000)?;
    whole_us.checked_add(microseconds)?.checked_mul(1000)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

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
        let found = stamp(V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, 99, 990_000, now);
        let expected = Stamp {
            capture_time_ns: 99_990_000_000,
            instant: MarkedInstant::FrameArrival,
            ready_at: now.instant - Duration::from_millis(10),
        };
        assert_eq!(found, expected);
        let exposure = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        let found = stamp(exposure, 99, 990_000, now);
        assert_eq!(found, Stamp { instant: MarkedInstant::ExposureStart, ..expected });
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
            assert_eq!(stamp(flags, seconds, microseconds, now), arrival, "{what}");
        }
        // The oldest and the youngest that are believed.
        for (seconds, microseconds) in [(60, 0), (100, 0)] {
            let found = stamp(exposure, seconds, microseconds, now);
            assert_eq!(found.instant, MarkedInstant::ExposureStart, "{seconds}");
        }
    }
}
