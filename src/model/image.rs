//! A borrowed grey picture with a row stride.
//!
//! The pipeline never owns pixels: the camera driver's buffer, a file's frame or a flash page is
//! borrowed for the duration of one step. Construction checks the sizes once; afterwards every row
//! has `width` pixels.

use core::hint::black_box;

use crate::limits::{FRAME_SIDE_PX_MAX, FRAME_SIDE_PX_MIN};

/// What a processor loads from memory at once; where it is more or less, only speed differs.
const CACHE_LINE_BYTES: usize = 64;

/// Largest rectangle that [`GreyImage::fetch`] loads: a target 300 px wide and high, with 8-bit
/// pixels, which a cache of the second level holds.
const FETCHED_BYTES_MAX: usize = 128 * 1024;

/// A grey sample: 8 bits, or up to 16 bits in a 16-bit word.
pub trait Pixel: Copy + Into<f32> + Into<u32> + Send + Sync + 'static {}

impl Pixel for u8 {}
impl Pixel for u16 {}

/// Why pixels and sizes do not make a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageError {
    /// A side is outside [`FRAME_SIDE_PX_MIN`]`..=`[`FRAME_SIDE_PX_MAX`].
    Size,
    /// The stride is shorter than a row.
    Stride,
    /// Fewer pixels than the rows need.
    TooShort,
    /// White is 0.
    WhiteLevel,
}

impl core::fmt::Display for ImageError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Size => write!(
                formatter,
                "a side of the frame is not within {FRAME_SIDE_PX_MIN} to {FRAME_SIDE_PX_MAX} px"
            ),
            Self::Stride => formatter.write_str("the stride is shorter than a row"),
            Self::TooShort => formatter.write_str("there are fewer pixels than the rows need"),
            Self::WhiteLevel => formatter.write_str("the white level is 0"),
        }
    }
}

impl core::error::Error for ImageError {}

/// A borrowed grey picture.
///
/// `pixels[y * stride + x]` is the sample at column `x`, row `y`; pixel (0, 0)
/// is the top-left one and its coordinates are those of its centre.
#[derive(Debug, Clone, Copy)]
pub struct GreyImage<'a, P = u8> {
    pixels: &'a [P],
    width: usize,
    height: usize,
    stride: usize,
    white_level: u16,
}

impl<'a> GreyImage<'a, u8> {
    /// An 8-bit picture; `stride` is in pixels. White is 255.
    ///
    /// # Errors
    /// [`ImageError`] when the sizes do not fit the pixels or the limits.
    pub fn new(
        pixels: &'a [u8],
        width: usize,
        height: usize,
        stride: usize,
    ) -> Result<Self, ImageError> {
        Self::with_white_level(pixels, width, height, stride, 255)
    }
}

impl<'a, P: Pixel> GreyImage<'a, P> {
    /// A picture whose brightest possible sample is `white_level` (1023 for
    /// 10-bit samples in 16-bit words); `stride` is in pixels.
    ///
    /// # Errors
    /// [`ImageError`] when the sizes do not fit the pixels or the limits.
    pub fn with_white_level(
        pixels: &'a [P],
        width: usize,
        height: usize,
        stride: usize,
        white_level: u16,
    ) -> Result<Self, ImageError> {
        let sides = usize::from(FRAME_SIDE_PX_MIN)..=usize::from(FRAME_SIDE_PX_MAX);
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(ImageError::Size);
        }
        if stride < width {
            return Err(ImageError::Stride);
        }
        // The last row may end with its last pixel: padding after it is not needed.
        let needed = stride.checked_mul(height - 1).and_then(|rows| rows.checked_add(width));
        if needed.is_none_or(|needed| pixels.len() < needed) {
            return Err(ImageError::TooShort);
        }
        if white_level == 0 {
            return Err(ImageError::WhiteLevel);
        }
        Ok(Self { pixels, width, height, stride, white_level })
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The brightest possible sample.
    #[must_use]
    pub fn white_level(&self) -> u16 {
        self.white_level
    }

    /// Row `y`, exactly [`width`](Self::width) pixels.
    ///
    /// # Panics
    /// When `y` is not below the height: a caller's bug.
    #[must_use]
    pub fn row(&self, y: usize) -> &'a [P] {
        assert!(y < self.height, "row {y} of {}", self.height);
        &self.pixels[y * self.stride..][..self.width]
    }

    /// The pixels of row `y` from column `x` on, as many as are asked for; `None` where the row has
    /// fewer, or there is no such row.
    #[inline]
    #[must_use]
    pub fn span<const COUNT: usize>(&self, x: usize, y: usize) -> Option<&'a [P; COUNT]> {
        if x + COUNT > self.width {
            return None;
        }
        self.pixels.get(y * self.stride + x..)?.first_chunk()
    }

    /// One pixel.
    ///
    /// # Panics
    /// When it lies beyond the last row: a caller's bug.
    #[inline]
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> P {
        self.pixels[y * self.stride + x]
    }

    /// Loads a rectangle, as far as it is inside the frame, into the processor's cache, by reading
    /// one pixel of each cache line.
    ///
    /// A frame that has just been captured is in main memory, not in the cache. Calculations read it
    /// a few pixels at a time, and so wait for memory again and again; these reads do not depend on
    /// each other, so that memory answers many of them at once. Nothing but speed depends on them.
    ///
    /// A rectangle larger than [`FETCHED_BYTES_MAX`] is not loaded: its first pixels might leave the
    /// cache before they are used.
    pub(crate) fn fetch(&self, [left_px, top_px]: [f64; 2], [right_px, bottom_px]: [f64; 2]) {
        let line = CACHE_LINE_BYTES / size_of::<P>();
        // One more line, because the first may begin before the rectangle.
        let columns = left_px as usize..(right_px as usize).saturating_add(line).min(self.width);
        let rows = top_px as usize..(bottom_px as usize).saturating_add(1).min(self.height);
        if columns.len() * rows.len() * size_of::<P>() > FETCHED_BYTES_MAX {
            return;
        }
        let mut all = 0;
        for row in rows {
            let pixels = self.row(row).get(columns.clone()).unwrap_or_default();
            for &pixel in pixels.iter().step_by(line) {
                all |= Into::<u32>::into(pixel);
            }
        }
        // Without a use of the pixels, the compiler would leave out the reads.
        black_box(all);
    }

    /// The integer centre pixel of a square window of `radius` around a
    /// sub-pixel position, or `None` when the window is not wholly inside (or
    /// the position is not a number).
    #[must_use]
    pub fn window_centre(&self, position_px: [f64; 2], radius: usize) -> Option<(usize, usize)> {
        let [x, y] = position_px;
        let radius_px = radius as f64;
        let inside = |value: f64, side: usize| {
            value >= radius_px - 0.5 && value < (side - 1) as f64 - radius_px + 0.5
        };
        if !inside(x, self.width) || !inside(y, self.height) {
            return None;
        }
        Some(((x + 0.5) as usize, (y + 0.5) as usize))
    }

    /// The mean of 3 x 3 pixels around a sub-pixel position; `None` when they are not all inside.
    #[must_use]
    pub fn mean_around(&self, position_px: [f64; 2]) -> Option<f32> {
        let (column, row) = self.window_centre(position_px, 1)?;
        let mut sum = 0.0;
        for row in row - 1..=row + 1 {
            for &pixel in &self.row(row)[column - 1..=column + 1] {
                let value: f32 = pixel.into();
                sum += value;
            }
        }
        Some(sum / 9.0)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use super::*;
    use crate::test_support::Random;

    #[test]
    fn sizes_that_do_not_fit_are_refused() {
        let pixels = [0_u8; 64 * 64];
        let made = |width, height, stride| {
            GreyImage::new(&pixels, width, height, stride).map(|image| image.width())
        };
        assert_eq!(made(64, 64, 64), Ok(64));
        assert_eq!(made(63, 64, 64), Err(ImageError::Size));
        assert_eq!(made(64, usize::MAX, 64), Err(ImageError::Size));
        assert_eq!(made(65, 64, 64), Err(ImageError::Stride));
        assert_eq!(made(64, 65, 64), Err(ImageError::TooShort));
        assert_eq!(made(64, 64, usize::MAX), Err(ImageError::TooShort));
    }

    #[test]
    fn a_span_is_inside_a_row_or_nothing() {
        let pixels: [u8; 64 * 80] = core::array::from_fn(|place| (place % 251) as u8);
        let image = GreyImage::new(&pixels, 64, 79, 64).unwrap();
        assert_eq!(image.span(0, 0), Some(&[0, 1, 2]));
        assert_eq!(image.span(60, 78).map(|span: &[u8; 4]| span[3]), Some(image.pixel(63, 78)));
        assert_eq!(image.span::<4>(61, 0), None);
        assert_eq!(image.span::<1>(0, 80), None);
    }

    #[test]
    fn any_rectangle_can_be_fetched() {
        let pixels = [0_u8; 64 * 80];
        let image = GreyImage::new(&pixels, 64, 80, 64).unwrap();
        let places =
            [f64::NEG_INFINITY, -1.0, 0.0, 63.0, 79.0, 80.0, 1e30, f64::INFINITY, f64::NAN];
        for first in places {
            for last in places {
                image.fetch([first; 2], [last; 2]);
            }
        }
    }

    #[test]
    fn a_window_is_inside_or_nothing() {
        let pixels = [0_u8; 64 * 80];
        let image = GreyImage::new(&pixels, 64, 80, 64).unwrap();
        assert_eq!(image.window_centre([6.0, 6.0], 6), Some((6, 6)));
        assert_eq!(image.window_centre([57.4, 73.4], 6), Some((57, 73)));
        assert_eq!(image.window_centre([57.6, 73.0], 6), None);
        assert_eq!(image.window_centre([5.4, 20.0], 6), None);
        assert_eq!(image.window_centre([f64::NAN, 20.0], 6), None);
        assert_eq!(image.window_centre([20.0, 20.0], 40), None);
    }

    #[test]
    fn padding_after_the_last_pixel_is_not_needed() {
        let pixels = [0_u16; 63 * 70 + 64];
        let made = |count: usize, white_level: u16| {
            GreyImage::with_white_level(&pixels[..count], 64, 64, 70, white_level)
                .map(|image| image.white_level())
        };
        assert_eq!(made(pixels.len(), 1023), Ok(1023));
        assert_eq!(made(pixels.len() - 1, 1023), Err(ImageError::TooShort));
        assert_eq!(made(pixels.len(), 0), Err(ImageError::WhiteLevel));
    }

    #[test]
    fn each_fault_is_told_in_words() {
        for (error, words) in [
            (ImageError::Size, "a side of the frame is not within 64 to 4096 px"),
            (ImageError::Stride, "the stride is shorter than a row"),
            (ImageError::TooShort, "there are fewer pixels than the rows need"),
            (ImageError::WhiteLevel, "the white level is 0"),
        ] {
            assert_eq!(error.to_string(), words);
        }
    }

    #[test]
    fn a_window_reaches_its_radius_around_the_nearest_pixel() {
        let pixels = [0_u8; 64 * 80];
        let image = GreyImage::new(&pixels, 64, 80, 64).unwrap();
        for (quarters, radius) in
            (-8_i32..90 * 4).flat_map(|at| [0, 1, 6].map(|radius| (at, radius)))
        {
            let position_px = f64::from(quarters) / 4.0;
            // Half-way between two pixels, the one with the larger number.
            let nearest = (quarters + 2).div_euclid(4);
            let wanted = |side: i32| {
                (nearest - radius >= 0 && nearest + radius < side).then_some(nearest as usize)
            };
            let found = |position_px: [f64; 2]| image.window_centre(position_px, radius as usize);
            assert_eq!(found([position_px, 40.0]).map(|it| it.0), wanted(64), "{position_px}");
            assert_eq!(found([30.0, position_px]).map(|it| it.1), wanted(80), "{position_px}");
        }
    }

    #[test]
    fn a_mean_is_that_of_nine_pixels() {
        let mut random = Random::new(1);
        let pixels: [u16; 70 * 80] = core::array::from_fn(|_| (random.bits() % 1024) as u16);
        let image = GreyImage::with_white_level(&pixels, 64, 80, 70, 1023).unwrap();
        for _ in 0..2000 {
            let (column, row) = (random.bits() as usize % 64, random.bits() as usize % 80);
            let place = [column as f64, row as f64];
            let off_px = [random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)];
            let mean = image.mean_around([place[0] + off_px[0], place[1] + off_px[1]]);
            let is_inside = (1..63).contains(&column) && (1..79).contains(&row);
            let sum = || -> u16 {
                let row_above = (row - 1) * 70 + column - 1;
                [0, 1, 2, 70, 71, 72, 140, 141, 142].iter().map(|on| pixels[row_above + on]).sum()
            };
            assert_eq!(mean, is_inside.then(|| f32::from(sum()) / 9.0), "{column} {row}");
        }
    }
}
