//! The pixels around a corner: their brightness, gradients and weights.
//!
//! The window is round, with Gaussian weights, so that no direction is favoured. Its rows consist of
//! whole blocks of [`LANES`] pixels, which may extend beyond the circle. Every sum over the window
//! is a sum over all blocks, with a weight of 0 for the pixels that do not belong to it: that is
//! faster than a branch for each pixel.

use heapless::Vec;

use super::lanes::{LANES, Lanes};
use crate::model::image::{GreyImage, Pixel};

/// Radius of the largest window: a larger one costs more and does not improve the direction.
pub(super) const HALF_MAX: usize = 9;
const SIDE_MAX: usize = 2 * HALF_MAX + 1;

/// Blocks of a square around the largest window.
const BLOCKS_MAX: usize = SIDE_MAX * SIDE_MAX.div_ceil(LANES);

/// Pixels of a row that take part in the gradients, and room for its last block.
const NEIGHBOURHOOD_WIDTH: usize = SIDE_MAX + 2 + LANES - 1;

/// Gradients weaker than this fraction of the strongest are noise, or the flanks of the blur.
const GRADIENT_MIN: f32 = 0.15;

/// Neighbouring pixels of a row.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// The first pixel's position from the centre of the window, x and y.
    first: [f32; 2],
    pub(super) brightness: Lanes,
    /// Along x and y.
    pub(super) gradient: [Lanes; 2],
    /// The gradient's length.
    pub(super) magnitude: Lanes,
    /// 0 outside the window.
    pub(super) weight: Lanes,
    /// The same where the gradient exceeds the noise, and 0 elsewhere.
    pub(super) edge_weight: Lanes,
}

impl Block {
    /// The pixels' positions from the centre of the window, x and y.
    #[inline(always)]
    pub(super) fn offset(&self) -> [Lanes; 2] {
        let [x, y] = self.first;
        [Lanes([x, x + 1.0, x + 2.0, x + 3.0]), Lanes::all(y)]
    }

    /// 1 for the pixels inside a circle around the centre of the window, and 0 for the others.
    #[inline(always)]
    pub(super) fn within(&self, radius: usize) -> Lanes {
        let [x, y] = self.offset();
        // Squared distances are whole numbers: one that exceeds the radius' square by 1 is inside.
        let limit = (radius * radius) as f32 + 1.5;
        Lanes::all(1.0).where_less(x * x + y * y, Lanes::all(limit))
    }
}

/// The pixels within `half` of a pixel.
pub(super) struct Window {
    half: usize,
    blocks: Vec<Block, BLOCKS_MAX>,
}

impl Window {
    /// An empty window.
    #[inline]
    pub(super) fn new(half: usize) -> Self {
        Self { half, blocks: Vec::new() }
    }

    /// Fills the window with the pixels around one, which must be farther from the frame's border
    /// than `half`.
    pub(super) fn fill<P: Pixel>(&mut self, image: &GreyImage<'_, P>, [x, y]: [usize; 2]) {
        let half = self.half;
        let grey = neighbourhood(image, [x, y], half + 1);
        // The Gaussian is separable: the same weights by columns and by rows.
        let mut gaussian = [0.0; SIDE_MAX + LANES];
        for distance in 0..=half {
            let ratio = distance as f32 / half as f32;
            let weight = libm::expf(-2.0 * ratio * ratio);
            (gaussian[half - distance], gaussian[half + distance]) = (weight, weight);
        }
        let mut strongest = Lanes::ZERO;
        for row in 0..=2 * half {
            let dy = row.abs_diff(half);
            // The square of the largest radius fits into a byte, whose root is looked up in a table.
            let reach = usize::from(((half * half + 1 - dy * dy) as u8).isqrt()).min(half);
            let [above, here, below] = [&grey[row], &grey[row + 1], &grey[row + 2]];
            for left in (half - reach..half + reach + 1).step_by(LANES) {
                let gx = block_of(here, left + 2) - block_of(here, left);
                let gy = block_of(below, left + 1) - block_of(above, left + 1);
                let mut block = Block {
                    first: [left, row].map(|place| place as f32 - half as f32),
                    brightness: block_of(here, left + 1),
                    gradient: [gx, gy],
                    magnitude: (gx * gx + gy * gy).sqrt(),
                    weight: block_of(&gaussian, left) * gaussian[row],
                    edge_weight: Lanes::ZERO,
                };
                let inside = block.within(half);
                block.weight = block.weight * inside;
                strongest = strongest.max(block.magnitude * inside);
                // There is room for the whole square: this cannot fail.
                let _ = self.blocks.push(block);
            }
        }
        let least = GRADIENT_MIN * strongest.0.into_iter().fold(0.0, f32::max);
        for block in &mut self.blocks {
            block.edge_weight = block.weight.where_less(Lanes::all(least), block.magnitude);
        }
    }

    /// All blocks, row by row.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The blocks of the rows within `reach` of the centre.
    pub(super) fn blocks_within(&self, reach: usize) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(move |block| block.first[1].abs() <= reach as f32)
    }
}

/// The brightness of the pixels around one, from `reach` columns and rows before it to as many after
/// it, and beyond to the end of the last block; 0 outside the frame.
fn neighbourhood<P: Pixel>(
    image: &GreyImage<'_, P>,
    [x, y]: [usize; 2],
    reach: usize,
) -> [[f32; NEIGHBOURHOOD_WIDTH]; SIDE_MAX + 2] {
    let mut grey = [[0.0; NEIGHBOURHOOD_WIDTH]; SIDE_MAX + 2];
    for (row, values) in grey[..=2 * reach].iter_mut().enumerate() {
        let (x, y) = (x - reach, y + row - reach);
        match image.span(x, y) {
            Some(pixels) => *values = pixels.map(Into::into),
            None => {
                for (value, &pixel) in values.iter_mut().zip(&image.row(y)[x..]) {
                    *value = pixel.into();
                }
            }
        }
    }
    grey
}

/// A block of a row's numbers.
#[inline(always)]
fn block_of(row: &[f32], start: usize) -> Lanes {
    Lanes(*row[start..].first_chunk().expect("a row has room for its last block"))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::find::corner::tests::plain::{PlainPixel, plain_window};
    use crate::test_support::Random;

    #[test]
    fn a_window_holds_each_pixel_of_its_circle_once() {
        let mut random = Random::new(1);
        let words: Vec<u16> = (0..66 * 70).map(|_| (random.bits() % 1024) as u16).collect();
        let image = GreyImage::with_white_level(&words, 65, 70, 66, 1023).unwrap();
        for half in 3..=HALF_MAX {
            // As near to the frame's borders as it may be, and inside.
            let reach = half + 1;
            for place in [[reach, reach], [64 - reach, reach], [reach, 69 - reach], [31, 40]] {
                let mut window = Window::new(half);
                window.fill(&image, place);
                let mut pixels = plain_window(&image, place, half);
                for block in window.blocks() {
                    let [Lanes(dx), Lanes(dy)] = block.offset();
                    for lane in 0..LANES {
                        let offset = [dx[lane], dy[lane]];
                        let [gx, gy] = block.gradient.map(|Lanes(values)| f64::from(values[lane]));
                        let [brightness, magnitude, weight, edge_weight] =
                            [block.brightness, block.magnitude, block.weight, block.edge_weight]
                                .map(|Lanes(values)| f64::from(values[lane]));
                        let is_here =
                            |pixel: &PlainPixel| pixel.offset.map(|value| value as f32) == offset;
                        let Some(n) = pixels.iter().position(is_here) else {
                            assert_eq!([weight, edge_weight], [0.0; 2], "{half} {offset:?}");
                            continue;
                        };
                        let pixel = pixels.swap_remove(n);
                        assert_eq!(brightness, pixel.brightness, "{half} {offset:?}");
                        assert_eq!([gx, gy], pixel.gradient, "{half} {offset:?}");
                        // Single precision.
                        for (ours, plain) in [
                            (magnitude, pixel.magnitude),
                            (weight, pixel.weight),
                            (edge_weight, pixel.edge_weight),
                        ] {
                            assert!((ours - plain).abs() <= 1e-6 * plain, "{half} {offset:?}");
                        }
                    }
                }
                assert!(pixels.is_empty(), "{half}: {}", pixels.len());
            }
        }
    }

    #[test]
    fn the_rows_within_a_reach_are_those_of_a_smaller_window() {
        let bytes = [90_u8; 64 * 64];
        let image = GreyImage::new(&bytes, 64, 64, 64).unwrap();
        let mut window = Window::new(HALF_MAX);
        window.fill(&image, [30, 30]);
        for reach in 3..=HALF_MAX {
            let mut rows = Vec::new();
            for block in window.blocks_within(reach) {
                let Lanes(dy) = block.offset()[1];
                let is_new = !rows.contains(&dy[0]);
                rows.extend(is_new.then_some(dy[0]));
            }
            let reach = reach as i32;
            let expected: Vec<f32> = (-reach..=reach).map(|row| row as f32).collect();
            assert_eq!(rows, expected);
        }
    }

    #[test]
    fn without_a_gradient_there_is_no_edge() {
        let bytes = [90_u8; 64 * 64];
        let image = GreyImage::new(&bytes, 64, 64, 64).unwrap();
        let mut window = Window::new(5);
        window.fill(&image, [30, 30]);
        assert!(window.blocks().iter().all(|block| block.edge_weight == Lanes::ZERO));
    }
}
