//! The input of the refinement: the quantities measured in each photograph, and the board's shape.

use std::sync::Arc;

use nalgebra::{Matrix2x3, Vector2, Vector3};
use plumbline::lens::{Lens, ray_by_point, ray_of};
use plumbline::pose::{Cam, Pose, Target};

/// One quantity measured in a photograph: a position across an edge, or a coordinate of a corner.
///
/// Its residual is `by_px[0] . raw pixel of points[0] + by_px[1] . that of points[1] - value`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The indices of two points of the board.
    pub points: [usize; 2],
    /// The derivatives of the quantity with respect to their raw pixels.
    pub by_px: [Vector2<f64>; 2],
    /// The measured value, raw pixels.
    pub value_px: f64,
    /// Its standard deviation due to the noise of the pixels.
    pub sigma_px: f64,
}

impl Seen {
    /// The quantity predicted from the raw pixels of all points, minus the measured value.
    pub fn residual_px(&self, raw_px: &[Vector2<f64>]) -> f64 {
        let [first, second] = self.points.map(|point| raw_px[point]);
        self.by_px[0].dot(&first) + self.by_px[1].dot(&second) - self.value_px
    }
}

/// The measurements of the board in one photograph.
#[derive(Debug, Clone)]
pub struct Photograph {
    /// Shared by all trial steps of the minimisation.
    pub seen: Arc<[Seen]>,
    pub cam_from_board: Pose<Cam, Target>,
}

/// How the board deviates from a flat one with square pitch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shape {
    /// z = xx x^2 + xy x y + yy y^2, 1/mm.
    pub bend_per_mm: [f64; 3],
    /// By what fraction the pitch along y exceeds that along x.
    pub stretch: f64,
}

impl Shape {
    /// Maps a point of the flat board to this shape.
    #[must_use]
    pub fn apply(&self, point_mm: &Vector3<f64>) -> Vector3<f64> {
        let [x, y] = [point_mm.x, point_mm.y];
        let [xx, xy, yy] = self.bend_per_mm;
        let height = xx * x * x + xy * x * y + yy * y * y;
        Vector3::new(x, y * (1.0 + self.stretch), point_mm.z + height)
    }
}

/// The derivative of a raw pixel with respect to the point in the camera's frame; `None` when the
/// point lies behind the camera.
pub fn raw_by_point(lens: &Lens, point_cam_mm: &Vector3<f64>) -> Option<Matrix2x3<f64>> {
    let ray = ray_of(point_cam_mm)?;
    let (_, by_ray) = lens.distortion.distort_with_jacobian(&ray);
    Some(lens.pixel_by_ray() * by_ray * ray_by_point(point_cam_mm, &ray))
}

/// The midpoint of an edge and its residual, raw pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// The position of the midpoint according to the calibration.
    pub at_px: Vector2<f64>,
    /// The offset from the observed position, across the edge.
    pub off_px: Vector2<f64>,
}
