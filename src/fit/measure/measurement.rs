//! What is measured, the result, and why there may be none.

use nalgebra::{Matrix6, Vector3};

use crate::fit::edge::Appearance;
use crate::model::image::GreyImage;
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::TargetGeometry;

/// Fewest corners of a pose: six points give twelve equations for six unknowns.
pub(super) const CORNERS_MIN: usize = 6;

/// A target's pose in one frame, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// The pose.
    pub cam_from_target: Pose<Cam, Target>,
    /// Covariance of `[omega_rad, delta_mm]`, the increments of [`Pose::moved_by`].
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
}

/// Why a target that is expected, or was found, has no pose in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasureFailure {
    /// Fewer corners visible than a pose needs.
    TooFewCorners,
    /// The corners do not fit the target's geometry.
    PoorFit,
}
