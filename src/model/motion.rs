//! How a target moves from frame to frame.
//!
//! In: its pose at the instant of each measurement. Out: its pose at a later instant, and its
//! velocity at the last one.

use nalgebra::Vector6;

use crate::model::pose::{Cam, Pose, Target, vector_from_rotation};

/// A velocity is trusted for this long: two frames at 20 Hz. After a longer gap it says nothing
/// about where in its sway the body is.
const VELOCITY_NS_MAX: u64 = 100_000_000;

/// The largest acceleration of a standing person's trunk, recovery steps included: about half of
/// gravity.
const ACCELERATION_MM_PER_S2_MAX: f64 = 5_000.0;

/// How much of the last change of velocity is expected to happen again. All of it would follow a
/// steady acceleration exactly, and double the noise of the prediction; of a swaying body's, this
/// share leaves the smallest errors from 30 to 60 Hz.
const ACCELERATION_SHARE: f64 = 0.8;

/// Where a target was, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The pose when it was last measured.
    pub cam_from_target: Pose<Cam, Target>,
    /// When that was.
    pub time_ns: u64,
    /// Between the last two measurements, where they were not too far apart.
    velocity: Option<Velocity>,
}

/// A mean velocity, and how it changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Velocity {
    /// Increment of [`Pose::moved_by`] per second.
    per_s: Vector6<f64>,
    /// The time over which it is the mean.
    interval_s: f64,
    /// The change since the interval before, per second; zero where there was none.
    change_per_s2: Vector6<f64>,
}

impl Velocity {
    /// The increment expected over the time after the interval.
    fn increment(&self, gap_s: f64) -> Vector6<f64> {
        // The change says nothing about more than the next frame.
        let is_next = gap_s < 1.5 * self.interval_s;
        let between_middles_s = 0.5 * (self.interval_s + gap_s);
        let change = if is_next { ACCELERATION_SHARE * between_middles_s } else { 0.0 };
        (self.per_s + self.change_per_s2 * change) * gap_s
    }
}

impl Motion {
    /// Of a target measured for the first time.
    #[must_use]
    pub fn new(cam_from_target: Pose<Cam, Target>, time_ns: u64) -> Self {
        Self { cam_from_target, time_ns, velocity: None }
    }

    /// Time since the last measurement. Time that runs backwards (a recording that starts again)
    /// counts as a very long gap.
    pub(crate) fn gap_ns(&self, time_ns: u64) -> u64 {
        time_ns.checked_sub(self.time_ns).unwrap_or(u64::MAX)
    }

    /// The pose expected at a time: the last velocity and most of its last change for the next
    /// frame, after a missed one the velocity alone, for at most two frames at 20 Hz.
    #[must_use]
    pub fn predict(&self, time_ns: u64) -> Pose<Cam, Target> {
        let gap_s = self.gap_ns(time_ns).min(VELOCITY_NS_MAX) as f64 * 1e-9;
        match &self.velocity {
            Some(velocity) => self.cam_from_target.moved_by(&velocity.increment(gap_s)),
            None => self.cam_from_target,
        }
    }

    /// The velocity at the last measurement, as increments of [`Pose::moved_by`] per second; zero
    /// where it is not known. Exact for a steady acceleration.
    #[must_use]
    pub fn velocity_per_s(&self) -> Vector6<f64> {
        self.velocity.map_or(Vector6::zeros(), |velocity| {
            velocity.per_s + velocity.change_per_s2 * (0.5 * velocity.interval_s)
        })
    }

    /// True while a corner near its predicted place can only be that corner: a part of
    /// the target is then enough. The nearest corner of the same colours lies one square
    /// across and one down, 1.41 pitches away, and the prediction must be good to half of
    /// that; the error of a constant velocity grows as a t^2 / 2. At a pitch of 12 mm the
    /// frames may be 58 ms apart: 20 Hz, but not 15.
    #[must_use]
    pub(crate) fn identifies_corners(&self, time_ns: u64, pitch_mm: f64) -> bool {
        let gap_s = self.gap_ns(time_ns) as f64 * 1e-9;
        ACCELERATION_MM_PER_S2_MAX * gap_s * gap_s < core::f64::consts::SQRT_2 * pitch_mm
    }

    /// The motion after a new measurement.
    #[must_use]
    pub fn continued(&self, cam_from_target: Pose<Cam, Target>, time_ns: u64) -> Self {
        let gap_ns = self.gap_ns(time_ns);
        let velocity = (gap_ns > 0 && gap_ns <= VELOCITY_NS_MAX).then(|| {
            let turn_rad = vector_from_rotation(
                &(self.cam_from_target.rotation.transpose() * cam_from_target.rotation),
            );
            let moved_mm = cam_from_target.translation_mm - self.cam_from_target.translation_mm;
            let interval_s = gap_ns as f64 * 1e-9;
            let per_s = Vector6::from_iterator(turn_rad.iter().chain(moved_mm.iter()).copied())
                / interval_s;
            let change_per_s2 = self.velocity.map_or(Vector6::zeros(), |before| {
                (per_s - before.per_s) / (0.5 * (before.interval_s + interval_s))
            });
            Velocity { per_s, interval_s, change_per_s2 }
        });
        Self { cam_from_target, time_ns, velocity }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: u64 = 16_666_667;

    fn pose(x_mm: f64) -> Pose<Cam, Target> {
        Pose::from_theta([0.01, -0.02, 0.03, x_mm, 5.0, 1000.0])
    }

    fn motion(time_ns: u64) -> Motion {
        Motion::new(pose(0.0), time_ns)
    }

    #[test]
    fn a_steady_motion_is_predicted() {
        let moving = motion(0).continued(pose(0.5), FRAME_NS);
        let expected = moving.predict(2 * FRAME_NS);
        assert!((expected.translation_mm.x - 1.0).abs() < 1e-9);
        // And no further than the velocity is trusted.
        let far = moving.predict(FRAME_NS + 10 * VELOCITY_NS_MAX);
        assert!((far.translation_mm.x - 3.5).abs() < 1e-6);
    }

    #[test]
    fn an_acceleration_is_followed_by_its_share() {
        // x = t^2 / 2 in frames: 0, 0.5, 2, and then 4.5.
        let moving = motion(0).continued(pose(0.5), FRAME_NS).continued(pose(2.0), 2 * FRAME_NS);
        let next = moving.predict(3 * FRAME_NS).translation_mm.x;
        assert!((next - (3.5 + ACCELERATION_SHARE)).abs() < 1e-6, "{next}");
        // Also when the frames are not evenly spaced: it is 8 at 4 frames, 18 at 6.
        let later = moving.continued(pose(8.0), 4 * FRAME_NS);
        let next = later.predict(6 * FRAME_NS).translation_mm.x;
        assert!((next - (14.0 + 4.0 * ACCELERATION_SHARE)).abs() < 1e-6, "{next}");
        // After a missed frame only the velocity counts: 1.5 a frame.
        let after_gap = moving.predict(4 * FRAME_NS).translation_mm.x;
        assert!((after_gap - 5.0).abs() < 1e-6, "{after_gap}");
    }

    #[test]
    fn a_gap_or_a_standstill_of_time_leaves_no_velocity() {
        let long = motion(0).continued(pose(9.0), VELOCITY_NS_MAX + 1);
        assert_eq!(long.velocity, None);
        let none = motion(7).continued(pose(9.0), 7);
        assert_eq!(none.velocity, None);
    }

    #[test]
    fn corners_are_identified_for_about_three_frames() {
        // 5 m/s^2 moves 12 mm / sqrt(2) in 58.3 ms.
        let last = motion(0);
        assert!(last.identifies_corners(58_000_000, 12.0));
        assert!(!last.identifies_corners(59_000_000, 12.0));
    }

    #[test]
    fn the_velocity_is_that_of_the_last_instant() {
        // x = t^2 / 2 in frames: 0, 0.5, 2, with a velocity of 0, 1, 2 a frame.
        let first = motion(0);
        assert_eq!(first.velocity_per_s(), Vector6::zeros());
        let steady = first.continued(pose(0.5), FRAME_NS);
        let per_frame = |motion: &Motion| motion.velocity_per_s()[3] * FRAME_NS as f64 * 1e-9;
        assert!((per_frame(&steady) - 0.5).abs() < 1e-9);
        let moving = steady.continued(pose(2.0), 2 * FRAME_NS);
        assert!((per_frame(&moving) - 2.0).abs() < 1e-9);
    }
}
