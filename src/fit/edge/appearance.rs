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
    /// Whether the border was seen where it should be: the outermost squares of a board may
    /// be cut, or have no margin.
    pub has_border: bool,
}

/// Smallest blur. Below it the samples do not determine the blur: only pictures sharpened by the
/// camera call for less.
pub(super) const BLUR_PX_MIN: f64 = 0.4;
/// Largest blur. Above it a target is too far out of focus to be of use.
pub(super) const BLUR_PX_MAX: f64 = 4.0;
/// Largest correction of ln s at once: the model is far from linear beyond it.
pub(super) const LN_BLUR_STEP_MAX: f64 = 0.3;
/// Largest growth; anything more is not growth.
pub(super) const GROWTH_PX_MAX: f64 = 1.0;

impl Appearance {
    /// The first guess: a good lens in focus, the pixel's box, and an exact print.
    pub const START: Self =
        Self { x_blur_px: 0.75, y_blur_px: 0.75, growth_px: 0.0, has_border: false };

    pub(super) fn blur_px(&self, direction: Direction) -> f64 {
        match direction {
            Direction::X => self.x_blur_px,
            Direction::Y => self.y_blur_px,
        }
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
        let grown_px = self.growth_px + growth_px;
        if grown_px.abs() <= GROWTH_PX_MAX {
            self.growth_px = grown_px;
        }
        largest
    }
}
