//! What a screen shows, drawn on a small canvas whose pixels are enlarged on the screen.
//!
//! From the top: the box's name, the network's latest words, the status in its colour, all in
//! large letters, and what is wrong in smaller ones. Each takes the lines it needs. The status
//! always has room, what is wrong the rest.
//!
//! The letters come from the crate embedded-graphics, whose bitmap fonts are in the public
//! domain and whose drawing takes neither heap nor operating system. A character that they do
//! not have becomes a question mark.

use embedded_graphics::mono_font::iso_8859_1::{FONT_7X13, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::prelude::*;
use embedded_graphics::text::Baseline;
use embedded_graphics::text::renderer::TextRenderer;
use heapless::String;

use super::text::{MORE, lines};
use crate::status::Status;

/// A box's name and its serial number, in brackets.
pub const NAME_BYTES_MAX: usize = 64;

/// As much as the logger keeps.
const TEXT_BYTES_MAX: usize = 512;

/// The largest canvas: with it, large letters have a tenth of the height of a wide screen.
pub const CANVAS_WIDTH_MAX: usize = 400;
pub const CANVAS_HEIGHT_MAX: usize = 240;

const LARGE: MonoFont<'_> = FONT_10X20;
const SMALL: MonoFont<'_> = FONT_7X13;

/// Around everything, as screens may hide their edges.
const MARGIN: usize = 6;

/// Between two lines, and besides between the status and its neighbours.
const LEADING: usize = 2;
const GAP: usize = 6;

const NETWORK_LINES_MAX: usize = 3;

/// The longest words of a status, on the narrowest canvas.
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
    /// Rows from the top; as many as the size at hand needs.
    pixels: Vec<Ink>,
    width: usize,
    height: usize,
}

impl Canvas {
    /// An empty canvas, with the memory for the largest.
    pub fn new() -> Self {
        let pixels = Vec::with_capacity(CANVAS_WIDTH_MAX * CANVAS_HEIGHT_MAX);
        Self { pixels, width: 0, height: 0 }
    }

    /// Gives it a size, at most the largest.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.width = width.min(CANVAS_WIDTH_MAX);
        self.height = height.min(CANVAS_HEIGHT_MAX);
    }

    /// The rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = &[Ink]> {
        self.pixels.chunks_exact(self.width.max(1))
    }

    /// Draws the picture anew.
    pub fn draw(&mut self, shown: &Shown) {
        self.pixels.clear();
        self.pixels.resize(self.width * self.height, Ink::Paper);
        let words = shown.status.words();
        let columns = self.columns(&LARGE);
        let status_lines = lines(words, columns, STATUS_LINES_MAX).count();
        let free = self.height.saturating_sub(2 * MARGIN + 2 * GAP) / line_height(&LARGE);
        let network_lines = free.saturating_sub(1 + status_lines).min(NETWORK_LINES_MAX);

        let y = self.write(&shown.name, &LARGE, Ink::Plain, MARGIN, 1);
        let y = self.write(&shown.network, &LARGE, Ink::Plain, y, network_lines);
        let y = self.write(words, &LARGE, Ink::of(shown.status), y + GAP, STATUS_LINES_MAX) + GAP;
        let free = self.height.saturating_sub(MARGIN + y) / line_height(&SMALL);
        self.write(&shown.detail, &SMALL, Ink::Plain, y, free);
    }

    fn columns(&self, font: &MonoFont<'_>) -> usize {
        self.width.saturating_sub(2 * MARGIN) / font.character_size.width as usize
    }

    /// Writes a text from `y` on; where the next line begins.
    fn write(&mut self, text: &str, font: &MonoFont<'_>, ink: Ink, y: usize, max: usize) -> usize {
        let style = MonoTextStyle::new(font, ink);
        let mut y = y;
        for line in lines(text, self.columns(font), max) {
            // No canvas is so large that this does not fit.
            let at = Point::new(MARGIN as i32, y as i32);
            // Drawing on the canvas cannot fail.
            let Ok(end) = style.draw_string(line.text, at, Baseline::Top, self);
            if line.is_cut {
                let Ok(_) = style.draw_string(MORE, end, Baseline::Top, self);
            }
            y += line_height(font);
        }
        y
    }
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
