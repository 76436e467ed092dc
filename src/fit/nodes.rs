//! The nodes of a target's grid, where an expected pose puts them in the picture.
//!
//! A node is where squares meet: every inner corner, and a ring around them, where the outermost
//! squares end. Between two neighbouring nodes runs an *edge*, dark on one side and light on the
//! other; see [`crate::fit::edge`]. On the ring only the dark squares have edges, with the paper's
//! margin.
//!
//! ```text
//!   ┌───┐   ┌───┐
//!   │   ├───┤   ├───┐     3 x 2 corners: 5 x 4 nodes,
//!   └───┼───┼───┼───┤     2 x 4 edges along x and 3 x 3 along y,
//!   ┌───┼───┼───┼───┘     7 on the border
//!   └───┘   └───┘
//! ```

use heapless::Vec;
use nalgebra::{Matrix2, Vector2, Vector3, Vector6};

use crate::limits::TARGET_NODES_MAX;
use crate::model::lens::{ray_by_point, ray_of};
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::TargetGeometry;

/// How a target moves while a camera reads its picture row by row.
///
/// A rolling shutter sees a target that moves deformed, each row a little later than the one
/// before. A grid that is deformed in the same way, at the pose in which the target's middle is
/// seen, explains the picture; the nodes are those of that grid. The motion counts to first order:
/// in the 2 ms that a target of 140 rows takes, an acceleration of 1 m/s2 adds 0.0005 mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drift {
    /// The motion from one row to the next below: an increment of [`Pose::moved_by`].
    pub(crate) per_row: Vector6<f64>,
    /// The row in which the target's middle is seen.
    pub(crate) middle_row_px: f64,
}

/// A target moves at most by this share of a row while a row is read; no body is so fast.
const ROWS_PER_ROW_MAX: f64 = 0.5;

impl Drift {
    /// The displacement of a point, in the target frame, from one row to the next below.
    fn of_point_mm(
        &self,
        point_target_mm: &Vector3<f64>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Vector3<f64> {
        let turn_rad = self.per_row.fixed_rows::<3>(0).into_owned();
        let moved_mm = self.per_row.fixed_rows::<3>(3).into_owned();
        turn_rad.cross(point_target_mm) + cam_from_target.rotation.tr_mul(&moved_mm)
    }

    /// Where a point of the target lies, in the frame of the target at its middle's time, when the row
    /// in which it is seen is read; `None` when it is behind the camera.
    fn displaced_mm(
        &self,
        point_target_mm: &Vector3<f64>,
        lens: &LensTable,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Option<Vector3<f64>> {
        let point_cam_mm = cam_from_target.transform(point_target_mm);
        let ray = ray_of(&point_cam_mm)?;
        let (raw_px, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
        let drift_mm = self.of_point_mm(point_target_mm, cam_from_target);
        let drift_px =
            raw_by_ray * ray_by_point(&point_cam_mm, &ray) * (cam_from_target.rotation * drift_mm);
        // After r rows the point is in row raw.y + r drift.y, which is r rows below the middle.
        let rows_per_row = drift_px.y.clamp(-ROWS_PER_ROW_MAX, ROWS_PER_ROW_MAX);
        let rows = (raw_px.y - self.middle_row_px) / (1.0 - rows_per_row);
        Some(point_target_mm + drift_mm * rows)
    }
}

/// One node, and how its raw pixel changes with its ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// In the target frame: where the grid has it or, of a grid that a moving target deforms, where
    /// it is when its row is read.
    pub point_target_mm: Vector3<f64>,
    /// Its ray at the expected pose, at z = 1.
    pub ray: Vector2<f64>,
    /// Its raw pixel there.
    pub raw_px: Vector2<f64>,
    /// d raw pixel / d ray, there.
    pub raw_by_ray: Matrix2<f64>,
}

impl Node {
    /// The displacement, in raw pixels, from the expected position to that at another pose, to
    /// first order in the lens; `None` when the node lies behind the camera there.
    #[inline]
    #[must_use]
    pub(crate) fn moved_px(&self, cam_from_target: &Pose<Cam, Target>) -> Option<Vector2<f64>> {
        let ray = ray_of(&cam_from_target.transform(&self.point_target_mm))?;
        Some(self.raw_by_ray * (ray - self.ray))
    }
}

/// A line's direction on the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Along the columns' axis: left to right on an upright target.
    X,
    /// Along the rows' axis.
    Y,
}

/// The part of a grid line between two neighbouring nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Along which of the target's axes it runs.
    pub direction: Direction,
    /// Its ends, in the direction's order.
    pub nodes: [u8; 2],
    /// Whether the side to the right, seen along the edge in the picture, is light.
    pub is_right_light: bool,
    /// Whether it divides one of the outermost dark squares from the paper's margin.
    pub is_border: bool,
}

/// One square in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Square {
    /// The node at its lower right.
    pub node: u8,
    /// Raw pixel of its middle.
    pub middle_px: Vector2<f64>,
    /// Its shorter side.
    pub width_px: f64,
    /// Its colour.
    pub is_dark: bool,
}

/// All nodes of one target at one expected pose, row by row.
pub struct Nodes {
    columns: usize,
    rows: usize,
    nodes: Vec<Node, TARGET_NODES_MAX>,
}

impl Nodes {
    /// No nodes.
    #[must_use]
    pub const fn new() -> Self {
        Self { columns: 0, rows: 0, nodes: Vec::new() }
    }

    /// Projects every node at a pose. Returns whether that is possible: no node lies behind the
    /// camera, and the target's front is seen.
    #[must_use]
    pub fn project(
        &mut self,
        lens: &LensTable,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
    ) -> bool {
        self.project_drifting(lens, target, cam_from_target, None)
    }

    /// The same of a grid that a [`Drift`] deforms.
    #[must_use]
    pub(crate) fn project_drifting(
        &mut self,
        lens: &LensTable,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
        drift: Option<&Drift>,
    ) -> bool {
        self.nodes.clear();
        (self.columns, self.rows) = (target.columns() + 2, target.rows() + 2);
        // The target's z axis points away from a camera that sees its front.
        if cam_from_target.rotation.column(2).dot(&cam_from_target.translation_mm) <= 0.0 {
            return false;
        }
        for point_mm in points_mm(target) {
            let seen_mm = match drift {
                None => Some(point_mm),
                Some(drift) => drift.displaced_mm(&point_mm, lens, cam_from_target),
            };
            let Some(node) = seen_mm.and_then(|point_target_mm| {
                let ray = ray_of(&cam_from_target.transform(&point_target_mm))?;
                let (raw_px, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
                Some(Node { point_target_mm, ray, raw_px, raw_by_ray })
            }) else {
                self.nodes.clear();
                return false;
            };
            // A target has no more nodes than there is room for.
            let _ = self.nodes.push(node);
        }
        true
    }

    /// Deforms the grid by another drift, at a pose near the expected one. What was measured where
    /// the nodes were expected stays as it is.
    pub(crate) fn deform(
        &mut self,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
        drift: &Drift,
    ) {
        for (node, point_mm) in self.nodes.iter_mut().zip(points_mm(target)) {
            // The row in which the former drift puts the node is near enough: a velocity that is
            // corrected by 20 mm/s changes it by 0.04 rows, and so the node by 0.0001 mm.
            if let Some(moved_px) = node.moved_px(cam_from_target) {
                let rows = node.raw_px.y + moved_px.y - drift.middle_row_px;
                node.point_target_mm =
                    point_mm + drift.of_point_mm(&point_mm, cam_from_target) * rows;
            }
        }
    }

    /// All nodes, row by row.
    #[must_use]
    pub fn as_slice(&self) -> &[Node] {
        &self.nodes
    }

    /// The upper left and the lower right corner of the upright rectangle in the picture that
    /// contains all nodes, raw pixels.
    #[must_use]
    pub(crate) fn extent_px(&self) -> [Vector2<f64>; 2] {
        let (mut low, mut high) =
            (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for node in &self.nodes {
            (low, high) = (low.inf(&node.raw_px), high.sup(&node.raw_px));
        }
        [low, high]
    }

    /// Index of the corner at a node; `None` for the nodes of the ring around the corners.
    #[must_use]
    pub fn corner(&self, node: u8) -> Option<usize> {
        let (row, column) = (usize::from(node) / self.columns, usize::from(node) % self.columns);
        let inner = (1..self.columns - 1).contains(&column) && (1..self.rows - 1).contains(&row);
        inner.then(|| (row - 1) * (self.columns - 2) + column - 1)
    }

    /// Every edge; `first_square_dark`: see [`crate::find::grid::Grid`].
    pub fn edges(&self, first_square_dark: bool) -> impl Iterator<Item = Edge> + '_ {
        let is_empty = self.nodes.is_empty();
        let (columns, rows) = if is_empty { (1, 1) } else { (self.columns, self.rows) };
        let index = move |column: usize, row: usize| (row * columns + column) as u8;
        // Squares have the number of the node at their lower right; beyond them the margin
        // is light. Square (1, 1) is the first one.
        let dark = move |column: usize, row: usize| {
            let is_square = (1..columns).contains(&column) && (1..rows).contains(&row);
            is_square && (column + row).is_multiple_of(2) == first_square_dark
        };
        let along_x = (0..rows).flat_map(move |row| {
            (0..columns - 1).filter_map(move |column| {
                let [above, below] = [row, row + 1].map(|row| dark(column + 1, row));
                (above != below).then(|| Edge {
                    direction: Direction::X,
                    nodes: [index(column, row), index(column + 1, row)],
                    // The right-hand side of an edge that runs to the right is below it.
                    is_right_light: above,
                    is_border: row == 0 || row == rows - 1,
                })
            })
        });
        let along_y = (0..columns).flat_map(move |column| {
            (0..rows - 1).filter_map(move |row| {
                let [left, right] = [column, column + 1].map(|column| dark(column, row + 1));
                (left != right).then(|| Edge {
                    direction: Direction::Y,
                    nodes: [index(column, row), index(column, row + 1)],
                    // The right-hand side of an edge that runs downwards is on its left in the
                    // picture.
                    is_right_light: right,
                    is_border: column == 0 || column == columns - 1,
                })
            })
        });
        along_x.chain(along_y)
    }

    /// The number of squares in a row.
    #[must_use]
    pub fn columns_of_squares(&self) -> usize {
        self.columns.saturating_sub(1)
    }

    /// Every square, row by row; `first_square_dark`: see [`crate::find::grid::Grid`].
    pub fn squares(&self, first_square_dark: bool) -> impl Iterator<Item = Square> + '_ {
        let columns = self.columns.max(1);
        let lower_right = move |node: &usize| *node >= columns && !node.is_multiple_of(columns);
        (0..self.nodes.len()).filter(lower_right).map(move |node| {
            let at = |node: usize| self.nodes[node].raw_px;
            let (left, above, across) = (at(node - 1), at(node - columns), at(node - columns - 1));
            let here = at(node);
            // The shorter distance between opposite sides.
            let [x, y] = [here + above - left - across, here + left - above - across];
            Square {
                node: node as u8,
                middle_px: (here + left + above + across) * 0.25,
                width_px: 0.5 * libm::sqrt(x.norm_squared().min(y.norm_squared())),
                is_dark: (node / columns + node % columns).is_multiple_of(2) == first_square_dark,
            }
        })
    }

    /// The squares on both sides of an edge, given by the nodes at their lower right; a border edge
    /// has only one.
    pub(crate) fn squares_beside(&self, edge: &Edge) -> impl Iterator<Item = u8> {
        let end = usize::from(edge.nodes[1]);
        let (has_first, has_second, second) = match edge.direction {
            Direction::X => {
                let row = end / self.columns;
                (row > 0, row + 1 < self.rows, end + self.columns)
            }
            Direction::Y => {
                let column = end % self.columns;
                (column > 0, column + 1 < self.columns, end + 1)
            }
        };
        let first = has_first.then_some(end as u8);
        first.into_iter().chain(has_second.then_some(second as u8))
    }

    /// The edge in the picture, and the lines next to it.
    #[must_use]
    pub fn chord(&self, edge: &Edge) -> Chord {
        let at = |node: usize| self.nodes[node].raw_px;
        let [start, end] = edge.nodes.map(usize::from);
        let (row, column) = (start / self.columns, start % self.columns);
        // Across the edge, then along it: the step in node indices, the place of the edge's first
        // node, and the number of places.
        let (beside, line, lines, along, place, places) = match edge.direction {
            Direction::X => (self.columns, row, self.rows, 1, column, self.columns),
            Direction::Y => (1, column, self.columns, self.columns, row, self.rows),
        };
        // The lines on both sides; a border has only one.
        let before = if line == 0 { 0 } else { beside };
        let after = if line == lines - 1 { 0 } else { beside };
        let next = at(start + after) + at(end + after) - at(start - before) - at(end - before);
        let across_px = next * (0.5 * beside as f64 / (before + after) as f64);

        let chord_px = at(end) - at(start);
        let right = Vector2::new(-chord_px.y, chord_px.x) / chord_px.norm();
        // An arc's height over its chord is an eighth of its points' second difference.
        let bend_at =
            |node: usize| right.dot(&(at(node) * 2.0 - at(node - along) - at(node + along))) / 8.0;
        // Between two nodes it is their mean; half a step beyond the last node with neighbours on
        // both sides it is extrapolated linearly.
        let bend_px = match (place == 0, place + 2 == places) {
            (true, _) => 1.5 * bend_at(end) - 0.5 * bend_at(end + along),
            (_, true) => 1.5 * bend_at(start) - 0.5 * bend_at(start - along),
            _ => 0.5 * (bend_at(start) + bend_at(end)),
        };
        Chord { start_px: at(start), end_px: at(end), across_px, right, bend_px }
    }

    /// The largest displacement of any node between the expected pose and another, in raw pixels;
    /// `None` when a node lies behind the camera at the other pose.
    #[must_use]
    pub(crate) fn farthest_px(&self, cam_from_target: &Pose<Cam, Target>) -> Option<f64> {
        let mut farthest = 0.0_f64;
        for node in &self.nodes {
            farthest = farthest.max(node.moved_px(cam_from_target)?.norm_squared());
        }
        Some(libm::sqrt(farthest))
    }
}

impl Default for Nodes {
    fn default() -> Self {
        Self::new()
    }
}

/// An edge's straight line in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chord {
    /// Raw pixel of its first node.
    pub start_px: Vector2<f64>,
    /// Raw pixel of its second node.
    pub end_px: Vector2<f64>,
    /// To the next line of the same direction, along the crossing lines.
    pub across_px: Vector2<f64>,
    /// Unit normal, to the right.
    pub right: Vector2<f64>,
    /// How far right of the chord's middle the lens (or a bent print) puts the edge.
    pub bend_px: f64,
}

/// Each node's position on a target, row by row.
pub fn points_mm(target: &TargetGeometry) -> impl Iterator<Item = Vector3<f64>> + '_ {
    let (columns, rows) = (target.columns() + 2, target.rows() + 2);
    (0..rows).flat_map(move |row| (0..columns).map(move |column| point_mm(target, column, row)))
}

/// A node's position on the target. Nodes beyond the corners are extrapolated linearly.
fn point_mm(target: &TargetGeometry, column: usize, row: usize) -> Vector3<f64> {
    let along = |place: usize, count: usize| -> (usize, usize, f64) {
        // The inner place, its inner neighbour, and how much of their difference to add.
        match place {
            0 => (0, 1, 1.0),
            _ if place == count + 1 => (count - 1, count - 2, 1.0),
            _ => (place - 1, place - 1, 0.0),
        }
    };
    let (columns, rows) = (target.columns(), target.rows());
    let (column, next_column, beyond_x) = along(column, columns);
    let (row, next_row, beyond_y) = along(row, rows);
    let at = |column: usize, row: usize| target.corner_mm(row * columns + column);
    let here = at(column, row);
    here + (here - at(next_column, row)) * beyond_x + (here - at(column, next_row)) * beyond_y
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::model::target::{Origin, Role};
    use crate::test_support::{bedside_lens, table};

    mod grid;

    fn target() -> TargetGeometry {
        TargetGeometry::checker(3, 4, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap()
    }

    fn projected(pose: &Pose<Cam, Target>) -> Nodes {
        let mut nodes = Nodes::new();
        assert!(nodes.project(&table(&bedside_lens()), &target(), pose));
        nodes
    }

    fn pose() -> Pose<Cam, Target> {
        Pose::from_theta([0.02, -0.2, 0.1, 40.0, -30.0, 900.0])
    }

    #[test]
    fn nodes_are_the_corners_and_a_ring_around_them() {
        let nodes = projected(&pose());
        assert_eq!(nodes.as_slice().len(), 5 * 6);
        let point = |node: usize| nodes.as_slice()[node].point_target_mm;
        // Corner 0 is at (-12, -18); the ring lies one pitch further out.
        assert_eq!(point(0), Vector3::new(-24.0, -30.0, 0.0));
        assert_eq!(point(5 + 1), target().corner_mm(0));
        assert_eq!(point(29), Vector3::new(24.0, 30.0, 0.0));
        let corners: Vec<_> = (0..30).filter_map(|node| nodes.corner(node)).collect();
        assert_eq!(corners, (0..12).collect::<Vec<_>>());
    }

    #[test]
    fn the_extent_touches_the_outermost_nodes() {
        let nodes = projected(&pose());
        let [low, high] = nodes.extent_px();
        for axis in 0..2 {
            let mut along: Vec<_> = nodes.as_slice().iter().map(|node| node.raw_px[axis]).collect();
            along.sort_by(f64::total_cmp);
            assert_eq!([along[0], along[29]], [low[axis], high[axis]]);
        }
    }

    #[test]
    fn every_edge_is_there_once_and_has_its_light_side() {
        let nodes = projected(&pose());
        let edges: Vec<_> = nodes.edges(true).collect();
        // Rows and columns inside, and the dark half of the 18 sides of squares on the border.
        assert_eq!(edges.len(), 4 * 4 + 3 * 5 + 9);
        for edge in &edges {
            let [start, end] = edge.nodes.map(|node| nodes.as_slice()[usize::from(node)]);
            let along = (end.point_target_mm - start.point_target_mm) / 12.0;
            // A step to the right in the picture is a quarter turn from x to y.
            let right = Vector3::new(-along.y, along.x, 0.0);
            let middle = (start.point_target_mm + end.point_target_mm) / 2.0 + right * 6.0;
            // Squares counted from the one up and left of corner 0, which is dark.
            let square = (middle + Vector3::new(18.0, 24.0, 0.0)) / 12.0;
            let is_light = (square.x.round() + square.y.round()) as i32 % 2 != 0;
            assert_eq!(edge.is_right_light, is_light, "{edge:?}");
        }
    }

    #[test]
    fn a_chord_knows_the_distance_to_the_next_line() {
        let nodes = projected(&pose());
        for edge in nodes.edges(true) {
            let chord = nodes.chord(&edge);
            let along = chord.end_px - chord.start_px;
            // 12 mm at 0.9 m and f 1740 px is 23.2 px, less where it is tilted; the next
            // line lies to the right of an edge along x and to the left of one along y.
            let area = along.x * chord.across_px.y - along.y * chord.across_px.x;
            let across = area / along.norm();
            let (low, high) =
                if edge.direction == Direction::X { (21.0, 24.0) } else { (-24.0, -21.0) };
            assert!(across > low && across < high, "{across}");
        }
    }

    #[test]
    fn a_target_seen_from_behind_or_behind_the_camera_has_no_nodes() {
        let (lens, target) = (table(&bedside_lens()), target());
        let mut nodes = Nodes::new();
        let turned = Pose::from_theta([0.0, core::f64::consts::PI, 0.0, 0.0, 0.0, 900.0]);
        assert!(!nodes.project(&lens, &target, &turned));
        let behind = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, -900.0]);
        assert!(!nodes.project(&lens, &target, &behind));
        let through = Pose::from_theta([0.0, 1.5, 0.0, 0.0, 0.0, 15.0]);
        assert!(!nodes.project(&lens, &target, &through));
        assert_eq!(nodes.edges(true).count(), 0);
        assert!(nodes.project(&lens, &target, &pose()));
    }

    #[test]
    fn a_small_move_is_seen_to_first_order() {
        let nodes = projected(&pose());
        let moved = Pose::from_theta([0.021, -0.2, 0.1, 40.3, -30.0, 900.5]);
        let lens = bedside_lens();
        let mut farthest = 0.0_f64;
        for node in nodes.as_slice() {
            let exact =
                lens.project(&moved.transform(&node.point_target_mm)).unwrap() - node.raw_px;
            // A millionth of the focal length per px of displacement.
            assert!((node.moved_px(&moved).unwrap() - exact).norm() < 2e-5);
            farthest = farthest.max(exact.norm());
        }
        assert!((nodes.farthest_px(&moved).unwrap() - farthest).abs() < 2e-5);
    }

    /// The pose, this long after the target's middle was seen.
    fn moved(pose: &Pose<Cam, Target>, per_s: &Vector6<f64>, time_s: f64) -> Pose<Cam, Target> {
        pose.moved_by(&(per_s * time_s))
    }

    /// The row in which a target's middle is seen.
    fn middle_row_px(lens: &LensTable, pose: &Pose<Cam, Target>) -> f64 {
        lens.project(&pose.transform(&target().middle_mm())).unwrap().y
    }

    #[test]
    fn a_moving_target_is_drawn_as_its_rows_are_read() {
        // 16 ms for 1088 rows, read from the top and from the bottom.
        for row_s in [16e-3 / 1088.0, -16e-3 / 1088.0] {
            for per_s in [
                [0.0, 0.0, 0.0, 200.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, 200.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, 0.0, -200.0],
                [0.0, 0.0, 0.8, 100.0, -150.0, 80.0],
                [0.6, -0.7, 0.3, -120.0, 90.0, 60.0],
            ] {
                let per_s = Vector6::from(per_s);
                let lens = table(&bedside_lens());
                let middle_row_px = middle_row_px(&lens, &pose());
                let drift = Drift { per_row: per_s * row_s, middle_row_px };
                let mut nodes = Nodes::new();
                assert!(nodes.project_drifting(&lens, &target(), &pose(), Some(&drift)));
                let (mut off_px, mut deformed_px) = (0.0_f64, 0.0_f64);
                for (node, point_mm) in nodes.as_slice().iter().zip(points_mm(&target())) {
                    // The instant at which the point is in the row that is being read, by bisection.
                    let seen_at = |time_s: f64| {
                        lens.project(&moved(&pose(), &per_s, time_s).transform(&point_mm)).unwrap()
                    };
                    let (mut early_s, mut late_s) = (-0.01, 0.01);
                    for _ in 0..60 {
                        let time_s = 0.5 * (early_s + late_s);
                        let read_s = (seen_at(time_s).y - middle_row_px) * row_s;
                        *(if read_s > time_s { &mut early_s } else { &mut late_s }) = time_s;
                    }
                    off_px = off_px.max((node.raw_px - seen_at(early_s)).norm());
                    deformed_px = deformed_px.max((node.raw_px - seen_at(0.0)).norm());
                }
                // What is left is the second order of the turn and of the perspective.
                assert!(off_px < 1e-4 && deformed_px > 0.03, "{per_s}: {off_px}, {deformed_px}");
            }
        }
    }

    #[test]
    fn another_drift_deforms_the_grid_where_it_stands() {
        let lens = table(&bedside_lens());
        let row_s = 16e-3 / 1088.0;
        let drift_at = |pose: &Pose<Cam, Target>, per_s: [f64; 6]| Drift {
            per_row: Vector6::from(per_s) * row_s,
            middle_row_px: middle_row_px(&lens, pose),
        };
        let solved = Pose::from_theta([0.021, -0.2, 0.1, 40.1, -30.05, 900.5]);
        let late = drift_at(&pose(), [0.0, 0.0, 0.2, 150.0, 180.0, -30.0]);
        let now = drift_at(&solved, [0.1, 0.0, 0.3, 170.0, 200.0, -50.0]);
        let (mut deformed, mut drawn) = (Nodes::new(), Nodes::new());
        assert!(deformed.project_drifting(&lens, &target(), &pose(), Some(&late)));
        assert!(drawn.project_drifting(&lens, &target(), &solved, Some(&now)));
        deformed.deform(&target(), &solved, &now);
        for (deformed, drawn) in deformed.as_slice().iter().zip(drawn.as_slice()) {
            let off_mm = (deformed.point_target_mm - drawn.point_target_mm).norm();
            // The correction of 20 mm/s moves a node by 0.04 rows, of 0.003 mm each.
            assert!(off_mm < 2e-4, "{off_mm}");
            let place_px = deformed.raw_px + deformed.moved_px(&solved).unwrap();
            assert!((place_px - drawn.raw_px).norm() < 5e-4);
        }
    }
}
