//! The legend beside a sheet's targets: the ruler, the instructions, the entry of targets.toml.

use super::page::{Font, Shape, Stroke};

/// The position of texts and of the ruler's zero from the legend's left edge: half a label, mm.
pub const INDENT_MM: f64 = 1.0;
/// Length of the ruler, mm.
const RULER_MM: u8 = 100;
/// The position at which the entry begins, mm.
const ENTRY_LEFT_MM: f64 = 112.0;
/// 6 points: the longest line of an entry, 36 letters, is 46 mm long.
const ENTRY_FONT_MM: f64 = 2.117;
const ENTRY_LINE_MM: f64 = 2.45;
/// Width of the legend, mm.
pub const WIDTH_MM: f64 = ENTRY_LEFT_MM + 46.0;

const HINTS: [&str; 3] = [
    "Print at 100 % (\"actual size\"): the ruler must measure 100 mm.",
    "Glue it to something flat and stiff. Keep the white margin of one square all around.",
    "Measure the print over many squares. If the pitch differs, correct it in targets.toml.",
];

/// The legend of one sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct Legend {
    /// The contents of the sheet, in a few words.
    pub title: String,
    /// The entry for targets.toml.
    pub entry: String,
}

impl Legend {
    /// Height, mm.
    #[must_use]
    pub fn height_mm(&self) -> f64 {
        let entry_mm = (self.entry.trim_end().lines().count() + 1) as f64 * ENTRY_LINE_MM;
        entry_mm.max(26.0)
    }

    /// The shapes, relative to the legend's top left corner.
    #[must_use]
    pub fn shapes(&self) -> Vec<Shape> {
        let left = INDENT_MM;
        let mut shapes = ruler([left, 6.0]);
        shapes.push(Shape::text([left, 3.0], 3.3, Font::Bold, &self.title));
        for (line, hint) in HINTS.iter().enumerate() {
            let base = [left, 18.0 + 3.4 * line as f64];
            shapes.push(Shape::text(base, 2.5, Font::Regular, *hint));
        }
        let entry = std::iter::once("# targets.toml").chain(self.entry.trim_end().lines());
        for (line, text) in entry.enumerate() {
            let base = [ENTRY_LEFT_MM, 2.0 + ENTRY_LINE_MM * line as f64];
            shapes.push(Shape::text(base, ENTRY_FONT_MM, Font::Mono, text));
        }
        shapes
    }
}

/// A ruler of 100 mm, measured between the centres of its first and last line.
fn ruler([left, top]: [f64; 2]) -> Vec<Shape> {
    let line = |from, to| Shape::Line { ends: [from, to], stroke: Stroke::Fine };
    let mut shapes = vec![line([left, top], [left + f64::from(RULER_MM), top])];
    for mm in 0..=RULER_MM {
        let x = left + f64::from(mm);
        let length = match mm {
            mm if mm % 10 == 0 => 4.0,
            mm if mm % 5 == 0 => 3.0,
            _ => 2.0,
        };
        shapes.push(line([x, top], [x, top + length]));
        if mm % 10 == 0 {
            let label = if mm == RULER_MM { format!("{mm} mm") } else { mm.to_string() };
            // A Helvetica digit is 0.556 of its size wide; the number is centred, its unit follows.
            let half_mm = mm.to_string().len() as f64 * 0.556 * 2.5 / 2.0;
            shapes.push(Shape::text([x - half_mm, top + 7.0], 2.5, Font::Regular, label));
        }
    }
    shapes
}
