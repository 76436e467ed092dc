//! Squares beside a cover, their corners, and ink between places that must be hidden.

extern crate std;

use std::vec::Vec;

use super::*;
use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT};
use crate::test_support::Random;

/// A cover, as bright as neither ink nor paper.
const COVER: u8 = 110;

/// Paints the pixels of the sample at a place, and at most one more on each side.
fn spot(drawn: &mut Drawn, [u, v]: [f64; 2], level: u8) {
    drawn.paint(u - 0.11..u + 0.11, v - 0.13..v + 0.13, level);
}

/// Paints what is around a corner of a square, half a step far: ink in the quadrant `inwards`, and paper.
fn print_corner(drawn: &mut Drawn, [u, v]: [f64; 2], inwards: [f64; 2]) {
    drawn.paint(u - 0.5..u + 0.5, v - 0.5..v + 0.5, LIGHT);
    let quadrant =
        |place: f64, sign: f64| (place + 0.5 * sign).min(place)..place.max(place + 0.5 * sign);
    drawn.paint(quadrant(u, inwards[0]), quadrant(v, inwards[1]), DARK);
}

/// Signs of both directions of both axes.
const SIGNS: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

#[test]
fn between_is_inside_the_hull() {
    let triangle = [[0, 0], [10, 0], [0, 10]];
    assert!(is_between([2, 3], &triangle));
    for outside in [[-1, 5], [5, -1], [6, 5], [12, 0], [0, 12], [-1, -1]] {
        assert!(!is_between(outside, &triangle), "{outside:?}");
    }
    assert!(!is_between([2, 3], &triangle[..2]));
    assert!(!is_between([2, 3], &[]));
}

#[test]
fn each_of_sixteen_samples_may_show_the_ink_of_a_square() {
    let blank = || {
        let mut drawn = Drawn::new([4, 4]);
        drawn.paint(6.0..9.0, 1.0..4.0, LIGHT);
        drawn
    };
    let squares = || (6..9).flat_map(|u| (1..4).map(move |v| [u, v]));
    blank().seen(|view, _| assert!(!squares().any(|cell| has_ink(view, cell))));
    for dv in [0.1, 0.35, 0.65, 0.9] {
        for du in [0.1, 0.35, 0.65, 0.9] {
            let mut drawn = blank();
            spot(&mut drawn, [7.0 + du, 2.0 + dv], DARK);
            drawn.seen(|view, _| {
                let seen = squares().filter(|&cell| has_ink(view, cell));
                assert!(seen.eq([[7, 2]]), "{du} {dv}");
            });
        }
    }
    // Between the samples, nothing is looked at.
    let mut drawn = blank();
    spot(&mut drawn, [7.5, 2.5], DARK);
    drawn.seen(|view, _| assert!(!has_ink(view, [7, 2])));
}

/// Three samples of ink in the square and three of paper beside each edge, and nothing else.
#[test]
fn nine_samples_show_the_corner_of_a_square() {
    let near_ink = [[0.15, 0.15], [0.15, 0.25], [0.25, 0.15]];
    let near_paper =
        [[-0.15, 0.15], [-0.15, 0.4], [-0.4, 0.15], [0.15, -0.15], [0.15, -0.4], [0.4, -0.15]];
    let corner = [7.0, 2.0];
    for inwards in SIGNS {
        let at = |[along_u, along_v]: [f64; 2]| {
            [corner[0] + inwards[0] * along_u, corner[1] + inwards[1] * along_v]
        };
        let is_corner = |spoilt: Option<[f64; 2]>| {
            let mut drawn = Drawn::new([4, 4]);
            drawn.paint(6.0..8.0, 1.0..3.0, COVER);
            near_paper.into_iter().for_each(|along| spot(&mut drawn, at(along), LIGHT));
            near_ink.into_iter().for_each(|along| spot(&mut drawn, at(along), DARK));
            spoilt.into_iter().for_each(|along| spot(&mut drawn, at(along), COVER));
            drawn.seen(|view, _| {
                let corner = corner.map(|value| value as f32);
                SIGNS.map(|sign| is_corner_of_square(view, corner, sign.map(|value| value as f32)))
            })
        };
        assert_eq!(is_corner(None), SIGNS.map(|sign| sign == inwards), "{inwards:?}");
        for along in near_ink.into_iter().chain(near_paper) {
            assert_eq!(is_corner(Some(along)), [false; 4], "{inwards:?} {along:?}");
        }
    }
}

#[test]
fn a_square_is_seen_by_any_of_its_corners() {
    // Its corners are in line with the lattice's, and lie exactly in their places.
    let extent = Bounds { first: [0, 0], last: [9, 5] };
    for outwards in SIGNS {
        let mut drawn = Drawn::new([4, 4]);
        drawn.paint(5.5..9.5, 0.5..4.5, COVER);
        drawn.seen(|view, _| assert!(!is_square_seen(view, [7, 2], extent)));
        let corner = [7.5 + 0.5 * outwards[0], 2.5 + 0.5 * outwards[1]];
        print_corner(&mut drawn, corner, outwards.map(|sign| -sign));
        drawn.seen(|view, _| {
            let cells = (5..10).flat_map(|u| (0..5).map(move |v| [u, v]));
            let seen = cells.filter(|&cell| is_square_seen(view, cell, extent));
            assert!(seen.eq([[7, 2]]), "{outwards:?}");
        });
    }
}

/// A tenth of a step for each line that a corner lies outside of the lattice, and at most half a step.
#[test]
fn a_corner_may_lie_a_tenth_of_a_step_from_its_place_for_each_line_outside() {
    let around = Bounds { first: [0, 0], last: [12, 9] };
    for [du, dv] in [[1, 0], [-1, 0], [0, 1], [0, -1], [1, -1]] {
        for tenths in 0..=7_i32 {
            let mut drawn = Drawn::new([4, 4]);
            drawn.paint(5.5..9.5, 0.5..4.5, COVER);
            let off = |sign: i32| 0.1 * f64::from(sign * tenths);
            print_corner(&mut drawn, [7.0 + off(du), 2.0 + off(dv)], [1.0, 1.0]);
            drawn.seen(|view, _| {
                for lines in [0, 1, 4, 5, 8] {
                    // Lattices that end so many lines before the corner of the square, on each side.
                    let extents = [
                        Bounds { last: [7 - lines, 9], ..around },
                        Bounds { first: [7 + lines, 0], ..around },
                        Bounds { last: [12, 2 - lines], first: [0, -8] },
                        Bounds { first: [0, 2 + lines], ..around },
                    ];
                    for extent in extents {
                        let errors = lines.min(5);
                        // A tenth of a step is two pixels here: with one more, the samples may just do.
                        if tenths != errors + 1 {
                            let is_seen = is_square_seen(view, [7, 2], extent);
                            let what = (du, dv, tenths, extent);
                            assert_eq!(is_seen, tenths <= errors, "{what:?}");
                        }
                    }
                }
            });
        }
    }
}

/// A board of which something covers the squares beyond the last column.
fn covered() -> Drawn {
    let mut drawn = Drawn::new([5, 4]);
    drawn.paint(4.3..6.0, -1.4..4.4, COVER);
    drawn
}

/// Prints a square, with paper around it.
fn print_square(drawn: &mut Drawn, [u, v]: [i32; 2]) {
    let [from_u, from_v] = [u, v].map(f64::from);
    drawn.paint(from_u - 0.6..from_u + 1.6, from_v - 0.6..from_v + 1.6, LIGHT);
    drawn.paint(from_u..from_u + 1.0, from_v..from_v + 1.0, DARK);
}

#[test]
fn a_square_outside_is_in_line_with_a_covered_side_and_at_most_five_beyond() {
    let is_outside = |mut drawn: Drawn, cell: Option<[i32; 2]>| {
        cell.into_iter().for_each(|cell| print_square(&mut drawn, cell));
        drawn.seen(|view, bounds| is_square_outside(view, bounds, bounds))
    };
    assert!(!is_outside(covered(), None));
    // Of the squares beyond the last column, from that before the first row to that after the last one.
    for cell in [[6, 0], [6, 2], [7, -1], [7, 1], [7, 3], [8, 2], [9, -1], [9, 3]] {
        assert!(is_outside(covered(), Some(cell)), "{cell:?}");
        // Of a board that is seen to end there, it is no part.
        assert!(!is_outside(Drawn::new([5, 4]), Some(cell)), "{cell:?}");
    }
    // Light ones would be there; and one too far out, or not in line with the rows.
    for cell in [[6, 1], [7, 0], [7, 2], [8, 1], [10, 0], [10, 2], [7, -3], [7, 5], [8, -2]] {
        assert!(!is_outside(covered(), Some(cell)), "{cell:?}");
    }
}

#[test]
fn nine_lines_of_samples_lie_in_each_square() {
    let bounds = Bounds { first: [-1, 2], last: [0, 2] };
    let columns = (-19..=-11).chain(-9..=-1).chain(1..=9);
    assert!(lines_of_samples(bounds, 0).eq(columns));
    assert!(lines_of_samples(bounds, 1).eq((11..=19).chain(21..=29)));
}

#[test]
fn the_outline_has_room_for_two_places_on_each_line_of_the_longest_target() {
    let lines = TARGET_CORNERS_MAX as i32 / 3;
    let longest = Bounds { first: [0, 0], last: [2, lines - 1] };
    assert_eq!(2 * lines_of_samples(longest, 1).count(), OUTLINE_MAX);
}

/// By the definition: of all samples of the dark squares, one is ink and lies between those that are paper.
fn is_ink_between_paper(view: &View<'_, u8>, bounds: Bounds) -> bool {
    let all = || {
        let squares = bounds.squares().cells().filter(|[u, v]| (u + v) % 2 == 0);
        squares.flat_map(|[u, v]| {
            let in_square = (1..10).flat_map(|dv| (1..10).map(move |du| [du, dv]));
            in_square.map(move |[du, dv]| [10 * u as i16 + du, 10 * v as i16 + dv])
        })
    };
    let place = |sample: Sample| sample.map(|value| f32::from(value) / 10.0);
    let paper: Vec<Sample> = all().filter(|&sample| view.is_paper(place(sample))).collect();
    all().any(|sample| view.is_ink(place(sample)) && is_between(sample, &paper))
}

#[test]
fn ink_between_hidden_places_is_that_between_samples_that_are_paper() {
    let bounds = Bounds { first: [0, -1], last: [4, 2] };
    let mut random = Random::new(40);
    let mut outcomes = [0; 2];
    for number in 0..30 {
        let mut drawn = Drawn::new([3, 3]);
        drawn.paint(2.2..7.0, -3.0..5.0, COVER);
        // Patches that look like a cover, like ink and like paper.
        for _ in 0..4 {
            let [u, v] = [(2.2, 4.5), (-2.0, 2.5)].map(|(low, high)| random.uniform(low, high));
            let level = [COVER, DARK, LIGHT, LIGHT][(random.bits() % 4) as usize];
            drawn.paint(u..u + random.uniform(0.2, 1.0), v..v + random.uniform(0.2, 1.0), level);
        }
        drawn.seen(|view, _| {
            let expected = is_ink_between_paper(view, bounds);
            assert_eq!(is_ink_between_hidden(view, bounds), expected, "{number}");
            outcomes[usize::from(expected)] += 1;
        });
    }
    assert!(outcomes.iter().all(|&count| count >= 5), "{outcomes:?}");
}
