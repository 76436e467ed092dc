//! The undistortion table (LUT): the lens as the measurement uses it.
//!
//! Built once from any [`Lens`], it maps rays to raw pixels, with derivatives, and raw pixels to
//! rays. After that nothing needs to know which lens model the camera was calibrated with. It maps
//! points: resampling the picture would cost 5 to 75 % of the precision.
//!
//! ```text
//!      projection           table
//! ray ────────────▶ plane ────────▶ raw pixel
//!     ◀────────────       ◀────────
//! ```
//!
//! Each of the two tables is a `Map`, a grid of cells with a polynomial in each. For most lenses
//! the plane is that of the rays (x/z, y/z) themselves: their models are polynomials or nearly so,
//! and nothing needs to be projected. But a ray grows without bound towards the side of the camera.
//! Where the table is more precise over the stereographic projection p = 2 tan(theta/2) of the ray
//! at angle theta to the optical axis, which stays below 2 in front of the camera, it is made over
//! that: fisheyes are smooth there.
//!
//! The table from raw pixels to the plane is coarse; one Newton step on the other table makes up for
//! it, and makes the two maps inverse to each other.
//!
//! [`LensTable::fill`] measures the errors of both over the frame and refuses a lens for which they
//! exceed [`ERROR_PX_MAX`]; usual lenses stay below a hundredth of that. Outside the frame the maps
//! continue linearly.
//!
//! Cost: from ray to raw pixel less than by a polynomial lens model; over the stereographic plane a
//! square root and two divisions more. Building takes about 40,000 evaluations of the lens, and up to
//! three times as many where both planes have to be tried.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::limits::LENS_TABLE_CELLS;
use crate::model::lens::{Lens, LensError, ray_of};
use map::{Map, Rectangle};
use projection::{Projection, stereographic_from_ray};

mod map;
mod projection;

/// Largest error of either map anywhere in the frame, in raw pixels: a third of the error that
/// noise causes in a single corner.
pub const ERROR_PX_MAX: f64 = 0.002;

/// A table is refused when its error at any of the pixels checked is more than this; nowhere between
/// them is it twice as large.
const CHECKED_ERROR_PX_MAX: f64 = 0.5 * ERROR_PX_MAX;

/// Below this error at the pixels checked, no other plane is tried.
const GOOD_ERROR_PX: f64 = 0.05 * ERROR_PX_MAX;

/// Pixels checked along each axis for each cell: a polynomial's error changes its sign five times.
const CHECKS_PER_CELL: usize = 4;

/// A table of rays reaches this far beyond those of the frame, in parts of their range, so that a
/// target that leaves the frame keeps its shape at the border.
const MARGIN: f64 = 0.03;

/// A lens's maps between rays and raw pixels, see the module's description.
#[derive(Debug, Clone)]
pub struct LensTable {
    width_px: u16,
    height_px: u16,
    projection: Projection,
    raw_from_plane: Map<LENS_TABLE_CELLS>,
    plane_from_raw: Map<{ LENS_TABLE_CELLS / 2 }>,
}

impl LensTable {
    /// The table of no lens: no frame has its size.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            width_px: 0,
            height_px: 0,
            projection: Projection::Gnomonic,
            raw_from_plane: Map::new(),
            plane_from_raw: Map::new(),
        }
    }

    /// Frame width.
    #[must_use]
    pub fn width_px(&self) -> u16 {
        self.width_px
    }

    /// Frame height.
    #[must_use]
    pub fn height_px(&self) -> u16 {
        self.height_px
    }

    /// Becomes the table of no lens.
    pub fn clear(&mut self) {
        (self.width_px, self.height_px) = (0, 0);
    }

    /// Becomes a lens's table.
    ///
    /// The lens must have passed [`Lens::check`].
    ///
    /// # Errors
    /// [`LensError::Folds`] or [`LensError::Table`]; the table is then that of no lens.
    pub fn fill(&mut self, lens: &Lens) -> Result<(), LensError> {
        let error_px = self.fill_over_the_better_plane(lens);
        // A NaN is not below the bound.
        if error_px.is_some_and(|error_px| error_px <= CHECKED_ERROR_PX_MAX) {
            return Ok(());
        }
        self.clear();
        Err(if error_px.is_none() { LensError::Folds } else { LensError::Table })
    }

    /// Becomes a lens's table and returns its error; `None` where a pixel has no ray.
    fn fill_over_the_better_plane(&mut self, lens: &Lens) -> Option<f64> {
        let gnomonic_px = self.fill_over(Projection::Gnomonic, lens)?;
        if gnomonic_px <= GOOD_ERROR_PX {
            return Some(gnomonic_px);
        }
        let stereographic_px = self.fill_over(Projection::Stereographic, lens)?;
        if stereographic_px < gnomonic_px {
            return Some(stereographic_px);
        }
        self.fill_over(Projection::Gnomonic, lens)
    }

    /// Becomes a lens's table over a plane and returns its error; `None` where a pixel has no ray.
    fn fill_over(&mut self, projection: Projection, lens: &Lens) -> Option<f64> {
        let frame = Rectangle {
            start: Vector2::zeros(),
            end: Vector2::new(f64::from(lens.width_px - 1), f64::from(lens.height_px - 1)),
        };
        let rays = rays_of_frame(projection, lens, &frame)?;
        (self.width_px, self.height_px) = (lens.width_px, lens.height_px);
        self.projection = projection;
        self.raw_from_plane.fill(&rays, |plane| Some(projection.raw_from_plane(lens, plane)))?;
        self.plane_from_raw
            .fill(&frame, |raw_px| Some(projection.plane_from_ray(&lens.ray_from_raw(raw_px)?)))?;
        self.error_px(lens)
    }

    /// The larger error of both maps at pixels all over the frame, in raw pixels; `None` where a
    /// pixel has no ray.
    fn error_px(&self, lens: &Lens) -> Option<f64> {
        const STEPS: usize = CHECKS_PER_CELL * LENS_TABLE_CELLS;
        let along = |step: usize, side_px: u16| step as f64 / STEPS as f64 * f64::from(side_px - 1);
        let mut worst_px = 0.0_f64;
        for row in 0..=STEPS {
            for column in 0..=STEPS {
                let raw_px = Vector2::new(along(column, lens.width_px), along(row, lens.height_px));
                let ray = lens.ray_from_raw(&raw_px)?;
                let forth_px = (self.raw_from_ray_with_jacobian(&ray).0 - raw_px).norm();
                let back_px = self.ray_from_raw(&raw_px).map_or(f64::INFINITY, |back| {
                    (lens.raw_from_ray_with_jacobian(&back).0 - raw_px).norm()
                });
                // `max` would pass over a NaN.
                if !(forth_px + back_px).is_finite() {
                    return Some(f64::INFINITY);
                }
                worst_px = worst_px.max(forth_px).max(back_px);
            }
        }
        Some(worst_px)
    }

    /// The raw pixel of a ray (x/z, y/z), and its 2 x 2 Jacobian with respect to the ray.
    #[must_use]
    pub fn raw_from_ray_with_jacobian(&self, ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self.projection {
            Projection::Gnomonic => self.raw_from_plane.at(ray),
            Projection::Stereographic => {
                let (plane, plane_by_ray) = stereographic_from_ray(ray);
                let (raw_px, raw_by_plane) = self.raw_from_plane.at(&plane);
                (raw_px, raw_by_plane * plane_by_ray)
            }
        }
    }

    /// The ray of a raw pixel; `None` outside the frame.
    #[must_use]
    pub fn ray_from_raw(&self, raw_px: &Vector2<f64>) -> Option<Vector2<f64>> {
        // From border to border, not only from middle to middle of the outermost pixels.
        let inside = |at_px: f64, side_px: u16| (-0.5..=f64::from(side_px) - 0.5).contains(&at_px);
        if !inside(raw_px.x, self.width_px) || !inside(raw_px.y, self.height_px) {
            return None;
        }
        let (near, _) = self.plane_from_raw.at(raw_px);
        let (near_px, raw_by_plane) = self.raw_from_plane.at(&near);
        let plane = near + raw_by_plane.try_inverse()? * (raw_px - near_px);
        self.projection.ray_from_plane(&plane)
    }

    /// The raw pixel at which a point of the camera frame appears; `None` when it is not in front
    /// of the camera.
    #[must_use]
    pub fn project(&self, point_cam_mm: &Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.raw_from_ray_with_jacobian(&ray_of(point_cam_mm)?).0)
    }
}

impl Default for LensTable {
    fn default() -> Self {
        Self::new()
    }
}

/// The part of the plane that the frame shows, and a margin; `None` where a pixel of the frame's
/// border has no ray.
fn rays_of_frame(projection: Projection, lens: &Lens, frame: &Rectangle) -> Option<Rectangle> {
    const STEPS: usize = 64;
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = Vector2::repeat(f64::NEG_INFINITY);
    for step in 0..=STEPS {
        let [right, bottom]: [f64; 2] = frame.end.into();
        let fraction = step as f64 / STEPS as f64;
        let (x, y) = (fraction * right, fraction * bottom);
        for raw_px in [[x, 0.0], [x, bottom], [0.0, y], [right, y]] {
            let plane = projection.plane_from_ray(&lens.ray_from_raw(&raw_px.into())?);
            (low, high) = (low.inf(&plane), high.sup(&plane));
        }
    }
    let margin = (high - low) * MARGIN;
    Some(Rectangle { start: low - margin, end: high + margin })
}

#[cfg(test)]
mod tests;
