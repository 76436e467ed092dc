//! A picture in characters: each cell of the terminal is an upper half block, its text colour
//! the pixel above, its background the pixel below.

use std::io::{self, Write};

use crossterm::cursor::MoveTo;
use crossterm::queue;
use crossterm::style::{Color, Print, ResetColor, SetBackgroundColor, SetForegroundColor};
use image::{Rgb, RgbImage};

/// Colours that a terminal has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colours {
    /// 24 bits.
    True,
    /// A cube of 6 x 6 x 6, and a ramp of 24 greys.
    Palette,
}

/// Draws a picture from the terminal's upper left cell on, one row of cells for two of pixels.
///
/// # Errors
/// When it cannot be written.
pub fn draw(picture: &RgbImage, colours: Colours, out: &mut impl Write) -> io::Result<()> {
    let colour = |x: u32, y: u32| {
        let pixel = picture.get_pixel_checked(x, y).map_or([0; 3], |pixel| pixel.0);
        match colours {
            Colours::True => Color::from((pixel[0], pixel[1], pixel[2])),
            Colours::Palette => Color::AnsiValue(palette_place(Rgb(pixel))),
        }
    };
    for row in 0..picture.height().div_ceil(2) {
        queue!(out, MoveTo(0, row as u16))?;
        // A colour stays set until the next one: a uniform area takes a few bytes.
        let mut before = None;
        for x in 0..picture.width() {
            let (upper, lower) = (colour(x, 2 * row), colour(x, 2 * row + 1));
            if before != Some((upper, lower)) {
                queue!(out, SetForegroundColor(upper), SetBackgroundColor(lower))?;
                before = Some((upper, lower));
            }
            queue!(out, Print('\u{2580}'))?;
        }
        queue!(out, ResetColor)?;
    }
    Ok(())
}

/// The nearest of the 256 colours: greys from the ramp, which is finer, others from the cube.
fn palette_place(Rgb([r, g, b]): Rgb<u8>) -> u8 {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    if most - least < 16 {
        return match least {
            0..=3 => 16,
            247..=255 => 231,
            // The ramp is 8, 18 and so on to 238.
            grey => 232 + (grey.saturating_sub(3) / 10).min(23),
        };
    }
    // The cube's levels are 0, 95, 135, 175, 215 and 255.
    let level = |value: u8| if value < 48 { 0 } else { (value.saturating_sub(35) / 40).max(1) };
    16 + 36 * level(r) + 6 * level(g) + level(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_find_their_place_in_the_palette() {
        let places = [
            ([0, 0, 0], 16),
            ([8, 8, 8], 232),
            ([128, 128, 128], 244),
            ([238, 238, 238], 255),
            ([255, 255, 255], 231),
            ([255, 0, 0], 196),
            ([0, 255, 0], 46),
            ([95, 135, 175], 67),
        ];
        for (colour, place) in places {
            assert_eq!(palette_place(Rgb(colour)), place, "{colour:?}");
        }
    }

    #[test]
    fn two_rows_of_pixels_are_one_of_letters() {
        let picture =
            RgbImage::from_fn(2, 2, |_, y| if y == 0 { Rgb([255; 3]) } else { Rgb([0; 3]) });
        let mut out = Vec::new();
        draw(&picture, Colours::Palette, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert_eq!(text, "\x1b[1;1H\x1b[38;5;231m\x1b[48;5;16m\u{2580}\u{2580}\x1b[0m");
    }
}
