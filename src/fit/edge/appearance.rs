//! How a target looks, apart from where it is: estimated by each fit, and used by the next.

use crate::fit::nodes::Direction;

/// How the camera shows a target's edges; the estimate from one frame serves the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// Standard deviation of the blur and the pixel's box together, raw pixels, of the
    /// edges along x. Motion blurs those across it more.
    pub x_blur_px: f64,
    /// Of the edges along y.
    pub y_blur_px: f64,
    /// How much larger dark squares look than they are, raw pixels on each side: ink
    /// spreads, and a camera's response need not be linear. Inside the grid it shifts
    /// neighbouring edges in opposite directions; on its border, all of them outwards.
    pub growth_px: f64,
    /// The number of estimates of which the growth is the mean.
    pub growth_estimates: u8,
    /// How far the blurs may be from those of an edge of the next frame, as the standard deviation
    /// of their logarithms.
    pub ln_blur_sd: f64,
    /// Whether the border was seen where it should be: the outermost squares of a board may
    /// be cut, or have no margin.
    pub has_border: bool,
}

/// Smallest blur. Below it the samples do not determine the blur: only pictures sharpened by the
/// camera call for less.
pub(super) const BLUR_PX_MIN: f64 = 0.4;
/// Largest blur. Above it a target is too far out of focus to be of use.
pub(super) const BLUR_PX_MAX: f64 = 4.0;
/// Smallest uncertainty of ln s. Nearly as much follows from what all edges of a frame tell together;
/// a blur that differs more from edge to edge costs no more than a little precision, since whether
/// it moves an edge left or right depends on where the edge lies between the pixels.
const LN_BLUR_SD_MIN: f64 = 0.005;
/// Largest correction of ln s at once: the model is far from linear beyond it.
pub(super) const LN_BLUR_STEP_MAX: f64 = 0.3;
/// Estimates of the growth that are averaged. It is a property of print and camera and hardly
/// changes, and on the border its error is an error of the depth, which a single frame's estimate
/// would make 5 % less certain.
const GROWTH_ESTIMATES_MAX: u8 = 32;
/// A change of the growth by more than this is no noise: it is believed at once.
pub(crate) const GROWN_PX_MAX: f64 = 0.01;
/// A relative change of a blur by more than this is no noise.
const BLUR_SETTLED_MAX: f64 = 0.03;
/// Largest growth; anything more is not growth.
pub(super) const GROWTH_PX_MAX: f64 = 1.0;

impl Appearance {
    /// The first guess: a good lens in focus, the pixel's box, and an exact print.
    pub const START: Self = Self {
        x_blur_px: 0.75,
        y_blur_px: 0.75,
        ln_blur_sd: LN_BLUR_STEP_MAX,
        growth_px: 0.0,
        growth_estimates: 0,
        has_border: false,
    };

    /// The precision of ln s.
    pub(super) fn ln_blur_precision(&self) -> f64 {
        1.0 / (self.ln_blur_sd * self.ln_blur_sd)
    }

    pub(super) fn blur_px(&self, direction: Direction) -> f64 {
        match direction {
            Direction::X => self.x_blur_px,
            Direction::Y => self.y_blur_px,
        }
    }

    /// Whether the blur is known, as it is after a frame or two.
    pub(crate) fn has_settled(&self) -> bool {
        self.ln_blur_sd <= BLUR_SETTLED_MAX
    }

    /// With the growth of another: a frame counts once in the mean of the growth, with what its last
    /// pass makes of it. The first may start beside the edges, and take that for growth.
    #[must_use]
    pub(crate) fn with_growth_of(self, other: &Self) -> Self {
        Self { growth_px: other.growth_px, growth_estimates: other.growth_estimates, ..self }
    }

    /// Applies the fitted edges' corrections: those of each blur's logarithm, and of the growth.
    /// Returns the larger relative change of a blur. A NaN corrects nothing.
    pub fn correct(&mut self, [ln_x, ln_y]: [f64; 2], growth_px: f64) -> f64 {
        let mut largest = 0.0_f64;
        for (blur_px, correction) in [(&mut self.x_blur_px, ln_x), (&mut self.y_blur_px, ln_y)] {
            let correction = correction.clamp(-LN_BLUR_STEP_MAX, LN_BLUR_STEP_MAX);
            let corrected = (*blur_px * libm::exp(correction)).clamp(BLUR_PX_MIN, BLUR_PX_MAX);
            if corrected > 0.0 {
                largest = largest.max((corrected / *blur_px - 1.0).abs());
                *blur_px = corrected;
            }
        }
        if ln_x.is_finite() && ln_y.is_finite() {
            self.ln_blur_sd = largest.max(LN_BLUR_SD_MIN);
        }
        let earlier = if growth_px.abs() > GROWN_PX_MAX { 0 } else { self.growth_estimates };
        let estimates = (earlier + 1).min(GROWTH_ESTIMATES_MAX);
        let grown_px = self.growth_px + growth_px / f64::from(estimates);
        if grown_px.abs() <= GROWTH_PX_MAX {
            self.growth_px = grown_px;
            // With a wrong blur an estimate is wrong too.
            self.growth_estimates = if largest > BLUR_SETTLED_MAX { 0 } else { estimates };
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of a target that has been followed for a while.
    fn followed() -> Appearance {
        Appearance {
            x_blur_px: 0.5,
            y_blur_px: 2.0,
            ln_blur_sd: 0.25,
            growth_px: 0.1,
            growth_estimates: 3,
            has_border: true,
        }
    }

    #[test]
    fn each_direction_has_its_blur_and_both_have_one_precision() {
        let appearance = followed();
        assert_eq!(appearance.blur_px(Direction::X), 0.5);
        assert_eq!(appearance.blur_px(Direction::Y), 2.0);
        // Of a standard deviation of a quarter.
        assert_eq!(appearance.ln_blur_precision(), 16.0);
    }

    #[test]
    fn a_blur_that_is_known_to_3_percent_has_settled() {
        for (ln_blur_sd, has_settled) in [(0.005, true), (0.03, true), (0.0301, false)] {
            assert_eq!(Appearance { ln_blur_sd, ..followed() }.has_settled(), has_settled);
        }
        assert!(!Appearance::START.has_settled());
    }

    #[test]
    fn the_growth_is_the_mean_of_its_estimates() {
        let mut appearance = followed();
        appearance.correct([0.0; 2], 0.008);
        assert!((appearance.growth_px - (0.1 + 0.008 / 4.0)).abs() < 1e-15);
        assert_eq!(appearance.growth_estimates, 4);
        for _ in 0..40 {
            appearance.correct([0.0; 2], 0.0);
        }
        assert_eq!(appearance.growth_estimates, 32);
    }

    #[test]
    fn a_growth_that_has_changed_is_believed_at_once() {
        for (change_px, estimates) in [(0.01, 4), (-0.01, 4), (0.0101, 1), (-0.0101, 1)] {
            let mut appearance = followed();
            appearance.correct([0.0; 2], change_px);
            let grown_px = 0.1 + change_px / f64::from(estimates);
            assert!((appearance.growth_px - grown_px).abs() < 1e-15, "{change_px}");
            assert_eq!(appearance.growth_estimates, estimates, "{change_px}");
        }
    }

    #[test]
    fn an_estimate_of_the_growth_counts_if_the_blur_was_nearly_right() {
        for (ln_blur, estimates) in [(0.029, 4), (-0.03, 4), (0.03, 0), (-0.031, 0)] {
            let mut appearance = followed();
            appearance.correct([0.0, ln_blur], 0.0);
            assert_eq!(appearance.growth_estimates, estimates, "{ln_blur}");
        }
    }

    #[test]
    fn the_growth_can_be_taken_from_another() {
        let other = Appearance { growth_px: 0.2, growth_estimates: 7, ..Appearance::START };
        let expected = Appearance { growth_px: 0.2, growth_estimates: 7, ..followed() };
        assert_eq!(followed().with_growth_of(&other), expected);
    }
}
