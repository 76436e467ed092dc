//! The fine step: a blurred step fitted to all pixels beside an edge.
//!
//! # Region
//!
//! Each pixel of the target speaks about the edge that is nearest to it. Of an edge
//! between two nodes these pixels fill a diamond whose long diagonal is the edge:
//!
//! ```text
//!     ·────────·         no farther from the edge than from the crossing lines,
//!     │╲ ┌──┐ ╱│         no farther out than where the squares are flat anyway,
//!     │ ╱    ╲ │         and clear of the nodes, where the crossing line's blur
//!   ──┼┤══════├┼──       bends the profile
//!     │ ╲    ╱ │
//!     │╱ └──┘ ╲│
//!     ·────────·
//! ```
//!
//! # Model
//!
//! With v the distance of a pixel from the expected line, w its place along the edge
//! (-1/2 to 1/2 from node to node) and s the blur's standard deviation,
//!
//! ```text
//! I = offset + contrast/2 * E((v - shift - w turn) / s),   E(x) = erf(x / sqrt 2)
//! ```
//!
//! to first order in shift, turn and ln s, so that five numbers are found by one linear
//! regression of the pixels on (1, E, dE/d ln s, dE/dv, w dE/dv). The pixel's own box is
//! part of s: its variance, 1/12 px^2, is the same in every direction. The lens's
//! curvature along the edge is taken out of v.
//!
//! # Information
//!
//! The columns are in such an order that the last two of the Cholesky factor of their
//! normal equations are those of shift and turn with the others eliminated: a whitener for
//! [`crate::solve`].

use core::ops::{Range, RangeInclusive};

use nalgebra::{SMatrix, SVector, Vector2};

use super::light::{Levels, Light};
use super::profile::blurred_step;
use super::{CONTRAST_MIN, SeenEdge};
use crate::image::{GreyImage, Pixel};
use crate::nodes::{Chord, Direction, Edge, Nodes};

/// How the camera shows a target's edges; what one frame finds serves the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// Standard deviation of the blur and the pixel's box together, raw pixels, of the
    /// edges along x. Motion blurs those across it more.
    pub x_blur_px: f64,
    /// Of the edges along y.
    pub y_blur_px: f64,
    /// How much larger dark squares look than they are, raw pixels on each side: ink
    /// spreads, and a camera's response need not be straight. Inside the grid it shifts
    /// edges by turns to and fro; on its border, all of them outwards.
    pub growth_px: f64,
    /// Whether the border was seen where it should be: the outermost squares of a board may
    /// be cut, or have no margin.
    pub has_border: bool,
}

/// Below this the samples cannot tell: only pictures sharpened by the camera ask for less.
const BLUR_PX_MIN: f64 = 0.4;
/// Above this a target is out of focus beyond use.
const BLUR_PX_MAX: f64 = 4.0;
/// One correction's bound, of ln s: the model is far from linear beyond it.
const LN_BLUR_STEP_MAX: f64 = 0.3;
/// More growth than this is none.
const GROWTH_PX_MAX: f64 = 1.0;

impl Appearance {
    /// The first guess: a good lens in focus, the pixel's box, and an exact print.
    pub const START: Self =
        Self { x_blur_px: 0.75, y_blur_px: 0.75, growth_px: 0.0, has_border: false };

    fn blur_px(&self, direction: Direction) -> f64 {
        match direction {
            Direction::X => self.x_blur_px,
            Direction::Y => self.y_blur_px,
        }
    }

    /// Corrected by what fitted edges say: in ln s of either blur, and in growth. Returns
    /// the larger relative change of a blur. What is not a number corrects nothing.
    pub fn correct(&mut self, [ln_x, ln_y]: [f64; 2], growth_px: f64) -> f64 {
        let mut largest = 0.0_f64;
        for (blur_px, correction) in [(&mut self.x_blur_px, ln_x), (&mut self.y_blur_px, ln_y)] {
            let correction = correction.clamp(-LN_BLUR_STEP_MAX, LN_BLUR_STEP_MAX);
            let corrected = (*blur_px * libm::exp(correction)).clamp(BLUR_PX_MIN, BLUR_PX_MAX);
            if corrected > 0.0 {
                largest = largest.max((corrected / *blur_px - 1.0).abs());
                *blur_px = corrected;
            }
        }
        let grown_px = self.growth_px + growth_px;
        if grown_px.abs() <= GROWTH_PX_MAX {
            self.growth_px = grown_px;
        }
        largest
    }
}

/// What the pixels of one edge say beside its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFit {
    /// Variance of the pixels about the model, grey levels squared.
    pub noise_variance: f32,
    /// How much ln s should change.
    pub ln_blur: f32,
    /// Its precision for unit noise.
    pub ln_blur_weight: f32,
}

/// Pixels nearer than this to a crossing line, in s, are not used: there it still
/// bends the profile by 0.8 % of the contrast, oddly, so that the edge does not move.
const CLEAR_OF_NODES: f64 = 2.65;

/// Farthest pixels from the edge, in s and px, within which there is all that moves and
/// enough flat to know light and dark by.
const WIDTH_IN_BLURS: f64 = 3.5;
const WIDTH_PX: f64 = 0.7;

/// Half of an edge's length that is looked at, at most: the work is bounded, however
/// near the target is.
const HALF_LENGTH_PX_MAX: f64 = 32.0;

/// Largest shift that the linear model is good for, in s.
const SHIFT_IN_BLURS_MAX: f64 = 1.0;

/// Fewest pixels of an edge: five numbers are fitted.
const PIXELS_MIN: f64 = 20.0;

/// Smallest pivot over its own column's square: below, the pixels do not tell two of the
/// model's columns apart.
const PIVOT_RATIO_MIN: f64 = 1e-3;

/// Fits one edge, expected where the nodes have it; its precision is that for pixels with
/// a noise of 1. `None` where no edge of its colours is, or too little of it.
pub fn fit<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    edge: &Edge,
    appearance: &Appearance,
    light: Option<&Light>,
    batch: &mut Batch,
) -> Option<(SeenEdge, PixelFit)> {
    let chord = nodes.chord(edge);
    let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let blur_px = appearance.blur_px(edge.direction);
    let region = Region::new(&chord, blur_px)?;
    let mut sums = region.sums(image, batch)?;
    let sign = if edge.is_right_light { 1.0 } else { -1.0 };
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    if let Some(levels) = light.and_then(|light| light.beside(nodes, edge, &middle_px)) {
        sums.add_levels(&levels, sign);
    }
    let regression = Regression::new(&sums)?;
    let half_contrast = regression.coefficients[STEP] * sign;
    let white_level = f64::from(image.white_level());
    if half_contrast < 0.5 * f64::from(CONTRAST_MIN) * white_level {
        return None;
    }
    // d I / d shift = -sign half_contrast / s dE/dx.
    let per_px = -sign * half_contrast / blur_px;
    let shift_px = regression.coefficients[SLOPE] / per_px;
    if shift_px.abs() > SHIFT_IN_BLURS_MAX * blur_px {
        return None;
    }
    // A whitener may change its sign as long as what was seen does.
    let whitener = regression.factor.map(|value| value * per_px.abs());
    let [shift, turn] = regression.seen.map(|value| value * per_px.signum());
    let growth = whitener[0] * sign * appearance.growth_px;
    let seen = SeenEdge::new(*edge, ends, &chord.right, whitener, [shift - growth, turn]);
    let pixels = PixelFit {
        noise_variance: regression.noise_variance as f32,
        ln_blur: (regression.coefficients[BLUR] / (sign * half_contrast)) as f32,
        ln_blur_weight: (regression.blur_pivot * half_contrast * half_contrast) as f32,
    };
    Some((seen, pixels))
}

/// Pixels handled together: one SSE2 or NEON register.
const LANES: usize = 4;
type Lanes = [f32; LANES];

/// Columns of the regression.
const COLUMNS: usize = 5;
const STEP: usize = 1;
const BLUR: usize = 2;
const SLOPE: usize = 3;
const TURN: usize = 4;

/// Inner products of the columns and the pixels, the upper triangle row by row, the
/// pixels last. The column of ones makes the first row plain sums.
const PRODUCTS: usize = (COLUMNS + 1) * (COLUMNS + 2) / 2;

struct Sums {
    /// Of what tells of the noise: pixels, and levels known beforehand.
    count: f64,
    products: [f64; PRODUCTS],
    /// Taken out of all pixels, so that the sums keep their digits.
    base: f64,
}

impl Sums {
    /// Adds what is known of both sides: so many pixels of the right one's level, where E
    /// is 1, and so many of the left one's, where it is -1. However much they weigh, of the
    /// noise they tell as two pixels do.
    fn add_levels(&mut self, levels: &Levels, sign: f64) {
        self.count += 2.0;
        let light = (levels.light - self.base, levels.light_weight, sign);
        let dark = (levels.dark - self.base, levels.dark_weight, -sign);
        for (level, weight, step) in [light, dark] {
            let mut columns = [0.0; COLUMNS + 1];
            (columns[0], columns[STEP], columns[COLUMNS]) = (1.0, step, level);
            let mut index = 0;
            for row in 0..=COLUMNS {
                for column in row..=COLUMNS {
                    self.products[index] += weight * columns[row] * columns[column];
                    index += 1;
                }
            }
        }
    }
}

/// The pixels of one edge, as a convex polygon about its middle.
struct Region {
    /// Whole pixel at the middle.
    origin: [usize; 2],
    /// From there to the exact middle.
    middle: [f32; 2],
    along: [f32; 2],
    per_length: f32,
    per_blur: f32,
    /// The lens's bend in the middle of the edge, to its right, px.
    bend_px: f32,
    /// Rows of the polygon, above and below the origin.
    reach_rows: f32,
    sides: [HalfPlane; 8],
}

/// `normal . (pixel - middle) <= distance`, solved for x.
#[derive(Clone, Copy)]
struct HalfPlane {
    /// x <= (or >=) at + by_y y.
    at: f32,
    by_y: f32,
    bounds_above: bool,
}

impl HalfPlane {
    fn new(normal: Vector2<f64>, distance: f64) -> Self {
        // A side along the rows bounds x nowhere, or so far out that another does.
        const FLATTEST: f64 = 1e-6;
        let x =
            if normal.x.abs() < FLATTEST { libm::copysign(FLATTEST, normal.x) } else { normal.x };
        Self { at: (distance / x) as f32, by_y: (-normal.y / x) as f32, bounds_above: x > 0.0 }
    }
}

impl Region {
    /// `None` where the blur leaves nothing of the edge, or it is outside every frame.
    fn new(chord: &Chord, blur_px: f64) -> Option<Self> {
        let chord_px = chord.end_px - chord.start_px;
        let length_px = chord_px.norm();
        let along = chord_px / length_px;
        let right = chord.right;
        let middle_px = (chord.start_px + chord.end_px) * 0.5;
        let across = chord.across_px / chord.across_px.norm();
        let spacing_px = chord.across_px.dot(&right).abs();
        // Distances from the crossing lines shrink by the sine of the angle to them.
        let sine = across.dot(&right);
        let (across, sine) = if sine < 0.0 { (-across, -sine) } else { (across, sine) };
        // The crossing lines' normal, along the edge.
        let crossing = Vector2::new(across.y, -across.x);
        let half_length_px = 0.5 * length_px;
        let used_px = (half_length_px - CLEAR_OF_NODES * blur_px / sine).min(HALF_LENGTH_PX_MAX);
        let width_px = (WIDTH_IN_BLURS * blur_px + WIDTH_PX).min(0.5 * spacing_px);
        // Written so that a NaN is refused, which `min` passes over.
        let is_usable = used_px > 0.7 && width_px > 1.0 && sine > 0.0 && blur_px.is_finite();
        let is_near = middle_px.iter().all(|value| (0.0..65_536.0).contains(value));
        if !is_usable || !is_near {
            return None;
        }
        // Neither near a crossing line, nor far from this one, nor nearer to a crossing one.
        let (clear_px, diagonal_px) = (sine * used_px, sine * half_length_px);
        let sides = [
            HalfPlane::new(crossing, clear_px),
            HalfPlane::new(-crossing, clear_px),
            HalfPlane::new(right, width_px),
            HalfPlane::new(-right, width_px),
            HalfPlane::new(right + crossing, diagonal_px),
            HalfPlane::new(right - crossing, diagonal_px),
            HalfPlane::new(-right + crossing, diagonal_px),
            HalfPlane::new(-right - crossing, diagonal_px),
        ];
        let origin = [middle_px.x as usize, middle_px.y as usize];
        let reach_rows = used_px * along.y.abs() + width_px / sine * across.y.abs();
        Some(Self {
            origin,
            middle: [
                (middle_px.x - origin[0] as f64) as f32,
                (middle_px.y - origin[1] as f64) as f32,
            ],
            along: [along.x as f32, along.y as f32],
            per_length: (1.0 / length_px) as f32,
            per_blur: (1.0 / blur_px) as f32,
            bend_px: chord.bend_px as f32,
            reach_rows: reach_rows as f32,
            sides,
        })
    }

    /// The rows inside a frame, from the origin.
    fn rows(&self, height: usize) -> RangeInclusive<i32> {
        let [_, origin] = self.origin.map(|place| place as i32);
        let [_, y] = self.middle;
        let first = libm::ceilf(y - self.reach_rows) as i32;
        let last = libm::floorf(y + self.reach_rows) as i32;
        first.max(-origin)..=last.min(height as i32 - 1 - origin)
    }

    /// The columns of row `y` (from the middle) inside a frame.
    #[inline]
    fn columns(&self, y: f32, width: usize) -> Range<i32> {
        let (mut low, mut high) = (-1e4_f32, 1e4_f32);
        for side in &self.sides {
            let x = side.at + side.by_y * y;
            if side.bounds_above {
                high = if x < high { x } else { high };
            } else {
                low = if x > low { x } else { low };
            }
        }
        let [origin, _] = self.origin.map(|place| place as i32);
        let [x, _] = self.middle;
        let start = origin + libm::ceilf(low + x) as i32;
        let end = origin + libm::floorf(high + x) as i32 + 1;
        start.max(0)..end.min(width as i32)
    }

    /// Inner products over all pixels of the region inside the frame.
    fn sums<P: Pixel>(&self, image: &GreyImage<'_, P>, batch: &mut Batch) -> Option<Sums> {
        let [origin_x, origin_y] = self.origin;
        if origin_x >= image.width() || origin_y >= image.height() {
            return None;
        }
        let base: f32 = image.row(origin_y)[origin_x].into();
        let mut products = Products::new();
        batch.count = 0;
        let [middle_x, middle_y] = self.middle;
        let [along_x, along_y] = self.along;
        for row in self.rows(image.height()) {
            let y = row as f32 - middle_y;
            let columns = self.columns(y, image.width());
            let (start, end) = (columns.start, columns.end);
            if start >= end {
                continue;
            }
            let pixels = &image.row((origin_y as i32 + row) as usize)[start as usize..];
            let x = (start - origin_x as i32) as f32 - middle_x;
            let line = Line {
                base,
                across: (along_x * y - along_y * x) * self.per_blur,
                across_per_pixel: -along_y * self.per_blur,
                place: (along_x * x + along_y * y) * self.per_length,
                place_per_pixel: along_x * self.per_length,
            };
            let count = (end - start) as usize;
            if batch.count + count > BATCH_PX {
                products.add(batch, self.bend_px * self.per_blur);
            }
            batch.push(pixels, count.min(BATCH_PX), &line);
        }
        products.add(batch, self.bend_px * self.per_blur);
        let products = products.total();
        Some(Sums { count: products[0], products, base: base.into() })
    }
}

/// A row of pixels: its grey base, and where its pixels are.
struct Line {
    base: f32,
    /// Distance of the first one from the chord, to its right, in blurs.
    across: f32,
    across_per_pixel: f32,
    /// Place along the edge of the first one, in its lengths from the middle.
    place: f32,
    place_per_pixel: f32,
}

/// Pixels handled at once, more than an ordinary edge has.
const BATCH_PX: usize = 256;

/// One number per pixel. A row's last lanes may reach beyond its end, to be overwritten by
/// the next row.
type Column = [f32; BATCH_PX + LANES];

/// Pixels of one edge, row after row without gaps, so that no lane is idle; a buffer that is
/// kept only because clearing it would cost as much as using it.
pub struct Batch {
    count: usize,
    grey: Column,
    across: Column,
    place: Column,
    step: Column,
    blur: Column,
    slope: Column,
    turn: Column,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// An empty one.
    #[must_use]
    pub const fn new() -> Self {
        const EMPTY: Column = [0.0; BATCH_PX + LANES];
        Self {
            count: 0,
            grey: EMPTY,
            across: EMPTY,
            place: EMPTY,
            step: EMPTY,
            blur: EMPTY,
            slope: EMPTY,
            turn: EMPTY,
        }
    }

    /// Appends the first `count` pixels of a row; there must be room for them.
    #[inline]
    fn push<P: Pixel>(&mut self, pixels: &[P], count: usize, line: &Line) {
        for done in (0..count).step_by(LANES) {
            let grey = &mut self.grey[self.count + done..][..LANES];
            let across = &mut self.across[self.count + done..][..LANES];
            let place = &mut self.place[self.count + done..][..LANES];
            if let Some(pixels) = pixels[done..].first_chunk::<LANES>() {
                for lane in 0..LANES {
                    let value: f32 = pixels[lane].into();
                    grey[lane] = value - line.base;
                }
            } else {
                // At the frame's right border.
                for (grey, &pixel) in grey.iter_mut().zip(&pixels[done..]) {
                    let value: f32 = pixel.into();
                    *grey = value - line.base;
                }
            }
            for lane in 0..LANES {
                let column = done as f32 + lane as f32;
                across[lane] = line.across + line.across_per_pixel * column;
                place[lane] = line.place + line.place_per_pixel * column;
            }
        }
        self.count += count;
    }
}

/// The inner products, in lanes.
struct Products([Lanes; PRODUCTS]);

impl Products {
    fn new() -> Self {
        Self([[0.0; LANES]; PRODUCTS])
    }

    /// Adds a batch and empties it; `bend`: the lens's, in blurs.
    fn add(&mut self, batch: &mut Batch, bend: f32) {
        let count = batch.count;
        batch.count = 0;
        let end = count.next_multiple_of(LANES);
        let Batch { grey, across, place, step, blur, slope, turn, .. } = batch;
        for start in (0..end).step_by(LANES) {
            let (across, place) = (at(across, start), at(place, start));
            let (step, blur) = (at_mut(step, start), at_mut(blur, start));
            let (slope, turn) = (at_mut(slope, start), at_mut(turn, start));
            for lane in 0..LANES {
                let w = place[lane];
                let v = across[lane] - bend * (1.0 - 4.0 * w * w);
                let (value, by_v) = blurred_step(v);
                step[lane] = value;
                slope[lane] = by_v;
                blur[lane] = -v * by_v;
                turn[lane] = by_v * w;
            }
        }
        // What lies past the last pixel takes no part.
        for column in [&mut *grey, step, blur, slope, turn] {
            column[count..end].fill(0.0);
        }
        // Few enough sums at a time that they stay in registers.
        let [one, s, b, p, t, g, ss, sb, sp, st, sg, bb, bp, bt, bg, pp, pt, pg, tt, tg, gg] =
            &mut self.0;
        one[0] += count as f32;
        for start in (0..end).step_by(LANES) {
            let [step, blur, slope, turn, grey] =
                [&*step, blur, slope, turn, grey].map(|column| at(column, start));
            add(s, step);
            add(b, blur);
            add(p, slope);
            add(t, turn);
            add(g, grey);
            add_product(ss, step, step);
            add_product(sb, step, blur);
            add_product(sp, step, slope);
            add_product(st, step, turn);
            add_product(sg, step, grey);
        }
        for start in (0..end).step_by(LANES) {
            let [blur, slope, turn, grey] =
                [&*blur, slope, turn, grey].map(|column| at(column, start));
            add_product(bb, blur, blur);
            add_product(bp, blur, slope);
            add_product(bt, blur, turn);
            add_product(bg, blur, grey);
            add_product(pp, slope, slope);
            add_product(pt, slope, turn);
            add_product(pg, slope, grey);
            add_product(tt, turn, turn);
            add_product(tg, turn, grey);
            add_product(gg, grey, grey);
        }
    }

    fn total(&self) -> [f64; PRODUCTS] {
        self.0.map(|lanes| lanes.iter().map(|&value| f64::from(value)).sum())
    }
}

#[inline(always)]
fn at(column: &Column, start: usize) -> &Lanes {
    column[start..].first_chunk().expect("a batch has room for its last lanes")
}

#[inline(always)]
fn at_mut(column: &mut Column, start: usize) -> &mut Lanes {
    column[start..].first_chunk_mut().expect("a batch has room for its last lanes")
}

#[inline(always)]
fn add(sum: &mut Lanes, values: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += values[lane];
    }
}

#[inline(always)]
fn add_product(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += a[lane] * b[lane];
    }
}

/// The regression's answer.
struct Regression {
    coefficients: [f64; COLUMNS],
    /// Upper triangle of the factor of shift and turn: 00, 01, 11.
    factor: [f64; 3],
    /// That factor times their coefficients.
    seen: [f64; 2],
    /// Square of the blur's pivot.
    blur_pivot: f64,
    noise_variance: f64,
}

impl Regression {
    /// `None` when the pixels are too few, or do not tell the columns apart.
    fn new(&Sums { products: ref sums, count, .. }: &Sums) -> Option<Self> {
        let mut normal = SMatrix::<f64, COLUMNS, COLUMNS>::zeros();
        let mut right = SVector::<f64, COLUMNS>::zeros();
        let mut index = 0;
        for row in 0..COLUMNS {
            for column in row..COLUMNS {
                normal[(row, column)] = sums[index];
                normal[(column, row)] = sums[index];
                index += 1;
            }
            right[row] = sums[index];
            index += 1;
        }
        let squares = sums[index];
        if count < PIXELS_MIN {
            return None;
        }
        let factor = normal.cholesky()?.unpack();
        for column in 0..COLUMNS {
            let pivot = factor[(column, column)] * factor[(column, column)];
            if pivot < PIVOT_RATIO_MIN * normal[(column, column)] {
                return None;
            }
        }
        let whitened = factor.solve_lower_triangular(&right)?;
        let coefficients = factor.tr_solve_lower_triangular(&whitened)?;
        let residual = (squares - whitened.norm_squared()).max(0.0);
        Some(Self {
            coefficients: coefficients.into(),
            factor: [factor[(SLOPE, SLOPE)], factor[(TURN, SLOPE)], factor[(TURN, TURN)]],
            seen: [whitened[SLOPE], whitened[TURN]],
            blur_pivot: factor[(BLUR, BLUR)] * factor[(BLUR, BLUR)],
            noise_variance: residual / (count - COLUMNS as f64),
        })
    }
}

#[cfg(test)]
mod tests;
