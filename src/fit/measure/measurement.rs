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
