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
