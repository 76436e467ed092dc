//! Lattices of a few corners at exact places.

extern crate std;

use core::f64::consts::FRAC_PI_2;
use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::find::grid::tests::drawn::{STEP_PX, corners_at, grown, px};

/// The corners of a board, the first of which is at this place of one that begins at (0, 0).
fn board_from([u0, v0]: [i32; 2], size: [i32; 2]) -> Vec<Corner> {
    let mut corners = corners_at(size, |[u, v]| px([u + f64::from(u0), v + f64::from(v0)]));
    if (u0 + v0) % 2 != 0 {
        corners.iter_mut().for_each(|corner| corner.edges_rad.reverse());
    }
    corners
}

/// A lattice to which no corner belongs.
fn started(corners: &[Corner]) -> Box<Lattice> {
    let mut lattice = Box::new(Lattice::new());
    lattice.start(corners);
    lattice
}

/// A corner, moved by some pixels, with its edges turned.
fn moved(corner: Corner, by_px: [f64; 2], turns_deg: [f64; 2]) -> Corner {
    let [x, y] = [0, 1].map(|axis| (f64::from(corner.position_px[axis]) + by_px[axis]) as f32);
    let turned = |edge: usize| corner.edges_rad[edge] + turns_deg[edge].to_radians() as f32;
    Corner { position_px: [x, y], edges_rad: [0, 1].map(turned), ..corner }
}

/// Movements by less and by more than a distance, in four directions.
fn around(distance_px: f64) -> impl Iterator<Item = ([f64; 2], bool)> {
    [(distance_px - 0.1, true), (distance_px + 0.1, false)].into_iter().flat_map(|(by, is_near)| {
        [[by, 0.0], [-by, 0.0], [0.0, by], [0.0, -by]].map(|by_px| (by_px, is_near))
    })
}

/// How the edges of a corner may be turned from where they should be: by 25 degrees.
const TURNS_DEG: [([f64; 2], bool); 8] = [
    ([24.0, 24.0], true),
    ([-24.0, -24.0], true),
    ([24.0, -24.0], true),
    ([26.0, 26.0], false),
    ([26.0, 0.0], false),
    ([0.0, 26.0], false),
    ([-26.0, 0.0], false),
    ([0.0, -26.0], false),
];

#[test]
fn bounds_grow_at_all_sides_and_have_squares_around() {
    let bounds = Bounds { first: [-1, 2], last: [3, 5] };
    assert_eq!(bounds.squares(), Bounds { first: [-2, 1], last: [3, 5] });
    assert_eq!(bounds.grown(0), bounds);
    assert_eq!(bounds.grown(3), Bounds { first: [-4, -1], last: [6, 8] });
    for cell in bounds.grown(2).cells() {
        assert_eq!(bounds.contains(cell), bounds.cells().any(|of| of == cell), "{cell:?}");
    }
    assert_eq!(bounds.cells().count(), 5 * 4);
}

/// The first cell from a corner with four neighbours at these distances: right, down, left and up.
fn assert_first_cell_is_the_smallest(distances_px: [f32; 4]) {
    let [right, down, left, up] = distances_px;
    let corner = |x: f32, y: f32, is_even: bool| {
        let edges_rad = if is_even { [0.0, FRAC_PI_2] } else { [FRAC_PI_2, 0.0] };
        Corner {
            position_px: [100.0 + x, 100.0 + y],
            score: 0.2,
            edges_rad: edges_rad.map(|angle| angle as f32),
        }
    };
    let places = [-up, 0.0, down].into_iter().zip([false, true, false]).flat_map(|(y, row)| {
        [-left, 0.0, right]
            .into_iter()
            .zip([false, true, false])
            .map(move |(x, column)| corner(x, y, row == column))
    });
    let corners: Vec<_> = places.collect();
    let mut lattice = started(&corners);
    lattice.place_first_cell(&corners, 4, 1).expect("a cell");
    let [u, v, far] = [[1, 0], [0, 1], [1, 1]]
        .map(|cell| between(&corners, 4, lattice.corner(cell).expect("a corner")));
    // Both ways to the opposite corner.
    assert_eq!(plus_px(u, v), far, "{distances_px:?}");
    assert!(cross(u, v) > 0.0, "{distances_px:?}: {u:?} {v:?}");
    let nearer = |plus: f32, minus: f32| if plus < minus { plus } else { -minus };
    let nearest = [nearer(right, left), nearer(down, up)];
    assert_eq!(far, nearest, "{distances_px:?}");
    // The seed's edge 0 is horizontal.
    assert_eq!(lattice.edge_along_u([0, 0]), usize::from(u[0] == 0.0), "{distances_px:?}");
    assert_eq!((lattice.corner([0, 0]), lattice.cells().count()), (Some(4), 4));
}

#[test]
fn the_first_cell_is_the_smallest_around_the_seed() {
    const DISTANCES_PX: [f32; 4] = [18.0, 21.0, 25.0, 30.0];
    let places = || (0..4_usize).flat_map(|a| (0..4).map(move |b| (a, b)));
    for ((a, b), (c, d)) in places().flat_map(|ab| places().map(move |cd| (ab, cd))) {
        let mut sorted = [a, b, c, d];
        sorted.sort_unstable();
        if sorted == [0, 1, 2, 3] {
            assert_first_cell_is_the_smallest([a, b, c, d].map(|place| DISTANCES_PX[place]));
        }
    }
}

#[test]
fn the_sides_of_the_first_cell_are_of_similar_length() {
    // The seed's sides along u and along v, and the opposite ones.
    let is_cell = |[u, v]: [f64; 2], [far_u, far_v]: [f64; 2]| {
        // One of the pairs is parallel to the picture's sides, and the cell has right angles at them.
        let far = if far_u == u { [u, far_v] } else { [far_u, v] };
        let places = [[0.0, 0.0], [u, 0.0], [0.0, v], far];
        let towards = |from: usize, to: usize| {
            let [x, y] = [0, 1].map(|axis| places[to][axis] - places[from][axis]);
            y.atan2(x) as f32
        };
        let edges = [
            [towards(0, 1), towards(0, 2)],
            [towards(1, 3), towards(0, 1)],
            [towards(0, 2), towards(2, 3)],
            [towards(2, 3), towards(1, 3)],
        ];
        let corners: Vec<_> = places
            .into_iter()
            .zip(edges)
            .map(|(place, edges_rad)| Corner {
                position_px: place.map(|value| value as f32),
                score: 0.2,
                edges_rad,
            })
            .collect();
        let mut lattice = started(&corners);
        lattice.place_first_cell(&corners, 0, 1).is_some()
    };
    // Opposite sides up to 1.4 : 1, in either order, of a long cell, whose angles are nearly right.
    for (long, is_similar) in [(27.5, true), (28.5, false)] {
        for [near, far] in [[20.0, long], [long, 20.0]] {
            assert_eq!(is_cell([near, 45.0], [far, 45.0]), is_similar, "u: {near} {far}");
            assert_eq!(is_cell([45.0, near], [45.0, far]), is_similar, "v: {near} {far}");
        }
    }
    // Adjacent sides up to 3 : 1.
    for (long, is_similar) in [(59.0, true), (61.0, false)] {
        for sides in [[20.0, long], [long, 20.0]] {
            assert_eq!(is_cell(sides, sides), is_similar, "{sides:?}");
        }
    }
}

#[test]
fn a_lattice_has_the_lines_and_the_corners_that_are_asked_for() {
    let piece = Least::Piece { gap: 1 };
    for (size, hidden, is_target, is_piece) in [
        ([3, 3], None, true, true),
        ([3, 3], Some(8), false, true),
        ([3, 2], None, false, true),
        ([3, 2], Some(5), false, false),
        ([2, 3], None, false, true),
        ([2, 2], None, false, false),
        // More corners than 3 x 3 in two lines.
        ([5, 2], None, false, true),
        ([2, 5], None, false, true),
    ] {
        let mut corners = board_from([0, 0], size);
        if let Some(index) = hidden {
            corners.remove(index);
        }
        let mut lattice = started(&corners);
        let last = [size[0] - 1, size[1] - 1];
        for (least, is_large) in [(Least::Target, is_target), (piece, is_piece)] {
            let expected = is_large.then_some(Bounds { first: [0, 0], last });
            assert_eq!(lattice.grow(&corners, 0, least), expected, "{size:?} {hidden:?} {least:?}");
            // The same corners once more: they belong to this lattice now.
            let again = lattice.grow(&corners, 0, least);
            assert_eq!(again, None, "{size:?} {hidden:?} {least:?}");
            lattice.release();
            lattice.start(&corners);
        }
    }
}

#[test]
fn corners_of_another_lattice_are_left_out() {
    let corners = board_from([0, 0], [4, 3]);
    let mut lattice = started(&corners);
    // The last column.
    lattice.use_up([3, 7, 11].into_iter());
    assert_eq!(lattice.grow(&corners, 3, Least::Target), None);
    let bounds = Bounds { first: [0, 0], last: [2, 2] };
    assert_eq!(lattice.grow(&corners, 0, Least::Target), Some(bounds));
}

/// The corner above the seed's row is only predicted by the step behind it, and that one is found after its
/// start was looked at: the gap has to be passed below.
///
/// ```text
/// .  .  .  x  .
/// 0  +  +  +  +
/// +  +  .  +  +
/// +  +  +  +  +
/// +  +  +  +  +
/// ```
#[test]
fn what_is_predicted_only_once_others_were_found_is_found_in_another_round() {
    let board = board_from([0, 0], [5, 5]);
    let is_seen = |&(number, _): &(usize, Corner)| number == 3 || (number >= 5 && number != 12);
    let corners: Vec<_> =
        board.into_iter().enumerate().filter(is_seen).map(|(_, corner)| corner).collect();
    let mut lattice = started(&corners);
    let bounds = lattice.grow(&corners, 1, Least::Target);
    assert_eq!(bounds, Some(Bounds { first: [0, -1], last: [4, 3] }));
    assert_eq!(lattice.corner([3, -1]), Some(0));
    assert_eq!(lattice.corner([2, 1]), None);
}

/// How a corner is moved from its place, pixels, and how its edges are turned, degrees.
type Candidate = ([f64; 2], [f64; 2]);

/// Which of the corners after a board's is found beside its right side, and below it.
fn found_beside(candidates: [&[Candidate]; 2]) -> [Option<u16>; 2] {
    let mut corners = board_from([0, 0], [3, 3]);
    for (place, candidates) in [([3, 1], candidates[0]), ([1, 3], candidates[1])] {
        let corner = board_from(place, [1, 1])[0];
        corners.extend(candidates.iter().map(|&(by_px, turns)| moved(corner, by_px, turns)));
    }
    let (lattice, _) = grown(&corners, Least::Target);
    [[3, 1], [1, 3]].map(|cell| lattice.corner(cell))
}

#[test]
fn a_corner_lies_within_a_quarter_of_a_step_of_its_prediction() {
    for axis in 0..2 {
        for (by_px, is_near) in around(0.25 * STEP_PX[axis]) {
            let mut candidates = [&[][..]; 2];
            let candidate = [(by_px, [0.0; 2])];
            candidates[axis] = &candidate;
            let mut expected = [None; 2];
            expected[axis] = is_near.then_some(9);
            assert_eq!(found_beside(candidates), expected, "{by_px:?}");
        }
    }
}

#[test]
fn the_nearest_corner_is_taken_whose_edges_agree() {
    let [near, far] = [([1.0, 0.0], [0.0; 2]), ([0.0, -2.0], [0.0; 2])];
    assert_eq!(found_beside([&[near, far], &[far, near]]), [Some(9), Some(12)]);
    for (turns, agrees) in TURNS_DEG {
        let turned = ([0.0; 2], turns);
        let expected = agrees.then_some(9);
        assert_eq!(found_beside([&[turned], &[]]), [expected, None], "{turns:?}");
        // Otherwise, the next one is.
        let nearest = if agrees { [9, 11] } else { [10, 12] };
        let found = found_beside([&[turned, near], &[turned, far]]);
        assert_eq!(found, nearest.map(Some), "{turns:?}");
    }
}

#[test]
fn all_corners_of_a_search_may_be_one_lattice() {
    const COLUMNS: i32 = 32;
    let corners = board_from([0, 0], [COLUMNS, CORNERS_MAX as i32 / COLUMNS]);
    assert_eq!(corners.len(), CORNERS_MAX);
    let mut lattice = started(&corners);
    let middle = (CORNERS_MAX / 2) as u16 + COLUMNS as u16 / 2;
    assert!(lattice.grow(&corners, middle, Least::Target).is_some());
    assert_eq!(lattice.cells().count(), CORNERS_MAX);
}

#[test]
fn the_longest_target_is_a_lattice_from_either_of_its_ends() {
    let longest = TARGET_CORNERS_MAX as i32 / 3;
    for size in [[longest, 3], [3, longest]] {
        let corners = board_from([0, 0], size);
        for seed in [0, corners.len() - 1] {
            let mut lattice = started(&corners);
            let bounds = lattice.grow(&corners, seed as u16, Least::Target).unwrap();
            let lines = [bounds.columns(), bounds.rows()].map(|lines| lines as i32);
            assert!(lines == size || lines == [size[1], size[0]], "{lines:?}");
            assert_eq!(lattice.cells().count(), corners.len());
        }
    }
}

#[test]
fn what_lies_outside_of_the_map_is_left_out() {
    // Three more columns than the map has, at either end.
    let columns = SIDE as i32 + 6;
    let corners = board_from([-CENTRE - 3, 0], [columns, 3]);
    let mut lattice = started(&corners);
    let bounds = lattice.grow(&corners, (CENTRE + 3) as u16, Least::Target);
    let all = Bounds { first: [-CENTRE, 0], last: [CENTRE - 1, 2] };
    assert_eq!(bounds, Some(all));
    let plane = Plane::fit(&lattice, &corners).unwrap();
    assert_eq!(lattice.extend(&corners, &plane, 3), 0);
    assert_eq!(lattice.extent(), Some(all));
}

#[test]
fn pieces_on_both_sides_of_a_gap_are_joined() {
    let mut corners = board_from([0, 0], [3, 3]);
    corners.extend(board_from([5, 0], [3, 3]));
    // Beside a corner that has its place: nothing is placed there once more.
    corners.push(moved(corners[4], [1.0, 1.0], [0.0; 2]));
    let (mut lattice, bounds) = grown(&corners, Least::Target);
    assert_eq!(bounds.last, [2, 2]);
    let mut extend = |reach: i32| {
        let plane = Plane::fit(&lattice, &corners).unwrap();
        let added = lattice.extend(&corners, &plane, reach);
        assert_eq!(lattice.corner([1, 1]), Some(4));
        (added, lattice.extent().unwrap().last)
    };
    // The next column is three steps away.
    assert_eq!(extend(2), (0, [2, 2]));
    assert_eq!(extend(3), (3, [5, 2]));
    assert_eq!(extend(3), (6, [7, 2]));
    assert_eq!(extend(3), (0, [7, 2]));
}

/// Which of the corners after a board's a plane puts at a place that no corner of the board is beside.
fn found_on_plane(candidates: &[Candidate]) -> Option<u16> {
    const PLACE: [i32; 2] = [5, 1];
    let mut corners = board_from([0, 0], [4, 3]);
    let corner = board_from(PLACE, [1, 1])[0];
    corners.extend(candidates.iter().map(|&(by_px, turns)| moved(corner, by_px, turns)));
    let (lattice, _) = grown(&corners, Least::Target);
    let plane = Plane::fit(&lattice, &corners).unwrap();
    lattice.corner_on_plane(&corners, &plane, PLACE)
}

#[test]
fn the_nearest_corner_within_a_fifth_of_the_shorter_step_is_on_the_plane() {
    for (by_px, is_near) in around(0.2 * STEP_PX[1]) {
        let found = found_on_plane(&[(by_px, [0.0; 2])]);
        assert_eq!(found, is_near.then_some(12), "{by_px:?}");
    }
    let [near, far] = [([1.0, 0.0], [0.0; 2]), ([0.0, -2.0], [0.0; 2])];
    assert_eq!(found_on_plane(&[near, far]), Some(12));
    assert_eq!(found_on_plane(&[far, near]), Some(13));
    assert_eq!(found_on_plane(&[]), None);
    for (turns, agrees) in TURNS_DEG {
        let turned = ([0.0; 2], turns);
        assert_eq!(found_on_plane(&[turned]), agrees.then_some(12), "{turns:?}");
        assert_eq!(found_on_plane(&[turned, near]), Some(if agrees { 12 } else { 13 }));
    }
}

#[test]
fn what_belongs_to_a_lattice_is_not_on_the_plane_again() {
    let corners = board_from([0, 0], [4, 3]);
    let (mut lattice, _) = grown(&corners, Least::Target);
    let plane = Plane::fit(&lattice, &corners).unwrap();
    lattice.remove([1, 1]);
    assert_eq!(lattice.corner_on_plane(&corners, &plane, [1, 1]), None);
    lattice.start(&corners);
    assert_eq!(lattice.corner_on_plane(&corners, &plane, [1, 1]), Some(5));
    lattice.use_up([5].into_iter());
    assert_eq!(lattice.corner_on_plane(&corners, &plane, [1, 1]), None);
}
