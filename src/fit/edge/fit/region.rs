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
//!
//! They are read in *lines* across the edge: rows of the frame where the edge is nearer to the
//! vertical, otherwise columns. Along an edge little changes from line to line. Where no crossing
//! line reaches and the edge runs nearly at right angles to the lines, up to [`BAND_LINES_MAX`] of
//! them are averaged to one *band*, so that the model is evaluated once for all of them.

use core::array;
use core::ops::Range;

use nalgebra::Vector2;

use super::crossing::{self, CrossingLines, Crossings, EdgeEnd};
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

/// Most lines that are averaged: of an edge of 20 px, more would cost several percent of what it
/// tells about its turn.
pub(super) const BAND_LINES_MAX: u32 = 5;

/// How much the lines of a band may add to the variance of the blur, as a share of it: they lie
/// beside each other by the edge's slope. The model includes that, but a blurred edge is also a less
/// precise one, by about half of this share.
const BAND_VARIANCE_SHARE: f32 = 0.05;

/// Largest half length of an edge that is used: the work is bounded, however near the target is.
pub(super) const HALF_LENGTH_PX_MAX: f64 = 32.0;

/// The pixels of one edge, as a convex polygon about its middle.
pub(super) struct Region {
    /// Whether its lines are rows of the frame, and not columns.
    pub(super) are_lines_rows: bool,
    /// Whole pixel at the middle: its line, and its place in the line.
    pub(super) origin: [usize; 2],
    /// From there to the exact middle.
    pub(super) middle: [f32; 2],
    /// Unit vector along the edge: from line to line, and from place to place.
    pub(super) along: [f32; 2],
    /// Unit vector to its right.
    pub(super) right: [f32; 2],
    pub(super) per_length: f32,
    pub(super) per_blur: f32,
    /// The lens's bend in the middle of the edge, to its right, px.
    pub(super) bend_px: f32,
    /// The polygon's extent in lines, to either side of the middle.
    reach_lines: f32,
    /// That of its lines which no crossing line reaches.
    free_lines: f32,
    /// The number of such lines that may be averaged.
    band_lines: u32,
    /// A twelfth of the square of the edge's change of place from line to line, in blurs: n
    /// equidistant lines have (n^2 - 1) times this variance.
    band_spread: f32,
    strips: Strips,
    pub(super) crossings: Crossings,
}

/// Neighbouring lines, of which the pixels at the same place are averaged.
pub(super) struct Band {
    pub(super) first_line: usize,
    pub(super) lines: usize,
    pub(super) places: Range<usize>,
    /// Blur of a single line over the band's.
    pub(super) sharpness: f32,
    /// Mean of the lines, and the first place, from the edge's middle.
    pub(super) from_middle: [f32; 2],
}

/// Strips, each between two parallel sides, `low <= normal . (pixel - middle) <= high`, solved for
/// the place in a line: one lane each.
struct Strips {
    /// low + by_line line <= place <= high + by_line line.
    low: Lanes,
    high: Lanes,
    by_line: Lanes,
}

impl Strips {
    /// From normals, with the part from line to line first, and bounds.
    fn new(strips: [([f64; 2], [f64; 2]); LANES]) -> Self {
        let solved = strips.map(|([normal_line, normal_place], [low, high])| {
            // A side along the lines does not bound the place, or only so far out that another side
            // does.
            const FLATTEST: f64 = 1e-6;
            let is_flat = normal_place.abs() < FLATTEST;
            let normal_place =
                if is_flat { libm::copysign(FLATTEST, normal_place) } else { normal_place };
            let per_place = 1.0 / normal_place;
            let (low, high) = if normal_place > 0.0 { (low, high) } else { (high, low) };
            [low, high, -normal_line].map(|value| (value * per_place) as f32)
        });
        let [low, high, by_line] = array::from_fn(|part| solved.map(|strip| strip[part]));
        Self { low, high, by_line }
    }

    /// The first and the last place inside all of them, from the middle, in each of four lines.
    #[inline(always)]
    fn bounds(&self, lines: &Lanes) -> [Lanes; 2] {
        let (mut low, mut high) = ([f32::NEG_INFINITY; LANES], [f32::INFINITY; LANES]);
        for strip in 0..LANES {
            for lane in 0..LANES {
                let place = self.by_line[strip] * lines[lane];
                let (from, to) = (place + self.low[strip], place + self.high[strip]);
                low[lane] = if from > low[lane] { from } else { low[lane] };
                high[lane] = if to < high[lane] { to } else { high[lane] };
            }
        }
        [low, high]
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
        let cosine = right.dot(&crossing);
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
        let are_lines_rows = along.y.abs() >= along.x.abs();
        let by_lines = |[x, y]: [f64; 2]| if are_lines_rows { [y, x] } else { [x, y] };
        let [along_line, along_place] = by_lines(along.into());
        let [across_line, _] = by_lines(across.into());
        // Not far from this line, not near a crossing line, and not nearer to a crossing line than
        // to this one.
        let diagonal_px = sine * half_length_px;
        let within = |distance_px: f64| [-distance_px, distance_px];
        let strips = Strips::new([
            (by_lines(right.into()), within(width_px)),
            (by_lines(crossing.into()), [-sine * used_start_px, sine * used_end_px]),
            (by_lines((right + crossing).into()), within(diagonal_px)),
            (by_lines((right - crossing).into()), within(diagonal_px)),
        ]);
        let reach_lines =
            used_start_px.max(used_end_px) * along_line.abs() + width_px / sine * across_line.abs();
        // Where only the first strip bounds a line.
        let clear_px = (f64::from(crossing::REACH) * crossing_blur_px).max(width_px);
        let free_px = (half_length_px - (clear_px + width_px * cosine.abs()) / sine)
            .min(used_start_px.min(used_end_px) - width_px * cosine.abs() / sine);
        let free_lines = free_px * along_line.abs() - width_px * along_place.abs();
        let slope = along_place / blur_px;
        let band_spread = (slope * slope / 12.0) as f32;
        let [line_px, place_px] = by_lines(middle_px.into());
        let origin = [line_px as usize, place_px as usize];
        Some(Self {
            are_lines_rows,
            origin,
            middle: [(line_px - origin[0] as f64) as f32, (place_px - origin[1] as f64) as f32],
            along: [along_line as f32, along_place as f32],
            right: by_lines(right.into()).map(|value| value as f32),
            per_length: (1.0 / length_px) as f32,
            per_blur: (1.0 / blur_px) as f32,
            bend_px: chord.bend_px as f32,
            reach_lines: reach_lines as f32,
            free_lines: free_lines as f32,
            band_lines: band_lines(band_spread),
            band_spread,
            strips,
            crossings: Crossings::new(&CrossingLines {
                blur_px: crossing_blur_px,
                distance_px: diagonal_px,
                cosine,
                across_px: blur_px,
                along_px: sine * length_px,
                ends,
                sign,
            }),
        })
    }

    /// Calls `pixels` for each band of the region inside a frame, in order.
    #[inline]
    pub(super) fn each_band(&self, [width, height]: [usize; 2], mut pixels: impl FnMut(&Band)) {
        let [lines, places] = if self.are_lines_rows { [height, width] } else { [width, height] };
        let [origin_line, origin_place] = self.origin.map(|place| place as i32);
        let [middle_line, _] = self.middle;
        let first = (floor(middle_line - self.reach_lines) + 1).max(-origin_line);
        let end = (floor(middle_line + self.reach_lines) + 1).min(lines as i32 - origin_line);
        let first_free = (floor(middle_line - self.free_lines) + 1).max(first);
        let end_free = (floor(middle_line + self.free_lines) + 1).min(end);
        // As few bands as possible, and as alike as possible.
        let free = (end_free - first_free).max(0) as u32;
        let band_lines = free.div_ceil(free.div_ceil(self.band_lines).max(1)) as i32;
        let mut line = first;
        while line < end {
            // Four bands take no longer than one.
            let [mut lines, mut counts] = [[0; LANES]; 2];
            for lane in 0..LANES {
                let is_free = (first_free..end_free).contains(&line);
                let count = if is_free { band_lines.min(end_free - line) } else { 1 };
                (lines[lane], counts[lane]) = (line, count);
                line += count;
            }
            let mut four = Extents::default();
            self.measure(&lines, &counts, -origin_place, places as i32 - origin_place, &mut four);
            for lane in 0..LANES {
                let (line, start, after) = (lines[lane], four.starts[lane], four.ends[lane]);
                if line < end && start < after {
                    pixels(&Band {
                        first_line: (origin_line + line) as usize,
                        lines: counts[lane] as usize,
                        places: (origin_place + start) as usize..(origin_place + after) as usize,
                        sharpness: four.sharpness[lane],
                        from_middle: [four.middles[lane], four.starts_from_middle[lane]],
                    });
                }
            }
        }
    }

    /// Computes the extents of four bands, which begin at `lines` and have `counts` lines each. Lines
    /// and places are counted from the whole pixel at the middle; those inside the frame are the
    /// places from `first_place` to before `end_place`.
    ///
    /// Never inlined: the compiler vectorises what is read from memory and written to it.
    #[inline(never)]
    fn measure(
        &self,
        lines: &[i32; LANES],
        counts: &[i32; LANES],
        first_place: i32,
        end_place: i32,
        extents: &mut Extents,
    ) {
        let [middle_line, middle_place] = self.middle;
        let counts = counts.map(|count| count as f32);
        extents.middles =
            array::from_fn(|lane| lines[lane] as f32 + 0.5 * (counts[lane] - 1.0) - middle_line);
        extents.sharpness = counts.map(|count| {
            let added = self.band_spread * (count * count - 1.0);
            // 1 / sqrt(1 + added), to a ten-thousandth.
            1.0 - added * (0.5 - 0.375 * added)
        });
        let [low, high] = self.strips.bounds(&extents.middles);
        extents.starts = low.map(|low| (-floor(-(low + middle_place))).max(first_place));
        extents.ends = high.map(|high| (floor(high + middle_place) + 1).min(end_place));
        extents.starts_from_middle = extents.starts.map(|start| start as f32 - middle_place);
    }
}

/// The extents of four bands, one lane each.
#[derive(Default)]
struct Extents {
    /// The mean of the band's lines, from the edge's exact middle.
    middles: Lanes,
    /// The first of its places and the one after the last, from the whole pixel at the middle.
    starts: [i32; LANES],
    ends: [i32; LANES],
    /// The first of its places, from the exact middle.
    starts_from_middle: Lanes,
    /// Blur of a single line over the band's.
    sharpness: Lanes,
}

/// The number of lines that may be averaged.
fn band_lines(spread: f32) -> u32 {
    let added = |lines: u32| spread * (lines * lines - 1) as f32;
    (2..=BAND_LINES_MAX)
        .take_while(|&lines| added(lines) <= BAND_VARIANCE_SHARE)
        .last()
        .unwrap_or(1)
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
