//! Finds the grey values in a camera's buffer.
//!
//! Input: the bytes of one frame in one of the formats below. Output: 8-bit or
//! 16-bit grey.
//!
//! | format | kernel's code | bytes of a row | cost |
//! |---|---|---|---|
//! | Grey | `GREY` | Y | none, read in place |
//! | Nv12 | `NV12` | Y; the colours follow after all rows | none |
//! | Y10 | `Y10 ` | 10 bits in each little-endian word | none |
//! | Y16 | `Y16 ` | little-endian words | none |
//! | Yuyv | `YUYV`, `UYVY` | Y U Y V or U Y V Y | the luma is copied |
//! | Rgb24 | `RGB3`, `BGR3` | R G B or B G R | the green is copied |
//! | Y10 | `Y10P` | 4 high bytes, then the low bits of the four | unpacked |
//! | Y10 | `Y10B` | 4 samples in 5 bytes, highest bit first | unpacked |
//! | Bayer8 | `RGGB`, `GRBG`, `GBRG`, `BA81` | one colour a pixel | green is interpolated, see [`bayer`] |
//! | Mjpeg | `MJPG`, `JPEG` | a file | decoded, see [`jpeg`] |
//!
//! Rows may be padded. The memory for copies is allocated once; only decoding allocates for each
//! frame. `cargo xtask bench` measures what each format costs.
//!
//! Of colours only green is used. A weighted sum, as luma is, would mix in red and blue, which the
//! lens focuses elsewhere and most sensors sample more coarsely.

mod bayer;
mod jpeg;

use anyhow::{Context, Result, bail};
use plumbline::config::PixelFormat;
use plumbline::image::GreyImage;

use super::super::Pixels;

// Words are read in place, in the byte order of the formats.
const _: () = assert!(cfg!(target_endian = "little"));

/// No frame takes more memory: of the largest, each pixel has 3 bytes, and its rows may be padded to more
/// than twice their length. A driver that asks for more does not know what it says.
const FRAME_BYTES_MAX: usize = 128 << 20;

/// White of 10-bit samples.
const WHITE_10_BIT: u16 = 1023;

/// The kernel's codes of a configured format; the first that the camera has is taken.
pub fn codes(format: PixelFormat) -> &'static [&'static [u8; 4]] {
    match format {
        PixelFormat::Grey => &[b"GREY"],
        PixelFormat::Y10 => &[b"Y10 ", b"Y10P", b"Y10B"],
        PixelFormat::Y16 => &[b"Y16 "],
        PixelFormat::Yuyv => &[b"YUYV", b"UYVY"],
        PixelFormat::Nv12 => &[b"NV12"],
        PixelFormat::Rgb24 => &[b"RGB3", b"BGR3"],
        PixelFormat::Bayer8 => &[b"RGGB", b"GRBG", b"GBRG", b"BA81"],
        PixelFormat::Mjpeg => &[b"MJPG", b"JPEG"],
    }
}

/// The layout of a camera's frames, and the memory for samples that must be copied.
#[derive(Debug)]
pub struct Luma {
    width_px: usize,
    height_px: usize,
    stride_bytes: usize,
    row_bytes: usize,
    samples: Samples,
}

#[derive(Debug)]
enum Samples {
    /// One byte each, first in the buffer.
    Bytes,
    /// One word each.
    Words { white_level: u16 },
    /// One byte in each group of bytes.
    Every { copy_row: fn(&[u8], &mut [u8]), luma: Vec<u8> },
    /// Four in five bytes.
    Packed { unpack: fn(&[u8; 5]) -> [u16; 4], luma: Vec<u16> },
    /// One byte each, every second of which is green.
    Mosaic { begins_green: bool, green: Vec<u16> },
    /// A file.
    Jpeg { luma: Vec<u8> },
}

impl Luma {
    /// The layout for a format's code; `stride_bytes` is the distance between rows, 0
    /// if they are not padded.
    ///
    /// # Errors
    /// When rows do not fit in the stride, or the size cannot be tracked or packed.
    pub fn new(code: &[u8; 4], size_px: (usize, usize), stride_bytes: usize) -> Result<Self> {
        let (width_px, height_px) = size_px;
        let samples_max = width_px.checked_mul(height_px).context("the size is too large")?;
        let packed = |unpack| Samples::Packed { unpack, luma: vec![0; samples_max] };
        let luma = || vec![0; samples_max];
        let (row_bytes, samples) = match code {
            b"GREY" | b"NV12" => (width_px, Samples::Bytes),
            b"Y10 " => (2 * width_px, Samples::Words { white_level: WHITE_10_BIT }),
            b"Y16 " => (2 * width_px, Samples::Words { white_level: u16::MAX }),
            b"YUYV" => (2 * width_px, Samples::Every { copy_row: copy::<0, 2>, luma: luma() }),
            b"UYVY" => (2 * width_px, Samples::Every { copy_row: copy::<1, 2>, luma: luma() }),
            // Green is in the middle in both orders.
            b"RGB3" | b"BGR3" => {
                (3 * width_px, Samples::Every { copy_row: copy::<1, 3>, luma: luma() })
            }
            b"MJPG" | b"JPEG" => (width_px, Samples::Jpeg { luma: luma() }),
            b"Y10P" => (width_px / 4 * 5, packed(unpack_low_bits_last)),
            b"Y10B" => (width_px / 4 * 5, packed(unpack_bit_stream)),
            _ => {
                let begins_green = bayer::begins_green(code).with_context(|| {
                    format!("the format {} is not read here", code.escape_ascii())
                })?;
                (width_px, Samples::Mosaic { begins_green, green: vec![0; samples_max] })
            }
        };
        if matches!(samples, Samples::Packed { .. }) && !width_px.is_multiple_of(4) {
            bail!("packed rows of {width_px} px: only multiples of 4 are read");
        }
        let stride_bytes = if stride_bytes == 0 { row_bytes } else { stride_bytes };
        if stride_bytes < row_bytes {
            bail!("its rows of {width_px} px take {row_bytes} bytes, and it says {stride_bytes}");
        }
        if matches!(samples, Samples::Words { .. }) && !stride_bytes.is_multiple_of(2) {
            bail!("its rows of 16-bit words are {stride_bytes} bytes apart, an odd number");
        }
        let rows_bytes = stride_bytes.checked_mul(height_px);
        if rows_bytes.is_none_or(|bytes| bytes > FRAME_BYTES_MAX) {
            bail!(
                "its {height_px} rows are {stride_bytes} bytes apart: a frame has at most {} MiB",
                FRAME_BYTES_MAX >> 20
            );
        }
        let luma = Self { width_px, height_px, stride_bytes, row_bytes, samples };
        let blank = vec![0; luma.bytes_min()];
        let blank_words = vec![0; luma.bytes_min() / 2];
        luma.view(&blank, &blank_words).context("the size of the frame cannot be tracked")?;
        Ok(luma)
    }

    /// The size of a whole frame, without the last row's padding and without colours; of a
    /// compressed one, the smallest.
    pub fn bytes_min(&self) -> usize {
        match self.samples {
            Samples::Jpeg { .. } => jpeg::BYTES_MIN,
            _ => self.stride_bytes * (self.height_px - 1) + self.row_bytes,
        }
    }

    /// Copies or decodes samples that cannot be read in place. `bytes` holds at least
    /// [`bytes_min`](Self::bytes_min), and no more than the camera has written.
    ///
    /// # Errors
    /// When a compressed frame is damaged.
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let size_px = (self.width_px, self.height_px);
        let rows = bytes.chunks(self.stride_bytes).map(|row| &row[..self.row_bytes]);
        match &mut self.samples {
            Samples::Bytes | Samples::Words { .. } => {}
            Samples::Every { copy_row, luma } => {
                for (to, row) in luma.chunks_exact_mut(self.width_px).zip(rows) {
                    copy_row(row, to);
                }
            }
            Samples::Packed { unpack, luma } => {
                for (to, row) in luma.chunks_exact_mut(self.width_px).zip(rows) {
                    let (groups, _) = row.as_chunks();
                    for (to, group) in to.as_chunks_mut().0.iter_mut().zip(groups) {
                        *to = unpack(group);
                    }
                }
            }
            Samples::Mosaic { begins_green, green } => {
                let mosaic = GreyImage::new(bytes, size_px.0, size_px.1, self.stride_bytes)?;
                bayer::green(&mosaic, *begins_green, green);
            }
            Samples::Jpeg { luma } => jpeg::decode(bytes, size_px, luma)?,
        }
        Ok(())
    }

    /// The frame, in `bytes`, in the same memory as `words`, or in the samples that
    /// [`load`](Self::load) has copied. `None` if they are too short.
    pub fn view<'a>(&'a self, bytes: &'a [u8], words: &'a [u16]) -> Option<Pixels<'a>> {
        let (width, height) = (self.width_px, self.height_px);
        let grey8 = |luma, stride| GreyImage::new(luma, width, height, stride).ok();
        let grey16 = |luma, stride, white_level| {
            GreyImage::with_white_level(luma, width, height, stride, white_level).ok()
        };
        match &self.samples {
            Samples::Bytes => grey8(bytes, self.stride_bytes).map(Pixels::Grey8),
            Samples::Words { white_level } => {
                grey16(words, self.stride_bytes / 2, *white_level).map(Pixels::Grey16)
            }
            Samples::Every { luma, .. } | Samples::Jpeg { luma } => {
                grey8(luma, width).map(Pixels::Grey8)
            }
            Samples::Mosaic { green, .. } => grey16(green, width, bayer::WHITE).map(Pixels::Grey16),
            Samples::Packed { luma, .. } => grey16(luma, width, WHITE_10_BIT).map(Pixels::Grey16),
        }
    }
}

/// Copies one byte, which is at place `AT`, of each group of `GROUP` bytes.
fn copy<const AT: usize, const GROUP: usize>(row: &[u8], to: &mut [u8]) {
    for (to, group) in to.iter_mut().zip(row.as_chunks::<GROUP>().0) {
        *to = group[AT];
    }
}

/// Four high bytes; the fifth has the low bits, those of the first sample lowest.
fn unpack_low_bits_last(group: &[u8; 5]) -> [u16; 4] {
    let low = u16::from(group[4]);
    std::array::from_fn(|i| u16::from(group[i]) << 2 | low >> (2 * i) & 3)
}

/// One stream of bits, the highest bit of the first sample first.
fn unpack_bit_stream(group: &[u8; 5]) -> [u16; 4] {
    let bits = group.iter().fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte));
    std::array::from_fn(|i| (bits >> (30 - 10 * i)) as u16 & WHITE_10_BIT)
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};

    use super::*;

    /// Sample (x, y) of a frame, by the format's definition, bit by bit.
    fn sample(code: &[u8; 4], bytes: &[u8], stride: usize, x: usize, y: usize) -> u16 {
        let row = &bytes[y * stride..];
        let byte = |at: usize| u16::from(row[at]);
        match code {
            b"GREY" | b"NV12" => byte(x),
            b"Y10 " | b"Y16 " => byte(2 * x) + 256 * byte(2 * x + 1),
            b"YUYV" => byte(2 * x),
            b"UYVY" => byte(2 * x + 1),
            b"RGB3" | b"BGR3" => byte(3 * x + 1),
            b"Y10P" => {
                let (group, of) = (5 * (x / 4), x % 4);
                4 * byte(group + of) + (byte(group + 4) / 4_u16.pow(of as u32)) % 4
            }
            b"Y10B" => (10 * x..10 * x + 10)
                .fold(0, |value, bit| 2 * value + (byte(bit / 8) >> (7 - bit % 8)) % 2),
            _ => unreachable!(),
        }
    }

    #[test]
    fn every_format_reads_as_it_is_defined() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let tight: [(&[u8; 4], usize, u16); 10] = [
            (b"GREY", 64, 255),
            (b"NV12", 64, 255),
            (b"Y10 ", 128, 1023),
            (b"Y16 ", 128, 65535),
            (b"YUYV", 128, 255),
            (b"UYVY", 128, 255),
            (b"RGB3", 192, 255),
            (b"BGR3", 192, 255),
            (b"Y10P", 80, 1023),
            (b"Y10B", 80, 1023),
        ];
        for (code, row_bytes, white_level) in tight {
            for padding in [0, 2, 6, 64] {
                let stride = row_bytes + padding;
                let asked = if padding == 0 { 0 } else { stride };
                let mut luma = Luma::new(code, (64, 65), asked).unwrap();
                assert_eq!(luma.bytes_min(), stride * 64 + row_bytes);
                let mut bytes = vec![0; luma.bytes_min()];
                random.fill_bytes(&mut bytes);
                let words: Vec<u16> =
                    bytes.as_chunks().0.iter().copied().map(u16::from_le_bytes).collect();
                luma.load(&bytes).unwrap();
                let pixels = luma.view(&bytes, &words).unwrap();
                let read = |x: usize, y: usize| match pixels {
                    Pixels::Grey8(image) => (u16::from(image.row(y)[x]), image.white_level()),
                    Pixels::Grey16(image) => (image.row(y)[x], image.white_level()),
                };
                for (x, y) in (0..65).flat_map(|y| (0..64).map(move |x| (x, y))) {
                    let expected = (sample(code, &bytes, stride, x, y), white_level);
                    let name = code.escape_ascii();
                    assert_eq!(read(x, y), expected, "{name} +{padding} at {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn a_mosaic_and_a_compressed_frame_become_grey() {
        let mut luma = Luma::new(b"BA81", (64, 64), 70).unwrap();
        assert_eq!(luma.bytes_min(), 70 * 63 + 64);
        luma.load(&vec![9; luma.bytes_min()]).unwrap();
        let Some(Pixels::Grey16(image)) = luma.view(&[], &[]) else { panic!("16 bits") };
        assert_eq!((image.row(63)[63], image.white_level()), (72, 2040));

        let mut luma = Luma::new(b"MJPG", (64, 64), 0).unwrap();
        let mut file = Vec::new();
        jpeg_encoder::Encoder::new(&mut file, 75)
            .encode(&[128; 64 * 64], 64, 64, jpeg_encoder::ColorType::Luma)
            .unwrap();
        luma.load(&file).unwrap();
        let Some(Pixels::Grey8(image)) = luma.view(&[], &[]) else { panic!("8 bits") };
        assert_eq!((image.row(63)[63], image.white_level()), (128, 255));
        assert!(luma.load(&file[..file.len() / 2]).unwrap_err().to_string().contains("cut off"));
    }

    #[test]
    fn a_frame_that_is_read_where_it_lies_is_not_copied() {
        for code in [b"GREY", b"NV12"] {
            let luma = Luma::new(code, (64, 64), 0).unwrap();
            let bytes = [7; 64 * 64];
            let Some(Pixels::Grey8(image)) = luma.view(&bytes, &[]) else { panic!("8 bits") };
            assert_eq!(image.row(0).as_ptr(), bytes.as_ptr());
        }
        let luma = Luma::new(b"Y16 ", (64, 64), 0).unwrap();
        let words = [7; 64 * 64];
        let Some(Pixels::Grey16(image)) = luma.view(&[], &words) else { panic!("16 bits") };
        assert_eq!(image.row(0).as_ptr(), words.as_ptr());
    }

    #[test]
    fn impossible_layouts_are_refused_with_their_reason() {
        let cases = [
            (b"H264", (64, 64), 0, "H264 is not read"),
            (b"GREY", (64, 64), 63, "take 64 bytes, and it says 63"),
            (b"Y16 ", (64, 64), 129, "an odd number"),
            (b"Y10P", (66, 64), 0, "multiples of 4"),
            (b"GREY", (8, 8), 0, "cannot be tracked"),
            // The most that a driver can say, of which nobody has the memory.
            (b"YUYV", (64, 64), u32::MAX as usize, "at most 128 MiB"),
            (b"GREY", (64, 64), usize::MAX, "at most 128 MiB"),
        ];
        for (code, size_px, stride, expected) in cases {
            let error = Luma::new(code, size_px, stride).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
