//! Where in the frame the boards were seen.

use nalgebra::Vector2;

/// Cells of the map: across and down.
pub const COLUMNS: usize = 12;
pub const ROWS: usize = 8;

/// A board nearer to a side of the frame than this part of it has reached that side.
const SIDE: f64 = 0.15;

/// In how many photographs each cell of the frame showed a part of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coverage {
    photographs: [[usize; COLUMNS]; ROWS],
}

impl Coverage {
    /// From what each photograph shows: raw pixels, in a frame of this size.
    pub fn new<'a>(
        photographs: impl Iterator<Item = &'a [Vector2<f64>]>,
        size_px: [f64; 2],
    ) -> Self {
        let mut counts = [[0; COLUMNS]; ROWS];
        for places_px in photographs {
            let mut touched = [[false; COLUMNS]; ROWS];
            for place_px in places_px {
                // The frame begins half a pixel before the middle of its first one.
                let cell = |value: f64, side: f64, cells: usize| {
                    (((value + 0.5) / side * cells as f64) as usize).min(cells - 1)
                };
                let column = cell(place_px.x, size_px[0], COLUMNS);
                touched[cell(place_px.y, size_px[1], ROWS)][column] = true;
            }
            for (count, touched) in counts.as_flattened_mut().iter_mut().zip(touched.as_flattened())
            {
                *count += usize::from(*touched);
            }
        }
        Self { photographs: counts }
    }

    /// The part of the frame in which a board was seen at all.
    #[must_use]
    pub fn share(&self) -> f64 {
        let cells = self.photographs.as_flattened();
        cells.iter().filter(|count| **count > 0).count() as f64 / cells.len() as f64
    }

    /// The sides of the frame that no board came near.
    #[must_use]
    pub fn missed_sides(&self) -> Vec<&'static str> {
        let seen = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| {
            self.photographs[rows]
                .iter()
                .any(|row| row[columns.clone()].iter().any(|&count| count > 0))
        };
        let reach = |cells: usize| ((SIDE * cells as f64).round() as usize).max(1);
        let (x, y) = (reach(COLUMNS), reach(ROWS));
        let sides = [
            ("left", seen(0..ROWS, 0..x)),
            ("right", seen(0..ROWS, COLUMNS - x..COLUMNS)),
            ("upper", seen(0..y, 0..COLUMNS)),
            ("lower", seen(ROWS - y..ROWS, 0..COLUMNS)),
        ];
        sides.into_iter().filter(|(_, seen)| !seen).map(|(name, _)| name).collect()
    }

    /// The map, a line per row of cells: `.` for no photograph, a digit for so many, 9 for nine
    /// or more.
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

    #[test]
    fn cells_count_photographs_and_not_corners() {
        let corner = vec![Vector2::new(0.0, 0.0), Vector2::new(10.0, 5.0)];
        let opposite = vec![Vector2::new(1199.0, 799.0)];
        let photographs = [&corner[..], &corner, &opposite];
        let coverage = Coverage::new(photographs.into_iter(), [1200.0, 800.0]);
        let lines = coverage.lines();
        assert_eq!(lines[0], "2...........");
        assert_eq!(lines[7], "...........1");
        assert!((coverage.share() - 2.0 / 96.0).abs() < 1e-12);
        assert!(coverage.missed_sides().is_empty());
        let left = Coverage::new([&corner[..]].into_iter(), [1200.0, 800.0]);
        assert_eq!(left.missed_sides(), ["right", "lower"]);
    }
}
