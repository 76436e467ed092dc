//! What is seen at the sides of boards that are drawn.

extern crate std;

use core::ops::Range;

use super::*;
use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT, STEP_PX};

/// The four sides of a board of 5 x 4 corners, in the order of its borders, and how many of the squares
/// around it are light and dark there.
const SIDES: [(usize, [u32; 2]); 4] = [(0, [3, 3]), (1, [3, 3]), (2, [2, 3]), (3, [3, 2])];

/// Paints a strip along a side of a board of 5 x 4 corners, between these distances outwards from its
/// corners.
pub(super) fn cover(drawn: &mut Drawn, side: usize, out: Range<f64>, level: u8) {
    match side {
        0 => drawn.paint(-2.0..6.0, -out.end..-out.start, level),
        1 => drawn.paint(-2.0..6.0, 3.0 + out.start..3.0 + out.end, level),
        2 => drawn.paint(-out.end..-out.start, -2.0..5.0, level),
        _ => drawn.paint(4.0 + out.start..4.0 + out.end, -2.0..5.0, level),
    }
}

fn votes_at(drawn: &Drawn, side: usize) -> Votes {
    drawn.seen(|view, bounds| votes(view, &bounds.borders()[side]))
}

fn assert_are(votes: &Votes, expected: &Votes) {
    assert_eq!(std::format!("{votes:?}"), std::format!("{expected:?}"));
}

/// The votes of a whole side.
fn whole_of([light, dark]: [u32; 2]) -> Votes {
    Votes {
        margins: light,
        dark_ends: dark,
        seen: light + dark,
        dark,
        dark_maybe: dark,
        dark_exact: dark,
        possible: light + dark,
        ..Votes::default()
    }
}

#[test]
fn a_whole_board_ends_at_all_sides() {
    Drawn::new([5, 4]).seen(|view, bounds| {
        let all = all_votes(view, bounds);
        // By axis, and first those against its direction.
        for (side, place) in SIDES.iter().zip([[1, 0], [1, 1], [0, 0], [0, 1]]) {
            assert_are(&all[place[0]][place[1]], &whole_of(side.1));
            assert_are(&votes(view, &bounds.borders()[side.0]), &whole_of(side.1));
        }
        assert_eq!(sides(&all), [[Side::Ends; 2]; 2]);
        assert_eq!(with_squares_beyond(view, bounds), bounds);
    });
}

#[test]
fn a_board_that_is_larger_goes_on() {
    // The last column and row of corners are not seen.
    let mut drawn = Drawn::new([6, 5]);
    let column = (0..5).map(|row| [5, row]);
    let cells: std::vec::Vec<_> = column.chain((0..5).map(|column| [column, 4])).collect();
    drawn.hide(&cells);
    drawn.seen(|view, bounds| {
        let all = all_votes(view, bounds);
        for (votes, [light, dark]) in [(&all[1][1], [3, 3]), (&all[0][1], [3, 2])] {
            let whole = whole_of([light, dark]);
            assert_are(votes, &Votes { margins: 0, more: light, ..whole });
        }
        let goes_on = [Side::Ends, Side::GoesOn];
        assert_eq!(sides(&all), [goes_on, goes_on]);
    });
}

#[test]
fn covers_like_paper_and_like_ink_cut_squares() {
    for (side, [light, dark]) in SIDES {
        let squares = whole_of([light, dark]);
        // From two thirds of the squares on.
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 0.65..2.0, LIGHT);
        let by_paper = Votes {
            dark_ends: 0,
            covered: dark,
            dark_maybe: 0,
            dark_exact: 0,
            early: [0, dark],
            cut_by_paper: dark,
            ..squares
        };
        assert_are(&votes_at(&drawn, side), &by_paper);
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 0.65..2.0, DARK);
        let by_ink = Votes {
            margins: 0,
            covered: light + dark,
            early: [light, 0],
            cut_by_paper: 0,
            ..by_paper
        };
        assert_are(&votes_at(&drawn, side), &by_ink);
        // A strip of paper that ends before the squares would: something darker follows.
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 0.65..1.15, LIGHT);
        cover(&mut drawn, side, 1.15..2.0, 150);
        let narrow = Votes { margins: 0, covered: light + dark, cut_by_paper: 0, ..by_paper };
        assert_are(&votes_at(&drawn, side), &narrow);
        // One that is darker than paper up to where the squares end, and paper behind.
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 0.65..1.1, 140);
        cover(&mut drawn, side, 1.1..2.0, LIGHT);
        assert_are(&votes_at(&drawn, side), &Votes { cut_by_paper: 0, ..by_paper });
        // From a tenth on: what is in the middle of a square is not the square.
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 0.1..2.0, LIGHT);
        let hidden =
            Votes { margins: light, seen: light, possible: light + dark, ..Votes::default() };
        assert_are(&votes_at(&drawn, side), &hidden);
    }
}

#[test]
fn a_square_that_is_too_long_or_before_a_narrow_margin_may_end() {
    for (side, [light, dark]) in SIDES {
        let squares = whole_of([light, dark]);
        // What follows begins a seventh of a step late: light squares do not go on there.
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 1.15..2.0, DARK);
        let late = Votes { margins: 0, dark_ends: 0, covered: light + dark, ..squares };
        let late = Votes { dark_exact: 0, ..late };
        assert_are(&votes_at(&drawn, side), &late);
        // A margin of a fifth of a step, with something nearly as bright behind, or something darker.
        for (level, dark_exact) in [(160, dark), (150, 0)] {
            let mut drawn = Drawn::new([5, 4]);
            cover(&mut drawn, side, 1.2..2.0, level);
            let narrow = Votes { margins: 0, dark_ends: 0, covered: light + dark, ..squares };
            assert_are(&votes_at(&drawn, side), &Votes { dark_exact, ..narrow });
        }
    }
    // Dark squares that are a seventh of a step too long, with paper behind.
    let mut drawn = Drawn::new([5, 4]);
    for row in [0.0, 2.0] {
        drawn.paint(5.0..5.15, row..row + 1.0, DARK);
    }
    let long = Votes { dark_ends: 0, covered: 2, dark_exact: 0, ..whole_of([3, 2]) };
    assert_are(&votes_at(&drawn, 3), &long);
    // A quarter: no square of this board.
    for row in [0.0, 2.0] {
        drawn.paint(5.0..5.25, row..row + 1.0, DARK);
    }
    assert_are(&votes_at(&drawn, 3), &Votes { dark_maybe: 0, ..long });
}

#[test]
fn a_margin_is_paper_all_over() {
    // In the middle of what follows the light squares, and beside that on either side.
    for beside in [1.25, 1.5, 1.75] {
        let mut drawn = Drawn::new([5, 4]);
        drawn.paint(5.2..5.45, beside - 0.1..beside + 0.1, 150);
        let whole = whole_of([3, 2]);
        assert_are(&votes_at(&drawn, 3), &Votes { margins: 2, covered: 1, ..whole });
    }
}

#[test]
fn a_square_that_ends_within_seven_hundredths_and_half_a_pixel_is_exact() {
    for (side, [light, dark]) in SIDES {
        let squares = whole_of([light, dark]);
        // That is 1.7 or 2.0 pixels; between samples, an end is known to about half a pixel.
        let step_px = STEP_PX[usize::from(side < 2)];
        for (early_px, dark_ends) in [(1.0, dark), (3.0, 0)] {
            let mut drawn = Drawn::new([5, 4]);
            cover(&mut drawn, side, 1.0 - early_px / step_px..2.0, LIGHT);
            let dark_exact = dark_ends;
            let expected = Votes { dark_ends, dark_exact, covered: dark - dark_ends, ..squares };
            assert_are(&votes_at(&drawn, side), &expected);
        }
    }
}

#[test]
fn a_line_of_ink_is_where_dark_squares_would_begin() {
    for (side, [light, dark]) in SIDES {
        let mut drawn = Drawn::new([5, 4]);
        cover(&mut drawn, side, 1.0..1.18, DARK);
        // With it, the dark squares are too long.
        let squares = whole_of([light, dark]);
        let line = Votes { margins: 0, more: light, dark_ends: 0, covered: dark, ..squares };
        assert_are(&votes_at(&drawn, side), &Votes { dark_exact: 0, ..line });
    }
}

#[test]
fn beside_a_covered_square_one_is_seen_if_its_corners_are() {
    // The light square inside of the dark one at (4, 0) is covered.
    let mut drawn = Drawn::new([5, 4]);
    drawn.paint(3.0..4.0, 0.0..1.0, DARK);
    let without = |hidden: &[[i32; 2]]| {
        let mut without = Drawn { bytes: drawn.bytes.clone(), corners: drawn.corners.clone() };
        without.hide(hidden);
        votes_at(&without, 3)
    };
    for corner in [[4, 0], [4, 1]] {
        assert_are(&without(&[corner]), &Votes { possible: 5, ..whole_of([3, 1]) });
    }
    // One of the covered square's, and those of other squares, do not matter.
    assert_are(&without(&[[3, 0]]), &whole_of([3, 2]));
    assert_are(&without(&[[3, 0], [4, 3]]), &whole_of([3, 2]));
    // The first and the last square have one corner of the line each.
    for (row, corner) in [(-1, [4, 0]), (3, [4, 3])] {
        let mut drawn = Drawn::new([5, 4]);
        let first = f64::from(row);
        drawn.paint(3.0..4.0, first..first + 1.0, LIGHT);
        assert_are(&votes_at(&drawn, 3), &whole_of([3, 2]));
        drawn.hide(&[corner]);
        assert_are(&votes_at(&drawn, 3), &Votes { possible: 5, ..whole_of([2, 2]) });
    }
}

#[test]
fn a_square_with_half_of_the_contrast_to_its_neighbour_is_seen() {
    // Of a contrast of 120, the square at (4, 0) has 59 and 61 to the light one inside of it.
    for (level, seen) in [(LIGHT - 59, 4), (LIGHT - 61, 5)] {
        let mut drawn = Drawn::new([5, 4]);
        drawn.paint(4.0..5.0, 0.0..1.0, level);
        let votes = votes_at(&drawn, 3);
        assert_eq!((votes.seen, votes.possible), (seen, 5), "{level}");
    }
}
