//! What a lattice needs to be the grid of a wanted shape. Nothing is printed in these pictures: then the
//! corners decide, and the squares beyond them say nothing.

use super::drawn::{corners_at, grown, px};
use super::*;
use crate::test_support::Random;

const WIDTH: usize = 400;
static PLAIN: [u8; WIDTH * 320] = [110; WIDTH * 320];

const fn shape(columns: u8, rows: u8) -> GridShape {
    GridShape { columns, rows }
}

/// The part of a plain picture with these sides.
fn plain([width, height]: [usize; 2]) -> GreyImage<'static, u8> {
    GreyImage::new(&PLAIN, width, height, WIDTH).unwrap()
}

/// The lattice of these corners in such a picture, if it is a grid of the shape.
fn judged(
    corners: &[Corner],
    sides: [usize; 2],
    shape: GridShape,
) -> Result<Judged, GridRejection> {
    let (mut lattice, bounds) = grown(corners, Least::Target);
    assert_eq!(lattice.cells().count(), corners.len());
    judge(&plain(sides), &mut lattice, corners, bounds, shape)
}

/// The corners of a board of 6 x 5, without these, and with more beyond it.
fn lumbar_corners(hidden: &[[i32; 2]], clutter: &[[i32; 2]], clutter_score: f32) -> Vec<Corner> {
    let cells = Bounds { first: [0; 2], last: [7, 6] }.cells();
    let all = corners_at([8, 7], px).into_iter().zip(cells);
    let board = Bounds { first: [0; 2], last: [5, 4] };
    all.filter_map(|(corner, cell)| {
        if board.contains(cell) {
            (!hidden.contains(&cell)).then_some(corner)
        } else {
            clutter.contains(&cell).then_some(Corner { score: clutter_score, ..corner })
        }
    })
    .collect()
}

#[test]
fn each_rejection_is_told_in_words() {
    use std::string::ToString as _;
    for (rejection, words) in [
        (GridRejection::NoLattice, "no checkerboard is seen"),
        (GridRejection::OtherDimensions, "only checkerboards with other columns and rows are seen"),
        (GridRejection::Cut, "the checkerboard touches the border of the picture"),
        (GridRejection::Incomplete, "too many of the checkerboard's corners are hidden or blurred"),
        (
            GridRejection::GoesOn,
            "the checkerboard seems to go on beyond the wanted columns and rows",
        ),
        (GridRejection::Ambiguous, "two checkerboards of the same shape are seen"),
    ] {
        assert_eq!(rejection.to_string(), words);
    }
}

#[test]
fn a_lattice_may_be_a_shape_and_two_more_lines_of_clutter_along_each_axis() {
    for (columns, rows) in (3..=13).flat_map(|columns| (3..=13).map(move |rows| (columns, rows))) {
        for (seen_u, seen_v) in (3..=16).flat_map(|u| (3..=16).map(move |v| (u, v))) {
            let is_more = |seen: i32, lines: u8| (0..=2).contains(&(seen - i32::from(lines)));
            let fits = (is_more(seen_u, columns) && is_more(seen_v, rows))
                || (is_more(seen_u, rows) && is_more(seen_v, columns));
            let is_target = usize::from(columns) * usize::from(rows) <= TARGET_CORNERS_MAX;
            let bounds = Bounds { first: [-2, 1], last: [seen_u - 3, seen_v] };
            let may_be = may_be(bounds, shape(columns, rows));
            assert_eq!(may_be, fits && is_target, "{seen_u} {seen_v}: {columns} x {rows}");
        }
    }
}

#[test]
fn a_corner_can_be_detected_seven_pixels_from_the_border() {
    let image = plain([300, 200]);
    for (place, is_inside) in [
        ([7.0, 7.0], true),
        ([6.9, 100.0], false),
        ([100.0, 6.9], false),
        ([292.0, 192.0], true),
        ([292.1, 100.0], false),
        ([100.0, 192.1], false),
        ([150.0, 100.0], true),
        ([f32::NAN, 100.0], false),
        ([-100.0, 100.0], false),
    ] {
        assert_eq!(is_detectable(&image, place), is_inside, "{place:?}");
    }
}

#[test]
fn the_median_is_that_of_the_scores_within_the_bounds() {
    // The largest lattice in which a target is looked for.
    let [columns, rows] = [TARGET_CORNERS_MAX as i32 / 3 + 2, 5];
    let mut random = Random::new(50);
    let mut corners = corners_at([columns, rows], px);
    // Higher from row to row: without the last corners, or the first, the median is another one.
    for (number, corner) in (0..).zip(&mut corners) {
        corner.score = random.uniform(0.1, 0.3) as f32 + 0.1 * (number / columns) as f32;
    }
    let (mut lattice, all) = grown(&corners, Least::Target);
    for bounds in
        [all, Bounds { first: [1, 2], last: [3, 3] }, Bounds { first: [2; 2], last: [4; 2] }]
    {
        let inside = bounds.cells().map(|[u, v]| corners[(v * columns + u) as usize].score);
        let mut scores: Vec<f32> = inside.collect();
        scores.sort_by(f32::total_cmp);
        assert_eq!(
            median_score(&lattice, &corners, bounds),
            scores[scores.len() / 2],
            "{bounds:?}"
        );
    }
    let one = Bounds { first: [2; 2], last: [2; 2] };
    assert_eq!(median_score(&lattice, &corners, one), corners[(2 * columns + 2) as usize].score);
    lattice.remove([2, 2]);
    assert_eq!(median_score(&lattice, &corners, one), 0.0);
}

/// Where all steps along an axis are the same, their mean direction is known.
#[test]
fn rightwards_is_the_cosine_between_a_step_and_the_x_axis() {
    for turn_deg in [0.0_f64, 20.0, 75.0, 90.0, 130.0, 200.0, 310.0] {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        // Steps of 20 px along u, and of 15 px along v, 80 degrees from it.
        let (sin_v, cos_v) = (turn_deg + 80.0).to_radians().sin_cos();
        let at = |[u, v]: [f64; 2]| {
            [200.0 + 20.0 * cos * u + 15.0 * cos_v * v, 160.0 + 20.0 * sin * u + 15.0 * sin_v * v]
        };
        let corners = corners_at([4, 5], at);
        let (mut lattice, bounds) = grown(&corners, Least::Target);
        lattice.remove([2, 1]);
        for (step, expected) in [([1, 0], cos), ([-1, 0], -cos), ([0, 1], cos_v), ([0, -1], -cos_v)]
        {
            let cosine = rightwards(&lattice, &corners, bounds, step);
            // Single precision, of positions of some hundred pixels.
            assert!((f64::from(cosine) - expected).abs() < 1e-5, "{turn_deg} {step:?}: {cosine}");
        }
        // Without a step there is no direction.
        let one = Bounds { first: [3, 4], last: [3, 4] };
        assert_eq!(rightwards(&lattice, &corners, one, [1, 0]), 0.0);
    }
    // In perspective, it is the sum of all steps that has the direction.
    let corners = corners_at([3, 3], |[u, v]| [100.0 + 20.0 * u, 100.0 + 20.0 * v + 2.0 * u * v]);
    let (lattice, bounds) = grown(&corners, Least::Target);
    let cosine = rightwards(&lattice, &corners, bounds, [1, 0]);
    // Two steps in each row, whose slopes are 0, 0.1 and 0.2.
    assert!((cosine - 1.0 / libm::sqrtf(1.01)).abs() < 1e-5, "{cosine}");
}

#[test]
fn five_sixths_of_the_corners_and_all_but_one_of_a_border_line_are_seen() {
    let hidden = [[2, 2], [3, 2], [4, 2], [2, 3], [3, 3], [4, 3]];
    let of = |hidden: &[[i32; 2]]| {
        let corners = lumbar_corners(hidden, &[], 0.0);
        let judged = judged(&corners, [400, 320], shape(6, 5));
        judged.map(|judged| judged.grid.corners.iter().flatten().count())
    };
    assert_eq!(of(&[]), Ok(30));
    assert_eq!(of(&hidden[..5]), Ok(25));
    assert_eq!(of(&hidden), Err(GridRejection::Incomplete));
    for (hidden, expected) in [
        (&[[2, 0]][..], Ok(29)),
        (&[[2, 4], [5, 2]], Ok(28)),
        (&[[2, 0], [4, 0]], Err(GridRejection::Incomplete)),
        (&[[2, 4], [4, 4]], Err(GridRejection::Incomplete)),
        (&[[5, 1], [5, 3]], Err(GridRejection::Incomplete)),
    ] {
        assert_eq!(of(hidden), expected, "{hidden:?}");
    }
}

#[test]
fn a_line_with_few_corners_is_clutter_if_they_are_weak() {
    let of = |clutter: &[[i32; 2]], score: f32| {
        let corners = lumbar_corners(&[], clutter, score);
        judged(&corners, [400, 320], shape(6, 5)).map(|judged| judged.bounds)
    };
    let board = Bounds { first: [0; 2], last: [5, 4] };
    // Three tenths of the median, and more, are the score of the board's corners.
    for (score, expected) in [
        (0.05, Ok(board)),
        (BEYOND_SCORE_MIN * 0.2, Err(GridRejection::GoesOn)),
        (0.07, Err(GridRejection::GoesOn)),
        (0.2, Err(GridRejection::GoesOn)),
    ] {
        for clutter in [[2, 5], [6, 2], [6, 3], [1, 5]] {
            assert_eq!(of(&[clutter], score), expected, "{score} {clutter:?}");
        }
    }
    // A third of a line is a line.
    for score in [0.05, 0.2] {
        assert_eq!(of(&[[2, 5], [4, 5]], score), Err(GridRejection::OtherDimensions), "{score}");
    }
}

/// The next line beyond the last column is slanted: of its six corners, four pixels apart, some would be
/// too near to the picture's border.
#[test]
fn a_board_is_cut_where_less_than_half_of_the_next_line_could_be_detected() {
    let corners = corners_at([5, 6], |[u, v]| [100.0 + 20.0 * u + 4.0 * v, 60.0 + 18.0 * v]);
    let slanted_down = corners_at([6, 5], |[u, v]| [80.0 + 18.0 * u, 80.0 + 20.0 * v + 4.0 * u]);
    for visible in 0..=6_usize {
        // The corners of the next line are at 200 px, and so on, of which the last one that is detected is
        // nearest to the border: seven pixels, and one to spare.
        let side = 200 + 4 * visible - 3 + 7 + 1;
        let is_cut = visible < 3;
        let judged = |corners: &[Corner], sides: [usize; 2], shape: GridShape| {
            self::judged(corners, sides, shape).unwrap().cut
        };
        assert_eq!(judged(&corners, [side, 320], shape(5, 6)), [is_cut, false], "{visible}");
        // The columns' ends are at 180 px, and so on.
        assert_eq!(
            judged(&slanted_down, [400, side - 20], shape(6, 5)),
            [false, is_cut],
            "{visible}"
        );
    }
}
