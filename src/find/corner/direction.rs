//! The two edges of a corner, its position from them, and its score.
//!
//! As in Geiger et al.: the two highest modes of the histogram of gradient orientations give the
//! edges, each of which is then turned so that the gradients along it are perpendicular to it (the
//! smallest eigenvector of their second moments). The point towards which all these edge elements
//! run is the position, accurate to about a quarter of a pixel. The score compares the window with
//! an ideal corner of these edges: four sectors, of which opposite ones are equally bright, and no
//! gradient except along the edges.

use core::f32::consts::PI;
use core::ops::Range;

use heapless::Vec;

use super::list::Corner;
use crate::model::image::{GreyImage, Pixel};

/// Radius of the largest window: a larger one costs more and does not improve the direction.
const HALF_MAX: usize = 9;
/// Radius of the smallest window: a smaller one says nothing about the edges.
const HALF_MIN: usize = 3;
const SIDE_MAX: usize = 2 * HALF_MAX + 1;

/// Bins of the histogram over half a turn, as in the paper.
const BINS: usize = 32;
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
/// Elements farther than this from the edge through the centre belong to the parallel edge of the
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

/// Gradients weaker than this fraction of the strongest are noise, or the flanks of the blur.
const GRADIENT_MIN: f32 = 0.15;

/// A pixel with a significant gradient.
#[derive(Clone, Copy)]
struct Element {
    /// From the centre of the window.
    offset: [f32; 2],
    gradient: [f32; 2],
    magnitude: f32,
    weight: f32,
}

type Elements = Vec<Element, { SIDE_MAX * SIDE_MAX }>;

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
    let mut elements = Elements::new();
    window.collect(&mut elements);
    let edges_rad = modes(&elements)?.map(|angle_rad| turned(&elements, angle_rad));
    let edges = edges_rad.map(|angle_rad| [libm::cosf(angle_rad), libm::sinf(angle_rad)]);
    if cross(edges[0], edges[1]).abs() < BETWEEN_EDGES_SINE_MIN {
        return None;
    }
    let shift = intersection(&elements, edges)?;
    let (levels, correlation) = window.compare(image, place, radius, edges, shift)?;
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

/// The gradients around a pixel. The window is round, with Gaussian weights, so that no direction
/// is favoured.
struct Window {
    /// From the pixel in the middle to the border.
    half: usize,
    /// Weight by the distance along x or y.
    gaussian: [f32; HALF_MAX + 1],
    /// The gradient along x and along y, and its magnitude.
    gradients: [[[f32; 3]; SIDE_MAX]; SIDE_MAX],
    /// The largest magnitude.
    strongest: f32,
}

impl Window {
    /// An empty window.
    #[inline]
    fn new(half: usize) -> Self {
        Self {
            half,
            gaussian: [0.0; HALF_MAX + 1],
            gradients: [[[0.0; 3]; SIDE_MAX]; SIDE_MAX],
            strongest: 0.0,
        }
    }

    /// Computes the gradients around a pixel, which must be farther from the frame's border than
    /// `half`.
    fn fill<P: Pixel>(&mut self, image: &GreyImage<'_, P>, [x, y]: [usize; 2]) {
        let (half, side) = (self.half, self.side());
        for (distance, weight) in self.gaussian.iter_mut().enumerate() {
            *weight = libm::expf(-2.0 * (distance * distance) as f32 / (half * half) as f32);
        }
        for (row, line) in self.gradients[..side].iter_mut().enumerate() {
            let y = y + row - half;
            let columns = columns_within(half, half, row);
            let x = x + columns.start - half;
            let above = &image.row(y - 1)[x..][..columns.len()];
            let below = &image.row(y + 1)[x..][..columns.len()];
            let here = &image.row(y)[x - 1..][..columns.len() + 2];
            let pixels = here.windows(3).zip(above.iter().zip(below));
            for (gradient, (here, (&above, &below))) in line[columns].iter_mut().zip(pixels) {
                let gx = value(here[2]) - value(here[0]);
                let gy = value(below) - value(above);
                let magnitude = libm::sqrtf(gx * gx + gy * gy);
                *gradient = [gx, gy, magnitude];
                self.strongest = self.strongest.max(magnitude);
            }
        }
    }

    fn side(&self) -> usize {
        2 * self.half + 1
    }

    /// Appends the pixels whose gradient exceeds the noise.
    #[inline]
    fn collect(&self, elements: &mut Elements) {
        let (half, side) = (self.half, self.side());
        let least = GRADIENT_MIN * self.strongest;
        for (row, line) in self.gradients[..side].iter().enumerate() {
            for column in columns_within(half, half, row) {
                let [gx, gy, magnitude] = line[column];
                if magnitude > least {
                    let (dx, dy) = (column.abs_diff(half), row.abs_diff(half));
                    let weight = self.gaussian[dx] * self.gaussian[dy];
                    let offset = [column as f32 - half as f32, row as f32 - half as f32];
                    let gradient = [gx, gy];
                    // There is room for every pixel of the window: this cannot fail.
                    let _ = elements.push(Element { offset, gradient, magnitude, weight });
                }
            }
        }
    }

    /// Compares the window with a corner of these edges, `shift` away from its middle. Returns the
    /// mean grey level of each of the four sectors, indexed by the signs of the distances from both
    /// edges, and the correlation of the gradient with the edges. `None` when a sector has no
    /// pixel.
    fn compare<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        [x, y]: [usize; 2],
        radius: usize,
        [edge0, edge1]: [[f32; 2]; 2],
        shift: [f32; 2],
    ) -> Option<([f32; 4], f32)> {
        let (half, side) = (self.half, self.side());
        let core = half.min(radius + 1);
        let mut sums = [[0.0_f32; 2]; 4];
        let mut moments = Moments::default();
        for (row, line) in self.gradients[..side].iter().enumerate() {
            let pixels = &image.row(y + row - half)[x - half..][..side];
            for column in columns_within(core, half, row) {
                let (pixel, gradient) = (pixels[column], line[column]);
                let (dx, dy) = (column.abs_diff(half), row.abs_diff(half));
                let weight = self.gaussian[dx] * self.gaussian[dy];
                let offset =
                    [column as f32 - half as f32 - shift[0], row as f32 - half as f32 - shift[1]];
                let (from0, from1) = (cross(edge0, offset), cross(edge1, offset));
                let distance = from0.abs().min(from1.abs());
                let on_edge = distance <= EDGE_HALF_WIDTH_PX;
                moments.add(if on_edge { 1.0 } else { -1.0 }, gradient[2]);
                if distance >= CLEAR_OF_EDGE_PX {
                    let sector = usize::from(from0 > 0.0) + 2 * usize::from(from1 > 0.0);
                    sums[sector][0] += weight * value(pixel);
                    sums[sector][1] += weight;
                }
            }
        }
        if sums.iter().any(|sum| sum[1] <= 0.0) {
            return None;
        }
        Some((sums.map(|sum| sum[0] / sum[1]), moments.correlation()))
    }
}

/// The columns of a row that lie inside a circle around the middle of a window, which is `half` from
/// its border.
fn columns_within(radius: usize, half: usize, row: usize) -> Range<usize> {
    let dy = row.abs_diff(half);
    let Some(square) = (radius * radius + 1).checked_sub(dy * dy) else { return 0..0 };
    let reach = square.isqrt().min(half);
    half - reach..half + reach + 1
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
    /// From the levels of [`Window::compare`].
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

fn value<P: Pixel>(pixel: P) -> f32 {
    pixel.into()
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

/// Directions of the two strongest edges, `[0, pi)`.
fn modes(elements: &Elements) -> Option<[f32; 2]> {
    let mut bins = [0.0_f32; BINS];
    for Element { gradient, magnitude, weight, .. } in elements {
        let mass = weight * magnitude;
        // The edge is perpendicular to the gradient: (-y, x), or turned by half a turn (y, -x).
        let position = half_turn(-gradient[0], gradient[1]) * BINS as f32;
        let bin = (position as usize).min(BINS - 1);
        let part = position - bin as f32;
        bins[bin] += mass * (1.0 - part);
        bins[(bin + 1) % BINS] += mass * part;
    }
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

/// The direction of (y, x) as a fraction of half a turn, `[0, 1)`: atan2 by a
/// polynomial with an error of 0.005 rad, twenty times finer than a bin.
fn half_turn(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let ratio = ax.min(ay) / ax.max(ay).max(f32::MIN_POSITIVE);
    let octant = ratio * (0.9724 - 0.1919 * ratio * ratio);
    let quadrant = if ay > ax { 0.5 * PI - octant } else { octant };
    let angle = if (x < 0.0) != (y < 0.0) { PI - quadrant } else { quadrant };
    let turn = angle / PI;
    if turn >= 1.0 { 0.0 } else { turn }
}

/// The direction turned so that the gradients along this edge are perpendicular to it.
fn turned(elements: &Elements, angle_rad: f32) -> f32 {
    let mut angle_rad = angle_rad;
    for _ in 0..2 {
        let edge = [libm::cosf(angle_rad), libm::sinf(angle_rad)];
        let (mut xx, mut xy, mut yy) = (0.0_f32, 0.0_f32, 0.0_f32);
        for element in elements.iter().filter(|element| is_along(element, edge)) {
            let [x, y] = element.gradient;
            xx += element.weight * x * x;
            xy += element.weight * x * y;
            yy += element.weight * y * y;
        }
        // The normal is the largest eigenvector of the moments; the edge is a quarter turn away.
        let normal_rad = 0.5 * libm::atan2f(2.0 * xy, xx - yy);
        angle_rad = normal_rad + 0.5 * PI;
    }
    // normal in [-pi/2, pi/2]: the edge in [0, pi].
    if angle_rad >= PI { 0.0 } else { angle_rad.max(0.0) }
}

/// Whether an element belongs to an edge of this direction.
fn is_along(element: &Element, edge: [f32; 2]) -> bool {
    let along = element.gradient[0] * edge[0] + element.gradient[1] * edge[1];
    along.abs() < ALONG_SINE_MAX * element.magnitude
}

/// The point towards which the edge elements run, relative to the centre of the window.
fn intersection(elements: &Elements, edges: [[f32; 2]; 2]) -> Option<[f32; 2]> {
    let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
    for element in elements {
        let Element { offset: [dx, dy], gradient: [x, y], weight, .. } = *element;
        // In the middle the gradient has no clear direction.
        let middle = dx * dx + dy * dy < 1.5;
        let is_own = |&edge: &[f32; 2]| {
            is_along(element, edge) && cross(edge, element.offset).abs() < OWN_EDGE_PX
        };
        if middle || !edges.iter().any(is_own) {
            continue;
        }
        let inward = x * dx + y * dy;
        xx += weight * x * x;
        xy += weight * x * y;
        yy += weight * y * y;
        bx += weight * x * inward;
        by += weight * y * inward;
    }
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

/// Sums for a correlation.
#[derive(Default)]
struct Moments {
    count: f32,
    a: f32,
    b: f32,
    aa: f32,
    ab: f32,
    bb: f32,
}

impl Moments {
    fn add(&mut self, a: f32, b: f32) {
        self.count += 1.0;
        self.a += a;
        self.b += b;
        self.aa += a * a;
        self.ab += a * b;
        self.bb += b * b;
    }

    /// Pearson's correlation; 0 where one side does not vary.
    fn correlation(&self) -> f32 {
        let covariance = self.count * self.ab - self.a * self.b;
        let spread =
            (self.count * self.aa - self.a * self.a) * (self.count * self.bb - self.b * self.b);
        if spread > 0.0 { covariance / libm::sqrtf(spread) } else { 0.0 }
    }
}
