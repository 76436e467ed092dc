//! Which of several lattices and wanted shapes belong together.

use super::drawn::{Drawn, LIGHT, corners_at, px};
use super::*;

const fn shape(columns: u8, rows: u8) -> GridShape {
    GridShape { columns, rows }
}

fn found(drawn: &Drawn, wanted: &[GridShape]) -> Vec<Result<Grid, GridRejection>> {
    let mut found = std::vec![Err(GridRejection::NoLattice); wanted.len()];
    let mut finder = Box::new(GridFinder::new());
    let (image, border) = (drawn.image(), FrameBorder::OutsideBoard);
    finder.find(&image, &drawn.corners, wanted, border, &mut found);
    found
}

/// The corners of so many boards of 3 x 3 corners, far from each other, in a picture without squares.
fn boards(count: i32) -> Drawn {
    let mut drawn = Drawn::new([3, 3]);
    drawn.bytes.fill(110);
    let first = (0..count).map(|number| [6.0 * f64::from(number % 2), 6.0 * f64::from(number / 2)]);
    drawn.corners =
        first.flat_map(|[u0, v0]| corners_at([3, 3], |[u, v]| px([u0 + u, v0 + v]))).collect();
    drawn
}

#[test]
fn one_board_of_a_shape_is_found_and_more_are_ambiguous() {
    for count in 0..=4 {
        let found = &found(&boards(count), &[shape(3, 3)])[0];
        match count {
            0 => assert_eq!(*found, Err(GridRejection::NoLattice)),
            1 => assert_eq!(found.as_ref().unwrap().corners.iter().flatten().count(), 9),
            _ => assert_eq!(*found, Err(GridRejection::Ambiguous), "{count}"),
        }
    }
}

/// Boards of 5 x 3 corners, one below the other, of which a strap hides the middle row.
fn covered(count: i32) -> Drawn {
    let mut drawn = Drawn::new([5, 3]);
    drawn.corners.clear();
    for number in 0..count {
        let from = 8 * number;
        let below = f64::from(from);
        drawn.paint(-2.0..6.0, below - 2.0..below + 4.0, LIGHT);
        drawn.print(-1..5, from - 1..from + 3);
        drawn.paint(-3.0..7.0, below + 0.7..below + 1.3, 110);
        let corners = corners_at([5, 3], |[u, v]| px([u, v + below]));
        let cells = (0..3).flat_map(|row| [row; 5]);
        let seen = corners.into_iter().zip(cells).filter(|(_, row)| *row != 1);
        drawn.corners.extend(seen.map(|(corner, _)| corner));
    }
    drawn
}

#[test]
fn a_covered_board_is_found_for_each_wish_and_two_are_ambiguous() {
    let wanted = [shape(5, 3); 5];
    for found in found(&covered(1), &wanted) {
        let corners = found.unwrap().corners;
        let seen = |row: usize| corners[5 * row..5 * row + 5].iter().flatten().count();
        assert_eq!([0, 1, 2].map(seen), [5, 0, 5]);
    }
    for found in found(&covered(2), &wanted) {
        assert_eq!(found, Err(GridRejection::Ambiguous));
    }
}

#[test]
fn a_shape_may_be_covered_unless_one_or_two_of_it_are_seen() {
    let grid = Grid { shape: shape(5, 4), corners: heapless::Vec::new(), first_square_dark: true };
    assert!(!may_be_covered(&Ok(grid)));
    for (rejection, may_be) in [
        (GridRejection::NoLattice, true),
        (GridRejection::OtherDimensions, true),
        (GridRejection::Cut, true),
        (GridRejection::Incomplete, true),
        (GridRejection::GoesOn, true),
        (GridRejection::Ambiguous, false),
    ] {
        assert_eq!(may_be_covered(&Err(rejection)), may_be, "{rejection:?}");
    }
}

/// A grid of 5 x 4 corners, and a mark that tells it from others.
fn grid(mark: bool) -> Grid {
    Grid { shape: shape(5, 4), corners: heapless::Vec::new(), first_square_dark: mark }
}

/// What becomes of open grids of 5 x 4 corners, each with the axes along which more may be hidden.
fn settled(
    open: &[[bool; 2]],
    wanted: &[GridShape],
    mut found: Vec<Result<Grid, GridRejection>>,
) -> Vec<Result<Grid, GridRejection>> {
    let bounds = Bounds { first: [0, 0], last: [4, 3] };
    let open = open.iter().map(|&hidden| OpenGrid { grid: grid(true), bounds, hidden });
    settle(open.collect(), wanted, &mut found);
    found
}

#[test]
fn an_open_grid_is_accepted_unless_it_may_be_a_part_of_what_is_missing() {
    let none = || Err(GridRejection::NoLattice);
    let incomplete = || Err(GridRejection::Incomplete);
    let is = || Ok(grid(true));
    let (five, larger) = (shape(5, 4), shape(6, 4));
    for (hidden, other, expected) in [
        // A column more, where columns may be hidden.
        ([true, false], larger, incomplete()),
        ([true, true], larger, incomplete()),
        ([false, true], larger, is()),
        ([false, false], larger, is()),
        // And a row more; a board with fewer columns and more rows is none of both.
        ([false, true], shape(5, 5), incomplete()),
        ([true, false], shape(5, 5), is()),
        ([true, true], shape(4, 6), incomplete()),
        ([true, true], shape(3, 6), is()),
    ] {
        let found = settled(&[hidden], &[five, other], [none(), none()].into());
        assert_eq!(found, [expected, none()], "{hidden:?} {other:?}");
        // What was found with all its sides is no longer looked for.
        let found = settled(&[hidden], &[five, other], [none(), Ok(grid(false))].into());
        assert_eq!(found, [is(), Ok(grid(false))], "{hidden:?} {other:?}");
    }
    // One that was found with all its sides remains.
    let found = settled(&[[false; 2]], &[five, larger], [Ok(grid(false)), none()].into());
    assert_eq!(found, [Ok(grid(false)), none()]);
    // Each wish for the shape is fulfilled, by one grid only.
    let found = settled(&[[false; 2]], &[larger, five, five], [none(), none(), none()].into());
    assert_eq!(found, [none(), is(), is()]);
    let ambiguous = || Err(GridRejection::Ambiguous);
    let found = settled(&[[false; 2]; 2], &[larger, five, five], [none(), none(), none()].into());
    assert_eq!(found, [none(), ambiguous(), ambiguous()]);
}
