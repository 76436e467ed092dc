//! Encodes a frame as a picture file, for set-up mode: full-size and lossless, or reduced.

use anyhow::{Context, Result, ensure};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use plumbline::image::{GreyImage, Pixel};

use crate::source::Pixels;

/// The largest reduction: beyond it a picture shows nothing of use.
const REDUCTION_MAX: u8 = 16;

/// Good enough for aiming, and small enough for a serial line.
const JPEG_QUALITY: u8 = 80;

/// The picture file: a PNG of the whole frame for a reduction of 1, a JPEG for more.
///
/// # Errors
/// When there is no such reduction.
pub fn file(pixels: &Pixels<'_>, reduction: u8) -> Result<Vec<u8>> {
    ensure!(
        (1..=REDUCTION_MAX).contains(&reduction),
        "a reduction of {reduction}; there are 1 to {REDUCTION_MAX}"
    );
    match (pixels, reduction) {
        (Pixels::Grey8(image), 1) => png(image, &samples(image, 1), ExtendedColorType::L8),
        (Pixels::Grey16(image), 1) => png(image, &wide(image), ExtendedColorType::L16),
        (Pixels::Grey8(image), _) => jpeg(image, reduction),
        (Pixels::Grey16(image), _) => jpeg(image, reduction),
    }
}

fn png<P: Pixel>(
    image: &GreyImage<'_, P>,
    samples: &[u8],
    colour: ExtendedColorType,
) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Sub)
        .write_image(samples, image.width() as u32, image.height() as u32, colour)
        .context("the picture cannot be written as PNG")?;
    Ok(file)
}

fn jpeg<P: Pixel>(image: &GreyImage<'_, P>, reduction: u8) -> Result<Vec<u8>> {
    let size_px = [image.width(), image.height()].map(|side| side as u32 / u32::from(reduction));
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY)
        .write_image(
            &samples(image, reduction.into()),
            size_px[0],
            size_px[1],
            ExtendedColorType::L8,
        )
        .context("the picture cannot be written as JPEG")?;
    Ok(file)
}

/// 8-bit samples: the means of squares of pixels; incomplete squares are left out.
fn samples<P: Pixel>(image: &GreyImage<'_, P>, reduction: usize) -> Vec<u8> {
    let white = u32::from(image.white_level()) * (reduction * reduction) as u32;
    let mut samples = Vec::new();
    for y in 0..image.height() / reduction {
        let mut sums = vec![0_u32; image.width() / reduction];
        for row in y * reduction..(y + 1) * reduction {
            for (sum, square) in sums.iter_mut().zip(image.row(row).chunks_exact(reduction)) {
                *sum += square.iter().map(|&pixel| Into::<u32>::into(pixel)).sum::<u32>();
            }
        }
        samples.extend(sums.iter().map(|&sum| ((sum * 255 + white / 2) / white).min(255) as u8));
    }
    samples
}

/// 16-bit samples, with white at the largest value: no two levels of a camera become one.
fn wide(image: &GreyImage<'_, u16>) -> Vec<u8> {
    let white = u32::from(image.white_level());
    let level = |&pixel: &u16| (u32::from(pixel).min(white) * 65_535 / white) as u16;
    let rows = (0..image.height()).flat_map(|y| image.row(y));
    rows.flat_map(|pixel| level(pixel).to_ne_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 70;
    const HEIGHT: usize = 66;
    /// Rows have padding, as in a driver's buffer.
    const STRIDE: usize = 80;

    #[test]
    fn a_whole_picture_is_the_frame_bit_by_bit() {
        let pixels: Vec<u8> = (0..STRIDE * HEIGHT).map(|at| (at * 7 % 256) as u8).collect();
        let image = GreyImage::new(&pixels, WIDTH, HEIGHT, STRIDE).unwrap();
        let file = file(&Pixels::Grey8(image), 1).unwrap();
        let decoded = image::load_from_memory(&file).unwrap().into_luma8();
        assert_eq!(decoded.dimensions(), (WIDTH as u32, HEIGHT as u32));
        for y in 0..HEIGHT {
            assert_eq!(&decoded.as_raw()[y * WIDTH..][..WIDTH], image.row(y));
        }
    }

    #[test]
    fn ten_bits_come_back_from_sixteen() {
        let pixels: Vec<u16> = (0..STRIDE * HEIGHT).map(|at| (at * 5 % 1024) as u16).collect();
        let image = GreyImage::with_white_level(&pixels, WIDTH, HEIGHT, STRIDE, 1023).unwrap();
        let file = file(&Pixels::Grey16(image), 1).unwrap();
        let decoded = image::load_from_memory(&file).unwrap().into_luma16();
        for (x, y, pixel) in decoded.enumerate_pixels() {
            // Rounded up again, as it was rounded down.
            let level = (u32::from(pixel.0[0]) * 1023).div_ceil(65_535);
            assert_eq!(level as u16, image.row(y as usize)[x as usize]);
        }
    }

    #[test]
    fn a_reduced_picture_has_the_means() {
        let pixels: Vec<u8> =
            (0..WIDTH * HEIGHT).map(|at| if at % WIDTH < 40 { 40 } else { 200 }).collect();
        let image = GreyImage::new(&pixels, WIDTH, HEIGHT, WIDTH).unwrap();
        let decode = |file: Vec<u8>| image::load_from_memory(&file).unwrap().into_luma8();
        let reduced = decode(file(&Pixels::Grey8(image), 4).unwrap());
        assert_eq!(reduced.dimensions(), (17, 16));
        assert!(reduced.get_pixel(2, 8).0[0].abs_diff(40) < 4);
        assert!(reduced.get_pixel(14, 8).0[0].abs_diff(200) < 4);
        for reduction in [0, 17] {
            assert!(file(&Pixels::Grey8(image), reduction).is_err());
        }
    }
}
