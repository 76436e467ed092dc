//! The corner likelihood of Geiger et al.: two prototypes of four kernels.
//!
//! Prototype 1 is a corner whose edges run along x and y, prototype 2 one that is turned by 45
//! degrees. Each has four kernels, the wedges A and B (opposite each other) and C and D, weighted
//! by a Gaussian whose sigma is half the radius, and normalised to a sum of 1. With mu the mean of
//! the four responses, a corner whose A and B are bright scores
//! `min(min(a, b) - mu, mu - max(c, d))`, and one whose A and B are dark the same with the signs
//! exchanged; the likelihood is the best over both signs, both prototypes and all sizes. It is half
//! the contrast at a perfect corner.

use core::ops::Range;

use crate::model::image::{GreyImage, Pixel};

/// Radii of the kernels.
pub(super) const RADII_PX: [usize; 3] = [4, 8, 12];
const RADIUS_MAX: usize = 12;

/// Columns that are processed together: one vector register of x86 or ARM.
const LANES: usize = 4;
type Lanes = [f32; LANES];

/// Blocks of [`LANES`] columns that hold the widest window.
const BLOCKS_MAX: usize = (2 * RADIUS_MAX + 1).div_ceil(LANES);

/// The kernels of one size. The Gaussian is separable: its weights by rows, and by blocks of columns
/// of the window; columns beyond the window weigh nothing.
#[derive(Debug, Clone, Copy)]
struct Size {
    radius: usize,
    /// Weight at each distance from the centre.
    gaussian: [f32; RADIUS_MAX + 1],
    columns: [Columns; BLOCKS_MAX],
    /// 1 / sum of a kernel of prototype 1, of prototype 2.
    norm: [f32; 2],
}

/// A block of columns.
#[derive(Debug, Clone, Copy)]
struct Columns {
    /// Distances from the centre.
    across: Lanes,
    /// Weights left of the centre, and right of it.
    left: Lanes,
    right: Lanes,
    /// Weights of all.
    all: Lanes,
}

/// All kernels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernels {
    sizes: [Size; RADII_PX.len()],
}

impl Kernels {
    pub(super) fn new() -> Self {
        Self { sizes: RADII_PX.map(Size::new) }
    }

    /// The largest likelihood at a pixel, in grey levels, over those of these sizes that fit into
    /// the frame, and the index of its size; `None` where none fits.
    pub(super) fn best<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
        sizes: Range<usize>,
    ) -> Option<(f32, usize)> {
        let mut best: Option<(f32, usize)> = None;
        for size in sizes {
            if let Some(likelihood) = self.of_size(image, x, y, size)
                && best.is_none_or(|(most, _)| likelihood > most)
            {
                best = Some((likelihood, size));
            }
        }
        best
    }

    /// Whether the likelihood at a pixel reaches `least` at any size; the first that does settles
    /// it.
    pub(super) fn reaches<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
        least: f32,
    ) -> bool {
        (0..self.sizes.len())
            .any(|size| self.of_size(image, x, y, size).is_some_and(|value| value >= least))
    }

    /// The likelihood at a pixel by the kernels of one size; `None` where they do not fit into
    /// the frame.
    pub(super) fn of_size<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
        size: usize,
    ) -> Option<f32> {
        let size = &self.sizes[size];
        let radius = size.radius;
        let inside = |value: usize, side: usize| value >= radius && value + radius < side;
        if !inside(x, image.width()) || !inside(y, image.height()) {
            return None;
        }
        Some(match radius {
            4 => size.likelihood::<P, 9>(image, x, y),
            8 => size.likelihood::<P, 17>(image, x, y),
            _ => size.likelihood::<P, 25>(image, x, y),
        })
    }
}

impl Size {
    fn new(radius: usize) -> Self {
        let sigma = radius as f32 / 2.0;
        let mut gaussian = [0.0; RADIUS_MAX + 1];
        for (distance, weight) in gaussian.iter_mut().enumerate().take(radius + 1) {
            let ratio = distance as f32 / sigma;
            *weight = libm::expf(-0.5 * ratio * ratio);
        }
        let none = [0.0; LANES];
        let mut columns =
            [Columns { across: none, left: none, right: none, all: none }; BLOCKS_MAX];
        for column in 0..=2 * radius {
            let across = column.abs_diff(radius);
            let (block, lane) = (&mut columns[column / LANES], column % LANES);
            block.across[lane] = across as f32;
            block.all[lane] = gaussian[across];
            if column < radius {
                block.left[lane] = gaussian[across];
            } else if column > radius {
                block.right[lane] = gaussian[across];
            }
        }
        let half: f32 = gaussian[1..=radius].iter().sum();
        // A wedge of prototype 2: at each distance d along its axis, the pixels that are nearer to
        // the axis than d.
        let mut wedge = 0.0;
        let mut across = gaussian[0];
        for weight in &gaussian[1..=radius] {
            wedge += weight * across;
            across += 2.0 * weight;
        }
        Self { radius, gaussian, columns, norm: [1.0 / (half * half), 1.0 / wedge] }
    }

    /// `SIDE` is the side of the window, 2 radius + 1.
    fn likelihood<P: Pixel, const SIDE: usize>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
    ) -> f32 {
        let radius = SIDE / 2;
        let pixels: [&[P]; SIDE] =
            core::array::from_fn(|row| &image.row(y + row - radius)[x - radius..]);
        // A, B, C, D of prototype 1, then of prototype 2, in partial sums.
        let mut sums = [[0.0; LANES]; 8];
        for (block, columns) in self.columns[..SIDE.div_ceil(LANES)].iter().enumerate() {
            // Sums along the columns. Of the rows above the centre and of those below: all pixels,
            // and those inside the wedges; of all rows, those beside the wedges. Pixels on the
            // diagonals are neither.
            let [mut above, mut below, mut upper, mut lower] = [[0.0; LANES]; 4];
            let mut beside = lanes(pixels[radius], block);
            for distance in 1..=radius {
                let weight = [self.gaussian[distance]; LANES];
                let up = product(lanes(pixels[radius - distance], block), weight);
                let down = product(lanes(pixels[radius + distance], block), weight);
                above = sum(above, up);
                below = sum(below, down);
                let limit = [distance as f32; LANES];
                upper = sum(upper, where_less(columns.across, limit, up));
                lower = sum(lower, where_less(columns.across, limit, down));
                beside = sum(beside, where_less(limit, columns.across, sum(up, down)));
            }
            let &Columns { left, right, all, .. } = columns;
            for (sum_of_all, more) in sums.iter_mut().zip([
                product(above, left),
                product(below, right),
                product(above, right),
                product(below, left),
                product(upper, all),
                product(lower, all),
                product(beside, left),
                product(beside, right),
            ]) {
                *sum_of_all = sum(*sum_of_all, more);
            }
        }
        let [a1, b1, c1, d1, a2, b2, c2, d2] = sums.map(|[a, b, c, d]| (a + b) + (c + d));
        let upright = combine([a1, b1, c1, d1], self.norm[0]);
        upright.max(combine([a2, b2, c2, d2], self.norm[1]))
    }
}

/// A block of the pixels of a row; 0 beyond the frame.
#[inline(always)]
fn lanes<P: Pixel>(row: &[P], block: usize) -> Lanes {
    let rest = &row[LANES * block..];
    match rest.first_chunk::<LANES>() {
        Some(pixels) => core::array::from_fn(|n| pixels[n].into()),
        None => core::array::from_fn(|n| rest.get(n).map_or(0.0, |&pixel| pixel.into())),
    }
}

#[inline(always)]
fn sum(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n] + b[n])
}

/// The values where `a` is less than `b`, and 0 elsewhere.
#[inline(always)]
fn where_less(a: Lanes, b: Lanes, values: Lanes) -> Lanes {
    core::array::from_fn(|n| if a[n] < b[n] { values[n] } else { 0.0 })
}

#[inline(always)]
fn product(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n] * b[n])
}

/// The better of both signs; the arguments are the responses of A, B, C and D before normalisation.
fn combine([a, b, c, d]: [f32; 4], norm: f32) -> f32 {
    let mean = 0.25 * (a + b + c + d);
    let bright = (a.min(b) - mean).min(mean - c.max(d));
    let dark = (mean - a.max(b)).min(c.min(d) - mean);
    bright.max(dark) * norm
}
