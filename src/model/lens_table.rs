//! The undistortion table (LUT): the lens as the measurement uses it.
//!
//! Built once from any [`Lens`], it maps rays to raw pixels and raw pixels to rays, with
//! derivatives. After that nothing needs to know which lens model the camera was calibrated with,
//! and every lens costs the same. It maps points: resampling the picture would cost 5 to 75 % of
//! the precision.
//!
//! ```text
//!        stereographic            cubic spline
//! ray ──────────────────▶ plane ──────────────▶ raw pixel
//!     ◀──────────────────       ◀──────────────
//! ```
//!
//! A ray (x/z, y/z) grows without bound towards the side of the camera, and a table over rays would
//! be too coarse in the middle of a wide frame. The table is therefore made over the stereographic
//! projection p = 2 tan(theta/2) of the ray at angle theta to the optical axis, which stays below 2
//! in front of the camera and in which every usual lens is smooth.
//!
//! Each map is the lens's intrinsic matrix plus a bicubic spline through samples of the rest (de
//! Boor 1962), with the lens's own derivatives at the borders; its error falls with the fourth
//! power of the cell's size. [`LensTable::fill`] measures the error over the frame and refuses a
//! lens for which it exceeds [`ERROR_PX_MAX`]; usual lenses stay below a tenth of that. Beyond the
//! frame, the maps continue linearly.
//!
//! Cost: 16 coefficients for each coordinate of a point; building takes about 20,000 evaluations
//! of the lens.

use core::array;
use core::hint::black_box;

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::limits::LENS_TABLE_COEFFICIENTS;
use crate::model::lens::{Lens, LensError, ray_of};

/// Largest error of either map anywhere in the frame, in raw pixels: a third of the error with
/// which noise leaves a single corner.
pub const ERROR_PX_MAX: f64 = 0.002;

/// A table is refused when the error in the middle of any cell is more than this; nowhere in a cell
/// is it much larger than there.
const CHECKED_ERROR_PX_MAX: f64 = 0.5 * ERROR_PX_MAX;

/// Samples of the longest side.
const LINE_MAX: usize = 128;

/// Samples of the shortest side: a spline needs a few.
const LINE_MIN: usize = 8;

/// A table of rays reaches this far beyond those of the frame, in parts of their range, so that a
/// target that leaves the frame keeps its shape at the border.
const MARGIN: f64 = 0.03;

/// Rays are sampled up to this distance from the middle of the stereographic plane: 87 degrees off
/// the optical axis.
const PLANE_MAX: f64 = 1.9;

/// A lens's maps between rays and raw pixels, see the module's description.
#[derive(Debug, Clone)]
pub struct LensTable {
    width_px: u16,
    height_px: u16,
    raw_from_plane: Map,
    plane_from_raw: Map,
}

impl LensTable {
    /// The table of no lens: no frame has its size.
    #[must_use]
    pub const fn new() -> Self {
        Self { width_px: 0, height_px: 0, raw_from_plane: Map::new(), plane_from_raw: Map::new() }
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
        self.clear();
        let frame = Rectangle {
            start: Vector2::zeros(),
            end: Vector2::new(f64::from(lens.width_px - 1), f64::from(lens.height_px - 1)),
        };
        let rays = rays_of_frame(lens, &frame).ok_or(LensError::Folds)?;
        let raw_from_plane = |plane: &Vector2<f64>| Some(raw_from_plane(lens, plane));
        let plane_from_raw = |raw_px: &Vector2<f64>| plane_from_raw(lens, raw_px);
        self.raw_from_plane
            .fill(&rays, &Affine::of(|plane| lens.pixel_from_ray(plane)), raw_from_plane)
            .and_then(|()| {
                let affine = Affine::of(|raw_px| lens.ray_from_pixel(raw_px));
                self.plane_from_raw.fill(&frame, &affine, plane_from_raw)
            })
            .ok_or(LensError::Table)?;
        (self.width_px, self.height_px) = (lens.width_px, lens.height_px);
        let error_px = self.error_px(lens);
        // A NaN is not below the bound.
        if error_px.is_some_and(|error_px| error_px <= CHECKED_ERROR_PX_MAX) {
            return Ok(());
        }
        self.clear();
        Err(LensError::Table)
    }

    /// The larger error of both maps in the middles of all cells, in raw pixels; `None` where the
    /// lens has no ray.
    fn error_px(&self, lens: &Lens) -> Option<f64> {
        let map = &self.plane_from_raw;
        let mut worst = 0.0_f64;
        for row in 0..map.lines[1] - 3 {
            for column in 0..map.lines[0] - 3 {
                let middle = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
                let raw_px = map.start + middle.component_div(&map.per_unit);
                let ray = lens.ray_from_raw(&raw_px)?;
                let forth = self.raw_from_ray_with_jacobian(&ray).0 - raw_px;
                let back = self.ray_from_raw_with_jacobian(&raw_px)?.0;
                let back = lens.raw_from_ray_with_jacobian(&back).0 - raw_px;
                // `max` would pass over a NaN.
                let error = forth.norm() + back.norm();
                if !error.is_finite() {
                    return None;
                }
                worst = worst.max(forth.norm()).max(back.norm());
            }
        }
        Some(worst)
    }

    /// The raw pixel of a ray (x/z, y/z), and its 2 x 2 Jacobian with respect to the ray.
    #[must_use]
    pub fn raw_from_ray_with_jacobian(&self, ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (plane, plane_by_ray) = plane_from_ray(ray);
        let (raw_px, raw_by_plane) = self.raw_from_plane.at(&plane);
        (raw_px, raw_by_plane * plane_by_ray)
    }

    /// The ray of a raw pixel, and its 2 x 2 Jacobian with respect to the pixel; `None` outside the
    /// frame.
    #[must_use]
    pub fn ray_from_raw_with_jacobian(
        &self,
        raw_px: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        // From border to border, not only from middle to middle of the outermost pixels.
        let inside = |at_px: f64, side_px: u16| (-0.5..=f64::from(side_px) - 0.5).contains(&at_px);
        if !inside(raw_px.x, self.width_px) || !inside(raw_px.y, self.height_px) {
            return None;
        }
        let (plane, plane_by_raw) = self.plane_from_raw.at(raw_px);
        let (ray, ray_by_plane) = ray_from_plane(&plane);
        Some((ray, ray_by_plane * plane_by_raw))
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

/// The stereographic projection of a ray, and its Jacobian with respect to the ray.
#[inline]
fn plane_from_ray(ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    // With theta the angle to the axis: 1 / cos(theta), and 2 tan(theta/2) / tan(theta).
    let secant = libm::sqrt(1.0 + ray.norm_squared());
    let scale = 2.0 / (1.0 + secant);
    let change = -scale * scale / (2.0 * secant);
    let cross = change * ray.x * ray.y;
    let jacobian =
        Matrix2::new(scale + change * ray.x * ray.x, cross, cross, scale + change * ray.y * ray.y);
    (ray * scale, jacobian)
}

/// The ray at a point of the stereographic plane, which must be within 2 of its middle, and its
/// Jacobian with respect to the point.
#[inline]
fn ray_from_plane(plane: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let scale = 1.0 / (1.0 - 0.25 * plane.norm_squared());
    let change = 0.5 * scale * scale;
    let cross = change * plane.x * plane.y;
    let jacobian = Matrix2::new(
        scale + change * plane.x * plane.x,
        cross,
        cross,
        scale + change * plane.y * plane.y,
    );
    (plane * scale, jacobian)
}

/// A lens's raw pixel at a point of the stereographic plane, and its Jacobian; linear beyond
/// [`PLANE_MAX`].
fn raw_from_plane(lens: &Lens, plane: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let within = plane * (PLANE_MAX / plane.norm()).min(1.0);
    let (ray, ray_by_plane) = ray_from_plane(&within);
    let (raw_px, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
    let jacobian = raw_by_ray * ray_by_plane;
    (raw_px + jacobian * (plane - within), jacobian)
}

/// The point of the stereographic plane that a lens shows at a raw pixel, and its Jacobian.
fn plane_from_raw(lens: &Lens, raw_px: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let ray = lens.ray_from_raw(raw_px)?;
    let (plane, plane_by_ray) = plane_from_ray(&ray);
    let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
    Some((plane, plane_by_ray * raw_by_ray.try_inverse()?))
}

/// The part of the stereographic plane that the frame shows, and a margin; `None` where a pixel of
/// its border has no ray.
fn rays_of_frame(lens: &Lens, frame: &Rectangle) -> Option<Rectangle> {
    const STEPS: usize = 64;
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = Vector2::repeat(f64::NEG_INFINITY);
    for step in 0..=STEPS {
        let [right, bottom]: [f64; 2] = frame.end.into();
        let fraction = step as f64 / STEPS as f64;
        let (x, y) = (fraction * right, fraction * bottom);
        for raw_px in [[x, 0.0], [x, bottom], [0.0, y], [right, y]] {
            let (plane, _) = plane_from_ray(&lens.ray_from_raw(&raw_px.into())?);
            (low, high) = (low.inf(&plane), high.sup(&plane));
        }
    }
    let margin = (high - low) * MARGIN;
    Some(Rectangle { start: low - margin, end: high + margin })
}

/// A part of a plane.
struct Rectangle {
    start: Vector2<f64>,
    end: Vector2<f64>,
}

/// An affine map: the matrix's columns, and the image of zero.
#[derive(Debug, Clone)]
struct Affine {
    matrix: Matrix2<f64>,
    origin: Vector2<f64>,
}

impl Affine {
    /// From a function that is affine.
    fn of(function: impl Fn(&Vector2<f64>) -> Vector2<f64>) -> Self {
        let origin = function(&Vector2::zeros());
        let column = |axis: Vector2<f64>| function(&axis) - origin;
        let matrix = Matrix2::from_columns(&[column(Vector2::x()), column(Vector2::y())]);
        Self { matrix, origin }
    }

    #[inline]
    fn at(&self, from: &Vector2<f64>) -> Vector2<f64> {
        self.matrix * from + self.origin
    }
}

/// A map of the plane: an affine map plus a bicubic spline for each coordinate.
#[derive(Debug, Clone)]
struct Map {
    affine: Affine,
    /// The first sample.
    start: Vector2<f64>,
    /// Cells per unit.
    per_unit: Vector2<f64>,
    /// Columns and rows of coefficients: one beyond the samples on every side.
    lines: [usize; 2],
    /// Row by row, both coordinates of the value side by side. The affine part, which is by far the
    /// larger, is not in them: single precision then rounds by less than 0.0001 px.
    coefficients: [[f32; 2]; LENS_TABLE_COEFFICIENTS],
}

impl Map {
    const fn new() -> Self {
        Self {
            affine: Affine {
                matrix: Matrix2::new(0.0, 0.0, 0.0, 0.0),
                origin: Vector2::new(0.0, 0.0),
            },
            start: Vector2::new(0.0, 0.0),
            per_unit: Vector2::new(0.0, 0.0),
            lines: [0; 2],
            coefficients: [[0.0; 2]; LENS_TABLE_COEFFICIENTS],
        }
    }

    /// The value at a point and its Jacobian.
    #[inline]
    fn at(&self, from: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [(column, x, x_beyond), (row, y, y_beyond)] = array::from_fn(|axis| {
            let place = (from[axis] - self.start[axis]) * self.per_unit[axis];
            // One ring of coefficients lies outside, and the last sample begins no cell. A NaN
            // becomes 0, and stays a NaN in what lies beyond.
            let cells = self.lines[axis].saturating_sub(3) as u32;
            let end = f64::from(cells);
            let within = if place < end { place } else { end };
            let within = if place > 0.0 { within } else { 0.0 };
            let cell = (within as u32).min(cells.saturating_sub(1));
            let weights = Weights::at((within - f64::from(cell)) as f32);
            (cell as usize, weights, place - within)
        });
        let stride = 2 * self.lines[0];
        let corner = self.coefficients.as_flattened().get(row * stride + 2 * column..);
        let corner = corner.unwrap_or_default();
        // Across the rows first: four columns with two coordinates each are two registers.
        let [mut sum, mut slope] = [[0.0_f32; 8]; 2];
        for line in 0..4 {
            let four = corner.get(line * stride..).and_then(<[f32]>::first_chunk::<8>);
            let Some(four) = four else {
                return (Vector2::repeat(f64::NAN), Matrix2::repeat(f64::NAN));
            };
            for lane in 0..8 {
                sum[lane] += y.value[line] * four[lane];
                slope[lane] += y.slope[line] * four[lane];
            }
        }
        // Opaque to the compiler, which would otherwise tear the registers apart to add their parts
        // in another way, at twice the cost.
        let [sum, slope] = black_box([sum, slope]);
        let value = along(&sum, &x.value);
        let by_x = along(&sum, &x.slope);
        let by_y = along(&slope, &x.value);
        let [per_x, per_y]: [f64; 2] = self.per_unit.into();
        let jacobian = self.affine.matrix + Matrix2::from_columns(&[by_x * per_x, by_y * per_y]);
        (self.affine.at(from) + value + by_x * x_beyond + by_y * y_beyond, jacobian)
    }

    /// Becomes the spline of a function, given with its Jacobian, on a rectangle; `None` where the
    /// function has no value.
    fn fill(
        &mut self,
        on: &Rectangle,
        affine: &Affine,
        function: impl Fn(&Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)>,
    ) -> Option<()> {
        let size = on.end - on.start;
        let rows = libm::sqrt(LENS_TABLE_COEFFICIENTS as f64 * size.y / size.x) as usize;
        let rows = rows.clamp(LINE_MIN, LINE_MAX);
        let columns = (LENS_TABLE_COEFFICIENTS / rows).clamp(LINE_MIN, LINE_MAX);
        let last = [columns - 3, rows - 3];
        self.affine = affine.clone();
        self.start = on.start;
        self.per_unit = Vector2::from_fn(|axis, _| last[axis] as f64 / size[axis]);
        self.lines = [columns, rows];

        // What the affine part leaves, and its change from sample to sample.
        let (start, per_unit) = (self.start, self.per_unit);
        let rest = |column: usize, row: usize| {
            let place = Vector2::new(column as f64, row as f64).component_div(&per_unit);
            let from = start + place;
            let (value, jacobian) = function(&from)?;
            let mut slopes = jacobian - affine.matrix;
            for axis in 0..2 {
                slopes.column_mut(axis).unscale_mut(per_unit[axis]);
            }
            Some((value - affine.at(&from), slopes))
        };

        for row in 0..=last[1] {
            let mut lines = [[0.0; LINE_MAX]; 2];
            let mut ends = [Vector2::zeros(); 2];
            for column in 0..=last[0] {
                let (value, slopes) = rest(column, row)?;
                for (coordinate, line) in lines.iter_mut().enumerate() {
                    line[column + 1] = value[coordinate];
                }
                if column == 0 || column == last[0] {
                    ends[usize::from(column != 0)] = slopes.column(0).into_owned();
                }
            }
            for (coordinate, line) in lines.iter_mut().enumerate() {
                spline(&mut line[..columns], ends.map(|end| end[coordinate]))?;
                for (column, &value) in line[..columns].iter().enumerate() {
                    self.coefficients[(row + 1) * columns + column][coordinate] = value as f32;
                }
            }
        }

        // The change across the first and the last row, as splines along them.
        let mut across = [[[0.0; LINE_MAX]; 2]; 2];
        for (row, lines) in [0, last[1]].into_iter().zip(&mut across) {
            for column in 0..=last[0] {
                let (_, slopes) = rest(column, row)?;
                for (coordinate, line) in lines.iter_mut().enumerate() {
                    line[column + 1] = slopes[(coordinate, 1)];
                }
            }
            for line in lines {
                let start = 0.5 * (4.0 * line[2] - 3.0 * line[1] - line[3]);
                let end = &line[last[0] - 1..columns - 1];
                let end = 0.5 * (3.0 * end[2] - 4.0 * end[1] + end[0]);
                spline(&mut line[..columns], [start, end])?;
            }
        }
        let [first, last] = &across;
        for (coordinate, (starts, ends)) in first.iter().zip(last).enumerate() {
            for (column, (&start, &end)) in starts.iter().zip(ends).take(columns).enumerate() {
                self.spline_down(column, coordinate, [start, end])?;
            }
        }
        Some(())
    }

    /// Turns a column of samples into a spline's coefficients.
    fn spline_down(&mut self, column: usize, coordinate: usize, ends: [f64; 2]) -> Option<()> {
        let [columns, rows] = self.lines;
        let mut line = [0.0; LINE_MAX];
        for (row, value) in line[..rows].iter_mut().enumerate() {
            *value = self.coefficients[row * columns + column][coordinate].into();
        }
        spline(&mut line[..rows], ends)?;
        for (row, &value) in line[..rows].iter().enumerate() {
            self.coefficients[row * columns + column][coordinate] = value as f32;
        }
        Some(())
    }
}

/// Turns samples, which leave the first and the last place free, into the coefficients of the cubic
/// spline that has these values, and these slopes per sample at its ends. `None` where they are not
/// finite.
fn spline(line: &mut [f64], [start, end]: [f64; 2]) -> Option<()> {
    let last = line.len() - 2;
    // c[i-1] + 4 c[i] + c[i+1] = 6 f[i] with c[2] - c[0] = 2 start and the same at the end:
    // a tridiagonal system, eliminated from the start.
    let mut above = [0.0; LINE_MAX];
    for place in 1..=last {
        let (before, after) = match place {
            1 => (0.0, 2.0),
            _ if place == last => (2.0, 0.0),
            _ => (1.0, 1.0),
        };
        let end_slope = match place {
            1 => 2.0 * start,
            _ if place == last => -2.0 * end,
            _ => 0.0,
        };
        let pivot = 4.0 - before * above[place - 1];
        above[place] = after / pivot;
        let known = 6.0 * line[place] + end_slope;
        line[place] = (known - before * if place == 1 { 0.0 } else { line[place - 1] }) / pivot;
    }
    for place in (1..last).rev() {
        line[place] -= above[place] * line[place + 1];
    }
    line[0] = line[2] - 2.0 * start;
    line[last + 1] = line[last - 1] + 2.0 * end;
    line.iter().sum::<f64>().is_finite().then_some(())
}

/// The four cubic B-splines that are not zero in a cell, and their slopes.
struct Weights {
    value: [f32; 4],
    slope: [f32; 4],
}

impl Weights {
    /// At a place in the cell, 0 to 1.
    #[inline]
    fn at(place: f32) -> Self {
        const CONSTANT: [f32; 4] = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0, 0.0];
        const LINEAR: [f32; 4] = [-0.5, 0.0, 0.5, 0.0];
        const SQUARE: [f32; 4] = [0.5, -1.0, 0.5, 0.0];
        const CUBE: [f32; 4] = [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0];
        let value = array::from_fn(|line| {
            CONSTANT[line] + place * (LINEAR[line] + place * (SQUARE[line] + place * CUBE[line]))
        });
        let slope = array::from_fn(|line| {
            LINEAR[line] + place * (2.0 * SQUARE[line] + place * (3.0 * CUBE[line]))
        });
        black_box(Self { value, slope })
    }
}

/// The sum over four columns, for both coordinates.
#[inline]
fn along(columns: &[f32; 8], weights: &[f32; 4]) -> Vector2<f64> {
    let [a, b, c, d] = *weights;
    let (near, far) = ([a, a, b, b], [c, c, d, d]);
    let halves: [f32; 4] =
        array::from_fn(|lane| columns[lane] * near[lane] + columns[lane + 4] * far[lane]);
    Vector2::new((halves[0] + halves[2]).into(), (halves[1] + halves[3]).into())
}

#[cfg(test)]
mod tests;
