//! What is measured, the result, and why there may be none.

use core::array;

use nalgebra::{Matrix6, Vector3};

use crate::fit::edge::Appearance;
use crate::fit::nodes::Drift;
use crate::model::image::GreyImage;
use crate::model::lens_table::LensTable;
use crate::model::motion::Motion;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::shutter::Shutter;
use crate::model::target::TargetGeometry;

/// Fewest corners of a pose: six points give twelve equations for six unknowns.
pub(super) const CORNERS_MIN: usize = 6;

/// How a standing person's trunk moves, one standard deviation of each component of an increment
/// of [`Pose::moved_by`] per second: along each axis 12 mm/s, the speed of a brisk sway, and about
/// each as a body does that sways so about its ankles, a metre below.
const VELOCITY_SD_PER_S: [f64; 6] = [0.012, 0.012, 0.012, 12.0, 12.0, 12.0];

/// The standard deviation of its acceleration, over that of its velocity: a brisk sway goes to and fro
/// once a second.
const SWAY_RAD_PER_S: f64 = core::f64::consts::TAU;

/// A target's pose in one frame, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// The pose when the middle of the target's grid was exposed.
    pub cam_from_target: Pose<Cam, Target>,
    /// How much later than the frame's time that was; 0 with a global shutter.
    pub delay_ns: u32,
    /// Covariance of `[omega_rad, delta_mm]`, the increments of [`Pose::moved_by`]: what the pixels'
    /// noise leaves uncertain and, with a rolling shutter, a velocity that is not known yet: in the
    /// first two frames.
    pub covariance: Matrix6<f64>,
    /// The reprojection error: root mean square distance, in raw pixels, between the corners used,
    /// as given by the edges that meet there, and where the pose puts them.
    pub rms_px: f64,
    /// Corners used: those of which at least three of the four edges were used.
    pub corners: u8,
    /// Corners of the target. If fewer are used, a part of it is hidden.
    pub corners_total: u8,
}

impl Measurement {
    /// When the middle of the target's grid was exposed, in a frame of this time.
    #[must_use]
    pub fn own_time_ns(&self, frame_time_ns: u64) -> u64 {
        frame_time_ns.saturating_add(self.delay_ns.into())
    }

    /// Standard deviations of x, y, z of the target's origin in the camera frame.
    #[must_use]
    pub fn sd_mm(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| libm::sqrt(self.covariance[(3 + axis, 3 + axis)]))
    }
}

/// A measurement that was accepted, and what the next one can use.
#[derive(Debug, Clone, Copy)]
pub struct Fitted {
    /// The pose and its quality.
    pub measurement: Measurement,
    /// How the camera shows the target.
    pub appearance: Appearance,
    /// Bit i is set when corner i of the target was used.
    pub used: u128,
}

/// What is measured: a target of known colours in a picture through a lens.
pub struct View<'a, P> {
    /// The picture.
    pub image: &'a GreyImage<'a, P>,
    /// The camera.
    pub lens: &'a LensTable,
    /// The target.
    pub target: &'a TargetGeometry,
    /// Whether the square up and left of corner 0 is dark, see
    /// [`Grid`](crate::find::grid::Grid).
    pub first_square_dark: bool,
    /// How the rows were read, one after the other; `None` for a global shutter, and where the
    /// target is known to stand still.
    pub rolling: Option<Rolling<'a>>,
}

/// A frame that was read row by row, and what is known of the target's motion.
#[derive(Debug, Clone, Copy)]
pub struct Rolling<'a> {
    /// When each row was exposed.
    pub shutter: Shutter,
    /// The frame's time: when the first row was.
    pub time_ns: u64,
    /// The motion up to the frame before; without it, the target is taken to stand still.
    pub motion: Option<&'a Motion>,
}

/// How much later than the frame's time a target at a pose is exposed: its middle. 0 where that is
/// not in the picture.
pub fn delay_ns(
    shutter: &Shutter,
    lens: &LensTable,
    target: &TargetGeometry,
    cam_from_target: &Pose<Cam, Target>,
) -> u32 {
    middle_row_px(lens, target, cam_from_target).map_or(0, |row_px| shutter.delay_ns(row_px))
}

impl Rolling<'_> {
    /// How the target moves while its rows are read, if it has reached this pose.
    ///
    /// The velocity follows from the pose itself and those before it: one that was predicted from
    /// those before alone would be as late as they are.
    pub(super) fn drift(
        &self,
        lens: &LensTable,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Option<Drift> {
        let middle_row_px = middle_row_px(lens, target, cam_from_target)?;
        let motion = self.continued(cam_from_target, middle_row_px);
        let velocity_per_s = motion.and_then(|motion| motion.velocity_per_s());
        let per_row = velocity_per_s.unwrap_or_default() * self.shutter.row_s();
        Some(Drift { per_row, middle_row_px })
    }

    /// The motion of a target that has reached this pose.
    fn continued(&self, cam_from_target: &Pose<Cam, Target>, middle_row_px: f64) -> Option<Motion> {
        let time_ns = self.time_ns.saturating_add(self.shutter.delay_ns(middle_row_px).into());
        Some(self.motion?.continued(*cam_from_target, time_ns))
    }

    /// Where the velocity of a target at this pose is not known, or only an earlier one: six drifts, in
    /// each of which one component differs from what is known by one standard deviation.
    fn unknown_drifts(
        &self,
        lens: &LensTable,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Option<[Drift; 6]> {
        let known = self.drift(lens, target, cam_from_target)?;
        let motion = self.continued(cam_from_target, known.middle_row_px);
        let age_s = motion.and_then(|motion| motion.velocity_age_s());
        let missing = age_s.map_or(1.0, |age_s| (SWAY_RAD_PER_S * age_s).min(1.0));
        (missing > 0.0).then(|| {
            let missing_s = missing * self.shutter.row_s();
            array::from_fn(|component| {
                let mut drift = known;
                drift.per_row[component] += VELOCITY_SD_PER_S[component] * missing_s;
                drift
            })
        })
    }
}

fn middle_row_px(
    lens: &LensTable,
    target: &TargetGeometry,
    cam_from_target: &Pose<Cam, Target>,
) -> Option<f64> {
    Some(lens.project(&cam_from_target.transform(&target.middle_mm()))?.y)
}

impl<P> View<'_, P> {
    /// How the target moves while its rows are read; `None` for a global shutter.
    pub(super) fn drift(&self, cam_from_target: &Pose<Cam, Target>) -> Option<Drift> {
        self.rolling.and_then(|rolling| rolling.drift(self.lens, self.target, cam_from_target))
    }

    /// The drifts that a target may have instead of the known one, which differ from it independently
    /// of each other; `None` where its velocity is known, and for a global shutter.
    pub(super) fn unknown_drifts(&self, cam_from_target: &Pose<Cam, Target>) -> Option<[Drift; 6]> {
        self.rolling?.unknown_drifts(self.lens, self.target, cam_from_target)
    }

    /// How much later than the frame's time the target is exposed.
    pub(super) fn delay_ns(&self, cam_from_target: &Pose<Cam, Target>) -> u32 {
        self.rolling.map_or(0, |rolling| {
            delay_ns(&rolling.shutter, self.lens, self.target, cam_from_target)
        })
    }
}

/// Why a target that is expected, or was found, has no pose in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasureFailure {
    /// Fewer corners visible than a pose needs.
    TooFewCorners,
    /// What was seen does not fit the target's geometry, or the fit did not settle on a pose.
    PoorFit,
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::model::target::{Origin, Role};
    use crate::test_support::{bedside_lens, table};

    fn target() -> TargetGeometry {
        TargetGeometry::checker(6, 5, 12.0, Origin::FirstCorner, Role::Upper, [0.0; 3]).unwrap()
    }

    fn pose() -> Pose<Cam, Target> {
        Pose::from_theta([0.02, -0.2, 0.1, 40.0, -30.0, 900.0])
    }

    /// 16 ms for the 1088 rows of the lens, from the top.
    fn shutter() -> Shutter {
        Shutter::new(16_000_000, 1088)
    }

    /// What is known at this time of a target that has had these poses, 16 ms apart.
    fn motion(poses: &[Pose<Cam, Target>]) -> Motion {
        let first = Motion::new(poses[0], 0);
        (1..poses.len())
            .fold(first, |motion, place| motion.continued(poses[place], 16_000_000 * place as u64))
    }

    #[test]
    fn a_measurement_has_its_own_time() {
        let mut measurement = Measurement {
            cam_from_target: pose(),
            delay_ns: 7_000,
            covariance: Matrix6::zeros(),
            rms_px: 0.1,
            corners: 30,
            corners_total: 30,
        };
        assert_eq!(measurement.own_time_ns(1_000_000), 1_007_000);
        assert_eq!(measurement.own_time_ns(u64::MAX), u64::MAX);
        let variances = Vector6::new(1.0, 2.0, 3.0, 4.0, 9.0, 0.25);
        measurement.covariance = Matrix6::from_diagonal(&variances);
        assert_eq!(measurement.sd_mm(), Vector3::new(2.0, 3.0, 0.5));
    }

    #[test]
    fn a_target_is_as_late_as_the_row_of_its_middle() {
        let lens = table(&bedside_lens());
        let middle_mm = pose().transform(&Vector3::new(30.0, 24.0, 0.0));
        let row_px = bedside_lens().project(&middle_mm).unwrap().y;
        let expected_ns = row_px * 16e6 / 1088.0;
        let found_ns = f64::from(delay_ns(&shutter(), &lens, &target(), &pose()));
        // The table is good to 0.002 rows of 14.7 us.
        assert!((found_ns - expected_ns).abs() < 30.0, "{found_ns}, {expected_ns}");
        let behind = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, -900.0]);
        assert_eq!(delay_ns(&shutter(), &lens, &target(), &behind), 0);
    }

    #[test]
    fn a_target_is_late_only_where_rows_are_read_one_after_the_other() {
        let (pixels, lens, target) = ([0_u8; 64 * 64], table(&bedside_lens()), target());
        let image = GreyImage::new(&pixels, 64, 64, 64).unwrap();
        let (image, lens, target) = (&image, &lens, &target);
        let mut view = View { image, lens, target, first_square_dark: true, rolling: None };
        assert_eq!(view.delay_ns(&pose()), 0);
        let late_ns = delay_ns(&shutter(), lens, target, &pose());
        assert!(late_ns > 1_000_000, "{late_ns}");
        view.rolling = Some(Rolling { shutter: shutter(), time_ns: 5, motion: None });
        assert_eq!(view.delay_ns(&pose()), late_ns);
    }

    #[test]
    fn a_drift_is_the_motion_in_the_time_of_a_row() {
        let lens = table(&bedside_lens());
        let step = Vector6::new(1e-3, -2e-3, 3e-3, 0.8, -1.6, 2.4);
        let before = motion(&[pose(), pose().moved_by(&step)]);
        let now = pose().moved_by(&(step * 2.0));
        let delay_ns = delay_ns(&shutter(), &lens, &target(), &now);
        // The frame's time is such that its middle is seen 16 ms after the frame before.
        let time_ns = 32_000_000 - u64::from(delay_ns);
        let rolling = Rolling { shutter: shutter(), time_ns, motion: Some(&before) };
        let drift = rolling.drift(&lens, &target(), &now).unwrap();
        let row_px = f64::from(delay_ns) * 1088.0 / 16e6;
        assert!((drift.middle_row_px - row_px).abs() < 1e-4, "{}", drift.middle_row_px);
        // A frame's motion lasts as long as its 1088 rows are read. The second turn about the same
        // axis is the first one's, and rounding.
        assert!((drift.per_row * 1088.0 - step).norm() < 1e-12, "{}", drift.per_row);

        let still = Rolling { motion: None, ..rolling };
        assert_eq!(still.drift(&lens, &target(), &now).unwrap().per_row, Vector6::zeros());
        let behind = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, -900.0]);
        assert_eq!(rolling.drift(&lens, &target(), &behind), None);
    }

    /// The six drifts, less the one that is known, in standard deviations of a velocity.
    fn unknown_share(motion: Option<&Motion>, pose: &Pose<Cam, Target>) -> Option<f64> {
        let lens = table(&bedside_lens());
        let delay_ns = delay_ns(&shutter(), &lens, &target(), pose);
        let time_ns = motion.map_or(0, |it| it.time_ns + 16_000_000 - u64::from(delay_ns));
        let rolling = Rolling { shutter: shutter(), time_ns, motion };
        let known = rolling.drift(&lens, &target(), pose).unwrap();
        let drifts = rolling.unknown_drifts(&lens, &target(), pose)?;
        let row_s = 16e-3 / 1088.0;
        let share = (drifts[3].per_row[3] - known.per_row[3]) / (12.0 * row_s);
        for (component, drift) in drifts.iter().enumerate() {
            let sd_per_s = if component < 3 { 0.012 } else { 12.0 };
            let mut expected = known;
            expected.per_row[component] += share * sd_per_s * row_s;
            assert!((drift.per_row - expected.per_row).norm() < 1e-18, "{component}");
            assert_eq!(drift.middle_row_px, known.middle_row_px);
        }
        Some(share)
    }

    /// A velocity that two poses give is as old as half the time between them, and a brisk sway, of one
    /// second, has changed by then by 2 pi times as much of itself.
    #[test]
    fn what_is_not_known_of_a_velocity_is_its_age() {
        let step = Vector6::new(1e-3, -2e-3, 3e-3, 0.8, -1.6, 2.4);
        let poses: [_; 3] = array::from_fn(|place| pose().moved_by(&(step * place as f64)));
        let is_about = |share: Option<f64>, expected: f64| {
            share.is_some_and(|share| (share - expected).abs() < 1e-9)
        };
        assert!(is_about(unknown_share(None, &poses[0]), 1.0));
        let first = motion(&poses[..1]);
        let share = unknown_share(Some(&first), &poses[1]);
        assert!(is_about(share, core::f64::consts::TAU * 0.008), "{share:?}");
        // Three poses give the last velocity.
        let second = motion(&poses[..2]);
        assert_eq!(unknown_share(Some(&second), &poses[2]), None);
    }
}
