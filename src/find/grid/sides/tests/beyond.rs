//! What is seen beyond a cover: squares, and paper where there should be some.

extern crate std;

use std::vec::Vec;

use super::seen::cover;
use super::*;
use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT};

/// A board of which the first four columns of corners are seen, and something covers the squares behind
/// them, up to the last column of squares.
fn with_last_column([columns, rows]: [i32; 2]) -> Drawn {
    let mut drawn = Drawn::new([columns, rows]);
    let hidden = (4..columns).flat_map(|column| (0..rows).map(move |row| [column, row]));
    drawn.hide(&hidden.collect::<Vec<_>>());
    // And over them: where a cover ends, so could squares that it hides.
    drawn.paint(3.6..f64::from(columns) - 0.6, -2.0..f64::from(rows) + 1.0, 110);
    drawn
}

#[test]
fn squares_beyond_a_cover_are_seen_up_to_four_lines_away() {
    for columns in 5..=9 {
        with_last_column([columns, 4]).seen(|view, bounds| {
            assert_eq!(bounds, Bounds { first: [0, 0], last: [3, 3] });
            let lines = if columns <= 8 { columns - 4 } else { 0 };
            let last = [3 + lines, 3];
            let expected = Bounds { last, ..bounds };
            assert_eq!(with_squares_beyond(view, bounds), expected, "{columns}");
        });
    }
}

#[test]
fn squares_beyond_each_side_are_seen() {
    // 5 x 4 corners are seen of 7 x 6, and of the other lines only the outer squares.
    for side in 0..4 {
        let mut drawn = Drawn::new([5, 4]);
        // Two more lines of squares, the last of which are not covered.
        let (columns, rows) = match side {
            0 => (-1..5, -3..-2),
            1 => (-1..5, 5..6),
            2 => (-3..-2, -1..4),
            _ => (6..7, -1..4),
        };
        drawn.paint(-4.0..8.0, -4.0..7.0, 110);
        let whole = Drawn::new([5, 4]);
        for (byte, of_board) in drawn.bytes.iter_mut().zip(&whole.bytes) {
            if *of_board != 110 {
                *byte = *of_board;
            }
        }
        cover(&mut drawn, side, 0.6..2.0, 110);
        cover(&mut drawn, side, 2.0..4.5, LIGHT);
        drawn.print(columns, rows);
        drawn.seen(|view, bounds| {
            let expected = match side {
                0 => Bounds { first: [0, -2], ..bounds },
                1 => Bounds { last: [4, 5], ..bounds },
                2 => Bounds { first: [-2, 0], ..bounds },
                _ => Bounds { last: [6, 3], ..bounds },
            };
            assert_eq!(with_squares_beyond(view, bounds), expected, "{side}");
        });
    }
}

#[test]
fn one_dark_square_is_not_enough_unless_it_ends_at_two_sides() {
    let beyond = |drawn: &Drawn| drawn.seen(with_squares_beyond).last[0];
    // The squares at (5, -1), (5, 1) and (5, 3) are dark. One is seen.
    let mut middle = with_last_column([6, 4]);
    middle.paint(4.6..7.0, -2.0..0.9, 110);
    middle.paint(4.6..7.0, 2.1..5.0, 110);
    assert_eq!(beyond(&middle), 3);
    // Two.
    let mut two = with_last_column([6, 4]);
    two.paint(4.6..7.0, -2.0..0.9, 110);
    assert_eq!(beyond(&two), 5);
    // The first, at the board's corner, or the last.
    let mut first = with_last_column([6, 4]);
    first.paint(4.6..7.0, 0.1..5.0, 110);
    assert_eq!(beyond(&first), 5);
    let mut last = with_last_column([6, 4]);
    last.paint(4.6..7.0, -2.0..2.9, 110);
    assert_eq!(beyond(&last), 5);
    // Not at its other side.
    first.paint(4.6..7.0, -2.0..-0.9, 110);
    assert_eq!(beyond(&first), 3);
    last.paint(4.6..7.0, 3.9..5.0, 110);
    assert_eq!(beyond(&last), 3);
}

#[test]
fn the_edge_of_something_dark_is_none_of_squares() {
    // As many light squares end at it as dark ones, more, or fewer: each square.
    for (columns, rows) in [(6, 5), (7, 4), (6, 4)] {
        let mut edge = with_last_column([columns, rows]);
        let end = f64::from(columns);
        edge.paint(end - 1.0..end, -2.0..f64::from(rows) + 1.0, DARK);
        let [expected, beyond] =
            edge.seen(|view, bounds| [bounds, with_squares_beyond(view, bounds)]);
        assert_eq!(beyond, expected, "{columns} {rows}");
    }
}

#[test]
fn the_area_of_paper_is_counted_in_samples_that_have_neighbours() {
    let paper = |drawn: &Drawn| {
        drawn.seen(|view, bounds| {
            let [u, v] = bounds.last;
            paper_within(view, Bounds { last: [u + 1, v], ..bounds }, bounds)
        })
    };
    let is = |drawn: &Drawn, expected: f32| {
        let area = paper(drawn);
        assert!((area - expected).abs() < 1e-5, "{area} {expected}");
    };
    // Of the column after the last, the squares at (5, -1), (5, 1) and (5, 3) would be dark.
    let mut drawn = Drawn::new([5, 4]);
    is(&drawn, 3.0);
    drawn.paint(5.0..6.0, 0.0..1.0, DARK);
    is(&drawn, 3.0);
    // One sample of 25.
    drawn.paint(5.42..5.58, 1.42..1.58, DARK);
    is(&drawn, 3.0 - 1.0 / 25.0);
    // Two columns of samples, and then one, which is as thin as hair.
    drawn.paint(5.0..5.2, 1.0..2.0, DARK);
    drawn.paint(5.6..6.0, 1.0..2.0, DARK);
    drawn.paint(5.4..5.6, 1.0..2.0, LIGHT);
    is(&drawn, 2.0 + 10.0 / 25.0);
    drawn.paint(5.4..5.6, 1.0..2.0, DARK);
    is(&drawn, 2.0);
    // A row of them, and two rows.
    drawn.paint(5.0..6.0, 1.0..2.0, LIGHT);
    drawn.paint(5.0..6.0, 1.0..1.2, DARK);
    drawn.paint(5.0..6.0, 1.4..2.0, DARK);
    is(&drawn, 2.0);
    drawn.paint(5.0..6.0, 1.4..1.6, LIGHT);
    is(&drawn, 2.0 + 10.0 / 25.0);
}
