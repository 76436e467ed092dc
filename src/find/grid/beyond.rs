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
