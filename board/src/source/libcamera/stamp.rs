//! When a frame was captured.
//!
//! libcamera documents its sensor time stamps as CLOCK_BOOTTIME, but its
//! pipelines hand on what the kernel's video drivers say, which is
//! CLOCK_MONOTONIC. The two differ by the time that the computer was suspended,
//! so they are the same on a box that never is; where they are not, a stamp that
//! lies in CLOCK_MONOTONIC's future can only be of the other clock.

use std::time::{Duration, Instant};

use plumbline::packet::MarkedInstant;

/// All clocks, read together.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    pub monotonic_ns: u64,
    pub boottime_ns: u64,
    /// CLOCK_MONOTONIC as well, as the standard library has it.
    pub instant: Instant,
}

/// When a frame was captured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    pub capture_time_ns: u64,
    pub instant: MarkedInstant,
    pub ready_at: Instant,
}

impl Clocks {
    #[cfg(feature = "libcamera")]
    pub fn now() -> Self {
        use rustix::time::{ClockId, clock_gettime};
        let read_ns = |clock| {
            let time = clock_gettime(clock);
            // Neither clock is ever negative: both count from the boot.
            time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
        };
        Self {
            monotonic_ns: read_ns(ClockId::Monotonic),
            boottime_ns: read_ns(ClockId::Boottime),
            instant: Instant::now(),
        }
    }

    /// A frame's stamp: by the sensor when it has one, else by the driver, else
    /// now.
    pub fn stamp(&self, sensor_ns: Option<u64>, driver_ns: u64) -> Stamp {
        let by_sensor = sensor_ns.and_then(|time_ns| self.monotonic(time_ns));
        let (capture_time_ns, instant) = match by_sensor {
            Some(time_ns) => (time_ns, MarkedInstant::ExposureStart),
            None => {
                let arrival_ns = self.monotonic(driver_ns).unwrap_or(self.monotonic_ns);
                (arrival_ns, MarkedInstant::FrameArrival)
            }
        };
        let age = Duration::from_nanos(self.monotonic_ns - capture_time_ns);
        let ready_at = self.instant.checked_sub(age).unwrap_or(self.instant);
        Stamp { capture_time_ns, instant, ready_at }
    }

    /// A stamp of either clock on CLOCK_MONOTONIC; `None` for one that is not
    /// set, or that neither clock has reached.
    fn monotonic(&self, time_ns: u64) -> Option<u64> {
        let suspended_ns = self.boottime_ns.saturating_sub(self.monotonic_ns);
        let time_ns =
            if time_ns > self.monotonic_ns { time_ns.checked_sub(suspended_ns)? } else { time_ns };
        (1..=self.monotonic_ns).contains(&time_ns).then_some(time_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Up for 100 s, of which 0 or 30 s suspended.
    fn clocks(suspended_s: u64) -> Clocks {
        let monotonic_ns = (100 - suspended_s) * 1_000_000_000;
        // Far from the standard clock's start, wherever that is.
        let instant = Instant::now() + Duration::from_secs(1000);
        Clocks { monotonic_ns, boottime_ns: 100_000_000_000, instant }
    }

    #[test]
    fn the_sensors_stamp_comes_first_then_the_drivers_then_now() {
        let clocks = clocks(0);
        let stamp = |sensor_ns, driver_ns| {
            let stamp = clocks.stamp(sensor_ns, driver_ns);
            (stamp.capture_time_ns, stamp.instant, clocks.instant - stamp.ready_at)
        };
        let (sensor_ns, driver_ns) = (99_980_000_000, 99_990_000_000);
        let ms = Duration::from_millis;
        let by_sensor = (sensor_ns, MarkedInstant::ExposureStart, ms(20));
        let by_driver = (driver_ns, MarkedInstant::FrameArrival, ms(10));
        let by_us = (100_000_000_000, MarkedInstant::FrameArrival, ms(0));
        assert_eq!(stamp(Some(sensor_ns), driver_ns), by_sensor);
        assert_eq!(stamp(None, driver_ns), by_driver);
        assert_eq!(stamp(Some(0), driver_ns), by_driver);
        assert_eq!(stamp(None, 0), by_us);
        // In the future of both clocks.
        assert_eq!(stamp(Some(100_000_000_001), u64::MAX), by_us);
    }

    #[test]
    fn a_stamp_of_the_other_clock_is_moved() {
        let clocks = clocks(30);
        let expected_ns = 69_990_000_000;
        for sensor_ns in [69_990_000_000, 99_990_000_000] {
            let stamp = clocks.stamp(Some(sensor_ns), 0);
            assert_eq!(stamp.capture_time_ns, expected_ns);
            assert_eq!(stamp.instant, MarkedInstant::ExposureStart);
            assert_eq!(clocks.instant - stamp.ready_at, Duration::from_millis(10));
        }
    }
}
