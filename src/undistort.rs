//! The undistortion table: raw pixel in, undistorted pixel and its Jacobian out.
//!
//! Inverting a lens takes an iteration per point. Here it is done once, at the
//! nodes of a coarse grid that spans the frame; a point between nodes is
//! interpolated by cubic Lagrange polynomials on the 4 x 4 nodes around it
//! (towards the border the same polynomials are used off their middle, so that
//! the accuracy holds up to the last pixel's centre). What is stored is the
//! displacement, undistorted minus raw, because 32 bits resolve it better than
//! the position: to 8e-6 px below 128 px of displacement.
//!
//! The error falls with the fourth power of the spacing. [`UndistortionLut::build`]
//! measures it where it is largest and refuses a lens for which it exceeds
//! [`ERROR_PX_MAX`], so that a table in use is known to be good.
//!
//! It maps points, never pixels: resampling the picture would cost precision.
//! An undistorted pixel is K applied to the ray, [`Lens::pixel_from_ray`].
//!
//! Cost: 96 KiB, whatever the frame size; some milliseconds to build,
//! tens of nanoseconds per point on a workstation.

use nalgebra::{Matrix2, Vector2};

use crate::lens::{Lens, LensError};
use crate::limits::UNDISTORTION_NODES_MAX;

/// Largest error of an interpolated point, anywhere in the frame.
pub const ERROR_PX_MAX: f64 = 0.002;

/// Nodes along one side of an interpolation's stencil.
const STENCIL: usize = 4;

/// Why a lens has no undistortion table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UndistortError {
    /// The lens itself cannot be used.
    Lens(LensError),
    /// No ray reaches this raw pixel: the distortion folds back inside the frame.
    NoRay {
        /// The raw pixel.
        raw_px: [f64; 2],
    },
    /// The interpolation is worse than [`ERROR_PX_MAX`].
    TooCoarse {
        /// The largest error found.
        error_px: f64,
        /// The raw pixel where it was found.
        raw_px: [f64; 2],
    },
}

impl core::fmt::Display for UndistortError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Lens(error) => error.fmt(formatter),
            Self::NoRay { raw_px: [x, y] } => write!(
                formatter,
                "no ray reaches pixel ({x:.1}, {y:.1}): the distortion folds back inside the frame"
            ),
            Self::TooCoarse { error_px, raw_px: [x, y] } => write!(
                formatter,
                "the undistortion table is wrong by {error_px:.4} px at ({x:.1}, {y:.1}), more than {ERROR_PX_MAX} px: \
                 the distortion bends too sharply there, as it does shortly before it folds back"
            ),
        }
    }
}

impl core::error::Error for UndistortError {}

/// An undistorted point and how it moves with the raw one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Undistorted {
    /// K applied to the ray: where the point would be without distortion.
    pub pixel_px: Vector2<f64>,
    /// d undistorted / d raw, of the interpolation itself.
    pub undistorted_by_raw: Matrix2<f64>,
}

/// One axis of the grid of nodes.
#[derive(Debug, Clone, Copy)]
struct Axis {
    /// Nodes along this axis; 0 before the table is built.
    nodes: usize,
    /// Position of the last node: the frame's last pixel.
    end_px: f64,
    /// Spacings per pixel.
    per_px: f64,
}

/// The four weights of one axis, and their derivatives by the position.
struct Weights {
    /// First node of the stencil.
    start: usize,
    values: [f64; STENCIL],
    slopes_by_px: [f64; STENCIL],
}

impl Axis {
    const fn none() -> Self {
        Self { nodes: 0, end_px: 0.0, per_px: 0.0 }
    }

    fn new(nodes: usize, side_px: u16) -> Self {
        let end_px = f64::from(side_px - 1);
        Self { nodes, end_px, per_px: (nodes - 1) as f64 / end_px }
    }

    /// Position of a node, or of a point between nodes.
    fn position_px(&self, node: f64) -> f64 {
        // The last node is the last pixel, rounding or not.
        (node / self.per_px).min(self.end_px)
    }

    /// Cubic Lagrange weights; `None` outside the frame (and before the build).
    #[inline]
    fn weights(&self, position_px: f64) -> Option<Weights> {
        if !(position_px >= 0.0 && position_px <= self.end_px) || self.nodes < STENCIL {
            return None;
        }
        let node = position_px * self.per_px;
        let start = (node as usize).saturating_sub(1).min(self.nodes - STENCIL);
        // Distances to the stencil's nodes, in spacings.
        let a = node - start as f64;
        let (b, c, d) = (a - 1.0, a - 2.0, a - 3.0);
        const SIXTH: f64 = 1.0 / 6.0;
        let sixth_per_px = SIXTH * self.per_px;
        let half_per_px = 0.5 * self.per_px;
        Some(Weights {
            start,
            values: [-b * c * d * SIXTH, a * c * d * 0.5, -a * b * d * 0.5, a * b * c * SIXTH],
            slopes_by_px: [
                -(c * d + b * d + b * c) * sixth_per_px,
                (c * d + a * d + a * c) * half_per_px,
                -(b * d + a * d + a * b) * half_per_px,
                (b * c + a * c + a * b) * sixth_per_px,
            ],
        })
    }
}

/// The table. Filled by [`build`](Self::build); before that, and after a build
/// that failed, every point is `None`.
pub struct UndistortionLut {
    columns: Axis,
    rows: Axis,
    error_px: f64,
    /// Row by row, `columns.nodes` to a row.
    displacements_px: [[f32; 2]; UNDISTORTION_NODES_MAX],
}

impl Default for UndistortionLut {
    fn default() -> Self {
        Self::new()
    }
}

impl UndistortionLut {
    /// An empty table, all zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            columns: Axis::none(),
            rows: Axis::none(),
            error_px: 0.0,
            displacements_px: [[0.0; 2]; UNDISTORTION_NODES_MAX],
        }
    }

    /// Fills the table for a lens, and measures its error.
    ///
    /// # Errors
    /// [`UndistortError`]; the table is then empty.
    pub fn build(&mut self, lens: &Lens) -> Result<(), UndistortError> {
        (self.columns, self.rows, self.error_px) = (Axis::none(), Axis::none(), 0.0);
        lens.check().map_err(UndistortError::Lens)?;
        // Square spacing, as many nodes as there is room for.
        let aspect = f64::from(lens.width_px) / f64::from(lens.height_px);
        let column_count = libm::sqrt(UNDISTORTION_NODES_MAX as f64 * aspect) as usize;
        let row_count = UNDISTORTION_NODES_MAX / column_count;
        let columns = Axis::new(column_count, lens.width_px);
        let rows = Axis::new(row_count, lens.height_px);
        for row in 0..row_count {
            for column in 0..column_count {
                let raw_px =
                    Vector2::new(columns.position_px(column as f64), rows.position_px(row as f64));
                let displacement = exact(lens, &raw_px)? - raw_px;
                self.displacements_px[row * column_count + column] =
                    [displacement.x as f32, displacement.y as f32];
            }
        }
        (self.columns, self.rows) = (columns, rows);
        let (error_px, raw_px) = self.largest_error(lens).inspect_err(|_| self.clear())?;
        self.error_px = error_px;
        // A NaN is not within the bound either.
        if error_px <= ERROR_PX_MAX {
            return Ok(());
        }
        self.clear();
        Err(UndistortError::TooCoarse { error_px, raw_px })
    }

    /// The largest error that the build measured.
    #[must_use]
    pub fn error_px(&self) -> f64 {
        self.error_px
    }

    /// The undistorted pixel of a raw one; `None` outside the centres of the
    /// frame's outermost pixels, and before the table is built.
    #[must_use]
    #[inline]
    pub fn undistort(&self, raw_px: &Vector2<f64>) -> Option<Undistorted> {
        let across = self.columns.weights(raw_px.x)?;
        let down = self.rows.weights(raw_px.y)?;
        let (mut x, mut y) = (raw_px.x, raw_px.y);
        let [mut x_by_x, mut x_by_y, mut y_by_x, mut y_by_y] = [1.0, 0.0, 0.0, 1.0];
        for index in 0..STENCIL {
            let first = (down.start + index) * self.columns.nodes + across.start;
            let nodes: &[[f32; 2]; STENCIL] = self.displacements_px.get(first..)?.first_chunk()?;
            let [mut row_x, mut row_y, mut row_x_by_x, mut row_y_by_x] = [0.0; 4];
            for (node, (value, slope)) in
                nodes.iter().zip(across.values.iter().zip(&across.slopes_by_px))
            {
                let (node_x, node_y) = (f64::from(node[0]), f64::from(node[1]));
                row_x += value * node_x;
                row_y += value * node_y;
                row_x_by_x += slope * node_x;
                row_y_by_x += slope * node_y;
            }
            let (value, slope) = (down.values[index], down.slopes_by_px[index]);
            x += value * row_x;
            y += value * row_y;
            x_by_x += value * row_x_by_x;
            y_by_x += value * row_y_by_x;
            x_by_y += slope * row_x;
            y_by_y += slope * row_y;
        }
        Some(Undistorted {
            pixel_px: Vector2::new(x, y),
            undistorted_by_raw: Matrix2::new(x_by_x, x_by_y, y_by_x, y_by_y),
        })
    }

    fn clear(&mut self) {
        (self.columns, self.rows) = (Axis::none(), Axis::none());
    }

    /// The largest difference from the lens over one sample per cell, where the
    /// polynomial is worst: in the middle of a cell, or, on the border, 0.38 of
    /// a spacing from it (the extremum of s (s-1) (s-2) (s-3) there).
    fn largest_error(&self, lens: &Lens) -> Result<(f64, [f64; 2]), UndistortError> {
        let sample = |axis: &Axis, cell: usize| {
            let offset = match cell {
                0 => 0.382,
                _ if cell == axis.nodes - 2 => 0.618,
                _ => 0.5,
            };
            axis.position_px(cell as f64 + offset)
        };
        let mut worst = (0.0_f64, [0.0; 2]);
        for row in 0..self.rows.nodes - 1 {
            for column in 0..self.columns.nodes - 1 {
                let raw_px = Vector2::new(sample(&self.columns, column), sample(&self.rows, row));
                let wanted = exact(lens, &raw_px)?;
                let found = self.undistort(&raw_px).map(|found| found.pixel_px);
                let error_px = found.map_or(f64::INFINITY, |found| (found - wanted).norm());
                if error_px.is_nan() || error_px > worst.0 {
                    worst = (error_px, raw_px.into());
                }
            }
        }
        Ok(worst)
    }
}

/// The undistorted pixel by the lens itself.
fn exact(lens: &Lens, raw_px: &Vector2<f64>) -> Result<Vector2<f64>, UndistortError> {
    lens.ray_from_raw(raw_px)
        .map(|ray| lens.pixel_from_ray(&ray))
        .ok_or(UndistortError::NoRay { raw_px: (*raw_px).into() })
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;

    use super::*;
    use crate::lens::Distortion;
    use crate::test_support::{Random, repetitions};

    fn lens(width_px: u16, height_px: u16, focal_px: f64, distortion: Distortion) -> Lens {
        Lens {
            width_px,
            height_px,
            fx_px: focal_px,
            fy_px: focal_px * 1.006,
            cx_px: f64::from(width_px) * 0.502,
            cy_px: f64::from(height_px) * 0.496,
            skew_px: 0.7,
            distortion,
        }
    }

    const WIDE: Distortion = Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]);

    /// 108 degrees from side to side, 59 degrees off the axis in the corner.
    fn strongest() -> Lens {
        let distortion = Distortion::Brown5([-0.30, 0.12, 0.001, -0.0008, -0.015]);
        lens(1456, 1088, 700.0, distortion)
    }

    fn built(lens: &Lens) -> Box<UndistortionLut> {
        let mut lut = Box::new(UndistortionLut::new());
        assert_eq!(lut.build(lens), Ok(()));
        lut
    }

    /// A point of the frame: every second one within 30 px of two borders.
    fn point(random: &mut Random, lens: &Lens) -> Vector2<f64> {
        let [right, bottom] = [lens.width_px, lens.height_px].map(|side| f64::from(side - 1));
        if random.bits() & 1 == 0 {
            return Vector2::new(random.uniform(0.0, right), random.uniform(0.0, bottom));
        }
        let mut near = |end: f64| {
            let inset = random.uniform(0.0, 30.0);
            if random.bits() & 1 == 0 { inset } else { end - inset }
        };
        Vector2::new(near(right), near(bottom))
    }

    /// Largest error of points, px, and of Jacobians, relative.
    fn worst_errors(lens: &Lens, lut: &UndistortionLut) -> (f64, f64) {
        let mut random = Random::new(11);
        let mut worst = (0.0_f64, 0.0_f64);
        for _ in 0..repetitions(20_000) {
            let raw_px = point(&mut random, lens);
            let ray = lens.ray_from_raw(&raw_px).unwrap();
            let found = lut.undistort(&raw_px).unwrap();
            let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
            let wanted = lens.pixel_by_ray() * raw_by_ray.try_inverse().unwrap();
            worst.0 = worst.0.max((found.pixel_px - lens.pixel_from_ray(&ray)).norm());
            worst.1 = worst.1.max((found.undistorted_by_raw - wanted).norm() / wanted.norm());
        }
        worst
    }

    #[test]
    fn every_lens_is_within_the_bound_up_to_the_corners() {
        let mild = Distortion::Brown5([-0.12, 0.08, 0.0005, 0.0003, 0.0]);
        // Errors measured with this generator, rounded up: they grow with the frame
        // in pixels and with the fourth derivative of the distortion.
        for (lens, error_px_max, jacobian_error_max) in [
            (strongest(), 3e-4, 8e-5),
            (lens(1456, 1088, 800.0, WIDE), 3.2e-4, 8e-5),
            (lens(4096, 3072, 2200.0, WIDE), 1.1e-3, 9e-5),
            (lens(4096, 4096, 2300.0, WIDE), 1.4e-3, 1e-4),
            (lens(1456, 1088, 1740.0, mild), 3e-6, 1e-6),
            (lens(1456, 1088, 1740.0, Distortion::Radial2([-0.2, 0.1])), 4e-6, 1e-6),
            (lens(1456, 1088, 1000.0, Distortion::Radial2([0.2, 0.05])), 7e-6, 2.5e-6),
        ] {
            let lut = built(&lens);
            let (error_px, jacobian_error) = worst_errors(&lens, &lut);
            assert!(error_px < error_px_max, "{error_px} px for {lens:?}");
            assert!(jacobian_error < jacobian_error_max, "{jacobian_error} for {lens:?}");
            // The build's own samples lie where the error is largest: others may
            // exceed them by the rounding of 32 bits at 1,000 px only.
            assert!(error_px < 1.05 * lut.error_px() + 6e-5, "{error_px} {}", lut.error_px());
        }
    }

    #[test]
    fn the_jacobian_is_that_of_the_interpolation() {
        let lens = strongest();
        let lut = built(&lens);
        let mut random = Random::new(5);
        let mut worst = [0.0_f64; 2];
        for _ in 0..1000 {
            const STEP_PX: f64 = 1e-4;
            let raw_px = point(&mut random, &lens);
            let ahead = |step: Vector2<f64>| {
                let ahead_px = lut.undistort(&(raw_px + step))?.pixel_px;
                Some((ahead_px - lut.undistort(&(raw_px - step))?.pixel_px) / (2.0 * STEP_PX))
            };
            let columns = [Vector2::x(), Vector2::y()].map(|axis| ahead(axis * STEP_PX));
            let [Some(by_x), Some(by_y)] = columns else { continue };
            let difference = Matrix2::from_columns(&[by_x, by_y]);
            let found = lut.undistort(&raw_px).unwrap().undistorted_by_raw;
            for (worst, scale) in worst.iter_mut().zip([1.0, 1.0001]) {
                *worst = worst.max((found * scale - difference).norm());
            }
        }
        // Rounding of 1,500 px positions over 2e-4 px: 2e-9. Where a difference
        // straddles two polynomials it sees the jump between their slopes, 1e-4 of
        // which a step of 1e-4 px in 11 px meets once in 50,000.
        assert!(worst[0] < 1e-8, "{worst:?}");
        assert!(worst[1] > 1e-4, "{worst:?}");
    }

    #[test]
    fn outside_the_frame_and_before_the_build_there_is_nothing() {
        let empty = Box::new(UndistortionLut::new());
        assert_eq!(empty.undistort(&Vector2::new(10.0, 10.0)), None);
        let lut = built(&strongest());
        for inside in [[0.0, 0.0], [1455.0, 0.0], [0.0, 1087.0], [1455.0, 1087.0]] {
            assert!(lut.undistort(&Vector2::from(inside)).is_some(), "{inside:?}");
        }
        for outside in [[-1e-9, 5.0], [1455.001, 5.0], [5.0, 1087.001], [5.0, f64::NAN]] {
            assert_eq!(lut.undistort(&Vector2::from(outside)), None, "{outside:?}");
        }
    }

    #[test]
    fn a_lens_that_nearly_folds_is_refused_with_the_measured_error() {
        let mut lut = built(&strongest());
        // Folds back just outside the corner, where its slope is nearly infinite.
        let sharp = Distortion::Brown5([-0.30, 0.12, 0.001, -0.0008, -0.018]);
        let refused = lut.build(&lens(1456, 1088, 750.0, sharp));
        let Err(UndistortError::TooCoarse { error_px, raw_px }) = refused else {
            panic!("{refused:?}")
        };
        assert!(error_px > ERROR_PX_MAX);
        // In the top right corner, where the ray is longest.
        assert!(raw_px[0] > 1440.0 && raw_px[1] < 15.0, "{raw_px:?}");
        assert_eq!(lut.undistort(&Vector2::new(700.0, 500.0)), None);
        let folded = lut.build(&lens(1456, 1088, 700.0, sharp));
        assert_eq!(folded, Err(UndistortError::Lens(LensError::Folds)));
    }

    #[test]
    fn the_table_is_as_large_as_its_nodes() {
        let nodes = 8 * UNDISTORTION_NODES_MAX;
        // Two axes of three words, and the error.
        assert_eq!(size_of::<UndistortionLut>(), nodes + 2 * 3 * 8 + 8);
    }
}
