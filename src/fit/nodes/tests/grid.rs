//! The nodes of grids of other shapes, and what runs between them, against what a grid is by its
//! definition.

extern crate std;

use std::vec::Vec;

use super::*;
use crate::test_support::Random;

/// The shape of a target: corners along x and along y. Both parities, and neither is twice the other.
const SHAPES: [[u8; 2]; 3] = [[6, 5], [5, 7], [3, 3]];

fn checker([columns, rows]: [u8; 2]) -> TargetGeometry {
    TargetGeometry::checker(columns, rows, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap()
}

/// A grid whose rows and columns are cubics in the picture.
fn bent([columns, rows]: [u8; 2]) -> (Nodes, impl Fn(f64, f64) -> Vector2<f64>) {
    let at_px = |column: f64, row: f64| {
        let (u, v) = (column - 2.0, row - 3.0);
        let bend = 0.3 * u * u - 0.1 * u * v + 0.2 * v * v + 0.04 * u * u * u - 0.03 * v * v * v;
        Vector2::new(20.0 * u - 3.0 * v - bend, 2.0 * u + 17.0 * v + 0.7 * bend)
    };
    let (columns, rows) = (usize::from(columns) + 2, usize::from(rows) + 2);
    let mut nodes = Nodes { columns, rows, nodes: heapless::Vec::new() };
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let (point_target_mm, ray) = (Vector3::zeros(), Vector2::zeros());
        let raw_px = at_px(column as f64, row as f64);
        let raw_by_ray = Matrix2::identity();
        nodes.nodes.push(Node { point_target_mm, ray, raw_px, raw_by_ray }).unwrap();
    }
    (nodes, at_px)
}

/// Column and row of a node.
fn place(nodes: &Nodes, node: u8) -> [usize; 2] {
    [usize::from(node) % nodes.columns, usize::from(node) / nodes.columns]
}

/// The dark squares of a board, by their lower right nodes: every other one, from (1, 1) on.
fn is_dark([column, row]: [usize; 2], first_square_dark: bool) -> bool {
    let steps = column - 1 + row - 1;
    steps.is_multiple_of(2) == first_square_dark
}

#[test]
fn beyond_the_corners_the_grid_goes_on_as_it_ends() {
    for [columns, rows] in SHAPES {
        let mut random = Random::new(31);
        let mut measured = || random.uniform(-0.1, 0.1);
        let points_mm: Vec<_> = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| [column, row].map(f64::from)))
            .map(|[x, y]| [12.0 * x + measured(), 12.0 * y + measured(), measured()])
            .collect();
        let shape = [columns, rows].map(usize::from);
        let target =
            TargetGeometry::from_points(columns, rows, points_mm, Role::Upper, [0.0; 3]).unwrap();
        let corner_mm = |column: usize, row: usize| target.corner_mm(row * shape[0] + column);
        // From the nearest corner by as much as that is from its neighbour, along each axis.
        let near = |place: usize, count: usize| place.clamp(1, count) - 1;
        let inner = |place: usize, count: usize| match place {
            0 => 1,
            _ if place > count => count - 2,
            _ => place - 1,
        };
        let all: Vec<_> = super::points_mm(&target).collect();
        assert_eq!(all.len(), (shape[0] + 2) * (shape[1] + 2));
        for (node, point_mm) in all.iter().enumerate() {
            let [column, row] = [node % (shape[0] + 2), node / (shape[0] + 2)];
            let here_mm = corner_mm(near(column, shape[0]), near(row, shape[1]));
            let [beside_mm, above_mm] = [
                corner_mm(inner(column, shape[0]), near(row, shape[1])),
                corner_mm(near(column, shape[0]), inner(row, shape[1])),
            ];
            let expected_mm = here_mm * 3.0 - beside_mm - above_mm;
            assert!((point_mm - expected_mm).norm() < 1e-12, "{column} {row}: {point_mm}");
        }
    }
}

#[test]
fn only_corners_have_a_corners_number() {
    for shape in SHAPES {
        let (nodes, _) = bent(shape);
        let [columns, rows] = shape.map(usize::from);
        let mut next = 0;
        for node in 0..nodes.nodes.len() as u8 {
            let [column, row] = place(&nodes, node);
            let is_corner = column != 0 && column != columns + 1 && row != 0 && row != rows + 1;
            assert_eq!(nodes.corner(node), is_corner.then_some(next), "{column} {row}");
            next += usize::from(is_corner);
        }
        assert_eq!(next, columns * rows);
    }
}

/// Dark squares have no side in common, and whatever else there is, is light.
#[test]
fn the_edges_are_the_sides_of_the_dark_squares() {
    for shape in SHAPES {
        for first_square_dark in [true, false] {
            let (nodes, _) = bent(shape);
            let (columns, rows) = (nodes.columns, nodes.rows);
            let mut expected = Vec::new();
            for (column, row) in (1..columns).flat_map(|it| (1..rows).map(move |row| (it, row))) {
                if !is_dark([column, row], first_square_dark) {
                    continue;
                }
                let node = |left: usize, up: usize| ((row - up) * columns + column - left) as u8;
                // Seen along an edge to the right, its right side is below it, and along one downwards,
                // on the left of the picture.
                for (direction, nodes, is_right_light, is_border) in [
                    (Direction::X, [node(1, 1), node(0, 1)], false, row == 1),
                    (Direction::X, [node(1, 0), node(0, 0)], true, row == rows - 1),
                    (Direction::Y, [node(1, 1), node(1, 0)], true, column == 1),
                    (Direction::Y, [node(0, 1), node(0, 0)], false, column == columns - 1),
                ] {
                    expected.push(Edge { direction, nodes, is_right_light, is_border });
                }
            }
            let mut edges: Vec<_> = nodes.edges(first_square_dark).collect();
            edges.sort_by_key(|edge| edge.nodes);
            expected.sort_by_key(|edge| edge.nodes);
            assert_eq!(edges, expected, "{shape:?} {first_square_dark}");
        }
    }
}

#[test]
fn a_square_lies_between_four_nodes() {
    for shape in SHAPES {
        let (nodes, at_px) = bent(shape);
        assert_eq!(nodes.columns_of_squares(), nodes.columns - 1);
        for first_square_dark in [true, false] {
            let squares: Vec<_> = nodes.squares(first_square_dark).collect();
            let places =
                (1..nodes.rows).flat_map(|row| (1..nodes.columns).map(move |it| [it, row]));
            assert_eq!(squares.len(), places.clone().count());
            for (square, [column, row]) in squares.iter().zip(places) {
                assert_eq!(place(&nodes, square.node), [column, row]);
                assert_eq!(square.is_dark, is_dark([column, row], first_square_dark));
                let (x, y) = (column as f64, row as f64);
                let side = |from: [f64; 2], to: [f64; 2]| {
                    (at_px(x - from[0], y - from[1]) + at_px(x - to[0], y - to[1])) / 2.0
                };
                let (left, right) = (side([1.0, 1.0], [1.0, 0.0]), side([0.0, 1.0], [0.0, 0.0]));
                let (top, bottom) = (side([1.0, 1.0], [0.0, 1.0]), side([1.0, 0.0], [0.0, 0.0]));
                let width_px = (right - left).norm().min((bottom - top).norm());
                assert!((square.width_px - width_px).abs() < 1e-12, "{column} {row}");
                let middle_px = (left + right) / 2.0;
                assert!((square.middle_px - middle_px).norm() < 1e-12, "{column} {row}");
            }
        }
    }
    // The shorter side is once that along x and once that along y.
    let (nodes, at_px) = bent([6, 7]);
    let is_narrow = |square: &Square| {
        let [column, row] = place(&nodes, square.node).map(|it| it as f64);
        let across_px = at_px(column, row - 0.5) - at_px(column - 1.0, row - 0.5);
        let along_px = at_px(column - 0.5, row) - at_px(column - 0.5, row - 1.0);
        across_px.norm() < along_px.norm()
    };
    let narrow = nodes.squares(true).filter(is_narrow).count();
    assert!((1..56).contains(&narrow), "{narrow}");
}

#[test]
fn no_nodes_have_no_squares() {
    let nodes = Nodes::new();
    assert_eq!((nodes.columns_of_squares(), nodes.squares(true).count()), (0, 0));
}

/// A square beside an edge has both of its ends among its four corners.
#[test]
fn an_edge_has_a_square_on_each_side_that_has_one() {
    for shape in SHAPES {
        let (nodes, _) = bent(shape);
        let columns = nodes.columns as u8;
        for edge in nodes.edges(true).chain(nodes.edges(false)) {
            let has = |square: &u8, node: u8| {
                [*square, square - 1, square - columns, square - columns - 1].contains(&node)
            };
            let squares = nodes.squares(true).map(|square| square.node);
            let expected: Vec<_> =
                squares.filter(|it| edge.nodes.iter().all(|&node| has(it, node))).collect();
            let beside: Vec<_> = nodes.squares_beside(&edge).collect();
            assert_eq!(beside, expected, "{edge:?}");
            assert_eq!(beside.len(), if edge.is_border { 1 } else { 2 });
        }
    }
}

/// The second differences of a cubic tell how far it is from its chord's middle, and the mean of two
/// of them, or what lies on their line beyond, tells it exactly.
#[test]
fn a_chord_is_that_of_its_arc() {
    for shape in SHAPES {
        let (nodes, at_px) = bent(shape);
        for edge in nodes.edges(true).chain(nodes.edges(false)) {
            let chord = nodes.chord(&edge);
            let [start, end] = edge.nodes.map(|node| place(&nodes, node));
            let px = |[column, row]: [usize; 2]| at_px(column as f64, row as f64);
            assert_eq!([chord.start_px, chord.end_px], [px(start), px(end)]);
            let along = (px(end) - px(start)).normalize();
            // A quarter turn from x to y.
            let right = Vector2::new(-along.y, along.x);
            assert!((chord.right - right).norm() < 1e-14, "{edge:?}");

            let middle = [0, 1].map(|axis| (start[axis] + end[axis]) as f64 / 2.0);
            let arc_px = at_px(middle[0], middle[1]) - (px(start) + px(end)) / 2.0;
            assert!((chord.bend_px - right.dot(&arc_px)).abs() < 1e-12, "{edge:?}");

            // The mean step, at both ends, from the line before to the line after.
            let (axis, lines) = match edge.direction {
                Direction::X => (1, nodes.rows),
                Direction::Y => (0, nodes.columns),
            };
            let line = start[axis];
            let [before, after] = [line.saturating_sub(1), (line + 1).min(lines - 1)];
            let step_px = |mut node: [usize; 2]| {
                let [from_px, to_px] = [before, after].map(|line| {
                    node[axis] = line;
                    px(node)
                });
                (to_px - from_px) / (after - before) as f64
            };
            let across_px = (step_px(start) + step_px(end)) / 2.0;
            assert!((chord.across_px - across_px).norm() < 1e-12, "{edge:?}");
        }
    }
}

#[test]
fn a_drift_counts_from_the_row_in_which_a_node_is_seen() {
    let lens = table(&bedside_lens());
    let target = checker([6, 5]);
    let mut nodes = Nodes::new();
    assert!(nodes.project(&lens, &target, &pose()));
    // Some 10 px in the picture.
    let moved = Pose::from_theta([0.02, -0.2, 0.1, 38.0, -25.0, 900.0]);
    let per_row = Vector6::new(1e-5, -2e-5, 3e-5, 0.02, -0.03, 0.01);
    nodes.deform(&target, &moved, &Drift { per_row, middle_row_px: 500.0 });
    let mut farthest_mm = 0.0_f64;
    for (node, point_mm) in nodes.as_slice().iter().zip(points_mm(&target)) {
        let row_px = lens.project(&moved.transform(&point_mm)).unwrap().y;
        let moving = moved.moved_by(&(per_row * (row_px - 500.0)));
        let expected_mm = moved.inverse().transform(&moving.transform(&point_mm));
        // The square of a turn of 2e-3 is 8e-5 mm of 40 mm, and the lens's derivative is good to some
        // 5e-3 rows.
        assert!((node.point_target_mm - expected_mm).norm() < 3e-4, "{point_mm}");
        farthest_mm = farthest_mm.max((node.point_target_mm - point_mm).norm());
    }
    assert!(farthest_mm > 1.0, "{farthest_mm}");
}
