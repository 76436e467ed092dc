//! The ring test, which selects the pixels to which the kernels are applied.
//!
//! Sixteen samples on a ring of 4 px around a pixel, and the pixel's four neighbours. At a
//! checkerboard corner opposite samples are equal, samples a quarter turn apart differ, and the
//! middle is as bright as the ring on average (the idea of Bennett and Lasenby's ChESS detector,
//! 2014). All arithmetic is in bytes, so that the compiler can vectorise it: rounded means and
//! absolute differences of bytes are single instructions on x86 and ARM.
//!
//! The response at a corner whose contrast is c is about c for right angles and c / 2 for the
//! sharpest wedges of a board tilted by 60 degrees. Noise makes it smaller, not larger: the noise
//! of the differences of opposite samples is subtracted, and outweighs that of the signal. The
//! disorder (the differences of opposite samples, and that of the middle from the ring) must stay
//! below half of the signal: half a pixel away from corners tilted by 60 degrees it is at most 0.4
//! of the signal; in clutter it is usually more.
//!
//! Every other pair of opposite samples comes first: where its larger difference over a quarter turn
//! does not exceed its disorder, as nearly everywhere, the other half of the ring is not looked at.
//! At the sharpest wedges at least one of these differences is the whole contrast.
//!
//! The frame is processed in tiles, once at full size and once at half size, for squares that are
//! blurred by more than a pixel or so.

use core::hint::black_box;

use heapless::Vec;

use crate::model::image::{GreyImage, Pixel};

/// Tile size, pixels of the level: small enough for the second-level cache, and wide
/// enough that the border costs little.
pub(super) const TILE_WIDTH: usize = 512;
pub(super) const TILE_HEIGHT: usize = 64;

/// Reach of the ring.
const RING: usize = 4;
/// A maximum is the largest of (2 MAXIMUM + 1)^2 responses.
const MAXIMUM: usize = 2;
const HALO: usize = RING + MAXIMUM;

/// A row of responses in whole [`Lanes`], and the pixels that these need.
const RESPONSE_BLOCKS: usize = (TILE_WIDTH + 2 * MAXIMUM).div_ceil(LANES);
const PIXELS_WIDTH: usize = RESPONSE_BLOCKS * LANES + 2 * RING;

/// Smallest response, in grey levels of 255. Rounding alone gives 2.
const RESPONSE_MIN: u8 = 5;

/// Most that rounding the means adds to twice the disorder.
const ROUNDING: u8 = 4;

/// Most candidates of one tile: one per 64 pixels, many times as many as a checkerboard of the
/// smallest squares has.
const CANDIDATES_MAX: usize = TILE_WIDTH * TILE_HEIGHT / 64;

/// Position of a maximum of the ring response, in pixels of the level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Candidate {
    pub(super) x: u16,
    pub(super) y: u16,
}

/// One tile: bytes, ring responses, and their maxima.
#[derive(Debug)]
pub(super) struct Tile {
    pixels: [[u8; PIXELS_WIDTH]; TILE_HEIGHT + 2 * HALO],
    responses: [[Lanes; RESPONSE_BLOCKS]; TILE_HEIGHT + 2 * MAXIMUM],
    candidates: Vec<Candidate, CANDIDATES_MAX>,
}

impl Tile {
    pub(super) const fn new() -> Self {
        Self {
            pixels: [[0; PIXELS_WIDTH]; TILE_HEIGHT + 2 * HALO],
            responses: [[[0; LANES]; RESPONSE_BLOCKS]; TILE_HEIGHT + 2 * MAXIMUM],
            candidates: Vec::new(),
        }
    }

    /// Finds the candidates of the tile at (`x0`, `y0`) of `width x height`
    /// pixels, all in pixels of the level, and returns them with the number
    /// that did not fit. Beyond the frame its border pixels are repeated.
    pub(super) fn search<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        level: usize,
        [x0, y0]: [usize; 2],
        [width, height]: [usize; 2],
    ) -> (&[Candidate], u32) {
        let (level_width, level_height) = (image.width() >> level, image.height() >> level);
        let shift = shift_to_bytes(image.white_level());
        for (row, pixels) in self.pixels[..height + 2 * HALO].iter_mut().enumerate() {
            let y = (y0 + row).saturating_sub(HALO).min(level_height - 1);
            // Columns of the tile that lie inside the frame.
            let first = HALO.saturating_sub(x0);
            let last = (level_width + HALO - x0).min(width + 2 * HALO);
            let inside = &mut pixels[first..last];
            let x = x0 + first - HALO;
            if level == 0 {
                fill_whole(inside, &image.row(y)[x..], shift);
            } else {
                fill_half(
                    inside,
                    &image.row(2 * y)[2 * x..],
                    &image.row(2 * y + 1)[2 * x..],
                    shift,
                );
            }
            let (left, right) = (pixels[first], pixels[last - 1]);
            pixels[..first].fill(left);
            pixels[last..].fill(right);
        }
        let blocks = (width + 2 * MAXIMUM).div_ceil(LANES);
        let mut answering = [0; TILE_HEIGHT + 2 * MAXIMUM];
        for (y, answering) in answering[..height + 2 * MAXIMUM].iter_mut().enumerate() {
            let rows: &[_; 2 * RING + 1] = self.pixels[y..][..2 * RING + 1]
                .try_into()
                .expect("the tile has a halo of RING rows");
            *answering = respond(rows, &mut self.responses[y][..blocks]);
        }
        self.candidates.clear();
        let mut dropped = 0;
        for y in 0..height {
            let responses = self.responses[y + MAXIMUM].as_flattened();
            for column in columns_of(answering[y + MAXIMUM]) {
                let response = responses[column];
                let Some(x) = column.checked_sub(MAXIMUM).filter(|&x| x < width) else { continue };
                if response > 0 && is_maximum(&self.responses, x, y, response) {
                    let candidate = Candidate { x: (x0 + x) as u16, y: (y0 + y) as u16 };
                    dropped += u32::from(self.candidates.push(candidate).is_err());
                }
            }
        }
        (&self.candidates, dropped)
    }
}

/// Bits to drop so that white fits into a byte.
fn shift_to_bytes(white_level: u16) -> u32 {
    (u16::BITS - white_level.leading_zeros()).saturating_sub(8)
}

/// A sample as a byte, white and above as 255.
#[inline(always)]
fn to_byte<P: Pixel>(pixel: P, shift: u32) -> u8 {
    let value: u32 = pixel.into();
    (value >> shift).min(255) as u8
}

fn fill_whole<P: Pixel>(bytes: &mut [u8], row: &[P], shift: u32) {
    let mut fill = |shift: u32| {
        for (byte, &pixel) in bytes.iter_mut().zip(row) {
            *byte = to_byte(pixel, shift);
        }
    };
    // Bytes are copied as they are.
    if shift == 0 { fill(0) } else { fill(shift) }
}

/// Means of 2 x 2 pixels, rounded twice.
fn fill_half<P: Pixel>(bytes: &mut [u8], upper: &[P], lower: &[P], shift: u32) {
    // Whole blocks and the rest; `upper` and `lower` are at least twice as long as `bytes`.
    let (blocks, rest) = bytes.as_chunks_mut::<LANES>();
    let whole = 2 * LANES * blocks.len();
    let uppers = upper[..whole].as_chunks::<{ 2 * LANES }>().0;
    let lowers = lower[..whole].as_chunks::<{ 2 * LANES }>().0;
    for ((block, upper), lower) in blocks.iter_mut().zip(uppers).zip(lowers) {
        let columns: [u8; 2 * LANES] =
            core::array::from_fn(|n| mean_of_2(to_byte(upper[n], shift), to_byte(lower[n], shift)));
        // Two neighbours are read as one word, which separates even and odd pixels without moving a
        // byte.
        for (byte, pair) in block.iter_mut().zip(columns.as_chunks::<2>().0) {
            let pair = u16::from_le_bytes(*pair);
            *byte = (((pair & 255) + (pair >> 8) + 1) >> 1) as u8;
        }
    }
    let (uppers, lowers) = (upper[whole..].chunks_exact(2), lower[whole..].chunks_exact(2));
    for ((byte, upper), lower) in rest.iter_mut().zip(uppers).zip(lowers) {
        let column = |n: usize| mean_of_2(to_byte(upper[n], shift), to_byte(lower[n], shift));
        *byte = mean_of_2(column(0), column(1));
    }
}

#[inline(always)]
fn mean_of_2(a: u8, b: u8) -> u8 {
    // Never below 0. With a check for that, the compiler would compute one lane at a time.
    (a | b).wrapping_sub((a ^ b) >> 1)
}

/// Whether a response is larger than its neighbours before it in reading order, and at least as
/// large as those after it.
fn is_maximum(responses: &[[Lanes; RESPONSE_BLOCKS]], x: usize, y: usize, response: u8) -> bool {
    let side = 2 * MAXIMUM + 1;
    for (dy, row) in responses[y..y + side].iter().enumerate() {
        for (dx, &other) in row.as_flattened()[x..x + side].iter().enumerate() {
            let before = (dy, dx) < (MAXIMUM, MAXIMUM);
            if other > response || (before && other == response) {
                return false;
            }
        }
    }
    true
}

/// Neighbouring pixels that are processed together: one vector register of x86 or ARM.
const LANES: usize = 16;
type Lanes = [u8; LANES];

/// Rounded means: one instruction.
#[inline(always)]
fn mean(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| mean_of_2(a[n], b[n]))
}

#[inline(always)]
fn difference(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n].abs_diff(b[n]))
}

#[inline(always)]
fn larger(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n].max(b[n]))
}

/// a + b, saturating at 255.
#[inline(always)]
fn sum(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n].saturating_add(b[n]))
}

/// a - b, saturating at 0.
#[inline(always)]
fn less(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|n| a[n].saturating_sub(b[n]))
}

/// What four pairs of opposite samples of the ring show, in steps of about 45 degrees.
struct Pairs {
    /// The mean of all samples.
    level: Lanes,
    /// The mean difference between opposite samples.
    disorder: Lanes,
    /// The differences between pairs a quarter turn apart.
    quarters: [Lanes; 2],
}

/// The rows of pixels around a row of responses; `self.0[RING]` is its own.
struct Rows<'a>(&'a [[u8; PIXELS_WIDTH]; 2 * RING + 1]);

impl Rows<'_> {
    /// The samples beside the pixels of a block.
    #[inline(always)]
    fn at(&self, block: usize, dx: isize, dy: isize) -> Lanes {
        let row = &self.0[RING.wrapping_add_signed(dy)];
        let start = (block * LANES + RING).wrapping_add_signed(dx);
        row[start..start + LANES].try_into().expect("LANES pixels")
    }

    /// The mean and the difference of two opposite samples.
    #[inline(always)]
    fn pair(&self, block: usize, (dx, dy): (isize, isize)) -> (Lanes, Lanes) {
        let (one, other) = (self.at(block, dx, dy), self.at(block, -dx, -dy));
        (mean(one, other), difference(one, other))
    }

    #[inline(always)]
    fn pairs(&self, block: usize, places: [(isize, isize); 4]) -> Pairs {
        let (mean_0, odd_0) = self.pair(block, places[0]);
        let (mean_1, odd_1) = self.pair(block, places[1]);
        let (mean_2, odd_2) = self.pair(block, places[2]);
        let (mean_3, odd_3) = self.pair(block, places[3]);
        Pairs {
            level: mean(mean(mean_0, mean_1), mean(mean_2, mean_3)),
            disorder: mean(mean(odd_0, odd_1), mean(odd_2, odd_3)),
            quarters: [difference(mean_0, mean_2), difference(mean_1, mean_3)],
        }
    }

    /// The mean of the four neighbours of each pixel.
    #[inline(always)]
    fn centre(&self, block: usize) -> Lanes {
        // The compiler would piece these pixels together from those that it has loaded for the ring,
        // which takes longer than loading them: [`black_box`] hides that some are the same.
        let [left, right, above, below] =
            [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(dx, dy)| black_box(self.at(block, dx, dy)));
        mean(mean(left, right), mean(above, below))
    }

    /// The response of a block.
    #[inline(always)]
    fn respond(&self, block: usize) -> Lanes {
        let main = self.pairs(block, [(4, 0), (3, 3), (0, 4), (-3, 3)]);
        let contrast = larger(main.quarters[0], main.quarters[1]);
        let promise = less(contrast, sum(main.disorder, [RESPONSE_MIN - 1; LANES]));
        if u128::from_ne_bytes(promise) == 0 {
            return [0; LANES];
        }
        let between = self.pairs(block, [(4, 2), (2, 4), (-2, 4), (-4, 2)]);
        let signal = mean(
            mean(main.quarters[0], main.quarters[1]),
            mean(between.quarters[0], between.quarters[1]),
        );
        let offset = difference(mean(main.level, between.level), self.centre(block));
        let disorder = sum(mean(main.disorder, between.disorder), offset);
        let over = less(sum(disorder, disorder), sum(signal, [ROUNDING; LANES]));
        let rest = less(less(signal, disorder), [RESPONSE_MIN - 1; LANES]);
        core::array::from_fn(|n| if over[n] == 0 && promise[n] > 0 { rest[n] } else { 0 })
    }
}

/// Ring responses of one row, `responses.len()` rounded up to whole [`Lanes`];
/// `rows[RING]` is its own row of pixels. Returns a bit for each block, 1 where it has a response
/// above 0.
fn respond(rows: &[[u8; PIXELS_WIDTH]; 2 * RING + 1], responses: &mut [Lanes]) -> u64 {
    const { assert!(RESPONSE_BLOCKS <= u64::BITS as usize) };
    let rows = Rows(rows);
    let mut answering = 0;
    for (block, response) in responses.iter_mut().enumerate() {
        *response = rows.respond(block);
        answering |= u64::from(u128::from_ne_bytes(*response) != 0) << block;
    }
    answering
}

/// The columns of the blocks whose bits are 1.
fn columns_of(blocks: u64) -> impl Iterator<Item = usize> {
    let mut rest = blocks;
    let first = core::iter::from_fn(move || {
        let block = (rest != 0).then(|| rest.trailing_zeros() as usize);
        rest &= rest.wrapping_sub(1);
        block
    });
    first.flat_map(|block| block * LANES..(block + 1) * LANES)
}

#[cfg(test)]
mod tests;
