//! Which pixels belong to an edge.
//!
//! Each pixel of the target belongs to the edge that is nearest to it. The pixels of an edge
//! between two nodes fill a diamond whose long diagonal is the edge:
//!
//! ```text
//!     ·────────·         no farther from the edge than from the crossing lines,
//!     │╲ ┌──┐ ╱│         no farther out than where the squares are flat anyway,
//!     │ ╱    ╲ │         and clear of the nodes, where the crossing line's blur
//!   ──┼┤══════├┼──       mixes the colours
//!     │ ╲    ╱ │
//!     │╱ └──┘ ╲│
//!     ·────────·
//! ```

use core::array;
use core::ops::Range;

use nalgebra::Vector2;

use super::crossing::{CrossingLines, Crossings, EdgeEnd};
use super::lanes::{LANES, Lanes};
use crate::fit::nodes::Chord;

/// Pixels nearer than this to a line that crosses at a corner, in blurs of that line, are not used:
/// its effect on the profile is modelled only up to there, see [`super::crossing`].
const CLEAR_OF_CORNERS: f64 = 1.5;

/// The same at the target's border. A target that is not quite where it is expected has its border
/// elsewhere too, which would change the dark level there.
const CLEAR_OF_BORDER: f64 = 2.0;

/// The same where it is unknown what lies beyond the line, and nothing is modelled: at this distance
/// a line still changes the profile by 0.8 % of the contrast.
pub(super) const CLEAR_OF_UNKNOWN: f64 = 2.65;

/// Largest distance of pixels from the edge, a multiple of s plus an allowance in px.
pub(super) struct Width {
    in_blurs: f64,
    px: f64,
}

impl Width {
    /// Where light and dark are known beforehand: what lies farther out says nothing about the
    /// edge's place.
    pub(super) const KNOWN_LEVELS: Self = Self { in_blurs: 2.4, px: 0.4 };
    /// Where they are not: enough of the flat squares to determine them.
    pub(super) const UNKNOWN_LEVELS: Self = Self { in_blurs: 3.5, px: 0.7 };

    pub(super) fn at_px(&self, blur_px: f64) -> f64 {
        self.in_blurs * blur_px + self.px
    }
}

/// Largest half length of an edge that is used: the work is bounded, however near the target is.
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
    strips: [Strip; 4],
    pub(super) crossings: Crossings,
}

/// The strip between two parallel sides, `low <= normal . (pixel - middle) <= high`, solved for x.
#[derive(Clone, Copy)]
struct Strip {
    /// low + by_y y <= x <= high + by_y y.
    low: f32,
    high: f32,
    by_y: f32,
}

impl Strip {
    fn new(normal: Vector2<f64>, [low, high]: [f64; 2]) -> Self {
        // A side along the rows does not bound x, or only so far out that another side does.
        const FLATTEST: f64 = 1e-6;
        let x =
            if normal.x.abs() < FLATTEST { libm::copysign(FLATTEST, normal.x) } else { normal.x };
        let per_x = 1.0 / x;
        let (low, high) = if x > 0.0 { (low, high) } else { (high, low) };
        let [low, high, by_y] = [low, high, -normal.y].map(|value| (value * per_x) as f32);
        Self { low, high, by_y }
    }
}

impl Region {
    /// `None` where the blur leaves nothing of the edge, or it is outside every frame.
    /// `crossing_blur_px` is the blur of the lines at its ends; `sign` is 1 where the right side is
    /// light, otherwise -1.
    pub(super) fn new(
        chord: &Chord,
        [blur_px, crossing_blur_px]: [f64; 2],
        ends: [EdgeEnd; 2],
        sign: f64,
        width: &Width,
    ) -> Option<Self> {
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
        let [used_start_px, used_end_px] = ends.map(|end| {
            let clear = match end {
                EdgeEnd::Corner => CLEAR_OF_CORNERS,
                EdgeEnd::Border => CLEAR_OF_BORDER,
                EdgeEnd::Unknown => CLEAR_OF_UNKNOWN,
            };
            (half_length_px - clear * crossing_blur_px / sine).min(HALF_LENGTH_PX_MAX)
        });
        let width_px = width.at_px(blur_px).min(0.5 * spacing_px);
        // Written so that a NaN is rejected, which `min` ignores.
        let is_usable = used_start_px > 0.7
            && used_end_px > 0.7
            && width_px > 1.0
            && sine > 0.0
            && blur_px.is_finite();
        let is_near = middle_px.iter().all(|value| (0.0..65_536.0).contains(value));
        if !is_usable || !is_near {
            return None;
        }
        // Not near a crossing line, not far from this one, and not nearer to a crossing line than
        // to this one.
        let diagonal_px = sine * half_length_px;
        let within = |distance_px: f64| [-distance_px, distance_px];
        let strips = [
            Strip::new(crossing, [-sine * used_start_px, sine * used_end_px]),
            Strip::new(right, within(width_px)),
            Strip::new(right + crossing, within(diagonal_px)),
            Strip::new(right - crossing, within(diagonal_px)),
        ];
        let origin = [middle_px.x as usize, middle_px.y as usize];
        let reach_rows =
            used_start_px.max(used_end_px) * along.y.abs() + width_px / sine * across.y.abs();
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
            strips,
            crossings: Crossings::new(&CrossingLines {
                blur_px: crossing_blur_px,
                distance_px: diagonal_px,
                cosine: right.dot(&crossing),
                across_px: blur_px,
                along_px: sine * length_px,
                ends,
                sign,
            }),
        })
    }

    /// Calls `pixels` for each row of the region inside a frame, with the row counted from the
    /// origin and its columns in the frame.
    #[inline]
    pub(super) fn each_row(
        &self,
        [width, height]: [usize; 2],
        mut pixels: impl FnMut(i32, Range<usize>),
    ) {
        let [origin_x, origin_y] = self.origin.map(|place| place as i32);
        let [_, middle_y] = self.middle;
        let first = (floor(middle_y - self.reach_rows) + 1).max(-origin_y);
        let last = floor(middle_y + self.reach_rows).min(height as i32 - 1 - origin_y);
        for four in (first..=last).step_by(LANES) {
            let y = array::from_fn(|lane| (four + lane as i32) as f32 - middle_y);
            let (starts, ends) = self.columns(&y);
            for (row, (start, end)) in (four..=last).zip(starts.into_iter().zip(ends)) {
                let (start, end) = ((origin_x + start).max(0), (origin_x + end).min(width as i32));
                if start < end {
                    pixels(row, start as usize..end as usize);
                }
            }
        }
    }

    /// The first columns, and those after the last, of rows at `y` from the middle; columns are
    /// counted from the origin. Rows are handled together because that costs no more than a single
    /// one.
    #[inline]
    fn columns(&self, y: &Lanes) -> ([i32; LANES], [i32; LANES]) {
        let (mut low, mut high) = ([f32::NEG_INFINITY; LANES], [f32::INFINITY; LANES]);
        for strip in &self.strips {
            for lane in 0..LANES {
                let x = strip.by_y * y[lane];
                let (from, to) = (x + strip.low, x + strip.high);
                low[lane] = if from > low[lane] { from } else { low[lane] };
                high[lane] = if to < high[lane] { to } else { high[lane] };
            }
        }
        let [x, _] = self.middle;
        (low.map(|low| -floor(-(low + x))), high.map(|high| floor(high + x) + 1))
    }
}

/// The floor of a position in a region, to a ten-thousandth: a sum with a number that takes all 24
/// bits has no room for a fraction. A conversion would cost three times as much.
#[inline(always)]
fn floor(value: f32) -> i32 {
    const FAR: f32 = 1024.0;
    const WHOLE: f32 = 12_582_912.0;
    let value = if value < FAR { value } else { FAR };
    let value = if value > -FAR { value } else { -FAR };
    (value - 0.4999 + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_parts_are_those_of_the_library() {
        for step in -60_000_i32..=60_000 {
            // Never within a ten thousandth below a whole number.
            let value = (step as f32) * 0.01 + 0.003;
            assert_eq!(floor(value), libm::floorf(value) as i32, "{value}");
        }
        for step in -1000_i32..=1000 {
            assert_eq!(floor(step as f32 * 0.25), step.div_euclid(4), "{step}");
        }
        assert_eq!([floor(f32::INFINITY), floor(-4e7)], [1024, -1024]);
    }
}
