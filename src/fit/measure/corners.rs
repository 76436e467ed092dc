//! The corners where the edges that were used meet.

use crate::fit::nodes::Direction;
use crate::model::target::TargetGeometry;

/// How many of its four edges a corner needs.
pub(super) const EDGES_OF_CORNER_MIN: u8 = 3;

/// The edges that meet at a corner, two of each direction where all were used. Each gives the
/// displacement across itself, and the mean of the two on both sides of a corner is the
/// displacement of the corner.
#[derive(Default, Clone, Copy)]
pub(super) struct Crossing {
    distances_px: [f64; 2],
    counts: [u8; 2],
}

impl Crossing {
    pub(super) fn add(&mut self, direction: Direction, distance_px: f64) {
        self.distances_px[direction as usize] += distance_px;
        self.counts[direction as usize] += 1;
    }

    pub(super) fn edges(&self) -> u8 {
        self.counts.iter().sum()
    }

    /// The squared displacement of the corner, which needs at least one edge of each direction.
    pub(super) fn square_px2(&self) -> f64 {
        let [x, y] = [0, 1].map(|place| self.distances_px[place] / f64::from(self.counts[place]));
        x * x + y * y
    }
}

/// True when at least half of the corners of each of the grid's four border
/// lines were used: the grid's extent then proves that it was not shifted by a
/// square, whatever was expected.
#[must_use]
pub fn extent_is_certain(target: &TargetGeometry, used: u128) -> bool {
    let (columns, rows) = (target.columns(), target.rows());
    let seen = |row: usize, column: usize| used >> (row * columns + column) & 1 == 1;
    let line = |count: usize, length: usize| 2 * count >= length;
    [0, rows - 1]
        .into_iter()
        .all(|row| line((0..columns).filter(|&column| seen(row, column)).count(), columns))
        && [0, columns - 1]
            .into_iter()
            .all(|column| line((0..rows).filter(|&row| seen(row, column)).count(), rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::target::{Origin, Role};
    use crate::test_support::Random;

    #[test]
    fn an_extent_is_certain_only_with_all_four_borders() {
        let target =
            TargetGeometry::checker(5, 4, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap();
        let all = (1_u128 << 20) - 1;
        assert!(extent_is_certain(&target, all));
        // Without the left column; without the bottom row except one corner.
        let left = 1 | 1 << 5 | 1 << 10 | 1 << 15;
        assert!(!extent_is_certain(&target, all & !left));
        assert!(!extent_is_certain(&target, all & !(0b11110 << 15)));
        // A hole in the middle does not matter.
        assert!(extent_is_certain(&target, all & !(0b01110 << 5)));
    }

    #[test]
    fn half_of_the_corners_of_each_border_line_are_needed() {
        let mut random = Random::new(1);
        let (mut certain, mut uncertain) = (0, 0);
        for [columns, rows] in [[5, 4], [4, 5], [3, 3], [6, 7]] {
            let target =
                TargetGeometry::checker(columns, rows, 12.0, Origin::Center, Role::Upper, [0.0; 3])
                    .unwrap();
            let [columns, rows] = [columns, rows].map(usize::from);
            for _ in 0..500 {
                // Each corner is seen with a probability of three quarters.
                let used = u128::from(random.bits() | random.bits());
                let seen = |place: &usize| used & (1 << place) != 0;
                let is_half = |line: &mut dyn Iterator<Item = usize>, length: usize| {
                    line.filter(seen).count() >= length.div_ceil(2)
                };
                let last = columns * rows;
                let expected = is_half(&mut (0..columns), columns)
                    && is_half(&mut (last - columns..last), columns)
                    && is_half(&mut (0..last).step_by(columns), rows)
                    && is_half(&mut (columns - 1..last).step_by(columns), rows);
                assert_eq!(extent_is_certain(&target, used), expected, "{columns} {rows} {used:b}");
                *(if expected { &mut certain } else { &mut uncertain }) += 1;
            }
        }
        assert!(certain > 100 && uncertain > 100, "{certain} {uncertain}");
    }

    #[test]
    fn a_corner_is_displaced_by_the_mean_of_its_edges_of_each_direction() {
        let mut met = Crossing::default();
        assert_eq!(met.edges(), 0);
        met.add(Direction::X, 0.5);
        met.add(Direction::X, 0.25);
        met.add(Direction::Y, -1.0);
        assert_eq!(met.edges(), 3);
        assert_eq!(met.square_px2(), 0.375 * 0.375 + 1.0);
        met.add(Direction::Y, 0.5);
        assert_eq!(met.edges(), 4);
        assert_eq!(met.square_px2(), 0.375 * 0.375 + 0.25 * 0.25);
    }
}
