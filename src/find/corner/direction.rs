//! The two edges of a corner, its position from them, and its score.
//!
//! As in Geiger et al.: the two highest modes of the histogram of gradient orientations give the
//! edges, each of which is then turned so that the gradients along it are perpendicular to it (the
//! smallest eigenvector of their second moments). The point towards which all these edge elements
//! run is the position, accurate to about a quarter of a pixel. The score compares the window with
//! an ideal corner of these edges: four sectors, of which opposite ones are equally bright, and no
//! gradient except along the edges.

use core::f32::consts::PI;
use core::hint::black_box;

use super::lanes::{LANES, Lanes, totals};
use super::list::Corner;
use super::window::{Block, HALF_MAX, Window};
use crate::model::image::{GreyImage, Pixel};

/// Radius of the smallest window: a smaller one says nothing about the edges.
const HALF_MIN: usize = 3;

/// Bins of the histogram over half a turn, as in the paper.
const BINS: usize = 32;
/// 1.5 * 2^23. Numbers of this size are whole, so that adding it rounds a small number; the lowest
/// bits are then the whole number.
const ROUNDING: f32 = 12_582_912.0;
/// The two edges are at least this many bins apart: 28 degrees. A right angle
/// tilted by 60 degrees is at least 53 degrees wide.
const BINS_APART: usize = 5;
/// Smallest weight of the second edge, relative to the first. Both edges of a corner have the same
/// contrast.
const SECOND_EDGE_MIN: f32 = 0.15;
/// A gradient belongs to an edge when it is within this angle of the edge's normal (sine).
const ALONG_SINE_MAX: f32 = 0.35;
/// Half the width of an edge in the template of the gradient, Geiger's value.
const EDGE_HALF_WIDTH_PX: f32 = 1.5;
/// Pixels farther than this from the edge through the centre belong to the parallel edge of the
/// next square.
const OWN_EDGE_PX: f32 = 3.5;
/// Largest distance of the position from the pixel of the best likelihood.
const SHIFT_MAX_PX: f32 = 2.0;
/// The blurred edge itself belongs to neither side: the pixels of a sector are at least this far
/// from both edges.
const CLEAR_OF_EDGE_PX: f32 = 0.75;
/// Smallest angle between the two edges (sine): 24 degrees.
const BETWEEN_EDGES_SINE_MIN: f32 = 0.4;
/// Smallest gap between the dark sectors and the bright ones, relative to the whole span. It is 1
/// at a perfect corner.
const GAP_MIN: f32 = 0.3;
/// Smallest correlation of the gradient with the edges.
const CORRELATION_MIN: f32 = 0.2;

/// The corner at a pixel of high likelihood, or `None` when the window around it does not show one.
pub(super) fn describe<P: Pixel>(
    image: &GreyImage<'_, P>,
    place: [usize; 2],
    radius: usize,
) -> Option<Corner> {
    let [x, y] = place;
    // One more pixel for the differences.
    let room = x.min(y).min(image.width() - 1 - x).min(image.height() - 1 - y);
    let half = (radius + 3).min(HALF_MAX).min(room.checked_sub(1)?);
    if half < HALF_MIN {
        return None;
    }
    let mut window = Window::new(half);
    window.fill(image, place);
    let edges_rad = modes(&window)?.map(|angle_rad| turned(&window, angle_rad));
    if libm::sinf(edges_rad[1] - edges_rad[0]).abs() < BETWEEN_EDGES_SINE_MIN {
        return None;
    }
    let edges = edges_rad.map(|angle_rad| [libm::cosf(angle_rad), libm::sinf(angle_rad)]);
    let shift = intersection(&window, edges)?;
    let (levels, correlation) = compare(&window, half.min(radius + 1), edges, shift)?;
    let sectors = Sectors::of(levels);
    if sectors.gap < GAP_MIN * sectors.span || sectors.span <= 0.0 || correlation < CORRELATION_MIN
    {
        return None;
    }
    Some(Corner {
        position_px: [x as f32 + shift[0], y as f32 + shift[1]],
        score: correlation * 0.5 * sectors.gap / f32::from(image.white_level()),
        edges_rad: sectors.in_order(edges_rad),
    })
}

/// Compares the window, as far as `reach` from its middle, with a corner of these edges, `shift`
/// away from the middle. Returns the mean grey level of each of the four sectors, indexed by the
/// signs of the distances from both edges, and the correlation of the gradient with the edges.
/// `None` when a sector has no pixel.
fn compare(
    window: &Window,
    reach: usize,
    [edge0, edge1]: [[f32; 2]; 2],
    shift: [f32; 2],
) -> Option<([f32; 4], f32)> {
    let mut sectors = [[Lanes::ZERO; 2]; 4];
    let none = Lanes::ZERO;
    let mut moments = Moments { count: none, a: none, b: none, ab: none, bb: none };
    for block in window.blocks_within(reach) {
        let inside = block.within(reach);
        let [x, y] = block.offset();
        let offset = [x - Lanes::all(shift[0]), y - Lanes::all(shift[1])];
        let (from0, from1) = (distances(edge0, offset), distances(edge1, offset));
        let distance = from0.abs().min(from1.abs());
        let on_edge = inside.where_less(distance, Lanes::all(EDGE_HALF_WIDTH_PX));
        moments.add(inside, on_edge, block.magnitude);
        let weight = block.weight * inside.where_less(Lanes::all(CLEAR_OF_EDGE_PX), distance);
        for (sector, weight) in sectors.iter_mut().zip(by_sector(weight, from0, from1)) {
            sector[0] += weight * block.brightness;
            sector[1] += weight;
        }
    }
    let sums = sectors.map(|sums| totals(&sums));
    if sums.iter().any(|sum| sum[1] <= 0.0) {
        return None;
    }
    Some((sums.map(|sum| sum[0] / sum[1]), moments.correlation()))
}

/// Weights distributed over the four sectors by the signs of the distances from both edges.
#[inline(always)]
fn by_sector(weight: Lanes, from0: Lanes, from1: Lanes) -> [Lanes; 4] {
    let beyond0 = weight.where_less(Lanes::ZERO, from0);
    let before0 = weight - beyond0;
    let beyond_both = beyond0.where_less(Lanes::ZERO, from1);
    let beyond1_only = before0.where_less(Lanes::ZERO, from1);
    [before0 - beyond1_only, beyond0 - beyond_both, beyond1_only, beyond_both]
}

/// The brightness of the four sectors between two edges: at a corner, one pair of opposite sectors
/// is dark and the other bright.
struct Sectors {
    /// From the brighter of the dark sectors to the darker of the bright ones; negative where
    /// opposite sectors do not form such pairs.
    gap: f32,
    /// From the darkest sector to the brightest.
    span: f32,
    /// Whether the pair between edge 0 and edge 1, left of edge 0 and right of edge 1, is dark.
    is_between_dark: bool,
}

impl Sectors {
    /// From the levels of [`compare`].
    fn of([behind, between, between_opposite, behind_opposite]: [f32; 4]) -> Self {
        // Sectors 1 and 2 lie on the positive side of one edge only: they are opposite each other,
        // as are 0 and 3.
        let swept = (between.min(between_opposite), between.max(between_opposite));
        let other = (behind.min(behind_opposite), behind.max(behind_opposite));
        let is_between_dark = swept.1 <= other.0;
        let gap = if is_between_dark { other.0 - swept.1 } else { swept.0 - other.1 };
        let span = swept.1.max(other.1) - swept.0.min(other.0);
        Self { gap, span, is_between_dark }
    }

    /// The edges in the order that [`Corner::edges_rad`] promises.
    fn in_order(&self, edges_rad: [f32; 2]) -> [f32; 2] {
        // For edges[0] < edges[1] the sweep from 0 to 1 has cross(edge0, offset) > 0 and
        // cross(edge1, offset) < 0; otherwise it passes pi, where an edge's direction reverses.
        let swept_by_increase = edges_rad[0] < edges_rad[1];
        match (self.is_between_dark, swept_by_increase) {
            (true, true) | (false, false) => edges_rad,
            _ => [edges_rad[1], edges_rad[0]],
        }
    }
}

/// The signed distances of points from a line of this direction through the origin.
#[inline(always)]
fn distances([x, y]: [f32; 2], offset: [Lanes; 2]) -> Lanes {
    offset[1] * x - offset[0] * y
}

/// Directions of the two strongest edges, `[0, pi)`.
fn modes(window: &Window) -> Option<[f32; 2]> {
    // A histogram for each lane, because additions to the same bin wait for each other.
    let mut bins = [Lanes::ZERO; BINS];
    for block in window.blocks() {
        let mass = block.edge_weight * block.magnitude;
        // The edge is perpendicular to the gradient: (-y, x), or turned by half a turn (y, -x).
        let [gx, gy] = block.gradient;
        let position = half_turn(Lanes::ZERO - gx, gy) * BINS as f32;
        // Half a bin less, rounded, is the bin before the position.
        let rounded = position - Lanes::all(0.5) + Lanes::all(ROUNDING);
        let part = position - (rounded - Lanes::all(ROUNDING));
        let next = mass * part;
        // [`black_box`] makes the compiler finish the vectors before it takes them apart.
        let [Lanes(rounded), Lanes(own), Lanes(next)] = black_box([rounded, mass - next, next]);
        for lane in 0..LANES {
            let bin = rounded[lane].to_bits() as usize % BINS;
            bins[bin].0[lane] += own[lane];
            bins[(bin + 1) % BINS].0[lane] += next[lane];
        }
    }
    let bins = totals(&bins);
    // Smoothed by 1 4 6 4 1, roughly the paper's mean shift of one bin.
    let at = |bin: usize, step: usize| bins[(bin + step) % BINS];
    let mut smooth = [0.0_f32; BINS];
    for (bin, value) in smooth.iter_mut().enumerate() {
        *value = 6.0 * at(bin, 0)
            + 4.0 * (at(bin, 1) + at(bin, BINS - 1))
            + at(bin, 2)
            + at(bin, BINS - 2);
    }
    let is_mode = |bin: usize| {
        smooth[bin] > smooth[(bin + BINS - 1) % BINS] && smooth[bin] >= smooth[(bin + 1) % BINS]
    };
    let is_far_from = |other: usize, bin: usize| {
        let apart = bin.abs_diff(other);
        apart.min(BINS - apart) >= BINS_APART
    };
    let strongest = |far_from: Option<usize>| {
        (0..BINS)
            .filter(|&bin| is_mode(bin) && far_from.is_none_or(|other| is_far_from(other, bin)))
            .max_by(|&a, &b| smooth[a].total_cmp(&smooth[b]))
    };
    let first = strongest(None)?;
    let second = strongest(Some(first))?;
    if smooth[second] < SECOND_EDGE_MIN * smooth[first] {
        return None;
    }
    Some([first, second].map(|bin| bin as f32 * (PI / BINS as f32)))
}

/// The direction of (y, x) as a fraction of half a turn, `[0, 1]`: atan2 by a
/// polynomial with an error of 0.005 rad, twenty times finer than a bin.
#[inline(always)]
fn half_turn(y: Lanes, x: Lanes) -> Lanes {
    let (ax, ay) = (x.abs(), y.abs());
    let ratio = ax.min(ay) / ax.max(ay).max(Lanes::all(f32::MIN_POSITIVE));
    let octant = ratio * (Lanes::all(0.9724 / PI) - ratio * ratio * (0.1919 / PI));
    // Without branches: |a - b| is a where b is 0, and b - a where b is more than a.
    let quadrant = (octant - Lanes::all(0.5).where_less(ax, ay)).abs();
    (quadrant - Lanes::all(1.0).where_less(x * y, Lanes::ZERO)).abs()
}

/// The direction turned so that the gradients along this edge are perpendicular to it.
fn turned(window: &Window, angle_rad: f32) -> f32 {
    let mut angle_rad = angle_rad;
    for _ in 0..2 {
        let edge = [libm::cosf(angle_rad), libm::sinf(angle_rad)];
        let [mut xx, mut xy, mut yy] = [Lanes::ZERO; 3];
        for block in window.blocks() {
            let [x, y] = block.gradient;
            let weight = weight_along(block, edge);
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
        }
        // The normal is the largest eigenvector of the moments; the edge is a quarter turn away.
        let [xx, xy, yy] = totals(&[xx, xy, yy]);
        let normal_rad = 0.5 * libm::atan2f(2.0 * xy, xx - yy);
        angle_rad = normal_rad + 0.5 * PI;
    }
    // normal in [-pi/2, pi/2]: the edge in [0, pi].
    if angle_rad >= PI { 0.0 } else { angle_rad.max(0.0) }
}

/// The weights of the gradients that belong to an edge of this direction, and 0 for the others.
#[inline(always)]
fn weight_along(block: &Block, edge: [f32; 2]) -> Lanes {
    let [x, y] = block.gradient;
    let along = x * edge[0] + y * edge[1];
    block.edge_weight.where_less(along.abs(), block.magnitude * ALONG_SINE_MAX)
}

/// The point towards which the edges' pixels run, relative to the centre of the window.
fn intersection(window: &Window, edges: [[f32; 2]; 2]) -> Option<[f32; 2]> {
    let [mut xx, mut xy, mut yy, mut bx, mut by] = [Lanes::ZERO; 5];
    for block in window.blocks() {
        let ([x, y], [dx, dy]) = (block.gradient, block.offset());
        let own = edges.map(|edge| {
            let distance = distances(edge, [dx, dy]).abs();
            weight_along(block, edge).where_less(distance, Lanes::all(OWN_EDGE_PX))
        });
        // In the middle the gradient has no clear direction.
        let weight = own[0].max(own[1]).where_less(Lanes::all(1.5), dx * dx + dy * dy);
        let inward = x * dx + y * dy;
        let (wx, wy) = (weight * x, weight * y);
        xx += wx * x;
        xy += wx * y;
        yy += wy * y;
        bx += wx * inward;
        by += wy * inward;
    }
    let [xx, xy, yy, bx, by] = totals(&[xx, xy, yy, bx, by]);
    let determinant = xx * yy - xy * xy;
    let trace = xx + yy;
    // This bounds the ratio of the eigenvalues: below it one edge is missing.
    if determinant <= 0.01 * trace * trace {
        return None;
    }
    let shift = [(yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant];
    let length_square = shift[0] * shift[0] + shift[1] * shift[1];
    (length_square <= SHIFT_MAX_PX * SHIFT_MAX_PX).then_some(shift)
}

/// Sums for the correlation of two variables of which one, a, is 0 or 1.
struct Moments {
    count: Lanes,
    a: Lanes,
    b: Lanes,
    ab: Lanes,
    bb: Lanes,
}

impl Moments {
    /// Adds the lanes where `inside` is 1; where it is 0, `a` must be 0 as well.
    #[inline(always)]
    fn add(&mut self, inside: Lanes, a: Lanes, b: Lanes) {
        let b = b * inside;
        self.count += inside;
        self.a += a;
        self.b += b;
        self.ab += a * b;
        self.bb += b * b;
    }

    /// Pearson's correlation; 0 where one side does not vary.
    fn correlation(&self) -> f32 {
        let [count, a, b, ab, bb] = totals(&[self.count, self.a, self.b, self.ab, self.bb]);
        let covariance = count * ab - a * b;
        let spread = (count * a - a * a) * (count * bb - b * b);
        if spread > 0.0 { covariance / libm::sqrtf(spread) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests;
