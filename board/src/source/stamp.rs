//! When a frame was captured, and which frames never arrived: what all cameras have
//! in common.

use std::time::{Duration, Instant};

use plumbline::packet::MarkedInstant;

use crate::machine::clock;

/// The greatest age of a frame: at 1 Hz, the slowest rate, this is more than all
/// buffers of a queue. Other clocks differ by more.
const AGE_MAX: Duration = Duration::from_secs(40);

/// One instant on both of this computer's clocks.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// CLOCK_MONOTONIC, which cameras use.
    pub monotonic_ns: u64,
    /// The same clock in the standard library's type, which has no absolute value.
    pub instant: Instant,
}

impl Now {
    /// Reads both, one after the other.
    #[must_use]
    pub fn read() -> Self {
        Self { monotonic_ns: clock::monotonic_ns(), instant: Instant::now() }
    }
}

/// The capture time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// CLOCK_MONOTONIC.
    pub capture_time_ns: u64,
    /// Which instant of the frame it marks.
    pub instant: MarkedInstant,
    /// The same instant on this program's clock.
    pub ready_at: Instant,
}

impl Stamp {
    /// A time of CLOCK_MONOTONIC that marks `instant`; `None` when it lies in the
    /// future, or further back than a frame can have waited.
    #[must_use]
    pub fn at(capture_time_ns: u64, instant: MarkedInstant, now: Now) -> Option<Self> {
        let age = Duration::from_nanos(now.monotonic_ns.checked_sub(capture_time_ns)?);
        let ready_at = now.instant.checked_sub(age)?;
        (age <= AGE_MAX).then_some(Self { capture_time_ns, instant, ready_at })
    }

    /// The stamp of a frame without a usable time: its arrival, now.
    #[must_use]
    pub fn arrival(now: Now) -> Self {
        Self {
            capture_time_ns: now.monotonic_ns,
            instant: MarkedInstant::FrameArrival,
            ready_at: now.instant,
        }
    }
}

/// From the instant that a stamp marks to the middle of the exposure of the row that is read first;
/// `None` where that is not known.
///
/// `readout_ns` is the configuration's. The driver sees the last pixel when the last row has been
/// read, which began when its exposure ended; how long a camera with a global shutter takes to send
/// its frame is not known.
#[must_use]
pub fn to_mid_exposure_ns(
    instant: MarkedInstant,
    exposure_us: Option<u32>,
    readout_ns: i32,
) -> Option<i64> {
    let half_ns = i64::from(exposure_us?) * 500;
    match instant {
        MarkedInstant::ExposureStart => Some(half_ns),
        MarkedInstant::ExposureEnd => Some(-half_ns),
        MarkedInstant::FrameArrival if readout_ns != 0 => {
            Some(-half_ns - i64::from(readout_ns.unsigned_abs()))
        }
        MarkedInstant::FrameArrival | MarkedInstant::ExposureMiddle | MarkedInstant::Recording => {
            None
        }
    }
}

/// Finds gaps in a camera's frame numbers.
#[derive(Debug, Default)]
pub struct Sequence {
    last: Option<u32>,
}

impl Sequence {
    /// The number of frames that are missing before this one.
    ///
    /// The first number may be any: a sensor discards frames while it starts.
    /// Numbers wrap around; one that repeats or decreases is from a camera that does
    /// not count, or that has restarted.
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
    use super::*;

    #[test]
    fn a_time_that_cannot_be_is_none() {
        // Far enough from the machine's start that every age below fits.
        let instant = Instant::now() + Duration::from_secs(1000);
        let now = Now { monotonic_ns: 100_000_000_000, instant };
        let at = |time_ns| Stamp::at(time_ns, MarkedInstant::ExposureStart, now);
        let stamp = at(99_990_000_000).unwrap();
        assert_eq!(stamp.ready_at, instant - Duration::from_millis(10));
        // The oldest and the youngest that are believed, and their neighbours.
        assert!(at(60_000_000_000).is_some() && at(59_999_999_999).is_none());
        assert!(at(100_000_000_000).is_some() && at(100_000_000_001).is_none());
        assert!(at(0).is_none() && at(u64::MAX).is_none());
    }

    #[test]
    fn every_stamp_leads_to_the_middle_of_the_first_rows_exposure() {
        use MarkedInstant::*;
        // 4 ms of exposure, rows read in 16 ms: from the top, from the bottom, or all at once.
        for (instant, readout_ns, shift_ns) in [
            (ExposureStart, 16_000_000, Some(2_000_000)),
            (ExposureStart, 0, Some(2_000_000)),
            (ExposureEnd, -16_000_000, Some(-2_000_000)),
            (FrameArrival, 16_000_000, Some(-18_000_000)),
            (FrameArrival, -16_000_000, Some(-18_000_000)),
            (FrameArrival, 0, None),
            (ExposureMiddle, 16_000_000, None),
            (Recording, 16_000_000, None),
        ] {
            assert_eq!(to_mid_exposure_ns(instant, Some(4_000), readout_ns), shift_ns);
            assert_eq!(to_mid_exposure_ns(instant, None, readout_ns), None);
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
