//! Whether the squares of a checkerboard go on beyond a border of its lattice.
//!
//! The squares just outside the border corners belong to the board. In the next row outwards the
//! paper's margin follows, or, if corners were missed there, more squares, which alternate in step
//! with those inside. A row is compared with the row just inside: a board goes on when, in both
//! rows outside, each square differs from the next one in the right sense.

use heapless::Vec;

use super::lattice::{Lattice, Line};
use crate::find::corner::Corner;
use crate::limits::TARGET_CORNERS_MAX;
use crate::model::image::{GreyImage, Pixel};

/// Difference of neighbouring squares outside, relative to the mean one inside. A margin shows no
/// difference; a board that goes on shows all of it, less what the blur takes away.
const DIFFERENCE_MIN: f32 = 0.25;
/// Fewest differences that count as evidence: clutter agrees with any one of them in half of the
/// cases.
const fn differences_min(possible: usize) -> usize {
    let most = (3 * possible).div_ceil(4);
    if most < 2 { 2 } else { most }
}
/// Where the farther squares are sampled: in their nearer part, because the last squares of a board
/// are often cut, and a narrow margin ends soon.
const FARTHER_STEPS: f32 = 1.3;

/// Brightness of the squares along a border line: just inside, just outside, and one farther out.
type Rows = Vec<Option<[f32; 3]>, TARGET_CORNERS_MAX>;

/// Whether the second row of squares outside of a border line alternates like the board.
pub(super) fn squares_go_on<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    corners: &[Corner],
    line: &Line,
) -> bool {
    let mut rows = Rows::new();
    let mut previous: Option<([f32; 2], [f32; 2])> = None;
    for cell in line.cells() {
        let outer = lattice.corner(cell);
        let inner = lattice.corner([cell[0] - line.outwards[0], cell[1] - line.outwards[1]]);
        let here = outer.zip(inner).map(|(outer, inner)| {
            let [outer, inner] =
                [outer, inner].map(|index| corners[usize::from(index)].position_px);
            (outer, [outer[0] - inner[0], outer[1] - inner[1]])
        });
        let squares = previous.zip(here).and_then(|((a, step_a), (b, step_b))| {
            // The middle of the square between both, this many steps outside.
            let middle = |out: f32| {
                let coordinate =
                    |axis: usize| 0.5 * (a[axis] + b[axis] + out * (step_a[axis] + step_b[axis]));
                image.mean_around([coordinate(0), coordinate(1)].map(f64::from))
            };
            Some([middle(-0.5)?, middle(0.5)?, middle(FARTHER_STEPS)?])
        });
        // Cannot be full: a line has fewer corners than a target.
        let _ = rows.push(squares);
        previous = here;
    }
    // Each difference inside, and both outside, with the signs that a board that goes on would
    // have.
    let differences = rows.windows(2).filter_map(|pair| {
        let (here, next) = (pair[0]?, pair[1]?);
        let inside = here[0] - next[0];
        let sense = if inside < 0.0 { -1.0 } else { 1.0 };
        Some((inside.abs(), (next[1] - here[1]) * sense, (here[2] - next[2]) * sense))
    });
    let count = differences.clone().count();
    if count < differences_min(line.length().saturating_sub(2)) {
        return false;
    }
    let mean = differences.clone().map(|(inside, ..)| inside).sum::<f32>() / count as f32;
    let least = DIFFERENCE_MIN * mean;
    differences.into_iter().all(|(_, outside, farther)| outside > least && farther > least)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::find::grid::lattice::{Bounds, Least};
    use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT, grown};

    #[test]
    fn three_quarters_of_the_differences_and_at_least_two_are_evidence() {
        for (possible, least) in [(0, 2), (1, 2), (2, 2), (3, 3), (4, 3), (5, 4), (8, 6), (9, 7)] {
            assert_eq!(differences_min(possible), least, "{possible}");
        }
    }

    /// A larger board, of which the lattice lacks this many lines at its end along u.
    fn larger(lines: i32) -> Drawn {
        let mut drawn = Drawn::new([5 + lines, 6]);
        let hidden = (5..5 + lines).flat_map(|column| (0..6).map(move |row| [column, row]));
        drawn.hide(&hidden.collect::<Vec<_>>());
        drawn
    }

    fn go_on(drawn: &Drawn) -> [bool; 4] {
        let (lattice, bounds) = grown(&drawn.corners, Least::Target);
        assert_eq!(bounds, Bounds { first: [0, 0], last: [4, 5] });
        let image = drawn.image();
        bounds.borders().map(|line| squares_go_on(&image, &lattice, &drawn.corners, &line))
    }

    #[test]
    fn squares_go_on_where_lines_of_corners_are_missing() {
        assert_eq!(go_on(&larger(0)), [false; 4]);
        assert_eq!(go_on(&larger(1)), [false, false, false, true]);
        assert_eq!(go_on(&larger(2)), [false, false, false, true]);
        for (side, [columns, rows]) in
            [[-1..5, -2..-1], [-1..5, 6..7], [-2..-1, -1..6], [5..6, -1..6]].into_iter().enumerate()
        {
            let mut drawn = Drawn::new([5, 6]);
            drawn.print(columns, rows);
            let expected: [bool; 4] = core::array::from_fn(|place| place == side);
            assert_eq!(go_on(&drawn), expected);
        }
    }

    /// Of a contrast of 120, a quarter is 30: less is no difference, with the wrong sign or in one row alone.
    #[test]
    fn all_differences_in_both_rows_outside_are_a_quarter_of_those_inside() {
        let with = |just_outside: u8, farther: u8| {
            let mut drawn = Drawn::new([5, 6]);
            // Dark squares of other levels: just outside at (4, 0), (4, 2), (4, 4), and farther out at (5, 1) and
            // (5, 3).
            for row in [0.0, 2.0, 4.0] {
                drawn.paint(4.0..5.0, row..row + 1.0, just_outside);
            }
            for row in [1.0, 3.0] {
                drawn.paint(5.0..6.0, row..row + 1.0, farther);
            }
            go_on(&drawn)[3]
        };
        assert!(with(DARK, DARK));
        assert!(with(LIGHT - 31, LIGHT - 31));
        assert!(!with(LIGHT - 29, DARK));
        assert!(!with(DARK, LIGHT - 29));
        assert!(!with(DARK, LIGHT + 60));
        assert!(!with(LIGHT + 60, DARK));
        assert!(!with(LIGHT, DARK) && !with(DARK, LIGHT));
        // One that is missing contradicts all others.
        let mut drawn = larger(1);
        drawn.paint(5.0..6.0, 1.0..2.0, LIGHT);
        assert!(!go_on(&drawn)[3]);
        let mut drawn = larger(1);
        drawn.paint(4.0..5.0, 2.0..3.0, LIGHT);
        assert!(!go_on(&drawn)[3]);
    }

    #[test]
    fn with_too_few_differences_nothing_is_known() {
        // A line of six corners has five squares and four differences, of which three are needed.
        for (cell, is_known) in [([4, 5], true), ([4, 3], false)] {
            let mut drawn = larger(1);
            drawn.hide(&[cell]);
            assert_eq!(go_on(&drawn)[3], is_known, "{cell:?}");
        }
        // As well as without the corners one step inwards, which say how long a step is.
        for (cell, is_known) in [([3, 5], true), ([3, 2], false)] {
            let mut drawn = larger(1);
            drawn.hide(&[cell]);
            assert_eq!(go_on(&drawn)[3], is_known, "{cell:?}");
        }
    }
}
