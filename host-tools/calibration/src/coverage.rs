//! Where in the frame boards were seen, and where one is needed next.

use nalgebra::Vector2;

/// The number of cells of the map across.
pub const COLUMNS: usize = 12;
/// The number of cells of the map down.
pub const ROWS: usize = 8;

/// A point within this fraction of the frame from a side has reached that side; a point that close
/// to two sides has reached their corner. Distortion grows with the cube of the distance from the
/// centre, or faster: there it is a third of that in the very corner, and everything beyond is
/// extrapolated. A board of 9 x 6 corners, 9 squares high with its margin, comes this close if it
/// fills two thirds of the frame's height: its outermost corners lie two squares inside its edge.
const NEAR: f64 = 0.15;

/// The fraction of the frame in which a board should have been seen.
const SHARE_MIN: f64 = 0.6;

/// The parts of the frame, from top to bottom and from left to right.
const PARTS: [[&str; 3]; 3] = [
    ["in the upper left corner", "at the upper side", "in the upper right corner"],
    ["at the left side", "in the middle", "at the right side"],
    ["in the lower left corner", "at the lower side", "in the lower right corner"],
];

/// The positions of the corners in [`PARTS`].
const CORNERS: [(&str, [usize; 2]); 4] = [
    ("upper left", [0, 0]),
    ("upper right", [0, 2]),
    ("lower left", [2, 0]),
    ("lower right", [2, 2]),
];

/// The number of photographs in which each cell of the frame showed part of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coverage {
    photographs: [[usize; COLUMNS]; ROWS],
    /// Whether a board was seen, by rows: near the upper side, between, near the lower side; by
    /// columns: near the left side, between, near the right side.
    reached: [[bool; 3]; 3],
}

impl Coverage {
    /// Counts the corners that each photograph shows: raw pixels, in a frame of this size.
    pub fn new<'a>(
        photographs: impl Iterator<Item = &'a [Vector2<f64>]>,
        size_px: [f64; 2],
    ) -> Self {
        let mut coverage = Self { photographs: [[0; COLUMNS]; ROWS], reached: [[false; 3]; 3] };
        for places_px in photographs {
            let mut touched = [[false; COLUMNS]; ROWS];
            for place_px in places_px {
                // The frame begins half a pixel before the centre of its first pixel.
                let x = (place_px.x + 0.5) / size_px[0];
                let y = (place_px.y + 0.5) / size_px[1];
                let cell =
                    |part: f64, cells: usize| ((part * cells as f64) as usize).min(cells - 1);
                touched[cell(y, ROWS)][cell(x, COLUMNS)] = true;
                let margin =
                    |part: f64| 1 + usize::from(part > 1.0 - NEAR) - usize::from(part < NEAR);
                coverage.reached[margin(y)][margin(x)] = true;
            }
            let counts = coverage.photographs.as_flattened_mut();
            for (count, touched) in counts.iter_mut().zip(touched.as_flattened()) {
                *count += usize::from(*touched);
            }
        }
        coverage
    }

    /// The number of photographs in which each cell showed part of the board: rows from the top, each
    /// from the left.
    #[must_use]
    pub fn photographs(&self) -> &[[usize; COLUMNS]; ROWS] {
        &self.photographs
    }

    /// The fraction of the frame in which a board was seen at all.
    #[must_use]
    pub fn share(&self) -> f64 {
        let cells = self.photographs.as_flattened();
        cells.iter().filter(|count| **count > 0).count() as f64 / cells.len() as f64
    }

    /// The sides of the frame that no board came near, and the corners between sides that were
    /// reached.
    #[must_use]
    pub fn missed(&self) -> Vec<String> {
        let is_seen = |parts: [[usize; 2]; 3]| parts.iter().any(|&[y, x]| self.reached[y][x]);
        let down = |x| is_seen([0, 1, 2].map(|y| [y, x]));
        let across = |y| is_seen([0, 1, 2].map(|x| [y, x]));
        let sides =
            [("left", down(0)), ("right", down(2)), ("upper", across(0)), ("lower", across(2))];
        let sides =
            sides.into_iter().filter(|(_, seen)| !seen).map(|(name, _)| format!("the {name} side"));
        let corners = CORNERS
            .into_iter()
            .filter(|&(_, [y, x])| !self.reached[y][x] && across(y) && down(x))
            .map(|(name, _)| format!("the {name} corner"));
        sides.chain(corners).collect()
    }

    /// Where a board should be seen next; `None` when no part of the frame is missing.
    #[must_use]
    pub fn next(&self) -> Option<&'static str> {
        // If boards reached all corners, they also reached all sides.
        let corner = CORNERS.into_iter().find(|&(_, [y, x])| !self.reached[y][x]);
        if let Some((_, [y, x])) = corner {
            return Some(PARTS[y][x]);
        }
        (self.share() < SHARE_MIN).then(|| self.emptiest())
    }

    /// The one of the nine [`PARTS`] of the frame with the most unseen cells.
    fn emptiest(&self) -> &'static str {
        let mut unseen = [[0; 3]; 3];
        for (row, counts) in self.photographs.iter().enumerate() {
            for (column, _) in counts.iter().enumerate().filter(|(_, count)| **count == 0) {
                unseen[3 * row / ROWS][3 * column / COLUMNS] += 1;
            }
        }
        let parts = PARTS.as_flattened().iter().zip(unseen.as_flattened());
        // The first of several equal ones.
        let emptiest = parts.rev().max_by_key(|(_, unseen)| **unseen);
        emptiest.map_or("in the middle", |(part, _)| part)
    }

    /// The map, one line per row of cells: `.` for no photograph, otherwise their number, with 9
    /// for nine or more.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let letter = |count: usize| match count {
            0 => '.',
            _ => char::from_digit(count.min(9) as u32, 10).expect("one digit"),
        };
        self.photographs
            .iter()
            .map(|row| row.iter().map(|&count| letter(count)).collect())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [f64; 2] = [1200.0, 800.0];

    fn coverage(photographs: &[&[[f64; 2]]]) -> Coverage {
        let photographs: Vec<Vec<_>> = photographs
            .iter()
            .map(|places_px| places_px.iter().map(|&place| Vector2::from(place)).collect())
            .collect();
        Coverage::new(photographs.iter().map(Vec::as_slice), SIZE_PX)
    }

    #[test]
    fn cells_count_photographs_and_not_corners() {
        let corner: &[_] = &[[0.0, 0.0], [10.0, 5.0]];
        let coverage = coverage(&[corner, corner, &[[1199.0, 799.0]]]);
        let lines = coverage.lines();
        assert_eq!(lines[0], "2...........");
        assert_eq!(lines[7], "...........1");
        assert!((coverage.share() - 2.0 / 96.0).abs() < 1e-12);
    }

    #[test]
    fn a_side_is_missed_and_else_its_corner() {
        let none = coverage(&[]).missed();
        assert_eq!(none, ["the left side", "the right side", "the upper side", "the lower side"]);
        assert_eq!(coverage(&[&[[10.0, 5.0]]]).missed(), ["the right side", "the lower side"]);
        let diagonal = coverage(&[&[[10.0, 5.0]], &[[1190.0, 795.0]]]);
        assert_eq!(diagonal.missed(), ["the upper right corner", "the lower left corner"]);
        // The middle of every side, but no corner.
        let sides = coverage(&[&[[10.0, 400.0], [1190.0, 400.0], [600.0, 5.0], [600.0, 795.0]]]);
        let corners = CORNERS.map(|(name, _)| format!("the {name} corner"));
        assert_eq!(sides.missed(), corners);
    }

    /// 15 % of the frame is 180 px across and 120 px down.
    #[test]
    fn a_corner_is_reached_from_near_to_both_of_its_sides() {
        let others = [[10.0, 790.0], [1190.0, 10.0], [1190.0, 790.0]];
        let with = |place| coverage(&[&others, &[place]]).missed();
        assert_eq!(with([179.0, 119.0]), [""; 0]);
        for place in [[181.0, 119.0], [179.0, 121.0], [181.0, 121.0]] {
            assert_eq!(with(place), ["the upper left corner"], "{place:?}");
        }
    }

    #[test]
    fn the_next_place_is_a_corner_then_the_emptiest_part_then_none() {
        let mut places = Vec::new();
        for (corner, place) in [
            ("in the upper left corner", [10.0, 10.0]),
            ("in the upper right corner", [1190.0, 10.0]),
            ("in the lower left corner", [10.0, 790.0]),
            ("in the lower right corner", [1190.0, 790.0]),
        ] {
            assert_eq!(coverage(&[&places]).next(), Some(corner));
            places.push(place);
        }
        let cells = |columns: std::ops::Range<i32>| -> Vec<[f64; 2]> {
            let middle = |cell: i32| 50.0 + 100.0 * f64::from(cell);
            columns.flat_map(|x| (0..8).map(move |y| [middle(x), middle(y)])).collect()
        };
        assert_eq!(coverage(&[&places, &cells(0..6)]).next(), Some("at the right side"));
        assert_eq!(coverage(&[&places, &cells(0..7)]).next(), None);
    }
}
