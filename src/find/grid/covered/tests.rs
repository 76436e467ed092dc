//! Where a target lies, which sides it needs for that, and what is clutter.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT, corners_at, grown, px};

/// A cover, as bright as neither ink nor paper.
const COVER: u8 = 110;

fn bounds(first: [i32; 2], last: [i32; 2]) -> Bounds {
    Bounds { first, last }
}

const fn shape(columns: u8, rows: u8) -> GridShape {
    GridShape { columns, rows }
}

#[test]
fn one_end_of_an_axis_places_a_target_along_it() {
    use Side::{Ends, EndsInPart, GoesOn, Hidden, MayEnd};
    let all = [Ends, EndsInPart, Hidden, MayEnd, GoesOn];
    for (before, after) in all.into_iter().flat_map(|it| all.map(|after| (it, after))) {
        for hidden in -1..=2 {
            // By the rules: where the board is seen to end on one side, all that is hidden is on the other
            // one, which nothing says is an end too. If nothing is hidden, the other side may be anything
            // but squares that go on.
            let expected = match (before, after) {
                _ if hidden < 0 => None,
                (GoesOn, _) | (_, GoesOn) if hidden == 0 => None,
                (Ends, _) | (_, Ends) if hidden == 0 => Some([0, 0]),
                (Ends, Hidden | GoesOn) => Some([0, hidden]),
                (Hidden | GoesOn, Ends) => Some([hidden, 0]),
                _ => None,
            };
            let whole = [Ends, Ends];
            let what = (before, after, hidden);
            // Five columns and three rows.
            let extent = bounds([-1, 0], [3, 2]);
            let along_u = placed(extent, [(5 + hidden) as usize, 3], [[before, after], whole]);
            assert_eq!(along_u, expected.map(|[a, b]| bounds([-1 - a, 0], [3 + b, 2])), "{what:?}");
            let along_v = placed(extent, [5, (3 + hidden) as usize], [whole, [before, after]]);
            assert_eq!(along_v, expected.map(|[a, b]| bounds([-1, -a], [3, 2 + b])), "{what:?}");
        }
    }
}

#[test]
fn an_axis_is_whole_if_it_ends_at_both_sides_and_at_one_of_them_for_certain() {
    use Side::{Ends, EndsInPart, GoesOn, Hidden, MayEnd};
    for (sides, is_whole) in [
        ([Ends, Ends], true),
        ([Ends, EndsInPart], true),
        ([EndsInPart, Ends], true),
        ([EndsInPart, EndsInPart], false),
        ([Ends, Hidden], false),
        ([GoesOn, Ends], false),
        ([Ends, MayEnd], false),
        ([Hidden, EndsInPart], false),
        ([Hidden, Hidden], false),
    ] {
        assert_eq!(is_axis_whole(&sides), is_whole, "{sides:?}");
    }
}

/// A board of 6 x 5 corners, of which the last column, the last row, or both are hidden.
fn hidden_lines(column: bool, row: bool) -> Drawn {
    let mut drawn = Drawn::new([6, 5]);
    let cells = (0..5).flat_map(|v| (0..6).map(move |u| [u, v]));
    let is_hidden = |&[u, v]: &[i32; 2]| (column && u == 5) || (row && v == 4);
    drawn.hide(&cells.filter(is_hidden).collect::<Vec<_>>());
    if column {
        drawn.paint(4.3..8.0, -3.0..8.0, COVER);
    }
    if row {
        drawn.paint(-3.0..8.0, 3.3..8.0, COVER);
    }
    drawn
}

fn place_of(drawn: &Drawn, seen: usize, wanted: &[GridShape]) -> Option<Fit<Bounds>> {
    drawn.seen(|view, extent| {
        only_place(view, [extent, extent], seen, wanted).map(|fit| match fit {
            Fit::Only((index, shape, bounds)) => {
                assert_eq!(wanted[index], shape);
                Fit::Only(bounds)
            }
            Fit::Several => Fit::Several,
        })
    })
}

#[test]
fn nine_corners_and_two_fifths_of_the_targets_are_enough() {
    // A target of which all sides are seen needs nine.
    let whole = hidden_lines(false, false);
    for (seen, is_placed) in [(8, false), (9, true), (10, true), (30, true)] {
        let place = place_of(&whole, seen, &[shape(6, 5)]);
        assert_eq!(place, is_placed.then_some(Fit::Only(bounds([0, 0], [5, 4]))), "{seen}");
    }
    // Of 30, two fifths are 12.
    let covered = hidden_lines(false, true);
    for (seen, is_placed) in [(8, false), (11, false), (12, true), (24, true)] {
        let place = place_of(&covered, seen, &[shape(7, 5), shape(6, 5)]);
        assert_eq!(place, is_placed.then_some(Fit::Only(bounds([0, 0], [5, 4]))), "{seen}");
    }
    // Of 18, which are all that is seen of 6 x 3 corners, fewer than nine.
    let mut small = hidden_lines(false, false);
    small.hide(&(0..6).flat_map(|u| [[u, 3], [u, 4]]).collect::<Vec<_>>());
    small.paint(-3.0..8.0, 2.3..8.0, COVER);
    for (seen, is_placed) in [(8, false), (9, true)] {
        let place = place_of(&small, seen, &[shape(6, 3)]);
        assert_eq!(place, is_placed.then_some(Fit::Only(bounds([0, 0], [5, 2]))), "{seen}");
    }
}

#[test]
fn hidden_lines_need_an_axis_of_which_both_ends_are_seen() {
    let [all, seen] = [[5, 4], [4, 3]].map(|last| Some(Fit::Only(bounds([0, 0], last))));
    // One line is hidden, and across it both ends are seen.
    assert_eq!(place_of(&hidden_lines(true, false), 25, &[shape(6, 5)]), all);
    assert_eq!(place_of(&hidden_lines(false, true), 24, &[shape(6, 5)]), all);
    // One end of each axis: nothing may be hidden.
    let corner = hidden_lines(true, true);
    assert_eq!(place_of(&corner, 20, &[shape(5, 4)]), seen);
    for other in [shape(6, 4), shape(5, 5), shape(6, 5)] {
        assert_eq!(place_of(&corner, 20, &[other]), None, "{other:?}");
    }
    // Two shapes that fit are one too many.
    let two = [shape(6, 5), shape(5, 5)];
    assert_eq!(place_of(&hidden_lines(true, false), 25, &two), Some(Fit::Several));
    // And none where nothing is proven.
    assert_eq!(place_of(&corner, 20, &[shape(6, 4), shape(5, 5)]), None);
}

/// What a lattice says of whether its board goes on.
fn goes_on(drawn: &Drawn) -> bool {
    let (lattice, bounds) = grown(&drawn.corners, Least::Target);
    assert_eq!(bounds, Bounds { first: [0, 0], last: [4, 3] });
    goes_on_beyond(&drawn.image(), &lattice, &drawn.corners, bounds)
}

/// A board of 5 x 4 corners, and corners beyond it, with this score.
fn with_corners(beyond: &[[i32; 2]], score: f32) -> Drawn {
    let mut drawn = Drawn::new([5, 4]);
    for (corner, cell) in corners_at([10, 4], px).into_iter().zip(bounds([0, 0], [9, 3]).cells()) {
        if beyond.contains(&cell) {
            drawn.corners.push(Corner { score, ..corner });
        }
    }
    drawn
}

#[test]
fn two_strong_corners_within_three_lines_beyond_are_of_the_board() {
    assert!(!goes_on(&Drawn::new([5, 4])));
    for (beyond, is_beyond) in [
        (&[[6, 1], [6, 2]][..], true),
        (&[[7, 0], [6, 3]], true),
        // One may be clutter, and the fourth line is too far.
        (&[[6, 1]], false),
        (&[[8, 1], [8, 2]], false),
        (&[[7, 1], [8, 2]], false),
    ] {
        assert_eq!(goes_on(&with_corners(beyond, 0.2)), is_beyond, "{beyond:?}");
    }
    // All the board's corners have a score of 0.2, of which three tenths are enough.
    for (score, is_beyond) in [(0.05, false), (0.2 * BEYOND_SCORE_MIN, true), (0.07, true)] {
        assert_eq!(goes_on(&with_corners(&[[6, 1], [6, 2]], score)), is_beyond, "{score}");
    }
}

#[test]
fn squares_beyond_a_margin_or_one_beyond_a_cover_are_of_the_board() {
    // A line of squares, after something that looks like a margin.
    let mut drawn = Drawn::new([5, 4]);
    drawn.paint(5.0..9.0, -2.0..5.0, LIGHT);
    drawn.print(6..7, -1..4);
    drawn.seen(|view, bounds| {
        assert_ne!(sides::with_squares_beyond(view, bounds), bounds);
        assert!(!contradiction::is_square_outside(view, bounds, bounds));
    });
    assert!(goes_on(&drawn));
    // One square beside a cover.
    let mut drawn = Drawn::new([5, 4]);
    drawn.paint(4.3..6.0, -1.4..4.4, COVER);
    assert!(!goes_on(&drawn));
    drawn.paint(6.4..8.6, 0.4..2.6, LIGHT);
    drawn.print(7..8, 1..2);
    drawn.seen(|view, bounds| {
        assert_eq!(sides::with_squares_beyond(view, bounds), bounds);
        assert!(contradiction::is_square_outside(view, bounds, bounds));
    });
    assert!(goes_on(&drawn));
}

#[test]
fn an_axis_is_open_where_no_end_is_seen_and_hidden_where_squares_are_not() {
    let says = |drawn: &Drawn| {
        let (lattice, bounds) = grown(&drawn.corners, Least::Target);
        let Open { axes, hidden } = open(&drawn.image(), &lattice, &drawn.corners, bounds);
        (axes, hidden)
    };
    assert_eq!(says(&Drawn::new([5, 4])), ([false; 2], [false; 2]));
    // Beside a cover over the squares, along u and along v.
    let [of_u, of_v] = [[true, false], [false, true]];
    assert_eq!(says(&hidden_lines(true, false)), (of_u, of_u));
    assert_eq!(says(&hidden_lines(false, true)), (of_v, of_v));
    assert_eq!(says(&hidden_lines(true, true)), ([true; 2], [true; 2]));
    // All squares are seen, and what follows is no margin.
    let mut drawn = Drawn::new([5, 4]);
    drawn.paint(5.0..7.0, -3.0..6.0, COVER);
    assert_eq!(says(&drawn), (of_u, [false; 2]));
    // Nothing is known where the board is not seen.
    drawn.bytes.fill(COVER);
    assert_eq!(says(&drawn), ([true; 2], [true; 2]));
}

/// A board of 6 x 5 corners with more of them outside, which have this score: after the last column and
/// after the last row. `covered` if the squares beyond both are covered.
fn cluttered(clutter: &[[i32; 2]], score: f32, covered: bool) -> Drawn {
    let mut drawn = Drawn::new([6, 5]);
    if covered {
        drawn.paint(5.3..8.0, -3.0..7.0, COVER);
        drawn.paint(-3.0..8.0, 4.3..7.0, COVER);
    }
    for (corner, cell) in corners_at([8, 7], px).into_iter().zip(bounds([0, 0], [7, 6]).cells()) {
        if clutter.contains(&cell) {
            drawn.corners.push(Corner { score, ..corner });
        }
    }
    drawn
}

/// The bounds of what is left of a lattice without its clutter.
fn without_clutter(drawn: &Drawn) -> Bounds {
    let (mut lattice, _) = grown(&drawn.corners, Least::Target);
    assert_eq!(lattice.cells().count(), drawn.corners.len());
    remove_clutter(&drawn.image(), &mut lattice, &drawn.corners).unwrap();
    lattice.extent().unwrap()
}

#[test]
fn few_weak_corners_on_a_line_are_clutter() {
    let board = bounds([0, 0], [5, 4]);
    let least = 0.2 * BEYOND_SCORE_MIN;
    // On a line of five, and on one of six, of which two are a third.
    for (clutter, with_clutter) in [
        (&[[6, 2]][..], bounds([0, 0], [6, 4])),
        (&[[2, 5]], bounds([0, 0], [5, 5])),
        (&[[6, 2], [7, 2]], bounds([0, 0], [7, 4])),
    ] {
        let is = |score: f32| without_clutter(&cluttered(clutter, score, true));
        assert_eq!(is(0.05), board, "{clutter:?}");
        assert_eq!(is(least), with_clutter, "{clutter:?}");
        assert_eq!(is(0.2), with_clutter, "{clutter:?}");
    }
    for clutter in [[[2, 5], [3, 5]], [[0, 5], [5, 5]]] {
        let left = without_clutter(&cluttered(&clutter, 0.05, true));
        assert_eq!(left, bounds([0, 0], [5, 5]), "{clutter:?}");
    }
}

#[test]
fn few_corners_beyond_the_end_of_a_board_are_clutter() {
    for clutter in [[6, 2], [2, 5]] {
        for score in [0.05, 0.2] {
            let left = without_clutter(&cluttered(&[clutter], score, false));
            assert_eq!(left, bounds([0, 0], [5, 4]), "{clutter:?}");
        }
    }
    // Not a third of a line and more.
    let left = without_clutter(&cluttered(&[[2, 5], [3, 5]], 0.2, false));
    assert_eq!(left, bounds([0, 0], [5, 5]));
}

/// The place of a target in the lattice that grows from the first corner.
fn placed_at_first(drawn: &Drawn, wanted: &[GridShape]) -> Option<(usize, Grid)> {
    let mut lattice = Box::new(Lattice::new());
    lattice.start(&drawn.corners);
    let placed = place_at(&drawn.image(), &mut lattice, &drawn.corners, 0, wanted);
    if placed.is_some() {
        // All that was joined belongs to it.
        for seed in 0..drawn.corners.len() as u16 {
            let again = place_at(&drawn.image(), &mut lattice, &drawn.corners, seed, wanted);
            assert_eq!(again, None, "{seed}");
        }
    }
    placed
}

/// The rows of a grid whose corners are seen; the others lack all of them.
fn rows(grid: &Grid) -> Vec<usize> {
    let rows = grid.corners.chunks_exact(usize::from(grid.shape.columns)).enumerate();
    let seen = rows.filter(|(row, corners)| {
        let is_seen = corners[0].is_some();
        assert!(corners.iter().all(|corner| corner.is_some() == is_seen), "{row}");
        is_seen
    });
    seen.map(|(row, _)| row).collect()
}

/// A piece from which the plane of another reaches only the first line is joined all the same.
#[test]
fn pieces_are_joined_in_rounds() {
    let mut drawn = Drawn::new([5, 6]);
    drawn.hide(&(0..5).flat_map(|u| [[u, 2], [u, 3]]).collect::<Vec<_>>());
    drawn.paint(-2.0..6.0, 1.7..3.3, COVER);
    let (index, grid) = placed_at_first(&drawn, &[shape(5, 4), shape(5, 6)]).unwrap();
    assert_eq!((index, rows(&grid)), (1, [0, 1, 4, 5].to_vec()));
}

/// One line of corners is seen on each side of a strap: the squares above it say that two steps lie between
/// them, and those below it, which are half as high, say four.
#[test]
fn two_numbers_of_hidden_lines_that_fit_are_ambiguous() {
    let mut drawn = Drawn::new([5, 3]);
    drawn.hide(&(0..5).map(|u| [u, 1]).collect::<Vec<_>>());
    drawn.paint(-2.0..6.0, 0.7..1.3, COVER);
    drawn.paint(-2.0..6.0, 2.53..3.53, LIGHT);
    let [three, five] = [shape(5, 3), shape(5, 5)];
    for gap in [2, 4] {
        let (mut lattice, _) = grown(&drawn.corners, Least::Piece { gap });
        let fit = place(&drawn.image(), &mut lattice, &drawn.corners, &[five]);
        let Some(Fit::Only((_, grid))) = fit else { panic!("{gap}: {fit:?}") };
        assert_eq!(rows(&grid), [0, gap as usize]);
    }
    assert_eq!(placed_at_first(&drawn, &[five]), None);
    let (index, grid) = placed_at_first(&drawn, &[three]).unwrap();
    assert_eq!((index, rows(&grid)), (0, [0, 2].to_vec()));
    // With two steps between them both shapes fit, so that four prove nothing.
    assert_eq!(placed_at_first(&drawn, &[three, five]), None);
}

/// Two lines of corners are seen above a strap, and one below it: the squares above it say that four steps lie
/// between the first and the last line, those below it, which are twice as high, two, and those beside it leave
/// both possible. What neighbours show is not doubted for that.
#[test]
fn where_neighbours_fit_no_hidden_lines_are_looked_for() {
    let mut drawn = Drawn::new([5, 5]);
    drawn.hide(&(0..5).flat_map(|u| [[u, 2], [u, 3]]).collect::<Vec<_>>());
    drawn.paint(-0.3..4.3, 1.3..3.7, COVER);
    drawn.paint(-2.0..6.0, 5.0..7.5, LIGHT);
    for u in [0.0, 2.0, 4.0] {
        drawn.paint(u..u + 1.0, 5.0..6.0, DARK);
    }
    drawn.paint(-2.0..-0.3, 1.0..4.0, LIGHT);
    drawn.paint(-1.0..-0.3, -2.0..0.0, DARK);
    drawn.paint(-1.0..-0.3, 2.0..4.0, DARK);
    drawn.paint(4.3..6.0, 1.0..4.0, LIGHT);
    drawn.paint(4.3..5.0, 0.0..2.0, DARK);
    let wanted = [shape(5, 3), shape(5, 5)];
    let (mut lattice, _) = grown(&drawn.corners, Least::Piece { gap: 2 });
    let fit = place(&drawn.image(), &mut lattice, &drawn.corners, &wanted);
    assert_eq!(fit, Some(Fit::Several));
    let (index, grid) = placed_at_first(&drawn, &wanted).unwrap();
    assert_eq!((index, rows(&grid)), (1, [0, 1, 4].to_vec()));
}

/// No target has twice as many places as there can be corners: in a larger lattice, nothing is computed.
#[test]
fn a_lattice_with_more_places_than_two_targets_is_left_alone() {
    let rows = TARGET_CORNERS_MAX as i32 / 6;
    for (size, is_looked_at) in
        [([12, rows], true), ([12, rows + 1], false), ([11, rows + 2], false)]
    {
        let mut corners = corners_at(size, px);
        let (mut lattice, _) = grown(&corners, Least::Target);
        assert_eq!(lattice.cells().count(), corners.len());
        // Where it disagrees with its neighbours.
        corners[(3 * size[0] + 3) as usize].position_px[0] += 5.0;
        let drawn = Drawn::new([3, 3]);
        assert_eq!(place(&drawn.image(), &mut lattice, &corners, &[]), None);
        assert_eq!(lattice.corner([3, 3]).is_none(), is_looked_at, "{size:?}");
    }
}
