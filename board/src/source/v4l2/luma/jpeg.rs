//! Grey values from a camera that compresses each frame (Motion JPEG).
//!
//! Compressed frames come from outside and need not be whole: one that is cut off, corrupt, or of
//! another size gives an error and no picture.
//!
//! Decoding allocates: here the box's promise of no heap ends. How often is counted apart from
//! everything else, so that Health still tells of any other allocation, and is logged once.

use anyhow::{Context, Result, ensure};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// The smallest number of bytes that can be a frame: its first and its last marker.
pub const BYTES_MIN: usize = 4;

/// The marker at which a frame ends. Some cameras fill up what follows.
const END: [u8; 2] = [0xFF, 0xD9];

/// Scans of a progressive frame; cameras use one, and the most useful number is ten.
const SCANS_MAX: usize = 16;

/// Writes the luma of a frame of exactly this size. After an error `luma` may hold a part of it.
///
/// # Errors
/// When it is not a whole picture of this size.
pub fn decode(bytes: &[u8], (width, height): (usize, usize), luma: &mut [u8]) -> Result<()> {
    ensure!(bytes.windows(END.len()).any(|marker| marker == END), "it is cut off");
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(width)
        .set_max_height(height)
        .jpeg_set_max_scans(SCANS_MAX)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers()?;
    let info = decoder.info().context("it has no header")?;
    let found = (usize::from(info.width), usize::from(info.height));
    ensure!(found == (width, height), "it has {} x {} px", found.0, found.1);
    ensure!(decoder.output_buffer_size() == Some(luma.len()), "its luma does not fill a frame");
    decoder.decode_into(luma)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::{ExtendedColorType, ImageEncoder};
    use rand::{RngExt, SeedableRng};

    use super::*;

    const SIZE: (usize, usize) = (80, 72);

    fn picture() -> Vec<u8> {
        (0..SIZE.0 * SIZE.1).map(|place| (2 * (place % SIZE.0) + place / SIZE.0) as u8).collect()
    }

    /// As a colour camera compresses a grey picture: with both colours, which are subsampled.
    fn compressed() -> Vec<u8> {
        let rgb: Vec<u8> = picture().iter().flat_map(|&grey| [grey; 3]).collect();
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, 95)
            .write_image(&rgb, SIZE.0 as u32, SIZE.1 as u32, ExtendedColorType::Rgb8)
            .unwrap();
        file
    }

    fn decoded(file: &[u8]) -> Result<Vec<u8>> {
        let mut luma = vec![0; SIZE.0 * SIZE.1];
        decode(file, SIZE, &mut luma).map(|()| luma)
    }

    #[test]
    fn luma_is_that_of_the_picture() {
        let luma = decoded(&compressed()).unwrap();
        // The quantisation steps of quality 95 are at most 12, and errors of half a step average out.
        let worst = luma.iter().zip(picture()).map(|(&a, b)| a.abs_diff(b)).max();
        assert!(worst.unwrap() <= 3, "{worst:?}");
        // Filled up behind the end, as some drivers do.
        assert_eq!(decoded(&[&compressed()[..], &[0; 500]].concat()).unwrap(), luma);
    }

    #[test]
    fn a_frame_without_tables_gets_those_of_motion_jpeg() {
        let file = compressed();
        let luma = decoded(&file).unwrap();
        // Without its Huffman tables, and marked as AVI does.
        let mut bare = vec![0xFF, 0xD8, 0xFF, 0xE0, 0, 16];
        bare.extend(b"AVI1\0\0\0\0\0\0\0\0\0\0");
        let mut at = 2;
        while file[at + 1] != 0xDA {
            let length = 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
            if !matches!(file[at + 1], 0xC4 | 0xE0) {
                bare.extend(&file[at..at + length]);
            }
            at += length;
        }
        bare.extend(&file[at..]);
        assert!(bare.len() < file.len() - 300);
        assert_eq!(decoded(&bare).unwrap(), luma);
    }

    #[test]
    fn what_is_not_a_whole_frame_is_refused() {
        let file = compressed();
        for end in 0..file.len() - 1 {
            assert!(decoded(&file[..end]).is_err(), "cut off after {end} bytes");
        }
        let mut luma = vec![0; 64 * 64];
        let error = decode(&file, (64, 64), &mut luma).unwrap_err().to_string();
        assert!(!error.is_empty());
        let mut larger = vec![0; 160 * 144];
        let error = decode(&file, (160, 144), &mut larger).unwrap_err().to_string();
        assert!(error.contains("it has 80 x 72 px"), "{error}");
    }

    #[test]
    fn corrupt_frames_are_refused_or_whole_and_nothing_panics() {
        let file = compressed();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut refused = 0;
        for _ in 0..5_000 {
            let mut corrupt = file.clone();
            for _ in 0..random.random_range(1..6) {
                let place = random.random_range(0..corrupt.len());
                corrupt[place] = random.random();
            }
            refused += u32::from(decoded(&corrupt).is_err());
        }
        assert!(refused > 1_000, "only {refused} refused");
    }
}
