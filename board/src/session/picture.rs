//! Encodes a frame as a picture file, for set-up mode: full-size and lossless, or reduced.

use anyhow::{Context, Result, ensure};
use jpeg_encoder::ColorType;
use plumbline::image::{GreyImage, Pixel};
use png::{BitDepth, Compression, Filter};

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
        (Pixels::Grey8(image), 1) => png(image, &samples(image, 1), BitDepth::Eight),
        (Pixels::Grey16(image), 1) => png(image, &wide(image), BitDepth::Sixteen),
        (Pixels::Grey8(image), _) => jpeg(image, reduction),
        (Pixels::Grey16(image), _) => jpeg(image, reduction),
    }
}

fn png<P: Pixel>(image: &GreyImage<'_, P>, samples: &[u8], depth: BitDepth) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Sub);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(samples)?;
        writer.finish()
    });
    written.context("the picture cannot be written as PNG")?;
    Ok(file)
}

fn jpeg<P: Pixel>(image: &GreyImage<'_, P>, reduction: u8) -> Result<Vec<u8>> {
    let reduction = usize::from(reduction);
    // A side is at most `FRAME_SIDE_PX_MAX`.
    let [width, height] = [image.width(), image.height()].map(|side| (side / reduction) as u16);
    let mut file = Vec::new();
    jpeg_encoder::Encoder::new(&mut file, JPEG_QUALITY)
        .encode(&samples(image, reduction), width, height, ColorType::Luma)
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

/// 16-bit samples in PNG's order of bytes, with white at the largest value: no two levels of a camera
/// become one.
fn wide(image: &GreyImage<'_, u16>) -> Vec<u8> {
    let white = u32::from(image.white_level());
    let level = |&pixel: &u16| (u32::from(pixel).min(white) * 65_535 / white) as u16;
    let rows = (0..image.height()).flat_map(|y| image.row(y));
    rows.flat_map(|pixel| level(pixel).to_be_bytes()).collect()
}

/// The tests of the whole program read pictures too.
#[cfg(test)]
#[path = "../../tests/common/pictures.rs"]
mod pictures;

#[cfg(test)]
mod tests {
    use super::*;
    use pictures::{of_jpeg, of_png};

    const WIDTH: usize = 70;
    const HEIGHT: usize = 66;
    /// Rows have padding, as in a driver's buffer.
    const STRIDE: usize = 80;

    #[test]
    fn a_whole_picture_is_the_frame_bit_by_bit() {
        let pixels: Vec<u8> = (0..STRIDE * HEIGHT).map(|at| (at * 7 % 256) as u8).collect();
        let image = GreyImage::new(&pixels, WIDTH, HEIGHT, STRIDE).unwrap();
        let file = file(&Pixels::Grey8(image), 1).unwrap();
        let (samples, size) = of_png(&file);
        assert_eq!(size, [WIDTH, HEIGHT]);
        for y in 0..HEIGHT {
            assert_eq!(&samples[y * WIDTH..][..WIDTH], image.row(y));
        }
    }

    #[test]
    fn ten_bits_come_back_from_sixteen() {
        let pixels: Vec<u16> = (0..STRIDE * HEIGHT).map(|at| (at * 5 % 1024) as u16).collect();
        let image = GreyImage::with_white_level(&pixels, WIDTH, HEIGHT, STRIDE, 1023).unwrap();
        let file = file(&Pixels::Grey16(image), 1).unwrap();
        let (samples, size) = of_png(&file);
        assert_eq!(size, [WIDTH, HEIGHT]);
        let levels = (0..HEIGHT).flat_map(|y| image.row(y));
        let samples = samples.chunks_exact(2).map(|it| u16::from_be_bytes([it[0], it[1]]));
        // Rounded up again, as it was rounded down.
        let found = samples.map(|sample| (u32::from(sample) * 1023).div_ceil(65_535) as u16);
        assert!(found.eq(levels.copied()));
    }

    #[test]
    fn a_reduced_picture_has_the_means() {
        let pixels: Vec<u8> =
            (0..WIDTH * HEIGHT).map(|at| if at % WIDTH < 40 { 40 } else { 200 }).collect();
        let image = GreyImage::new(&pixels, WIDTH, HEIGHT, WIDTH).unwrap();
        let (reduced, size) = of_jpeg(&file(&Pixels::Grey8(image), 4).unwrap());
        assert_eq!(size, [17, 16]);
        assert!(reduced[8 * 17 + 2].abs_diff(40) < 4);
        assert!(reduced[8 * 17 + 14].abs_diff(200) < 4);
        for reduction in [0, 17] {
            assert!(file(&Pixels::Grey8(image), reduction).is_err());
        }
    }
}
