//! What the pixels of an edge have shown, and how that depends on the pose.

use core::array;

use heapless::Vec;
use nalgebra::{Vector2, Vector3};

use crate::fit::nodes::{Edge, Node, Nodes};
use crate::fit::solve::{Observations, by_motion};
use crate::limits::TARGET_NODES_MAX;
use crate::model::lens::ray_of;
use crate::model::pose::{Cam, Pose, Target};

/// Light minus dark below which there is no edge, as a part of the white level: 6 of
/// 255 grey levels.
pub(super) const CONTRAST_MIN: f32 = 0.025;

/// One end of an edge, and how its distance from the expected line depends on the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
struct End {
    /// d distance / d ray: raw pixels to the right of the line.
    distance_by_ray: Vector2<f64>,
    /// `distance_by_ray` times the expected ray.
    expected: f64,
}

impl End {
    fn new(node: &Node, right: &Vector2<f64>) -> Self {
        let distance_by_ray = node.raw_by_ray.tr_mul(right);
        Self { distance_by_ray, expected: distance_by_ray.dot(&node.ray) }
    }

    #[inline]
    fn distance_px(&self, ray: &Vector2<f64>) -> f64 {
        self.distance_by_ray.dot(ray) - self.expected
    }
}

/// An edge that was seen: its distance from the expected line, to the right of it in the picture,
/// and its turn, with their precision.
///
/// The residual is `whitener * [mean of the ends' distances, their difference] - seen`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenEdge {
    /// Which edge.
    pub edge: Edge,
    ends: [End; 2],
    /// Upper triangle: 00, 01, 11; standard deviations per raw pixel.
    pub(super) whitener: [f64; 3],
    seen: [f64; 2],
}

impl SeenEdge {
    /// From a measured shift (in the middle) and turn (end minus start), raw pixels, of
    /// the given precision; `right` is the unit normal of the expected line.
    pub(super) fn new(
        edge: Edge,
        nodes: [&Node; 2],
        right: &Vector2<f64>,
        whitener: [f64; 3],
        seen: [f64; 2],
    ) -> Self {
        Self { edge, ends: nodes.map(|node| End::new(node, right)), whitener, seen }
    }

    /// Makes the standard deviations `factor` times as large.
    pub fn scale_uncertainty(&mut self, factor: f64) {
        let per = 1.0 / factor;
        self.whitener = self.whitener.map(|value| value * per);
        self.seen = self.seen.map(|value| value * per);
    }

    /// Attributes this much of the shift to dark squares that look larger than they are.
    pub(crate) fn take_out_growth(&mut self, growth_px: f64) {
        let shift_px = if self.edge.is_right_light { growth_px } else { -growth_px };
        self.seen[0] -= self.whitener[0] * shift_px;
    }

    /// How far to the right of the expected line's middle the edge is seen, and the standard
    /// deviation of that, raw pixels.
    #[must_use]
    pub fn shift_px(&self) -> (f64, f64) {
        let [shift_by_shift, shift_by_turn, turn_by_turn] = self.whitener;
        let turn_px = self.seen[1] / turn_by_turn;
        let shift_px = (self.seen[0] - shift_by_turn * turn_px) / shift_by_shift;
        (shift_px, libm::hypot(1.0, shift_by_turn / turn_by_turn) / shift_by_shift)
    }

    /// How far to the right of where the edge is seen the pose of a residual puts it.
    #[must_use]
    pub(crate) fn distance_px(&self, residual: &[f64; 2]) -> f64 {
        residual[0] / self.whitener[0]
    }

    /// How much farther the dark side reaches than at the pose of a residual, and the precision of
    /// that.
    #[must_use]
    pub(crate) fn growth_px(&self, residual: &[f64; 2]) -> (f64, f64) {
        let [precision, ..] = self.whitener;
        let shift_px = -self.distance_px(residual);
        let growth_px = if self.edge.is_right_light { shift_px } else { -shift_px };
        (growth_px, precision * precision)
    }

    fn is_finite(&self) -> bool {
        let ends: f64 = self.ends.iter().map(|end| end.distance_by_ray.sum() + end.expected).sum();
        let [shift, _, turn] = self.whitener;
        let sum = ends + self.seen.iter().sum::<f64>() + self.whitener.iter().sum::<f64>();
        sum.is_finite() && shift > 0.0 && turn > 0.0
    }

    #[inline]
    pub(super) fn residual(&self, rays: [&Vector2<f64>; 2]) -> [f64; 2] {
        let start = self.ends[0].distance_px(rays[0]);
        let end = self.ends[1].distance_px(rays[1]);
        let [shift_by_shift, shift_by_turn, turn_by_turn] = self.whitener;
        let (shift, turn) = (0.5 * (start + end), end - start);
        let first = shift_by_shift * shift + shift_by_turn * turn;
        [first - self.seen[0], turn_by_turn * turn - self.seen[1]]
    }

    /// The residual's gradients, as [`by_motion`] gives them.
    #[inline]
    fn rows(&self, sights: [&Sight; 2]) -> [[f64; 6]; 2] {
        let [start, end] = [0, 1].map(|end| {
            let by_point = sights[end].by_point(&self.ends[end].distance_by_ray);
            by_motion(&by_point, &sights[end].arm_cam_mm)
        });
        let [shift_by_shift, shift_by_turn, turn_by_turn] = self.whitener;
        let by_start = 0.5 * shift_by_shift - shift_by_turn;
        let by_end = 0.5 * shift_by_shift + shift_by_turn;
        [
            array::from_fn(|axis| by_start * start[axis] + by_end * end[axis]),
            array::from_fn(|axis| turn_by_turn * (end[axis] - start[axis])),
        ]
    }
}

/// The edges seen of one target, and the nodes between which they run.
///
/// Nodes are shared: the ray of each is computed once, not once per edge.
#[derive(Clone, Copy)]
pub struct SeenEdges<'a> {
    nodes: &'a Nodes,
    edges: &'a [SeenEdge],
    /// One edge in this many is used.
    stride: usize,
}

/// Where a node is seen at a pose.
struct Sight {
    ray: Vector2<f64>,
    per_depth: f64,
    /// From the target's origin.
    arm_cam_mm: Vector3<f64>,
}

impl Sight {
    /// The gradient, with respect to the point in the camera frame, of a distance whose gradient
    /// with respect to the ray is known.
    #[inline]
    fn by_point(&self, by_ray: &Vector2<f64>) -> Vector3<f64> {
        Vector3::new(by_ray.x, by_ray.y, -by_ray.dot(&self.ray)) * self.per_depth
    }
}

impl<'a> SeenEdges<'a> {
    /// All of these edges; the nodes are where they were expected.
    #[must_use]
    pub fn new(nodes: &'a Nodes, edges: &'a [SeenEdge]) -> Self {
        Self { nodes, edges, stride: 1 }
    }

    /// One edge in this many of them, from all over the target.
    #[must_use]
    pub(crate) fn one_in(self, stride: usize) -> Self {
        Self { stride, ..self }
    }

    fn used(&self) -> impl Iterator<Item = &SeenEdge> {
        self.edges.iter().step_by(self.stride)
    }

    /// Visits the sight of each node in order; `None` when one lies behind the camera.
    #[inline]
    fn each_sight(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        mut visit: impl FnMut(Sight),
    ) -> Option<()> {
        for node in self.nodes.as_slice() {
            let arm_cam_mm = cam_from_target.rotation * node.point_target_mm;
            let point_cam_mm = arm_cam_mm + cam_from_target.translation_mm;
            let ray = ray_of(&point_cam_mm)?;
            visit(Sight { ray, per_depth: 1.0 / point_cam_mm.z, arm_cam_mm });
        }
        Some(())
    }
}

impl Observations for SeenEdges<'_> {
    fn count(&self) -> usize {
        self.edges.len().div_ceil(self.stride)
    }

    fn are_finite(&self) -> bool {
        let points = self.nodes.as_slice().iter().map(|node| node.point_target_mm.sum());
        points.sum::<f64>().is_finite() && self.used().all(SeenEdge::is_finite)
    }

    fn residuals(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        mut visit: impl FnMut(usize, [f64; 2]),
    ) -> Option<()> {
        let mut rays = Vec::<_, TARGET_NODES_MAX>::new();
        // There are no more than there is room for.
        self.each_sight(cam_from_target, |sight| rays.extend([sight.ray]))?;
        for (place, seen) in self.used().enumerate() {
            visit(place, seen.residual(seen.edge.nodes.map(|node| &rays[usize::from(node)])));
        }
        Some(())
    }

    fn residuals_with_jacobian(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        mut visit: impl FnMut(usize, &[f64; 2], &[[f64; 6]; 2]),
    ) -> Option<()> {
        let mut sights = Vec::<_, TARGET_NODES_MAX>::new();
        self.each_sight(cam_from_target, |sight| sights.extend([sight]))?;
        for (place, seen) in self.used().enumerate() {
            let ends = seen.edge.nodes.map(|node| &sights[usize::from(node)]);
            visit(place, &seen.residual(ends.map(|sight| &sight.ray)), &seen.rows(ends));
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector6};

    use super::*;
    use crate::fit::edge::rendered::Scene;
    use crate::fit::nodes::{Direction, Drift};

    /// A node whose raw pixel moves by 8 px for each unit of its ray's x, and by 4 px for its y.
    fn node(x: f64) -> Node {
        Node {
            point_target_mm: Vector3::new(x, 0.0, 0.0),
            ray: Vector2::new(x, 0.0),
            raw_px: Vector2::new(8.0 * x, 0.0),
            raw_by_ray: Matrix2::new(8.0, 0.0, 0.0, 4.0),
        }
    }

    /// An edge that was expected on the ray's x axis and is seen 1 px to the right of it, which is
    /// down, turned by half a pixel.
    fn seen(is_right_light: bool) -> SeenEdge {
        let edge =
            Edge { direction: Direction::X, nodes: [0, 1], is_right_light, is_border: false };
        let right = Vector2::new(0.0, 1.0);
        // 4 x 1 + 3 x 0.5, and 4 x 0.5.
        SeenEdge::new(edge, [&node(0.0), &node(1.0)], &right, [4.0, 3.0, 4.0], [5.5, 2.0])
    }

    /// The residual where the start is 1 px right of the expected line and the end 3 px: a shift of
    /// 2 px and a turn of 2 px.
    fn residual(seen: &SeenEdge) -> [f64; 2] {
        seen.residual([&Vector2::new(0.0, 0.25), &Vector2::new(1.0, 0.75)])
    }

    #[test]
    fn the_residual_is_what_the_whitener_makes_of_shift_and_turn() {
        // 4 x 2 + 3 x 2 - 5.5, and 4 x 2 - 2.
        assert_eq!(residual(&seen(true)), [8.5, 6.0]);
        // Where it is seen, there is none.
        let there = [&Vector2::new(0.0, 0.75 / 4.0), &Vector2::new(1.0, 1.25 / 4.0)];
        assert_eq!(seen(true).residual(there), [0.0; 2]);
    }

    #[test]
    fn the_shift_has_the_variance_of_the_inverse_normal_matrix() {
        // The inverse of [4 3; 0 4] has the first row [1/4, -3/16], whose length is 5/16.
        assert_eq!(seen(true).shift_px(), (1.0, 5.0 / 16.0));
    }

    #[test]
    fn a_less_certain_edge_is_seen_at_the_same_place() {
        let mut seen = seen(true);
        seen.scale_uncertainty(2.0);
        assert_eq!(seen.shift_px(), (1.0, 5.0 / 8.0));
        assert_eq!(residual(&seen), [8.5 / 2.0, 6.0 / 2.0]);
    }

    #[test]
    fn growth_reaches_to_the_light_side() {
        for (is_right_light, shift_px) in [(true, 0.75), (false, 1.25)] {
            let mut seen = seen(is_right_light);
            // A residual of -1 is an edge a quarter of a pixel farther right than the pose has it; the
            // dark side is on the left where the right one is light.
            let growth_px = if is_right_light { 0.25 } else { -0.25 };
            assert_eq!(seen.distance_px(&[-1.0, 0.0]), -0.25);
            assert_eq!(seen.growth_px(&[-1.0, 0.0]), (growth_px, 16.0));
            seen.take_out_growth(0.25);
            assert_eq!(seen.shift_px(), (shift_px, 5.0 / 16.0));
        }
    }

    #[test]
    fn an_edge_with_any_number_that_is_not_finite_is_not_finite() {
        assert!(seen(true).is_finite());
        for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for place in 0..2 {
                let mut edge = seen(true);
                edge.seen[place] = odd;
                assert!(!edge.is_finite(), "seen {place}");
                let mut edge = seen(true);
                edge.ends[place].expected = odd;
                assert!(!edge.is_finite(), "expected {place}");
                let mut edge = seen(true);
                edge.ends[1].distance_by_ray[place] = odd;
                assert!(!edge.is_finite(), "by ray {place}");
            }
            for place in 0..3 {
                let mut edge = seen(true);
                edge.whitener[place] = odd;
                assert!(!edge.is_finite(), "whitener {place}");
            }
        }
        // A standard deviation is neither infinite nor negative.
        for place in [0, 2] {
            for odd in [0.0, -4.0] {
                let mut edge = seen(true);
                edge.whitener[place] = odd;
                assert!(!edge.is_finite(), "whitener {place}");
            }
        }
        let mut edge = seen(true);
        edge.whitener[1] = -3.0;
        assert!(edge.is_finite());
    }

    #[test]
    fn edges_are_finite_when_their_nodes_and_those_that_are_used_are() {
        let scene = Scene::new(21.0, 0.1, 0.1);
        let mut nodes = scene.nodes(&scene.cam_from_target);
        let mut odd = seen(true);
        odd.seen[0] = f64::NAN;
        assert!(SeenEdges::new(&nodes, &[seen(true); 4]).are_finite());
        let edges = [seen(true), odd, seen(true), seen(true)];
        assert!(!SeenEdges::new(&nodes, &edges).are_finite());
        assert!(SeenEdges::new(&nodes, &edges).one_in(2).are_finite());
        let drift = Drift { per_row: Vector6::repeat(f64::NAN), middle_row_px: 0.0 };
        nodes.deform(&scene.target, &scene.cam_from_target, &drift);
        assert!(!SeenEdges::new(&nodes, &[seen(true); 4]).are_finite());
    }
}
