//! Where a frame's grey values lie in the first plane of its buffer.

use plumbline::config::PixelFormat;
use plumbline::image::{GreyImage, ImageError};

use crate::source::Pixels;

/// How samples lie in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// One byte each.
    Bytes,
    /// One 16-bit word each, little endian.
    Words {
        /// The brightest possible sample.
        white_level: u16,
    },
    /// One byte of each group.
    Every {
        /// Its place in the group.
        first: usize,
        /// The size of a group.
        step: usize,
    },
}

impl Samples {
    /// The samples of a format; `None` for those that are read from Video4Linux only. A plane of
    /// luma is the same as a picture of bytes.
    pub fn of(format: PixelFormat) -> Option<Self> {
        Some(match format {
            PixelFormat::Grey | PixelFormat::Nv12 => Self::Bytes,
            PixelFormat::Y10 => Self::Words { white_level: 1023 },
            PixelFormat::Y16 => Self::Words { white_level: u16::MAX },
            PixelFormat::Yuyv => Self::Every { first: 0, step: 2 },
            // Green is in the middle in both orders.
            PixelFormat::Rgb24 => Self::Every { first: 1, step: 3 },
            PixelFormat::Bayer8 | PixelFormat::Mjpeg => return None,
        })
    }
}

/// The picture in a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    pub size_px: (usize, usize),
    /// The distance between rows.
    pub stride_bytes: usize,
    pub samples: Samples,
}

impl Layout {
    /// The size of the buffer for a frame's luma, 0 if it can be read in place.
    pub fn copied_bytes(&self) -> usize {
        match self.samples {
            Samples::Every { .. } => self.size_px.0 * self.size_px.1,
            Samples::Bytes | Samples::Words { .. } => 0,
        }
    }

    /// Copies luma that cannot be read in place.
    pub fn copy_luma(&self, plane: &[u8], luma: &mut [u8]) {
        let Samples::Every { first, step } = self.samples else { return };
        let rows = luma.chunks_exact_mut(self.size_px.0);
        for (to, from) in rows.zip(plane.chunks(self.stride_bytes)) {
            for (sample, group) in to.iter_mut().zip(from.chunks_exact(step)) {
                *sample = group[first];
            }
        }
    }

    /// The picture: in `luma` if that was copied, otherwise in the plane itself.
    ///
    /// # Errors
    /// When the plane is too short, or its words or rows do not start on an even
    /// byte.
    pub fn pixels<'a>(&self, plane: &'a [u8], luma: &'a [u8]) -> Result<Pixels<'a>, ImageError> {
        let (width, height) = self.size_px;
        match self.samples {
            Samples::Bytes => {
                GreyImage::new(plane, width, height, self.stride_bytes).map(Pixels::Grey8)
            }
            Samples::Words { white_level } => {
                if !self.stride_bytes.is_multiple_of(2) {
                    return Err(ImageError::Stride);
                }
                let even = &plane[..plane.len() & !1];
                let words = bytemuck::try_cast_slice(even).map_err(|_| ImageError::Stride)?;
                let stride = self.stride_bytes / 2;
                GreyImage::with_white_level(words, width, height, stride, white_level)
                    .map(Pixels::Grey16)
            }
            Samples::Every { step, .. } => {
                if self.stride_bytes / step < width {
                    return Err(ImageError::Stride);
                }
                if plane.len() < self.stride_bytes * (height - 1) + step * width {
                    return Err(ImageError::TooShort);
                }
                GreyImage::new(luma, width, height, width).map(Pixels::Grey8)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::image::Pixel;

    use super::*;

    const SIZE_PX: (usize, usize) = (64, 66);

    /// The sample at column `x`, row `y`.
    fn sample(x: usize, y: usize) -> u8 {
        (3 * x + 5 * y) as u8
    }

    fn layout(format: PixelFormat, stride_bytes: usize) -> Layout {
        Layout { size_px: SIZE_PX, stride_bytes, samples: Samples::of(format).unwrap() }
    }

    fn assert_samples<P: Pixel>(image: &GreyImage<P>, expected: impl Fn(usize, usize) -> u32) {
        assert_eq!((image.width(), image.height()), SIZE_PX);
        for y in 0..SIZE_PX.1 {
            for (x, found) in image.row(y).iter().enumerate() {
                let found: u32 = (*found).into();
                assert_eq!(found, expected(x, y), "column {x}, row {y}");
            }
        }
    }

    #[test]
    fn bytes_and_a_plane_of_luma_are_used_where_they_lie() {
        for format in [PixelFormat::Grey, PixelFormat::Nv12] {
            let layout = layout(format, 80);
            let plane: Vec<u8> = (0..80 * 66).map(|at| sample(at % 80, at / 80)).collect();
            assert_eq!(layout.copied_bytes(), 0);
            let Ok(Pixels::Grey8(image)) = layout.pixels(&plane, &[]) else { panic!() };
            assert!(std::ptr::eq(image.row(0).as_ptr(), plane.as_ptr()));
            assert_samples(&image, |x, y| sample(x, y).into());
        }
    }

    #[test]
    fn words_are_used_where_they_lie_when_they_lie_evenly() {
        let layout = layout(PixelFormat::Y10, 160);
        let words: Vec<u16> =
            (0..80 * 66).map(|at| 4 * u16::from(sample(at % 80, at / 80))).collect();
        let plane: &[u8] = bytemuck::cast_slice(&words);
        let Ok(Pixels::Grey16(image)) = layout.pixels(plane, &[]) else { panic!() };
        assert_eq!(image.white_level(), 1023);
        assert!(std::ptr::eq(image.row(0).as_ptr(), words.as_ptr()));
        assert_samples(&image, |x, y| 4 * u32::from(sample(x, y)));
        // From an odd byte.
        assert_eq!(layout.pixels(&plane[1..], &[]).unwrap_err(), ImageError::Stride);
        let odd = Layout { stride_bytes: 161, ..layout };
        assert_eq!(odd.pixels(plane, &[]).unwrap_err(), ImageError::Stride);
        assert_eq!(layout.pixels(&plane[..160], &[]).unwrap_err(), ImageError::TooShort);
    }

    #[test]
    fn luma_between_chroma_is_copied() {
        // The last byte that belongs to a sample is the group's last.
        for (format, first, step) in [(PixelFormat::Yuyv, 0, 2), (PixelFormat::Rgb24, 1, 3)] {
            let stride = 64 * step + 12;
            let layout = layout(format, stride);
            let mut plane = vec![0xEE; stride * 66];
            for (y, row) in plane.chunks_mut(stride).enumerate() {
                for (x, group) in row.chunks_exact_mut(step).enumerate() {
                    group[first] = sample(x, y);
                }
            }
            let mut luma = vec![0; layout.copied_bytes()];
            layout.copy_luma(&plane, &mut luma);
            let Ok(Pixels::Grey8(image)) = layout.pixels(&plane, &luma) else { panic!() };
            assert_samples(&image, |x, y| sample(x, y).into());

            let narrow = Layout { stride_bytes: 64 * step - 1, ..layout };
            assert_eq!(narrow.pixels(&plane, &luma).unwrap_err(), ImageError::Stride);
            let short = &plane[..stride * 65 + 64 * step - 1];
            assert_eq!(layout.pixels(short, &luma).unwrap_err(), ImageError::TooShort);
        }
    }

    #[test]
    fn a_mosaic_and_compressed_frames_are_not_read() {
        assert_eq!(Samples::of(PixelFormat::Bayer8), None);
        assert_eq!(Samples::of(PixelFormat::Mjpeg), None);
    }
}
