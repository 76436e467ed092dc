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

/// The kernels of one size, by columns of the window; those beyond it weigh nothing. Rows above and
/// below the centre have the same weights.
#[derive(Debug, Clone, Copy)]
struct Size {
    radius: usize,
    /// Weights at each distance of the row from the centre.
    rows: [Row; RADIUS_MAX + 1],
    /// 1 left of the centre, and 1 right of it.
    sides: [[Lanes; BLOCKS_MAX]; 2],
    /// 1 / sum of a kernel of prototype 1, of prototype 2.
    norm: [f32; 2],
}

/// The weights of one row.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// The Gaussian.
    whole: [Lanes; BLOCKS_MAX],
    /// Inside the upper and lower wedges of prototype 2.
    inside: [Lanes; BLOCKS_MAX],
    /// Inside the wedges beside them. Pixels on the diagonal belong to none.
    beside: [Lanes; BLOCKS_MAX],
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
        let gaussian = |distance: usize| {
            let ratio = distance as f32 / sigma;
            libm::expf(-0.5 * ratio * ratio)
        };
        let mut gaussians = [0.0; RADIUS_MAX + 1];
        for (distance, weight) in gaussians[..=radius].iter_mut().enumerate() {
            *weight = gaussian(distance);
        }
        let none = [[0.0; LANES]; BLOCKS_MAX];
        let mut rows = [Row { whole: none, inside: none, beside: none }; RADIUS_MAX + 1];
        let mut sides = [none; 2];
        let (mut quadrant, mut wedge) = (0.0, 0.0);
        for column in 0..=2 * radius {
            let across = column.abs_diff(radius);
            let (block, lane) = (column / LANES, column % LANES);
            for (distance, row) in rows[..=radius].iter_mut().enumerate() {
                let weight = gaussians[distance] * gaussians[across];
                row.whole[block][lane] = weight;
                if across < distance {
                    row.inside[block][lane] = weight;
                    wedge += weight;
                } else if across > distance {
                    row.beside[block][lane] = weight;
                }
                if column < radius && distance > 0 {
                    quadrant += weight;
                }
            }
            if across > 0 {
                sides[usize::from(column > radius)][block][lane] = 1.0;
            }
        }
        Self { radius, rows, sides, norm: [1.0 / quadrant, 1.0 / wedge] }
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
        let [lefts, rights] = &self.sides;
        for block in 0..SIDE.div_ceil(LANES) {
            // Of the rows above the centre and of those below: all pixels, and those inside the
            // wedges; of all rows, those beside the wedges.
            let [mut above, mut below, mut upper, mut lower] = [[0.0; LANES]; 4];
            let mut beside = product(lanes(pixels[radius], block), self.rows[0].beside[block]);
            for (distance, row) in self.rows[..=radius].iter().enumerate().skip(1) {
                let up = lanes(pixels[radius - distance], block);
                let down = lanes(pixels[radius + distance], block);
                above = sum(above, product(up, row.whole[block]));
                below = sum(below, product(down, row.whole[block]));
                upper = sum(upper, product(up, row.inside[block]));
                lower = sum(lower, product(down, row.inside[block]));
                beside = sum(beside, product(sum(up, down), row.beside[block]));
            }
            let (left, right) = (lefts[block], rights[block]);
            sums[0] = sum(sums[0], product(above, left));
            sums[1] = sum(sums[1], product(below, right));
            sums[2] = sum(sums[2], product(above, right));
            sums[3] = sum(sums[3], product(below, left));
            sums[4] = sum(sums[4], upper);
            sums[5] = sum(sums[5], lower);
            sums[6] = sum(sums[6], product(beside, left));
            sums[7] = sum(sums[7], product(beside, right));
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
