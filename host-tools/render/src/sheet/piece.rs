//! One target as it is cut out: its squares, a white margin of one square and, beyond that margin,
//! where it does not disturb the search, a strip that tells a person which end is up.

use plumbline_files::targets::TargetDescription;

use super::page::{Font, Rectangle, Shape, Stroke};

/// Height of the strip above the margin, mm.
const STRIP_MM: f64 = 10.0;

/// The width needed by the arrow and the texts of the strip, mm.
const STRIP_TEXT_MM: f64 = 62.0;

/// The largest distance of the arrow from the margin's left edge, mm. It normally stands above the
/// left edge of the squares, which is printable; for large squares this limit lets the strip fit on
/// one sheet.
const STRIP_LEFT_MM_MAX: f64 = 12.0;

/// Width and height of the arrow, mm.
const ARROW_MM: [f64; 2] = [6.0, 8.0];

/// A target as printed.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    name: String,
    columns: u8,
    rows: u8,
    /// Side of a square, mm; the margin is as wide.
    pub pitch_mm: f64,
    /// Whether the strip above the margin is printed.
    pub strip: bool,
}

impl Piece {
    /// The piece with its strip. `pitch_mm` replaces the pitch of the description.
    #[must_use]
    pub fn new(description: &TargetDescription, pitch_mm: f64) -> Self {
        let &TargetDescription { columns, rows, .. } = description;
        Self { name: description.name.clone(), columns, rows, pitch_mm, strip: true }
    }

    /// A description of the target in words.
    #[must_use]
    pub fn words(&self) -> String {
        let Self { name, columns, rows, pitch_mm, .. } = self;
        format!("{name}: {columns} x {rows} inner corners, pitch {pitch_mm} mm")
    }

    /// The size of the whole piece, including margin and strip, mm.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        // One more square than inner corners, plus the margin on both sides.
        let [width, height] =
            [self.columns, self.rows].map(|corners| (f64::from(corners) + 3.0) * self.pitch_mm);
        if self.strip {
            [width.max(self.strip_left_mm() + STRIP_TEXT_MM), height + STRIP_MM]
        } else {
            [width, height]
        }
    }

    fn strip_left_mm(&self) -> f64 {
        self.pitch_mm.min(STRIP_LEFT_MM_MAX)
    }

    /// The outline to cut along.
    #[must_use]
    pub fn outline(&self) -> [Shape; 4] {
        Rectangle { corner: [0.0, 0.0], size: self.size_mm() }.border(Stroke::Cut)
    }

    /// Squares and strip, from the piece's top left corner.
    #[must_use]
    pub fn shapes(&self) -> Vec<Shape> {
        let pitch_mm = self.pitch_mm;
        let top_mm = if self.strip { STRIP_MM } else { 0.0 };
        let squares = (0..=self.rows).flat_map(|row| {
            // The square up and left of corner 0 is dark: see `plumbline::parts::Grid`.
            let dark = (0..=self.columns).filter(move |column| (column + row) % 2 == 0);
            dark.map(move |column| {
                let along = |square: u8| (f64::from(square) + 1.0) * pitch_mm;
                let corner = [along(column), top_mm + along(row)];
                Shape::Filled(Rectangle { corner, size: [pitch_mm; 2] })
            })
        });
        let mut shapes: Vec<Shape> = squares.collect();
        if self.strip {
            let left = self.strip_left_mm();
            let text_left = left + ARROW_MM[0] + 2.0;
            shapes.push(arrow([left, 1.0]));
            shapes.push(Shape::text([text_left, 4.4], 3.3, Font::Bold, "This side up"));
            shapes.push(Shape::text([text_left, 8.2], 2.3, Font::Regular, self.words()));
        }
        shapes
    }
}

/// An arrow that points up the page, from its top left corner.
fn arrow([x, y]: [f64; 2]) -> Shape {
    let [width, height] = ARROW_MM;
    let (middle, neck, stem) = (x + width / 2.0, y + 0.55 * height, 0.15 * width);
    Shape::Polygon(vec![
        [middle, y],
        [x + width, neck],
        [middle + stem, neck],
        [middle + stem, y + height],
        [middle - stem, y + height],
        [middle - stem, neck],
        [x, neck],
    ])
}

/// Width and height of [`mark`], mm.
pub const MARK_MM: [f64; 2] = [10.0, 32.0];

/// The arrow and its words as a column, for a sheet without room above the margin.
#[must_use]
pub fn mark() -> Vec<Shape> {
    let words = Shape::text([0.0, 0.0], 3.3, Font::Bold, "This side up").turned();
    vec![arrow([0.0, 0.0]), words.moved([4.2, MARK_MM[1]])]
}
