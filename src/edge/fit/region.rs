//! Which pixels speak about an edge.
//!
//! Each pixel of the target speaks about the edge that is nearest to it. Of an edge
//! between two nodes these pixels fill a diamond whose long diagonal is the edge:
//!
//! ```text
//!     ·────────·         no farther from the edge than from the crossing lines,
//!     │╲ ┌──┐ ╱│         no farther out than where the squares are flat anyway,
//!     │ ╱    ╲ │         and clear of the nodes, where the crossing line's blur
//!   ──┼┤══════├┼──       bends the profile
//!     │ ╲    ╱ │
//!     │╱ └──┘ ╲│
//!     ·────────·
//! ```

use core::ops::{Range, RangeInclusive};

use nalgebra::Vector2;

use crate::nodes::Chord;

/// Pixels nearer than this to a crossing line, in s, are not used: there it still
/// bends the profile by 0.8 % of the contrast, oddly, so that the edge does not move.
pub(super) const CLEAR_OF_NODES: f64 = 2.65;

/// Farthest pixels from the edge, in s and px, within which there is all that moves and
/// enough flat to know light and dark by.
pub(super) const WIDTH_IN_BLURS: f64 = 3.5;
pub(super) const WIDTH_PX: f64 = 0.7;

/// Half of an edge's length that is looked at, at most: the work is bounded, however
/// near the target is.
pub(super) const HALF_LENGTH_PX_MAX: f64 = 32.0;

/// The pixels of one edge, as a convex polygon about its middle.
pub(super) struct Region {
    /// Whole pixel at the middle.
    pub(super) origin: [usize; 2],
    /// From there to the exact middle.
    pub(super) middle: [f32; 2],
    pub(super) along: [f32; 2],
    pub(super) per_length: f32,
    pub(super) per_blur: f32,
    /// The lens's bend in the middle of the edge, to its right, px.
    pub(super) bend_px: f32,
    /// Rows of the polygon, above and below the origin.
    reach_rows: f32,
    sides: [HalfPlane; 8],
}

/// `normal . (pixel - middle) <= distance`, solved for x.
#[derive(Clone, Copy)]
struct HalfPlane {
    /// x <= (or >=) at + by_y y.
    at: f32,
    by_y: f32,
    bounds_above: bool,
}

impl HalfPlane {
    fn new(normal: Vector2<f64>, distance: f64) -> Self {
        // A side along the rows bounds x nowhere, or so far out that another does.
        const FLATTEST: f64 = 1e-6;
        let x =
            if normal.x.abs() < FLATTEST { libm::copysign(FLATTEST, normal.x) } else { normal.x };
        Self { at: (distance / x) as f32, by_y: (-normal.y / x) as f32, bounds_above: x > 0.0 }
    }
}

impl Region {
    /// `None` where the blur leaves nothing of the edge, or it is outside every frame.
    pub(super) fn new(chord: &Chord, blur_px: f64) -> Option<Self> {
        let chord_px = chord.end_px - chord.start_px;
        let length_px = chord_px.norm();
        let along = chord_px / length_px;
        let right = chord.right;
        let middle_px = (chord.start_px + chord.end_px) * 0.5;
        let across = chord.across_px / chord.across_px.norm();
        let spacing_px = chord.across_px.dot(&right).abs();
        // Distances from the crossing lines shrink by the sine of the angle to them.
        let sine = across.dot(&right);
        let (across, sine) = if sine < 0.0 { (-across, -sine) } else { (across, sine) };
        // The crossing lines' normal, along the edge.
        let crossing = Vector2::new(across.y, -across.x);
        let half_length_px = 0.5 * length_px;
        let used_px = (half_length_px - CLEAR_OF_NODES * blur_px / sine).min(HALF_LENGTH_PX_MAX);
        let width_px = (WIDTH_IN_BLURS * blur_px + WIDTH_PX).min(0.5 * spacing_px);
        // Written so that a NaN is refused, which `min` passes over.
        let is_usable = used_px > 0.7 && width_px > 1.0 && sine > 0.0 && blur_px.is_finite();
        let is_near = middle_px.iter().all(|value| (0.0..65_536.0).contains(value));
        if !is_usable || !is_near {
            return None;
        }
        // Neither near a crossing line, nor far from this one, nor nearer to a crossing one.
        let (clear_px, diagonal_px) = (sine * used_px, sine * half_length_px);
        let sides = [
            HalfPlane::new(crossing, clear_px),
            HalfPlane::new(-crossing, clear_px),
            HalfPlane::new(right, width_px),
            HalfPlane::new(-right, width_px),
            HalfPlane::new(right + crossing, diagonal_px),
            HalfPlane::new(right - crossing, diagonal_px),
            HalfPlane::new(-right + crossing, diagonal_px),
            HalfPlane::new(-right - crossing, diagonal_px),
        ];
        let origin = [middle_px.x as usize, middle_px.y as usize];
        let reach_rows = used_px * along.y.abs() + width_px / sine * across.y.abs();
        Some(Self {
            origin,
            middle: [
                (middle_px.x - origin[0] as f64) as f32,
                (middle_px.y - origin[1] as f64) as f32,
            ],
            along: [along.x as f32, along.y as f32],
            per_length: (1.0 / length_px) as f32,
            per_blur: (1.0 / blur_px) as f32,
            bend_px: chord.bend_px as f32,
            reach_rows: reach_rows as f32,
            sides,
        })
    }

    /// The rows inside a frame, from the origin.
    pub(super) fn rows(&self, height: usize) -> RangeInclusive<i32> {
        let [_, origin] = self.origin.map(|place| place as i32);
        let [_, y] = self.middle;
        let first = libm::ceilf(y - self.reach_rows) as i32;
        let last = libm::floorf(y + self.reach_rows) as i32;
        first.max(-origin)..=last.min(height as i32 - 1 - origin)
    }

    /// The columns of row `y` (from the middle) inside a frame.
    #[inline]
    pub(super) fn columns(&self, y: f32, width: usize) -> Range<i32> {
        let (mut low, mut high) = (-1e4_f32, 1e4_f32);
        for side in &self.sides {
            let x = side.at + side.by_y * y;
            if side.bounds_above {
                high = if x < high { x } else { high };
            } else {
                low = if x > low { x } else { low };
            }
        }
        let [origin, _] = self.origin.map(|place| place as i32);
        let [x, _] = self.middle;
        let start = origin + libm::ceilf(low + x) as i32;
        let end = origin + libm::floorf(high + x) as i32 + 1;
        start.max(0)..end.min(width as i32)
    }
}
