//! Grey values from a camera that compresses each frame (Motion JPEG).
//!
//! Input: the bytes of one frame. Output: its luma. The colours are read over: their samples follow
//! those of the luma in the same stream of bits.
//!
//! Frames come from outside and need not be whole. Three things guard against a damaged one: the
//! driver marks frames of which it has lost a part; [`markers`] checks that the parts of the file are
//! there and that it has the size configured; and where samples have been lost, the decoder runs out
//! of them and says so. JPEG has no checksum: a changed bit, or a gap of a few dozen bytes, after
//! which what follows happens to be read as enough blocks, is not noticed here. A gap of a packet of
//! the bus, 512 bytes, was noticed each time in thousands of trials.
//!
//! Decoding allocates: this is where the box's promise of no heap ends. Its allocations are counted
//! apart from all others, see [`allocation`](crate::allocation); they end with the frame. Their size
//! is that of the compressed frame, and of one row of blocks.

mod markers;

use anyhow::{Context, Result, ensure};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// The smallest number of bytes that can be a frame: its first and its last marker.
pub const BYTES_MIN: usize = 4;

/// Writes the luma of a frame of exactly this size. After an error `luma` may hold a part of it.
///
/// # Errors
/// When it is not a whole picture of this size.
pub fn decode(bytes: &[u8], size_px: (usize, usize), luma: &mut [u8]) -> Result<()> {
    let file = markers::guarded(bytes, size_px)?;
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(size_px.0)
        .set_max_height(size_px.1)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&file[..]), options);
    decoder.decode_headers()?;
    let size = decoder.output_buffer_size().context("it has no size")?;
    ensure!(size == luma.len(), "its luma does not fill a frame");
    decoder.decode_into(luma)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Neither is a multiple of a group of blocks.
    const SIZE: (usize, usize) = (168, 120);

    /// Waves and noise, so that no part of the stream of bits resembles another.
    fn picture() -> Vec<u8> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let pixel = |place: usize| {
            let (x, y) = ((place % SIZE.0) as f64, (place / SIZE.0) as f64);
            let wave = 60.0 * (x / 7.0).sin() + 40.0 * (y / 9.0 + x / 30.0).sin();
            (128.0 + wave) as u8 + random.random_range(0..4)
        };
        (0..SIZE.0 * SIZE.1).map(pixel).collect()
    }

    /// As a camera compresses a scene under a warm lamp.
    fn compressed(set_up: impl FnOnce(&mut Encoder<&mut Vec<u8>>)) -> Vec<u8> {
        let rgb: Vec<u8> = picture().iter().flat_map(|&grey| [grey, grey, grey / 2]).collect();
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, 95);
        encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
        set_up(&mut encoder);
        encoder.encode(&rgb, SIZE.0 as u16, SIZE.1 as u16, ColorType::Rgb).unwrap();
        file
    }

    fn usual() -> Vec<u8> {
        compressed(|_| {})
    }

    fn decoded(file: &[u8]) -> Result<Vec<u8>> {
        let mut luma = vec![0; SIZE.0 * SIZE.1];
        decode(file, SIZE, &mut luma).map(|()| luma)
    }

    fn error(file: &[u8]) -> String {
        decoded(file).unwrap_err().to_string()
    }

    /// A file without the segments of this marker.
    fn without(file: &[u8], marker: u8) -> Vec<u8> {
        let mut kept = file[..2].to_vec();
        let mut at = 2;
        while file[at + 1] != 0xDA {
            let length = 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
            if file[at + 1] != marker {
                kept.extend(&file[at..at + length]);
            }
            at += length;
        }
        kept.extend(&file[at..]);
        kept
    }

    #[test]
    fn luma_is_that_of_the_picture_however_colours_are_sampled() {
        use SamplingFactor::{R_4_2_0, R_4_2_2, R_4_4_4};
        let expected: Vec<f64> =
            picture().iter().map(|&grey| f64::from(grey) * (0.886 + 0.114 / 2.0)).collect();
        for sampling in [R_4_4_4, R_4_2_2, R_4_2_0] {
            for interval in [0, 1, 7] {
                let file = compressed(|encoder| {
                    encoder.set_sampling_factor(sampling);
                    encoder.set_restart_interval(interval);
                });
                let luma = decoded(&file).unwrap();
                let errors = luma.iter().zip(&expected).map(|(&a, b)| (f64::from(a) - b).abs());
                // Quality 95 rounds coefficients to steps of up to 12 (of up to 4 where most of the
                // picture is), which leaves less than a level in the mean.
                let (sum, worst) =
                    errors.fold((0.0, 0.0_f64), |(sum, worst), e| (sum + e, worst.max(e)));
                let mean = sum / luma.len() as f64;
                assert!(mean < 1.0 && worst < 6.0, "{sampling:?} {interval}: {mean} {worst}");
            }
        }
    }

    #[test]
    fn a_grey_cameras_frame_is_read() {
        let mut file = Vec::new();
        Encoder::new(&mut file, 95)
            .encode(&picture(), SIZE.0 as u16, SIZE.1 as u16, ColorType::Luma)
            .unwrap();
        let luma = decoded(&file).unwrap();
        let worst = luma.iter().zip(picture()).map(|(&a, b)| a.abs_diff(b)).max();
        assert!(worst.unwrap() < 6, "{worst:?}");
    }

    #[test]
    fn a_frame_without_tables_gets_those_of_motion_jpeg() {
        let luma = decoded(&usual()).unwrap();
        let bare = without(&usual(), 0xC4);
        assert!(bare.len() < usual().len() - 300);
        assert_eq!(decoded(&bare).unwrap(), luma);
        // Nor with the usual first segment, as some cameras send it.
        assert_eq!(decoded(&without(&bare, 0xE0)).unwrap(), luma);
    }

    #[test]
    fn what_follows_the_end_does_not_matter() {
        let luma = decoded(&usual()).unwrap();
        for filling in [&[0; 500][..], &[0xFF; 3], &usual()] {
            assert_eq!(decoded(&[&usual()[..], filling].concat()).unwrap(), luma);
        }
    }

    /// As some cameras send it, to begin each part on an even place in their memory.
    #[test]
    fn a_few_bytes_more_in_each_part_do_not_matter() {
        let file = compressed(|encoder| encoder.set_restart_interval(5));
        let mut longer = Vec::new();
        for (at, &byte) in file.iter().enumerate() {
            if byte == 0xFF && matches!(file.get(at + 1), Some(0xD0..=0xD7 | 0xD9)) {
                longer.extend(&[0x4A, 0x00, 0xFF, 0x00, 0x91][..at % 6]);
            }
            longer.push(byte);
        }
        assert!(longer.len() > file.len() + 40);
        assert_eq!(decoded(&longer).unwrap(), decoded(&file).unwrap());
    }

    #[test]
    fn a_frame_that_is_cut_off_is_refused() {
        let file = usual();
        for end in 0..file.len() - 1 {
            assert!(decoded(&file[..end]).is_err(), "cut off after {end} bytes");
            // The driver has put the end there, or the camera itself gave up.
            let ended = [&file[..end], &[0xFF, 0xD9]].concat();
            // The last bytes may only fill up.
            assert!(end + 8 > file.len() || decoded(&ended).is_err(), "ended after {end} bytes");
        }
    }

    #[test]
    fn a_frame_of_another_size_or_kind_is_refused() {
        let mut luma = vec![0; 64 * 64];
        for size in [(64, 64), (SIZE.0, 64), (SIZE.1, SIZE.0)] {
            luma.resize(size.0 * size.1, 0);
            let error = decode(&usual(), size, &mut luma).unwrap_err().to_string();
            assert!(error.contains("it has 168 x 120 px"), "{error}");
        }
        let progressive = compressed(|encoder| encoder.set_progressive(true));
        assert!(error(&progressive).contains("not baseline"), "{}", error(&progressive));
        let scans = compressed(|encoder| encoder.set_optimized_huffman_tables(true));
        assert!(error(&scans).contains("several scans"), "{}", error(&scans));
        assert!(error(b"GIF89a").contains("not a JPEG"));
        assert!(error(&without(&usual(), 0xC0)).contains("no size"));
        let mut four = Vec::new();
        Encoder::new(&mut four, 95)
            .encode(&vec![9; 4 * SIZE.0 * SIZE.1], SIZE.0 as u16, SIZE.1 as u16, ColorType::Cmyk)
            .unwrap();
        assert!(error(&four).contains("4 components"), "{}", error(&four));
        // The size says that there are rows for hours of work.
        let mut huge = usual();
        let place = huge.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap();
        huge[place + 5..place + 9].fill(0xFF);
        assert!(error(&huge).contains("it has 65535 x 65535 px"), "{}", error(&huge));
    }

    /// Bytes are lost in the middle: one packet of USB or a few.
    #[test]
    fn a_frame_with_a_hole_is_refused() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        // Several times as long as a hole.
        let file = usual();
        assert!(file.len() > 6_000);
        let start = 2 + file.windows(2).position(|pair| pair == [0xFF, 0xDA]).unwrap();
        for _ in 0..2_000 {
            let from = random.random_range(start + 12..file.len() - 2_100);
            let to = from + random.random_range(512..=2_048);
            let holed = [&file[..from], &file[to..]].concat();
            assert!(decoded(&holed).is_err(), "bytes {from} to {to} are missing");
        }
    }

    #[test]
    fn a_frame_without_one_of_its_restarts_is_refused() {
        let file = compressed(|encoder| encoder.set_restart_interval(5));
        let markers: Vec<usize> = (2..file.len() - 1)
            .filter(|&at| file[at] == 0xFF && matches!(file[at + 1], 0xD0..=0xD7))
            .collect();
        // 11 x 15 groups of blocks.
        assert_eq!(markers.len(), 32);
        for (from, to) in markers.iter().zip(&markers[1..]) {
            let error = error(&[&file[..*from], &file[*to..]].concat());
            assert!(error.contains("a part of it is missing"), "{error}");
        }
        // As many as are counted before they start again.
        let error = error(&[&file[..markers[3]], &file[markers[11]..]].concat());
        assert!(error.contains("a part of it is missing"), "{error}");
    }

    /// Corrupt bytes give an error or a picture in bounded time; there is no third way.
    #[test]
    fn no_bytes_make_it_panic_or_wait() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let files = [usual(), compressed(|encoder| encoder.set_restart_interval(3))];
        let (mut refused, started) = (0, Instant::now());
        for turn in 0..4_000 {
            let mut corrupt = files[turn % 2].clone();
            // Every second time, in the segments before the samples.
            let end = if turn % 4 < 2 { 640 } else { corrupt.len() };
            for _ in 0..random.random_range(1..6) {
                let place = random.random_range(2..end);
                corrupt[place] = random.random();
            }
            refused += u32::from(decoded(&corrupt).is_err());
        }
        // A third of a millisecond each, by far, where tests are built without optimisation.
        assert!(started.elapsed() < Duration::from_secs(40), "{:?}", started.elapsed());
        assert!(refused > 1_000, "only {refused} refused");
    }
}
