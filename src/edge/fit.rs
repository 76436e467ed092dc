//! The fine step: a blurred step fitted to all pixels beside an edge.
//!
//! [`region`] says which pixels speak about an edge, [`batch`] collects them and
//! multiplies out their model, [`crossing`] says what that is near corners, and [`regression`]
//! solves for its numbers.
//!
//! # Model
//!
//! With v the distance of a pixel from the expected line, w its place along the edge
//! (-1/2 to 1/2 from node to node) and s the blur's standard deviation,
//!
//! ```text
//! I = offset + contrast/2 * E((v - shift - w turn) / s),   E(x) = erf(x / sqrt 2)
//! ```
//!
//! to first order in shift, turn and ln s, so that five numbers are found by one linear
//! regression of the pixels on (1, E, -dE/d ln s, dE/dv, w dE/dv). The pixel's own box is
//! part of s: its variance, 1/12 px^2, is the same in every direction. The lens's
//! curvature along the edge is taken out of v.
//!
//! The light's slope is taken out of I: what it adds to the mean of both sides is subtracted,
//! and what it adds to the contrast divided out. As columns of their own they would cost
//! precision: an edge alone cannot tell a slope of the light along it from a turn.

mod batch;
mod crossing;
mod region;
mod regression;
#[cfg(test)]
mod tests;

pub use batch::Batch;

use region::Region;
use regression::{BLUR, Regression, SLOPE, STEP};

use super::light::Light;
use super::{CONTRAST_MIN, SeenEdge};
use crate::image::{GreyImage, Pixel};
use crate::nodes::{Direction, Edge, Nodes};

/// How the camera shows a target's edges; what one frame finds serves the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// Standard deviation of the blur and the pixel's box together, raw pixels, of the
    /// edges along x. Motion blurs those across it more.
    pub x_blur_px: f64,
    /// Of the edges along y.
    pub y_blur_px: f64,
    /// How much larger dark squares look than they are, raw pixels on each side: ink
    /// spreads, and a camera's response need not be straight. Inside the grid it shifts
    /// edges by turns to and fro; on its border, all of them outwards.
    pub growth_px: f64,
    /// Whether the border was seen where it should be: the outermost squares of a board may
    /// be cut, or have no margin.
    pub has_border: bool,
}

/// Below this the samples cannot tell: only pictures sharpened by the camera ask for less.
const BLUR_PX_MIN: f64 = 0.4;
/// Above this a target is out of focus beyond use.
const BLUR_PX_MAX: f64 = 4.0;
/// One correction's bound, of ln s: the model is far from linear beyond it.
const LN_BLUR_STEP_MAX: f64 = 0.3;
/// More growth than this is none.
const GROWTH_PX_MAX: f64 = 1.0;

impl Appearance {
    /// The first guess: a good lens in focus, the pixel's box, and an exact print.
    pub const START: Self =
        Self { x_blur_px: 0.75, y_blur_px: 0.75, growth_px: 0.0, has_border: false };

    fn blur_px(&self, direction: Direction) -> f64 {
        match direction {
            Direction::X => self.x_blur_px,
            Direction::Y => self.y_blur_px,
        }
    }

    /// Corrected by what fitted edges say: in ln s of either blur, and in growth. Returns
    /// the larger relative change of a blur. What is not a number corrects nothing.
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

/// What the pixels of one edge say beside its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFit {
    /// Variance of the pixels about the model, grey levels squared.
    pub noise_variance: f32,
    /// How much ln s should change.
    pub ln_blur: f32,
    /// Its precision for unit noise.
    pub ln_blur_weight: f32,
}

/// Largest shift that the linear model is good for, in s.
const SHIFT_IN_BLURS_MAX: f64 = 1.0;

/// Fits one edge, expected where the nodes have it; its precision is that for pixels with
/// a noise of 1. `None` where no edge of its colours is, or too little of it.
pub fn fit<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    edge: &Edge,
    appearance: &Appearance,
    light: Option<&Light>,
    batch: &mut Batch,
) -> Option<(SeenEdge, PixelFit)> {
    let chord = nodes.chord(edge);
    let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let blur_px = appearance.blur_px(edge.direction);
    let crossing_blur_px = match edge.direction {
        Direction::X => appearance.y_blur_px,
        Direction::Y => appearance.x_blur_px,
    };
    let are_corners = edge.nodes.map(|node| nodes.corner(node).is_some());
    let region = Region::new(&chord, [blur_px, crossing_blur_px], are_corners)?;
    let sign = if edge.is_right_light { 1.0 } else { -1.0 };
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    let levels = light.and_then(|light| light.beside(nodes, edge, &middle_px));
    let mut sums = batch.sums(image, &region, levels.as_ref())?;
    if let Some(levels) = levels {
        sums.add_levels(&levels, sign);
    }
    let regression = Regression::new(&sums)?;
    let half_contrast = regression.coefficients[STEP] * sign;
    let white_level = f64::from(image.white_level());
    if half_contrast < 0.5 * f64::from(CONTRAST_MIN) * white_level {
        return None;
    }
    // d I / d shift = -sign half_contrast / s dE/dx.
    let per_px = -sign * half_contrast / blur_px;
    let shift_px = regression.coefficients[SLOPE] / per_px;
    if shift_px.abs() > SHIFT_IN_BLURS_MAX * blur_px {
        return None;
    }
    // A whitener may change its sign as long as what was seen does.
    let whitener = regression.factor.map(|value| value * per_px.abs());
    let [shift, turn] = regression.seen.map(|value| value * per_px.signum());
    let growth = whitener[0] * sign * appearance.growth_px;
    let seen = SeenEdge::new(*edge, ends, &chord.right, whitener, [shift - growth, turn]);
    let pixels = PixelFit {
        noise_variance: regression.noise_variance as f32,
        ln_blur: (-regression.coefficients[BLUR] / (sign * half_contrast)) as f32,
        ln_blur_weight: (regression.blur_pivot * half_contrast * half_contrast) as f32,
    };
    Some((seen, pixels))
}
