//! What votes say, and the arithmetic of squares.

use super::*;

mod beyond;
mod seen;

/// The votes of a side at which a board ends: three light squares and three dark ones.
fn whole() -> Votes {
    Votes {
        margins: 3,
        dark_ends: 3,
        seen: 6,
        dark: 3,
        dark_maybe: 3,
        dark_exact: 3,
        possible: 6,
        ..Votes::default()
    }
}

#[test]
fn more_than_half_of_the_light_or_of_the_dark_squares_are_cut_short() {
    for (early, is_cut_short) in
        [([2, 0], false), ([3, 0], true), ([0, 1], false), ([0, 2], true), ([2, 1], false)]
    {
        // Four light squares and three dark ones.
        let votes = Votes { early, seen: 7, dark: 3, possible: 7, ..Votes::default() };
        assert_eq!(votes.is_cut_short(), is_cut_short, "{early:?}");
        assert_eq!(votes.is_complete(), !is_cut_short, "{early:?}");
    }
    // One light square, which is not: none is no more than half of one.
    let one = Votes { seen: 1, possible: 1, ..Votes::default() };
    assert!(!one.is_cut_short() && one.is_complete());
    for (seen, possible, is_complete) in
        [(4, 5, true), (3, 5, false), (8, 10, true), (7, 10, false), (5, 6, true), (6, 8, false)]
    {
        let votes = Votes { seen, possible, ..Votes::default() };
        assert_eq!(votes.is_complete(), is_complete, "{seen} of {possible}");
    }
}

#[test]
fn a_third_of_the_squares_and_at_least_two_are_a_cover() {
    for (early, seen, possible, is_covered) in [
        ([0, 0], 6, 6, false),
        ([1, 1], 6, 6, true),
        ([2, 0], 6, 6, true),
        ([0, 2], 6, 6, true),
        ([0, 0], 4, 6, true),
        ([1, 0], 5, 6, true),
        ([0, 1], 6, 6, false),
        // Two of seven are less than a third, and one of three is one.
        ([1, 1], 7, 7, false),
        ([1, 2], 7, 7, true),
        ([0, 0], 2, 3, false),
    ] {
        let votes = Votes { early, seen, possible, ..Votes::default() };
        assert_eq!(votes.is_partly_covered(), is_covered, "{votes:?}");
    }
}

#[test]
fn what_cuts_as_many_dark_squares_as_end_at_it_is_a_cover() {
    for (cut_by_paper, dark_ends, is_covered) in [
        (0, 0, false),
        (0, 5, false),
        (1, 0, true),
        (1, 1, true),
        (1, 2, false),
        (2, 2, true),
        (2, 3, false),
        (3, 3, true),
    ] {
        let votes = Votes { cut_by_paper, dark_ends, ..Votes::default() };
        assert_eq!(votes.is_covered_by_paper(), is_covered, "{votes:?}");
        let side = Votes { margins: 9, seen: 9, possible: 9, ..votes };
        let expected = match (is_covered, dark_ends) {
            (true, _) => Side::Hidden,
            (false, 0) => Side::MayEnd,
            (false, _) => Side::Ends,
        };
        assert_eq!(side.side(false), expected, "{side:?}");
    }
}

#[test]
fn a_side_is_what_its_votes_say() {
    let none = Votes { possible: 12, ..Votes::default() };
    let whole_board = whole();
    // Whether or not the margin is known from the other sides.
    for (votes, side) in [
        (Votes { ..whole() }, Side::Ends),
        (Votes { margins: 3, more: 1, ..whole() }, Side::Ends),
        (Votes { margins: 2, more: 0, dark_ends: 1, ..whole() }, Side::Ends),
        (Votes { margins: 1, dark_ends: 2, ..whole() }, Side::Ends),
        (Votes { covered: 2, ..whole() }, Side::Ends),
        // Two squares are too few, and half of all are not most.
        (Votes { margins: 1, dark_ends: 1, ..whole() }, Side::EndsInPart),
        (Votes { covered: 3, ..whole() }, Side::EndsInPart),
        (Votes { margins: 0, dark_ends: 2, covered: 4, ..whole() }, Side::EndsInPart),
        (Votes { margins: 0, dark_ends: 3, covered: 1, ..whole() }, Side::EndsInPart),
        (Votes { margins: 0, more: 3, ..whole() }, Side::GoesOn),
        (Votes { margins: 2, more: 3, ..whole() }, Side::GoesOn),
        (Votes { margins: 0, more: 1, dark_ends: 1, covered: 1, ..none }, Side::GoesOn),
        (Votes { margins: 0, more: 3, covered: 5, ..whole() }, Side::GoesOn),
        // More than half of the squares.
        (Votes { margins: 7, ..none }, Side::MayEnd),
        (Votes { margins: 6, ..none }, Side::Hidden),
        (Votes { margins: 4, dark_ends: 3, more: 4, ..none }, Side::MayEnd),
        (Votes { dark_ends: 1, ..none }, Side::Hidden),
        (Votes { margins: 7, early: [2, 2], ..none }, Side::Hidden),
        (none, Side::Hidden),
        (whole_board, Side::Ends),
    ] {
        let votes = Votes { seen: votes.possible, ..votes };
        assert_eq!(votes.side(true), side, "{votes:?}");
        if side != Side::Hidden || votes.more < 2 {
            assert_eq!(votes.side(false), side, "{votes:?}");
        }
    }
}

#[test]
fn a_margin_may_be_narrow_unless_it_is_known() {
    let of = |more, dark, dark_maybe, dark_exact| Votes {
        more,
        dark,
        dark_maybe,
        dark_exact,
        possible: 12,
        seen: 12,
        ..Votes::default()
    };
    for (votes, unknown, known) in [
        (of(1, 0, 0, 0), Side::Hidden, Side::Hidden),
        (of(2, 0, 0, 0), Side::MayEnd, Side::Hidden),
        (of(0, 4, 2, 0), Side::MayEnd, Side::Hidden),
        (of(0, 4, 1, 0), Side::Hidden, Side::Hidden),
        (of(0, 4, 4, 1), Side::MayEnd, Side::Hidden),
        (of(0, 4, 1, 2), Side::Hidden, Side::MayEnd),
        (of(0, 5, 3, 3), Side::MayEnd, Side::MayEnd),
        (of(0, 5, 2, 2), Side::Hidden, Side::Hidden),
        (of(0, 3, 1, 1), Side::Hidden, Side::Hidden),
        (of(0, 0, 0, 0), Side::Hidden, Side::Hidden),
    ] {
        assert_eq!(votes.side(false), unknown, "{votes:?}");
        assert_eq!(votes.side(true), known, "{votes:?}");
    }
    // More that goes on than ends, but less than what is covered.
    let more = Votes { more: 3, dark_ends: 3, covered: 6, ..of(0, 6, 0, 0) };
    assert_eq!((more.side(false), more.side(true)), (Side::MayEnd, Side::Hidden));
    // As many as end.
    let both = Votes { more: 3, margins: 3, dark_ends: 1, ..of(0, 6, 0, 0) };
    assert_eq!((both.side(false), both.side(true)), (Side::MayEnd, Side::Hidden));
    let one = Votes { more: 1, margins: 2, dark_ends: 1, ..of(0, 6, 0, 0) };
    assert_eq!((one.side(false), one.side(true)), (Side::Hidden, Side::Hidden));
}

#[test]
fn three_margins_make_the_fourth_known() {
    let open = || Votes { more: 2, possible: 12, seen: 12, ..Votes::default() };
    let ends = Side::Ends;
    assert_eq!(
        sides(&[[whole(), open()], [open(), whole()]]),
        [[ends, Side::MayEnd], [Side::MayEnd, ends]]
    );
    assert_eq!(
        sides(&[[whole(), whole()], [open(), whole()]]),
        [[ends, ends], [Side::Hidden, ends]]
    );
    assert_eq!(sides(&[[whole(), whole()], [whole(), whole()]]), [[ends; 2]; 2]);
}

#[test]
fn a_square_is_seen_from_its_inner_side() {
    for (outwards, place, beside) in [
        ([1, 0], [3.25, 3.5], [3.25, 3.75]),
        ([-1, 0], [1.75, 3.5], [1.75, 3.25]),
        ([0, 1], [2.5, 4.25], [2.75, 4.25]),
        ([0, -1], [2.5, 2.75], [2.25, 2.75]),
    ] {
        let square = Square { cell: [2, 3], outwards };
        assert_eq!(square.place(1.25), place, "{outwards:?}");
        assert_eq!(square.place(0.5), [2.5, 3.5], "{outwards:?}");
        assert_eq!(square.place_beside(1.25, 0.25), beside, "{outwards:?}");
    }
    let bounds = Bounds { first: [-1, 2], last: [3, 5] };
    for (line, cell) in bounds.borders().into_iter().zip([[1, -1], [1, 7], [-4, 4], [5, 4]]) {
        let square = Square::new(&line, 2, 2);
        assert_eq!((square.cell, square.outwards), (cell, line.outwards));
    }
}

#[test]
fn a_square_ends_where_the_level_first_crosses_the_middle() {
    let is = |end: Option<f32>, expected: f32| {
        let end = end.expect("an end");
        assert!((end - expected).abs() < 1e-5, "{end} {expected}");
    };
    for first in [0.5, 0.7] {
        for end in [0.76, 0.8, 1.0, 1.23, 1.39] {
            for slope in [100.0, -70.0] {
                // Between samples the level is taken for linear, which it is.
                is(end_of_square(|out| Some(40.0 + slope * (out - end)), 40.0, first), end);
            }
        }
        // Two thirds of a step from the sample that is twice as far from the middle.
        let jump = |out: f32| Some(if out < 1.15 { 0.0 } else { 30.0 });
        is(end_of_square(jump, 20.0, first), 1.1 + 0.1 * 2.0 / 3.0);
        // The next square's middle is too far.
        assert_eq!(end_of_square(|out| Some(out - 1.43), 0.0, first), None);
        assert_eq!(end_of_square(|_| Some(50.0), 40.0, first), None);
        assert_eq!(end_of_square(|out| (out < 1.05).then_some(50.0), 40.0, first), None);
        // It begins in the middle, or stays there.
        is(end_of_square(|out| Some(out - first), 0.0, first), first);
        is(end_of_square(|_| Some(7.0), 7.0, first), first + 0.1);
    }
    // Twice: the first crossing.
    is(end_of_square(|out| Some((out - 0.9) * (out - 1.2)), 0.0, 0.5), 0.9);
    assert_eq!(end_of_square(|_| None, 0.0, 0.5), None);
}
