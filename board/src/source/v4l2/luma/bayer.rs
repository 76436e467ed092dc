//! Grey values from a colour sensor's own samples, one colour a pixel, by the green ones.
//!
//! ```text
//!   R G R G      every second sample is green, in a chequered pattern;
//!   G B G B      the code of a format says which samples the first row has
//! ```
//!
//! Only green is used: red and blue are fainter by amounts that depend on the light, and the lens
//! focuses them elsewhere. A pixel that is not green gets the mean of its four neighbours; one that
//! is green is averaged with its four diagonal ones, so that both kinds are blurred alike, by half a
//! square pixel of variance along each axis. Without that the blur would differ from pixel to
//! pixel, which no model of an edge describes.
//!
//! Sums are not divided, so that nothing is rounded: white is [`WHITE`].

use std::array;

use plumbline::image::GreyImage;

/// White of the sums: eight times that of a sample.
pub const WHITE: u16 = 8 * 255;

/// Whether the first sample of the first row is green; `None` for a code that is not one of 8-bit
/// samples.
pub fn begins_green(code: &[u8; 4]) -> Option<bool> {
    match code {
        b"GRBG" | b"GBRG" => Some(true),
        b"RGGB" | b"BA81" => Some(false),
        _ => None,
    }
}

/// Writes eight times the green level of each pixel. A frame's border is continued by its mirror
/// image, in which green stays green.
pub fn green(samples: &GreyImage<'_, u8>, begins_green: bool, to: &mut [u16]) {
    let (width, height) = (samples.width(), samples.height());
    for (y, to) in to.chunks_exact_mut(width).enumerate().take(height) {
        let rows = [mirrored_before(y), y, mirrored_after(y, height)];
        let rows = rows.map(|y| &samples.row(y)[..width]);
        let begins_green = begins_green == y.is_multiple_of(2);
        let end = |x: usize, is_green: bool| {
            let columns = [mirrored_before(x), x, mirrored_after(x, width)];
            let samples = rows.map(|row| columns.map(|x| row[x]));
            sum(samples.each_ref().map(<[u8; 3]>::as_slice), mask(is_green))
        };
        to[0] = end(0, begins_green);
        inner_sums(rows, !begins_green, &mut to[1..width - 1]);
        to[width - 1] = end(width - 1, begins_green != width.is_multiple_of(2));
    }
}

/// Pixels that are computed at a time. Of a loop over a whole row it depends on the compiler's settings
/// whether it does so, and one at a time they take more than ten times as long.
const BLOCK: usize = 16;

/// The sums of a row without its two ends, whose first sample is green or not.
fn inner_sums(rows: [&[u8]; 3], begins_green: bool, to: &mut [u16]) {
    let masks = array::from_fn(|x| mask(begins_green == x.is_multiple_of(2)));
    let (blocks, rest) = to.as_chunks_mut::<BLOCK>();
    let rest_at = BLOCK * blocks.len();
    for (index, block) in blocks.iter_mut().enumerate() {
        block_sums(rows.map(|row| &row[BLOCK * index..]), &masks, block);
    }
    block_sums(rows.map(|row| &row[rest_at..]), &masks, rest);
}

/// The sums of at most a block, from the sample before it on.
#[inline(always)]
fn block_sums([above, here, below]: [&[u8]; 3], masks: &[u16; BLOCK], to: &mut [u16]) {
    let count = to.len() + 2;
    let (above, here, below) = (&above[..count], &here[..count], &below[..count]);
    for (x, (to, mask)) in to.iter_mut().zip(masks).enumerate() {
        *to = sum([&above[x..x + 3], &here[x..x + 3], &below[x..x + 3]], *mask);
    }
}

/// All bits for a green pixel, none for another.
fn mask(is_green: bool) -> u16 {
    if is_green { u16::MAX } else { 0 }
}

/// Eight times the green level of the middle of 3 x 3 samples.
#[inline(always)]
fn sum([above, here, below]: [&[u8]; 3], mask: u16) -> u16 {
    let level = u16::from;
    let of_green =
        4 * level(here[1]) + level(above[0]) + level(above[2]) + level(below[0]) + level(below[2]);
    let of_other = 2 * (level(here[0]) + level(here[2]) + level(above[1]) + level(below[1]));
    of_green & mask | of_other & !mask
}

/// The place before another; before the first one its mirror image.
fn mirrored_before(place: usize) -> usize {
    if place == 0 { 1 } else { place - 1 }
}

/// The place after another; after the last one its mirror image.
fn mirrored_after(place: usize, count: usize) -> usize {
    if place + 1 == count { place - 1 } else { place + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows are some blocks and a part of one.
    const SIZE: usize = 4 * BLOCK + 8;

    /// Green of a picture whose red and blue samples have a level of their own.
    fn measured(code: &[u8; 4], green_at: impl Fn(usize, usize) -> u8, other: u8) -> Vec<u16> {
        let begins = begins_green(code).unwrap();
        let samples: Vec<u8> = (0..SIZE * SIZE)
            .map(|place| {
                let (x, y) = (place % SIZE, place / SIZE);
                if (x + y).is_multiple_of(2) == begins { green_at(x, y) } else { other }
            })
            .collect();
        let image = GreyImage::new(&samples, SIZE, SIZE, SIZE).unwrap();
        let mut to = vec![0; SIZE * SIZE];
        green(&image, begins, &mut to);
        to
    }

    #[test]
    fn red_and_blue_have_no_effect() {
        for code in [b"RGGB", b"GRBG", b"GBRG", b"BA81"] {
            let slope = |x: usize, y: usize| (x + 2 * y) as u8;
            let one = measured(code, slope, 0);
            assert_eq!(one, measured(code, slope, 255), "{}", code.escape_ascii());
            // A slope is its own mean, except at the border, where it is mirrored.
            for (x, y) in (1..SIZE - 1).flat_map(|y| (1..SIZE - 1).map(move |x| (x, y))) {
                assert_eq!(one[y * SIZE + x], 8 * (x + 2 * y) as u16, "{x}, {y}");
            }
        }
        assert_eq!(measured(b"RGGB", |_, _| 255, 0), [WHITE; SIZE * SIZE]);
        assert_eq!(begins_green(b"GREY"), None);
    }

    #[test]
    fn both_kinds_of_pixels_are_blurred_alike() {
        // The mean of a parabola x^2 exceeds it by the variance of the blur, half a square pixel.
        let parabola = |x: usize, _: usize| ((x as i32 - 33).pow(2) % 256) as u8;
        let seen = measured(b"GRBG", parabola, 77);
        for x in 28..=38 {
            for y in [30, 31] {
                let expected = 8 * (x as i32 - 33).pow(2) + 4;
                assert_eq!(i32::from(seen[y * SIZE + x]), expected, "{x}, {y}");
            }
        }
    }
}
