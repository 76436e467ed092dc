//! How the lines that cross an edge at its ends change its profile.
//!
//! At a corner the colours change sides. After a blur, with v and d a pixel's distances from the
//! edge and from the crossing line, in blurs, and d increasing away from the corner, the picture is
//!
//! ```text
//! I = offset + contrast/2 * (E(v) E(d) + rho E'(v) E'(d))
//! ```
//!
//! to first order in rho, the cosine of the angle between both normals: a blurred product of signs,
//! whose derivative with respect to the blur's correlation is four times the normal density. The
//! first term lowers the step towards a corner; the second turns an edge of a sheared target, since
//! rho has opposite signs at its ends.
//!
//! Where an edge ends at the target's border there is only one dark square, a quarter of the plane,
//! whose share is the product of two integrals of the normal density:
//!
//! ```text
//! I = offset + contrast/2 * (E(v) h + (1 - h) + rho/2 E'(v) E'(d)),   h = (1 + E(d)) / 2
//! ```
//!
//! where the light side is to the right; where it is to the left, 1 - h has the other sign.
//!
//! With t the amount by which the line is nearer than [`REACH`], E(d) is about 1 - t^2 (a + b t^2),
//! and E'(d) the derivative of that. Odd powers are not needed, so that the sign of t can
//! distinguish the ends, and both ends cost no more than one.

/// From here outwards a line has no effect, in its blurs.
pub(super) const REACH: f32 = 3.4;

/// Least-squares fit to E and half its derivative from 1.5 outwards; their errors stay within
/// 0.0016 and 0.0044.
const A: f32 = 0.006_906_1;
const B: f32 = 0.008_323_3;

/// What is at an end of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EdgeEnd {
    /// A corner, where the colours change sides.
    Corner,
    /// The target's border: beyond it there is only the light margin.
    Border,
    /// The border of a target whose margin has not been seen: anything may be beyond.
    Unknown,
}

/// The lines across an edge.
pub(super) struct CrossingLines {
    pub(super) blur_px: f64,
    /// From the edge's middle to either line, at right angles to the line.
    pub(super) distance_px: f64,
    /// Cosine of the angle between the two normals: to the edge's right, and along it.
    pub(super) cosine: f64,
    /// Length of one blur across the edge.
    pub(super) across_px: f64,
    /// From the edge's start to its end, at right angles to the lines.
    pub(super) along_px: f64,
    pub(super) ends: [EdgeEnd; 2],
    /// 1 where the right side is light, otherwise -1.
    pub(super) sign: f64,
}

/// How t follows from a pixel's position, in the precision of the lanes.
#[derive(Clone, Copy)]
pub(super) struct Crossings {
    by_across: f32,
    by_place: f32,
    start: f32,
    end: f32,
    cosine: f32,
    /// How much of a corner's effect there is at the start and at the end: all or half.
    shares: [f32; 2],
    sign: f32,
}

impl Crossings {
    pub(super) fn new(lines: &CrossingLines) -> Self {
        let per_blur = 1.0 / lines.blur_px;
        let nearer = REACH - (lines.distance_px * per_blur) as f32;
        let [start, end] = lines.ends.map(|end| match end {
            EdgeEnd::Corner | EdgeEnd::Border => nearer,
            EdgeEnd::Unknown => f32::NEG_INFINITY,
        });
        Self {
            by_across: (lines.cosine * lines.across_px * per_blur) as f32,
            by_place: (lines.along_px * per_blur) as f32,
            start,
            end,
            cosine: lines.cosine as f32,
            shares: lines.ends.map(|end| if end == EdgeEnd::Border { 0.5 } else { 1.0 }),
            sign: lines.sign as f32,
        }
    }

    /// Whether no border is at an end, so that [`Crossings::at`] has less to do.
    pub(super) fn are_corners(&self) -> bool {
        self.shares == [1.0; 2]
    }

    /// The factor of E(v), what is added to it, and the factor of the E'(v) that is added, at
    /// `across` blurs to the right of the edge and `place` lengths from its middle.
    #[inline(always)]
    pub(super) fn at<const ARE_CORNERS: bool>(&self, across: f32, place: f32) -> (f32, f32, f32) {
        let along = self.by_across * across + self.by_place * place;
        let (start, end) = (self.start - along, self.end + along);
        let start = if start > 0.0 { start } else { 0.0 };
        let end = if end > 0.0 { end } else { 0.0 };
        let t = end - start;
        let square = t * t;
        let lowered = square * (A + B * square);
        // The normal at the end points against the direction of the edge.
        let turn = -self.cosine * t * (2.0 * A + 4.0 * B * square);
        if ARE_CORNERS {
            return (1.0 - lowered, 0.0, turn);
        }
        let share = if t > 0.0 { self.shares[1] } else { self.shares[0] };
        (1.0 - share * lowered, (1.0 - share) * self.sign * lowered, share * turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners 10 blurs before and after the middle, lines at an angle.
    fn crossings(ends: [EdgeEnd; 2]) -> Crossings {
        Crossings::new(&CrossingLines {
            blur_px: 2.0,
            distance_px: 20.0,
            cosine: 0.1,
            across_px: 1.5,
            along_px: 40.0,
            ends,
            sign: -1.0,
        })
    }

    use EdgeEnd::{Border, Corner, Unknown};

    /// E and its slope, at a distance in blurs.
    fn integral(distance: f64) -> (f64, f64) {
        let density =
            2.0 * libm::exp(-0.5 * distance * distance) / libm::sqrt(core::f64::consts::TAU);
        (libm::erf(distance / core::f64::consts::SQRT_2), density)
    }

    #[test]
    fn both_terms_are_those_of_a_blurred_corner() {
        let both = crossings([Corner; 2]);
        for step in 0..=850 {
            // From the middle to 1.5 blurs from a corner.
            let from_middle = f64::from(step) * 0.01;
            let distance = 10.0 - from_middle;
            let (exact, density) = integral(distance);
            let place = (from_middle / 20.0) as f32;
            let (height, lift, turn) = both.at::<false>(0.0, place);
            assert!((f64::from(height) - exact).abs() < 0.0017, "{distance}");
            assert_eq!(lift, 0.0, "{distance}");
            // Here the line's normal points against the edge's direction.
            assert!((f64::from(turn) + 0.1 * density).abs() < 0.1 * 0.005, "{distance}");
            assert_eq!(both.at::<false>(0.0, -place), (height, 0.0, -turn), "{distance}");
            assert_eq!(both.at::<true>(0.0, place), (height, 0.0, turn), "{distance}");
        }
        // The lines are not at right angles: 4 blurs of 1.5 px to the right of the edge, times
        // the cosine, are 0.3 blurs of 2 px nearer to the end.
        assert!((both.at::<false>(4.0, 0.4).0 - both.at::<false>(0.0, 0.415).0).abs() < 1e-6);
    }

    #[test]
    fn at_a_border_the_profile_is_that_of_a_quarter_of_the_plane() {
        // The left side is light: the dark square is where v is positive.
        let border = crossings([Corner, Border]);
        for distance in [1.5, 2.0, 2.5, 3.0, 4.0] {
            let place = ((10.0 - distance) / 20.0) as f32;
            let (height, lift, turn) = border.at::<false>(0.0, place);
            let (inside, density) = integral(distance);
            for v in [-2.0, -0.5, 0.0, 1.0, 3.0] {
                let (across, slope) = integral(v);
                let dark = 0.5 * (1.0 + across) * 0.5 * (1.0 + inside);
                // Light less twice the dark share, without what the correlation adds.
                let exact = 1.0 - 2.0 * dark;
                let model = -(f64::from(height) * across + f64::from(lift));
                assert!((model - exact).abs() < 0.0017, "{distance} {v}: {model} {exact}");
                // The correlation adds its own to the dark share: the product of the densities,
                // each of which is half of a slope here.
                let exact = -2.0 * -0.1 * 0.25 * slope * density;
                let model = -f64::from(turn) * slope;
                assert!((model - exact).abs() < 0.1 * 0.005, "{distance} {v}: {model} {exact}");
            }
        }
        // The other end is a corner.
        let (height, lift, _) = border.at::<false>(0.0, -0.4);
        assert_eq!((height, lift), {
            let (height, lift, _) = crossings([Corner; 2]).at::<false>(0.0, -0.4);
            (height, lift)
        });
    }

    #[test]
    fn where_nothing_is_known_nothing_is_corrected() {
        for (edge_ends, ends) in [
            ([Unknown; 2], [true; 2]),
            ([Corner, Unknown], [false, true]),
            ([Unknown, Corner], [true, false]),
        ] {
            let at_ends = [-0.42, 0.42].map(|place| crossings(edge_ends).at::<false>(0.0, place));
            for (is_plain, at_end) in ends.into_iter().zip(at_ends) {
                assert_eq!(at_end == (1.0, 0.0, 0.0), is_plain, "{edge_ends:?} {at_end:?}");
            }
        }
    }
}
