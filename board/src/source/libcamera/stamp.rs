//! When a frame was captured.
//!
//! The sensor's time stamp is taken when the CSI receiver sees the first row: it is then read, and
//! its exposure has just ended. libcamera's own description (the time at which the first row is
//! exposed) leaves that open; the Raspberry Pi's pipelines do it in this way.
//!
//! libcamera documents its sensor time stamps as CLOCK_BOOTTIME, but its
//! pipelines pass on the stamps of the kernel's video drivers, which are of
//! CLOCK_MONOTONIC. The two differ by the time for which the computer was
//! suspended, so they are the same on a box that never is. Where they differ, a
//! stamp in the future of CLOCK_MONOTONIC can only be of the other clock.

use plumbline::packet::MarkedInstant;

use super::super::stamp::{Now, Stamp};

/// All clocks, read together.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    pub now: Now,
    pub boottime_ns: u64,
}

impl Clocks {
    #[cfg(feature = "libcamera")]
    pub fn read() -> Self {
        Self { now: Now::read(), boottime_ns: crate::machine::clock::boottime_ns() }
    }

    /// A frame's stamp: the sensor's if there is one, else the driver's, else now.
    pub fn stamp(&self, sensor_ns: Option<u64>, driver_ns: u64) -> Stamp {
        let at = |time_ns, instant| Stamp::at(self.monotonic(time_ns)?, instant, self.now);
        sensor_ns
            .and_then(|time_ns| at(time_ns, MarkedInstant::ExposureEnd))
            .or_else(|| at(driver_ns, MarkedInstant::FrameArrival))
            .unwrap_or_else(|| Stamp::arrival(self.now))
    }

    /// A stamp of either clock on CLOCK_MONOTONIC.
    fn monotonic(&self, time_ns: u64) -> Option<u64> {
        let suspended_ns = self.boottime_ns.saturating_sub(self.now.monotonic_ns);
        if time_ns > self.now.monotonic_ns {
            time_ns.checked_sub(suspended_ns)
        } else {
            Some(time_ns)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    /// Up for 100 s, of which 0 or 30 s suspended.
    fn clocks(suspended_s: u64) -> Clocks {
        let monotonic_ns = (100 - suspended_s) * 1_000_000_000;
        // Far from the standard clock's start, wherever that is.
        let instant = Instant::now() + Duration::from_secs(1000);
        Clocks { now: Now { monotonic_ns, instant }, boottime_ns: 100_000_000_000 }
    }

    #[test]
    fn the_sensors_stamp_comes_first_then_the_drivers_then_now() {
        let clocks = clocks(0);
        let stamp = |sensor_ns, driver_ns| {
            let stamp = clocks.stamp(sensor_ns, driver_ns);
            (stamp.capture_time_ns, stamp.instant, clocks.now.instant - stamp.ready_at)
        };
        let (sensor_ns, driver_ns) = (99_980_000_000, 99_990_000_000);
        let ms = Duration::from_millis;
        let by_sensor = (sensor_ns, MarkedInstant::ExposureEnd, ms(20));
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
            assert_eq!(stamp.instant, MarkedInstant::ExposureEnd);
            assert_eq!(clocks.now.instant - stamp.ready_at, Duration::from_millis(10));
        }
    }
}
