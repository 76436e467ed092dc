//! A key as a QR code: on a terminal, and as a picture.

use std::fmt::Write as _;
use std::io::Cursor;

use image::{GrayImage, ImageFormat, Luma};
use plumbline::seal::KeyText;
use qrcode::{Color, EcLevel, QrCode};
use svg::Document;
use svg::node::element::{Path, Rectangle};

/// The white margin that belongs to every code, in modules.
const MARGIN: usize = 4;

/// The side of a module in a PNG, px: large enough for a telephone in front of a screen.
const MODULE_PX: u32 = 8;

/// Black on white, whatever the terminal's own colours are: of a code both must be seen. It is no
/// decoration, which NO_COLOR would be about.
const BLACK_ON_WHITE: &str = "\x1b[30;107m";
const AS_BEFORE: &str = "\x1b[0m";

/// The squares of a code with its margin.
pub struct Code {
    side: usize,
    is_dark: Vec<bool>,
}

impl Code {
    /// The code of a key. An eighth of it can be damaged.
    pub fn of(text: &KeyText) -> Self {
        let code = QrCode::with_error_correction_level(text.as_str(), EcLevel::M)
            .expect("a code has room for thousands of letters");
        let inside = code.width();
        let side = inside + 2 * MARGIN;
        let mut is_dark = vec![false; side * side];
        for (index, colour) in code.to_colors().into_iter().enumerate() {
            let (x, y) = (index % inside + MARGIN, index / inside + MARGIN);
            is_dark[y * side + x] = colour == Color::Dark;
        }
        Self { side, is_dark }
    }

    /// How many columns it takes on a terminal.
    pub fn columns(&self) -> usize {
        self.side
    }

    /// Rows are counted beyond the end as well, where everything is white.
    fn is_dark(&self, x: usize, y: usize) -> bool {
        self.is_dark.get(y * self.side + x).copied().unwrap_or(false)
    }

    /// Lines of text, each for two rows of squares.
    pub fn on_terminal(&self) -> String {
        let mut text = String::new();
        for y in (0..self.side).step_by(2) {
            text += BLACK_ON_WHITE;
            text.extend((0..self.side).map(|x| {
                match (self.is_dark(x, y), self.is_dark(x, y + 1)) {
                    (true, true) => '█',
                    (true, false) => '▀',
                    (false, true) => '▄',
                    (false, false) => ' ',
                }
            }));
            text += AS_BEFORE;
            text.push('\n');
        }
        text
    }

    /// A PNG file.
    pub fn png(&self) -> Vec<u8> {
        let side_px = self.side as u32 * MODULE_PX;
        let picture = GrayImage::from_fn(side_px, side_px, |x, y| {
            let is_dark = self.is_dark((x / MODULE_PX) as usize, (y / MODULE_PX) as usize);
            Luma([if is_dark { 0 } else { 255 }])
        });
        let mut file = Cursor::new(Vec::new());
        picture.write_to(&mut file, ImageFormat::Png).expect("memory takes every picture");
        file.into_inner()
    }

    /// An SVG file.
    pub fn svg(&self) -> String {
        let mut squares = String::new();
        for (index, _) in self.is_dark.iter().enumerate().filter(|(_, is_dark)| **is_dark) {
            let _ = write!(squares, "M{} {}h1v1h-1z", index % self.side, index / self.side);
        }
        let white = Rectangle::new().set("width", self.side).set("height", self.side);
        let document = Document::new()
            .set("viewBox", (0, 0, self.side, self.side))
            .set("shape-rendering", "crispEdges")
            .add(white.set("fill", "white"))
            .add(Path::new().set("d", squares).set("fill", "black"));
        format!("{document}\n")
    }
}

#[cfg(test)]
mod tests {
    use plumbline::seal::Key;

    use super::*;

    fn code() -> Code {
        Code::of(&Key::new([0x5a; 32]).unwrap().text())
    }

    /// The smallest code for so many letters of the alphanumeric set has 33 modules; bytes would
    /// take 41.
    #[test]
    fn a_key_takes_a_small_code() {
        assert_eq!(code().side, 33 + 2 * MARGIN);
    }

    #[test]
    fn the_terminal_and_the_pictures_show_the_same_squares() {
        let code = code();
        let lines: Vec<Vec<char>> = code
            .on_terminal()
            .lines()
            .map(|line| {
                let line = line.strip_prefix(BLACK_ON_WHITE).unwrap();
                line.strip_suffix(AS_BEFORE).unwrap().chars().collect()
            })
            .collect();
        let png = image::load_from_memory(&code.png()).unwrap().into_luma8();
        assert_eq!(png.width(), code.side as u32 * MODULE_PX);
        let svg = code.svg();
        let mut dark = 0;
        for y in 0..code.side {
            for (x, &letter) in lines[y / 2].iter().enumerate() {
                let shown = letter == '█' || letter == ['▀', '▄'][y % 2];
                let [px, py] = [x, y].map(|at| at as u32 * MODULE_PX + MODULE_PX / 2);
                assert_eq!(shown, png.get_pixel(px, py).0[0] < 128, "{x} {y}");
                assert_eq!(shown, svg.contains(&format!("M{x} {y}h")), "{x} {y}");
                let is_margin = [x, y].iter().any(|at| !(MARGIN..MARGIN + 33).contains(at));
                assert!(!(shown && is_margin), "{x} {y}");
                dark += usize::from(shown);
            }
        }
        assert!((400..700).contains(&dark), "{dark}");
    }
}
