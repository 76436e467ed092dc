//! What the refinement works on: the numbers measured in each photograph, and the board's shape.

use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use plumbline::pose::{Cam, Pose, Target};

/// One number measured in a photograph: a place across an edge, or a corner's coordinate.
///
/// Its residual is `by_px[0] . raw pixel of points[0] + by_px[1] . that of points[1] - value`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Two points of the board, by their places.
    pub points: [usize; 2],
    /// How it follows their raw pixels.
    pub by_px: [Vector2<f64>; 2],
    /// What was measured, raw pixels.
    pub value_px: f64,
    /// Its standard deviation as far as the pixels' noise goes.
    pub sigma_px: f64,
}

impl Seen {
    /// What the raw pixels of all points say, less what was measured.
    pub fn residual_px(&self, raw_px: &[Vector2<f64>]) -> f64 {
        let [first, second] = self.points.map(|point| raw_px[point]);
        self.by_px[0].dot(&first) + self.by_px[1].dot(&second) - self.value_px
    }
}

/// What one photograph shows of the board.
#[derive(Debug, Clone)]
pub struct Photograph {
    /// Shared by all trial steps of the descent.
    pub seen: Arc<[Seen]>,
    pub cam_from_board: Pose<Cam, Target>,
}

/// How the board differs from a flat one of square pitch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shape {
    /// z = xx x^2 + xy x y + yy y^2, 1/mm.
    pub bend_per_mm: [f64; 3],
    /// The pitch along y is larger than that along x by this part.
    pub stretch: f64,
}

impl Shape {
    /// A point of the flat board on this one.
    #[must_use]
    pub fn apply(&self, point_mm: &Vector3<f64>) -> Vector3<f64> {
        let [x, y] = [point_mm.x, point_mm.y];
        let [xx, xy, yy] = self.bend_per_mm;
        let height = xx * x * x + xy * x * y + yy * y * y;
        Vector3::new(x, y * (1.0 + self.stretch), point_mm.z + height)
    }
}

/// An edge's middle and its residual, raw pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Where the calibration puts the edge's middle.
    pub at_px: Vector2<f64>,
    /// From where it is seen, across the edge.
    pub off_px: Vector2<f64>,
}
