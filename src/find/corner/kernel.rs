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

use super::lanes::{LANES, Lanes, totals};
use crate::model::image::{GreyImage, Pixel};

/// Radii of the kernels: multiples of [`LANES`].
pub(super) const RADII_PX: [usize; 3] = [4, 8, 12];
const RADIUS_MAX: usize = 12;

/// Blocks of [`LANES`] columns on each side of the centre of the widest window.
const BLOCKS_MAX: usize = RADIUS_MAX / LANES;

/// The kernels of one size. The Gaussian is separable: its weights by rows, and by blocks of columns
/// left of the centre and right of it. The column in the middle weighs 1.
#[derive(Debug, Clone, Copy)]
struct Size {
    radius: usize,
    /// Weight at each distance from the centre.
    gaussian: [f32; RADIUS_MAX + 1],
    sides: [[Columns; BLOCKS_MAX]; 2],
    /// 1 / sum of a kernel of prototype 1, of prototype 2.
    norm: [f32; 2],
}

/// A block of columns.
#[derive(Debug, Clone, Copy)]
struct Columns {
    /// Distances from the centre.
    across: Lanes,
    weight: Lanes,
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
        let mut sides = [[Columns { across: Lanes::ZERO, weight: Lanes::ZERO }; BLOCKS_MAX]; 2];
        for n in 0..radius {
            for (side, across) in [radius - n, n + 1].into_iter().enumerate() {
                let (block, lane) = (&mut sides[side][n / LANES], n % LANES);
                block.across.0[lane] = across as f32;
                block.weight.0[lane] = gaussian[across];
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
        Self { radius, gaussian, sides, norm: [1.0 / (half * half), 1.0 / wedge] }
    }

    /// `SIDE` is the side of the window, 2 radius + 1.
    fn likelihood<P: Pixel, const SIDE: usize>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
    ) -> f32 {
        let radius = SIDE / 2;
        let rows: [&[P; SIDE]; SIDE] = core::array::from_fn(|row| {
            image.span(x - radius, y + row - radius).expect("the window fits into the frame")
        });
        // Weighted sums in lanes: of the quadrants and of the wedges beside the centre, left and
        // right; and of the wedges above and below the centre. Pixels on the axes belong to no
        // quadrant, pixels on the diagonals to no wedge.
        let [mut above, mut below, mut beside] = [[Lanes::ZERO; 2]; 3];
        let [mut upper, mut lower] = [Lanes::ZERO; 2];
        for (side, blocks) in self.sides.iter().enumerate() {
            let first = side * (radius + 1);
            for (block, columns) in blocks[..radius / LANES].iter().enumerate() {
                let start = first + block * LANES;
                let pixels = |row: usize| {
                    Lanes::of(rows[row][start..].first_chunk().expect("LANES columns"))
                };
                let sums = self.sum_columns::<SIDE>(pixels, columns.across);
                above[side] += sums.above * columns.weight;
                below[side] += sums.below * columns.weight;
                beside[side] += sums.beside * columns.weight;
                upper += sums.upper * columns.weight;
                lower += sums.lower * columns.weight;
            }
        }
        // The column in the middle, which belongs to the wedges above and below the centre.
        let mut middle = [0.0; 2];
        for distance in 1..=radius {
            for (sum, row) in middle.iter_mut().zip([radius - distance, radius + distance]) {
                let pixel: f32 = rows[row][radius].into();
                *sum += self.gaussian[distance] * pixel;
            }
        }
        let [a1, b1, c1, d1, a2, b2, c2, d2] =
            totals(&[above[0], below[1], above[1], below[0], upper, lower, beside[0], beside[1]]);
        let upright = combine([a1, b1, c1, d1], self.norm[0]);
        upright.max(combine([a2 + middle[0], b2 + middle[1], c2, d2], self.norm[1]))
    }

    /// The sums along a block of columns, whose pixels in a row `pixels` returns.
    #[inline(always)]
    fn sum_columns<const SIDE: usize>(
        &self,
        pixels: impl Fn(usize) -> Lanes,
        across: Lanes,
    ) -> ColumnSums {
        let radius = SIDE / 2;
        let none = Lanes::ZERO;
        let beside = pixels(radius);
        let mut sums = ColumnSums { above: none, below: none, upper: none, lower: none, beside };
        for distance in 1..=radius {
            let up = pixels(radius - distance) * self.gaussian[distance];
            let down = pixels(radius + distance) * self.gaussian[distance];
            let limit = Lanes::all(distance as f32);
            sums.above += up;
            sums.below += down;
            sums.upper += up.where_less(across, limit);
            sums.lower += down.where_less(across, limit);
            sums.beside += (up + down).where_less(limit, across);
        }
        sums
    }
}

/// Sums along columns, weighted by rows.
struct ColumnSums {
    /// Above the centre, and below it.
    above: Lanes,
    below: Lanes,
    /// Of these, the pixels that are nearer to the middle column than to the middle row.
    upper: Lanes,
    lower: Lanes,
    /// The pixels that are nearer to the middle row.
    beside: Lanes,
}

/// The better of both signs; the arguments are the responses of A, B, C and D before normalisation.
fn combine([a, b, c, d]: [f32; 4], norm: f32) -> f32 {
    let mean = 0.25 * (a + b + c + d);
    let bright = (a.min(b) - mean).min(mean - c.max(d));
    let dark = (mean - a.max(b)).min(c.min(d) - mean);
    bright.max(dark) * norm
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::test_support::Random;

    #[test]
    fn the_best_of_all_sizes_is_what_is_reached() {
        let mut random = Random::new(2);
        let bytes: Vec<u8> = (0..64 * 64).map(|_| random.bits() as u8).collect();
        let image = GreyImage::new(&bytes, 64, 64, 64).unwrap();
        let kernels = Kernels::new();
        let mut is_best = [false; RADII_PX.len()];
        for y in 0..64 {
            for x in 0..64 {
                let of_sizes = [0, 1, 2].map(|size| kernels.of_size(&image, x, y, size));
                let most = of_sizes.into_iter().flatten().fold(f32::MIN, f32::max);
                let best = kernels.best(&image, x, y, 0..RADII_PX.len());
                assert_eq!(best.is_some(), most > f32::MIN, "{x} {y}");
                let Some((likelihood, size)) = best else {
                    assert!(!kernels.reaches(&image, x, y, f32::MIN), "{x} {y}");
                    continue;
                };
                assert_eq!((likelihood, of_sizes[size]), (most, Some(most)), "{x} {y}");
                assert!(kernels.reaches(&image, x, y, most), "{x} {y}");
                assert!(!kernels.reaches(&image, x, y, most.next_up()), "{x} {y}");
                is_best[size] = true;
            }
        }
        assert_eq!(is_best, [true; RADII_PX.len()]);
    }

    /// Half the contrast at a perfect corner, upright or turned by 45 degrees.
    #[test]
    fn the_likelihood_of_a_perfect_corner_is_half_its_contrast() {
        let kernels = Kernels::new();
        for is_upright in [true, false] {
            for first_is_bright in [true, false] {
                let bytes: Vec<u8> = (0..64 * 64)
                    .map(|place| {
                        let [dx, dy] = [place % 64 - 32, place / 64 - 32];
                        // What lies on an edge is as bright as the mean.
                        let sign: i32 = if is_upright { dx * dy } else { dx * dx - dy * dy };
                        match sign.signum() {
                            0 => 100,
                            1 if first_is_bright => 140,
                            -1 if !first_is_bright => 140,
                            _ => 60,
                        }
                    })
                    .collect();
                let image = GreyImage::new(&bytes, 64, 64, 64).unwrap();
                for size in 0..RADII_PX.len() {
                    let likelihood = kernels.of_size(&image, 32, 32, size).unwrap();
                    // Rounding of sums in single precision.
                    assert!((likelihood - 40.0).abs() < 1e-3, "{is_upright} {size}: {likelihood}");
                }
            }
        }
    }
}
