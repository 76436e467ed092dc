//! The picture on the screen, drawn on a small canvas whose pixels are enlarged on the screen.
//!
//! From the top: the box's name, the network's latest message, the status above a bar of its
//! colour, all in large letters, and what is wrong in smaller ones. Each takes the lines it
//! needs. There is always room for the status; what is wrong gets the remaining lines.
//!
//! The letters come from the crate embedded-graphics, whose bitmap fonts are in the public
//! domain and whose drawing needs neither a heap nor an operating system. A character that the
//! fonts do not have becomes a question mark.

use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_7X13, FONT_9X15, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::Baseline;
use embedded_graphics::text::renderer::TextRenderer;
use heapless::String;

use super::text::{MORE, lines};
use crate::status::Status;

/// A box's name and its serial number, in brackets.
pub const NAME_BYTES_MAX: usize = 64;

/// As much as the logger keeps.
const TEXT_BYTES_MAX: usize = 512;

/// The largest canvas: on it, large letters have a tenth of the height of a wide screen.
pub const CANVAS_WIDTH_MAX: usize = 400;
pub const CANVAS_HEIGHT_MAX: usize = 240;

const LARGE: MonoFont<'_> = FONT_10X20;

/// Fonts for what is wrong; the largest is used in which all of it fits.
const SMALL: [MonoFont<'_>; 3] = [FONT_9X15, FONT_7X13, FONT_6X10];

/// The margin on every side, as screens may hide their edges.
const MARGIN: usize = 5;

/// The space between two lines, and the additional space between two texts.
const LEADING: usize = 2;
const GAP: usize = 5;

/// The height of the bar below the status.
const BAR: usize = 5;

/// Room for the address, which is what a person looks for.
const NETWORK_LINES_MAX: usize = 2;

/// What the longest words of a status need on the narrowest canvas.
const STATUS_LINES_MAX: usize = 2;

/// The colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    Paper,
    Plain,
    Green,
    Amber,
    Red,
}

impl PixelColor for Ink {
    type Raw = ();
}

impl Ink {
    fn of(status: Status) -> Self {
        match status {
            Status::Tracking => Self::Green,
            Status::Starting | Status::Searching => Self::Amber,
            Status::NoCamera | Status::NoConfiguration | Status::Refused | Status::Failed => {
                Self::Red
            }
        }
    }

    /// Red, green and blue.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Paper => [0, 0, 0],
            Self::Plain => [255, 255, 255],
            Self::Green => [64, 255, 64],
            Self::Amber => [255, 176, 0],
            Self::Red => [255, 72, 72],
        }
    }
}

/// Everything that a picture depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    name: String<NAME_BYTES_MAX>,
    network: String<TEXT_BYTES_MAX>,
    status: Status,
    detail: String<TEXT_BYTES_MAX>,
}

impl Shown {
    /// Texts beyond the bounds are left out.
    pub fn new(name: &str, network: &str, status: Status, detail: &str) -> Self {
        Self {
            name: name.try_into().unwrap_or_default(),
            network: network.try_into().unwrap_or_default(),
            status,
            detail: detail.try_into().unwrap_or_default(),
        }
    }
}

/// The canvas.
pub struct Canvas {
    /// Rows from the top, of the current size.
    pixels: Vec<Ink>,
    width: usize,
    height: usize,
}

impl Canvas {
    /// An empty canvas, with memory for the largest.
    pub fn new() -> Self {
        let pixels = Vec::with_capacity(CANVAS_WIDTH_MAX * CANVAS_HEIGHT_MAX);
        Self { pixels, width: 0, height: 0 }
    }

    /// Sets its size, at most the largest.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.width = width.min(CANVAS_WIDTH_MAX);
        self.height = height.min(CANVAS_HEIGHT_MAX);
    }

    /// The rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = &[Ink]> {
        self.pixels.chunks_exact(self.width.max(1))
    }

    /// Draws the whole picture.
    pub fn draw(&mut self, shown: &Shown) {
        self.pixels.clear();
        self.pixels.resize(self.width * self.height, Ink::Paper);
        let words = shown.status.words();
        let columns = self.columns(&LARGE);
        let status_lines = lines(words, columns, STATUS_LINES_MAX).count();
        let free = self.height.saturating_sub(2 * MARGIN + 2 * GAP + BAR) / line_height(&LARGE);
        let network_lines = free.saturating_sub(1 + status_lines).min(NETWORK_LINES_MAX);

        let y = self.write(&shown.name, &LARGE, Ink::Plain, MARGIN, 1);
        let y = self.write(&shown.network, &LARGE, Ink::Plain, y + GAP, network_lines);
        let ink = Ink::of(shown.status);
        let y = self.write(words, &LARGE, ink, y + GAP, STATUS_LINES_MAX);
        self.draw_bar(ink, y);
        self.write_detail(&shown.detail, y + BAR + GAP);
    }

    /// A bar from margin to margin.
    fn draw_bar(&mut self, ink: Ink, y: usize) {
        let size = Size::new(self.width.saturating_sub(2 * MARGIN) as u32, BAR as u32);
        // Drawing on the canvas cannot fail.
        let Ok(()) = self.fill_solid(&Rectangle::new(point(MARGIN, y), size), ink);
    }

    /// Writes a text into all of the space from `y` on.
    fn write_detail(&mut self, text: &str, y: usize) {
        let left = self.height.saturating_sub(MARGIN + y);
        for (index, font) in SMALL.iter().enumerate() {
            let max = left / line_height(font);
            let is_last = index + 1 == SMALL.len();
            if is_last || lines(text, self.columns(font), usize::MAX).count() <= max {
                self.write(text, font, Ink::Plain, y, max);
                return;
            }
        }
    }

    fn columns(&self, font: &MonoFont<'_>) -> usize {
        self.width.saturating_sub(2 * MARGIN) / font.character_size.width as usize
    }

    /// Writes a text from `y` on; returns where the next line begins.
    fn write(&mut self, text: &str, font: &MonoFont<'_>, ink: Ink, y: usize, max: usize) -> usize {
        let style = MonoTextStyle::new(font, ink);
        let mut y = y;
        for line in lines(text, self.columns(font), max) {
            // Drawing on the canvas cannot fail.
            let Ok(end) = style.draw_string(line.text, point(MARGIN, y), Baseline::Top, self);
            if line.is_cut {
                let Ok(_) = style.draw_string(MORE, end, Baseline::Top, self);
            }
            y += line_height(font);
        }
        y
    }
}

/// A position on the canvas, which always fits.
fn point(x: usize, y: usize) -> Point {
    Point::new(x as i32, y as i32)
}

fn line_height(font: &MonoFont<'_>) -> usize {
    font.character_size.height as usize + LEADING
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Ink;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Ink>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Self::Error> {
        for Pixel(Point { x, y }, ink) in pixels {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { continue };
            if x < self.width
                && let Some(pixel) = self.pixels.get_mut(y * self.width + x)
            {
                *pixel = ink;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(width: usize, height: usize, shown: &Shown) -> Canvas {
        let mut canvas = Canvas::new();
        canvas.resize(width, height);
        canvas.draw(shown);
        canvas
    }

    fn count(canvas: &Canvas, ink: Ink) -> usize {
        canvas.rows().flatten().filter(|&&it| it == ink).count()
    }

    #[test]
    fn long_texts_stay_within_the_margins_and_leave_room_for_the_status() {
        let text = "words of some length that go on ".repeat(16);
        let name = "x".repeat(NAME_BYTES_MAX);
        for (width, height) in [(160, 120), (135, 240), (320, 180), (384, 216), (400, 240)] {
            for status in Status::ALL {
                let short = drawn(width, height, &Shown::new("", "", status, ""));
                let long = drawn(width, height, &Shown::new(&name, &text, status, &text));
                let is_inside = |at: usize| {
                    (MARGIN..width - MARGIN).contains(&(at % width))
                        && (MARGIN..height - MARGIN).contains(&(at / width))
                };
                assert_eq!(long.pixels.len(), width * height);
                for (at, &ink) in long.pixels.iter().enumerate() {
                    assert!(is_inside(at) || ink == Ink::Paper, "{width} {status:?}");
                }
                // All of its words, and the bar.
                let ink = Ink::of(status);
                assert!(count(&short, ink) > BAR * (width - 2 * MARGIN));
                assert_eq!(count(&long, ink), count(&short, ink), "{width} {status:?}");
            }
        }
    }

    #[test]
    fn every_status_has_words_of_its_own_and_green_means_good() {
        let pictures =
            Status::ALL.map(|status| drawn(384, 216, &Shown::new("", "", status, "")).pixels);
        for (index, picture) in pictures.iter().enumerate() {
            assert!(!pictures[..index].contains(picture), "{:?}", Status::ALL[index]);
            let is_good = Status::ALL[index] == Status::Tracking;
            assert_eq!(picture.contains(&Ink::Green), is_good);
        }
    }

    #[test]
    fn a_character_that_no_font_has_is_a_question_mark() {
        let name = |name: &str| drawn(384, 216, &Shown::new(name, "", Status::Failed, "")).pixels;
        assert_eq!(name("ward \u{4e09}"), name("ward ?"));
        assert_eq!(name("a\nb"), name("a?b"));
        assert_ne!(name("ward \u{fc}"), name("ward ?"));
    }

    #[test]
    fn what_is_wrong_gets_smaller_letters_before_it_is_cut() {
        let heights = |characters: usize| {
            let text = "x".repeat(characters);
            let canvas = drawn(320, 180, &Shown::new("", "", Status::Failed, &text));
            let rows = canvas.rows().map(|row| row.contains(&Ink::Plain));
            // The first letters' rows.
            rows.skip_while(|is_drawn| !is_drawn).take_while(|is_drawn| *is_drawn).count()
        };
        let found = [40, 310, 400].map(heights);
        assert!(found.is_sorted_by(|larger, smaller| larger > smaller), "{found:?}");
    }
}
