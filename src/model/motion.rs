//! How a target moves from frame to frame.
//!
//! In: its pose at the instant of each measurement. Out: its pose at a later instant, and its
//! velocity at the last one.

use nalgebra::Vector6;

use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::TargetGeometry;

/// A velocity is trusted for this long: two frames at 20 Hz. After a longer gap it says nothing
/// about where in its sway the body is.
const VELOCITY_NS_MAX: u64 = 100_000_000;

/// The largest acceleration of a standing person's trunk, recovery steps included: about half of
/// gravity.
const ACCELERATION_MM_PER_S2_MAX: f64 = 5_000.0;

/// The speed that this acceleration reaches in a tenth of a second; a stumble lasts no longer.
const SPEED_MM_PER_S_MAX: f64 = 500.0;

/// A velocity that has changed faster than the largest acceleration, by more than noise and the
/// means over two intervals explain, is not that of a person: someone moved the target or the
/// camera, and it will not go on like that.
const CHANGE_MM_PER_S2_MAX: f64 = 1.25 * ACCELERATION_MM_PER_S2_MAX;

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
    /// The change since the interval before, per second, where there was one.
    change_per_s2: Option<Vector6<f64>>,
}

impl Velocity {
    /// The increment expected over the time after the interval.
    fn increment(&self, gap_s: f64) -> Vector6<f64> {
        // The change says nothing about more than the next frame.
        let is_next = gap_s < 1.5 * self.interval_s;
        let between_middles_s = 0.5 * (self.interval_s + gap_s);
        let change = if is_next { ACCELERATION_SHARE * between_middles_s } else { 0.0 };
        (self.per_s + self.change_per_s2.unwrap_or_default() * change) * gap_s
    }

    /// Judged across the line of sight: along it the noise is far larger.
    fn is_of_a_person(&self) -> bool {
        self.change_per_s2
            .is_none_or(|change| change.fixed_rows::<2>(3).norm() < CHANGE_MM_PER_S2_MAX)
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

    /// The velocity at the last measurement, as increments of [`Pose::moved_by`] per second; `None`
    /// where it is not known. Exact for a steady acceleration, if there were three measurements.
    #[must_use]
    pub fn velocity_per_s(&self) -> Option<Vector6<f64>> {
        let velocity = self.velocity.as_ref()?;
        let change = velocity.change_per_s2.unwrap_or_default();
        Some(velocity.per_s + change * (0.5 * velocity.interval_s))
    }

    /// How long ago the target had the velocity that is known: two measurements tell it for the
    /// middle of the time between them, three for the last one. `None` where it is not known.
    #[must_use]
    pub(crate) fn velocity_age_s(&self) -> Option<f64> {
        let velocity = self.velocity.as_ref()?;
        let is_latest = velocity.change_per_s2.is_some();
        Some(if is_latest { 0.0 } else { 0.5 * velocity.interval_s })
    }

    /// True when a pose found at a time can only be the target's own: a part of the target is then
    /// enough. A grid that is shifted by a square across and one down has the same colours, and lies
    /// 1.41 pitches away, so that both the prediction and the pose must be good to half of that. The
    /// error of a known velocity grows as a t^2 / 2: at a pitch of 12 mm the frames may be 58 ms
    /// apart, 20 Hz, but not 15. Where none is known, it is 16 ms, 60 Hz.
    #[must_use]
    pub(crate) fn identifies_corners(
        &self,
        time_ns: u64,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
    ) -> bool {
        let gap_s = self.gap_ns(time_ns) as f64 * 1e-9;
        let strayed_mm = match self.velocity {
            Some(_) => 0.5 * ACCELERATION_MM_PER_S2_MAX * gap_s * gap_s,
            None => SPEED_MM_PER_S_MAX * gap_s,
        };
        let middle_mm = target.middle_mm();
        let found_mm = cam_from_target.transform(&middle_mm);
        let off_mm = self.predict(time_ns).inverse().transform(&found_mm) - middle_mm;
        let half_way_mm = core::f64::consts::FRAC_1_SQRT_2 * target.pitch_mm();
        strayed_mm < half_way_mm && off_mm.xy().norm() < half_way_mm
    }

    /// The motion after a new measurement.
    #[must_use]
    pub fn continued(&self, cam_from_target: Pose<Cam, Target>, time_ns: u64) -> Self {
        let gap_ns = self.gap_ns(time_ns);
        let velocity = (gap_ns > 0 && gap_ns <= VELOCITY_NS_MAX).then(|| {
            let interval_s = gap_ns as f64 * 1e-9;
            let per_s = self.cam_from_target.increment_to(&cam_from_target) / interval_s;
            let change_per_s2 = self
                .velocity
                .map(|before| (per_s - before.per_s) / (0.5 * (before.interval_s + interval_s)));
            Velocity { per_s, interval_s, change_per_s2 }
        });
        let velocity = velocity.filter(Velocity::is_of_a_person);
        Self { cam_from_target, time_ns, velocity }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::target::{Origin, Role};

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
    fn three_measurements_tell_a_velocity_two_a_former_one() {
        let first = motion(0);
        assert_eq!((first.velocity_per_s(), first.velocity_age_s()), (None, None));
        // x = t^2 / 2 in frames: 0, 0.5, 2; after the first, 0.5 a frame was the velocity half a frame
        // before.
        let second = first.continued(pose(0.5), FRAME_NS);
        let third = second.continued(pose(2.0), 2 * FRAME_NS);
        let frame_s = FRAME_NS as f64 * 1e-9;
        for (motion, per_frame, age_frames) in [(&second, 0.5, 0.5), (&third, 2.0, 0.0)] {
            let per_s = motion.velocity_per_s().unwrap();
            assert!((per_s[3] * frame_s - per_frame).abs() < 1e-9, "{per_s}");
            assert_eq!(motion.velocity_age_s(), Some(age_frames * frame_s));
        }
    }

    #[test]
    fn a_gap_or_a_standstill_of_time_leaves_no_velocity() {
        let long = motion(0).continued(pose(9.0), VELOCITY_NS_MAX + 1);
        assert_eq!(long.velocity, None);
        let none = motion(7).continued(pose(9.0), 7);
        assert_eq!(none.velocity, None);
    }

    #[test]
    fn corners_are_identified_for_about_three_frames_and_half_a_diagonal() {
        let target =
            TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0; 3]).unwrap();
        let first = motion(0);
        let still = first.continued(pose(0.0), FRAME_NS);
        let identifies = |motion: &Motion, after_ns, x_mm| {
            motion.identifies_corners(motion.time_ns + after_ns, &target, &pose(x_mm))
        };
        // 5 m/s^2 moves 12 mm / sqrt(2) in 58.3 ms.
        assert!(identifies(&still, 58_000_000, 0.0));
        assert!(!identifies(&still, 59_000_000, 0.0));
        // 0.5 m/s does in 17.0 ms.
        assert!(identifies(&first, 16_900_000, 0.0));
        assert!(!identifies(&first, 17_100_000, 0.0));
        // It is 8.485 mm, which a yaw of 0.02 rad does not shorten visibly.
        assert!(identifies(&still, FRAME_NS, -8.4) && identifies(&still, FRAME_NS, 8.4));
        assert!(!identifies(&still, FRAME_NS, -8.6) && !identifies(&still, FRAME_NS, 8.6));
    }

    #[test]
    fn a_jump_is_no_velocity() {
        let still = motion(0).continued(pose(0.0), FRAME_NS);
        // 1.25 times 5 m/s^2 from one frame to the next is 1.736 mm.
        assert!(still.continued(pose(1.7), 2 * FRAME_NS).velocity.is_some());
        assert_eq!(still.continued(pose(1.8), 2 * FRAME_NS).velocity, None);
    }

    /// Of a target whose origin is its first corner, 30 mm and 24 mm from its middle.
    #[test]
    fn the_middle_must_be_where_it_is_predicted() {
        let origin = Origin::FirstCorner;
        let target = TargetGeometry::checker(6, 5, 12.0, origin, Role::Lower, [0.0; 3]).unwrap();
        let still = motion(0).continued(pose(0.0), FRAME_NS);
        let identifies =
            |found: &Pose<Cam, Target>| still.identifies_corners(2 * FRAME_NS, &target, found);
        assert!(identifies(&pose(-8.4)) && identifies(&pose(8.4)));
        assert!(!identifies(&pose(-8.6)) && !identifies(&pose(8.6)));
        // A turn about the origin moves the middle, which is 38.4 mm away: by 8.485 mm at 0.2213 rad.
        let turned =
            |angle_rad: f64| pose(0.0).moved_by(&Vector6::new(0.0, 0.0, angle_rad, 0.0, 0.0, 0.0));
        assert!(identifies(&turned(0.22)) && identifies(&turned(-0.22)));
        assert!(!identifies(&turned(0.223)) && !identifies(&turned(-0.223)));
    }
}
