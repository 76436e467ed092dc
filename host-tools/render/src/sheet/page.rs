//! A page as shapes, in millimetres from its top left corner, x right, y down.

/// The margin of a sheet on which printers cannot print, mm.
pub const EDGE_MM: f64 = 8.0;

/// A paper size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Paper {
    /// 210 x 297 mm.
    #[default]
    A4,
    /// 8.5 x 11 inches.
    Letter,
}

impl Paper {
    /// Width and height of the upright sheet, mm.
    #[must_use]
    pub fn size_mm(self) -> [f64; 2] {
        match self {
            Self::A4 => [210.0, 297.0],
            Self::Letter => [215.9, 279.4],
        }
    }

    /// The sizes of a sheet in both orientations, mm.
    pub(super) fn upright_and_across_mm(self) -> [[f64; 2]; 2] {
        let [width, height] = self.size_mm();
        [[width, height], [height, width]]
    }

    /// Its name as shown to people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::A4 => "A4",
            Self::Letter => "Letter",
        }
    }
}

/// One sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Width and height, mm.
    pub size_mm: [f64; 2],
    /// What is printed, in this order.
    pub shapes: Vec<Shape>,
}

/// An axis-aligned rectangle, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Its top left corner.
    pub corner: [f64; 2],
    /// Width and height.
    pub size: [f64; 2],
}

impl Rectangle {
    /// The bottom right corner, mm.
    #[must_use]
    pub fn end(&self) -> [f64; 2] {
        [self.corner[0] + self.size[0], self.corner[1] + self.size[1]]
    }

    /// The intersection of both, `None` when it has no area.
    #[must_use]
    pub fn common(&self, other: &Self) -> Option<Self> {
        let axis = |axis: usize| {
            let start = self.corner[axis].max(other.corner[axis]);
            let end = self.end()[axis].min(other.end()[axis]);
            (end > start).then_some((start, end - start))
        };
        let ((x, width), (y, height)) = (axis(0)?, axis(1)?);
        Some(Self { corner: [x, y], size: [width, height] })
    }

    /// Whether a point is inside or on the border.
    #[must_use]
    pub fn holds(&self, point: [f64; 2]) -> bool {
        (0..2).all(|axis| (self.corner[axis]..=self.end()[axis]).contains(&point[axis]))
    }

    /// Its border as four lines.
    #[must_use]
    pub fn border(&self, line: Stroke) -> [Shape; 4] {
        let ([left, top], [right, bottom]) = (self.corner, self.end());
        [
            [[left, top], [right, top]],
            [[right, top], [right, bottom]],
            [[left, bottom], [right, bottom]],
            [[left, top], [left, bottom]],
        ]
        .map(|ends| Shape::Line { ends, stroke: line })
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stroke {
    /// Black.
    Fine,
    /// Grey and dashed: where to cut.
    Cut,
}

impl Stroke {
    /// Dash and gap of [`Stroke::Cut`], mm.
    pub const DASH_MM: [f64; 2] = [2.0, 1.5];

    /// Width of every line, mm.
    pub const WIDTH_MM: f64 = 0.2;

    /// From 0, black, to 1, white.
    #[must_use]
    pub fn grey(self) -> f64 {
        match self {
            Self::Fine => 0.0,
            Self::Cut => 0.5,
        }
    }
}

/// Typefaces that every viewer has, from PDF's standard fonts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Font {
    /// Helvetica.
    Regular,
    /// Helvetica bold.
    Bold,
    /// Courier: 0.6 of its size per character.
    Mono,
}

/// Part of a page. Lengths in mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A black rectangle.
    Filled(Rectangle),
    /// A black polygon.
    Polygon(Vec<[f64; 2]>),
    /// A line along x or y.
    Line {
        /// From, to.
        ends: [[f64; 2]; 2],
        /// How it is drawn.
        stroke: Stroke,
    },
    /// One line of text.
    Text {
        /// Left end of the baseline.
        start: [f64; 2],
        /// Size of the font.
        size_mm: f64,
        /// Typeface.
        font: Font,
        /// Whether it reads upwards instead of to the right.
        upwards: bool,
        /// Latin-1, see [`is_printable`].
        text: String,
    },
}

/// Whether a text has only characters of the standard fonts: Latin-1 without control characters.
#[must_use]
pub fn is_printable(text: &str) -> bool {
    text.chars().all(|letter| matches!(letter, ' '..='~' | '\u{a0}'..='\u{ff}'))
}

impl Shape {
    /// Text that reads to the right.
    #[must_use]
    pub fn text(start: [f64; 2], size_mm: f64, font: Font, text: impl Into<String>) -> Self {
        Self::Text { start, size_mm, font, upwards: false, text: text.into() }
    }

    /// The shape, moved.
    #[must_use]
    pub fn moved(self, by: [f64; 2]) -> Self {
        self.mapped(|[x, y]| [x + by[0], y + by[1]])
    }

    /// The shape after a quarter turn counterclockwise about the page's corner, so that its text
    /// reads upwards; (x, y) goes to (y, -x).
    #[must_use]
    pub fn turned(self) -> Self {
        match self.mapped(|[x, y]| [y, -x]) {
            Self::Text { start, size_mm, font, upwards, text } => {
                assert!(!upwards, "text is turned at most once");
                Self::Text { start, size_mm, font, upwards: true, text }
            }
            other => other,
        }
    }

    /// `map` is a motion by quarter turns. Text keeps its orientation.
    fn mapped(self, map: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        match self {
            Self::Filled(rectangle) => {
                let [a, b] = [map(rectangle.corner), map(rectangle.end())];
                let corner = [a[0].min(b[0]), a[1].min(b[1])];
                let size = [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()];
                Self::Filled(Rectangle { corner, size })
            }
            Self::Polygon(points) => Self::Polygon(points.into_iter().map(map).collect()),
            Self::Line { ends, stroke } => Self::Line { ends: ends.map(map), stroke },
            Self::Text { start, size_mm, font, upwards, text } => {
                Self::Text { start: map(start), size_mm, font, upwards, text }
            }
        }
    }

    /// The part within a window: rectangles and lines are clipped to it; a polygon or a text
    /// belongs to the window in which it starts.
    #[must_use]
    pub fn within(&self, window: &Rectangle) -> Option<Self> {
        match self {
            Self::Filled(rectangle) => rectangle.common(window).map(Self::Filled),
            Self::Polygon(points) => window.holds(*points.first()?).then(|| self.clone()),
            Self::Text { start, .. } => window.holds(*start).then(|| self.clone()),
            Self::Line { ends, stroke } => {
                let clamp = |[x, y]: [f64; 2]| {
                    [
                        x.clamp(window.corner[0], window.end()[0]),
                        y.clamp(window.corner[1], window.end()[1]),
                    ]
                };
                let [start, end] = ends.map(clamp);
                // Clamping moves a line that misses the window off itself.
                let across = if ends[0][0] == ends[1][0] { 0 } else { 1 };
                let stays = start[across] == ends[0][across] && start != end;
                stays.then_some(Self::Line { ends: [start, end], stroke: *stroke })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Rectangle = Rectangle { corner: [10.0, 20.0], size: [30.0, 40.0] };

    #[test]
    fn what_passes_a_window_by_is_not_in_it() {
        let line = |ends| Shape::Line { ends, stroke: Stroke::Cut };
        let across = line([[0.0, 30.0], [100.0, 30.0]]);
        assert_eq!(across.within(&WINDOW), Some(line([[10.0, 30.0], [40.0, 30.0]])));
        for outside in
            [[[0.0, 5.0], [100.0, 5.0]], [[50.0, 0.0], [50.0, 100.0]], [[50.0, 30.0], [90.0, 30.0]]]
        {
            assert_eq!(line(outside).within(&WINDOW), None, "{outside:?}");
        }
        let square = |corner, size| Shape::Filled(Rectangle { corner, size });
        let cut = square([35.0, 50.0], [10.0, 10.0]).within(&WINDOW);
        assert_eq!(cut, Some(square([35.0, 50.0], [5.0, 10.0])));
        assert_eq!(square([40.0, 50.0], [10.0, 10.0]).within(&WINDOW), None);
    }

    #[test]
    fn a_turned_shape_reads_upwards() {
        let filled = Shape::Filled(Rectangle { corner: [1.0, 2.0], size: [10.0, 3.0] });
        let expected = Rectangle { corner: [2.0, -11.0], size: [3.0, 10.0] };
        assert_eq!(filled.turned(), Shape::Filled(expected));
        let text = Shape::text([1.0, 2.0], 3.0, Font::Bold, "up").turned();
        assert!(matches!(text, Shape::Text { start: [2.0, -1.0], upwards: true, .. }));
    }
}
