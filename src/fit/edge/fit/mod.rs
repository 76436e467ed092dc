//! The fine step: a blurred step fitted to all pixels beside an edge.
//!
//! [`fit_edge`] does this: [`region`] selects the pixels that belong to an edge, [`batch`] averages
//! them along the edge and sums the products of the model's columns ([`crossing`] models the vicinity
//! of corners), and [`regression`] solves for the model's parameters.
//!
//! # Model
//!
//! With v the distance of a pixel from the expected line, w its position along the edge (-1/2 to
//! 1/2 from node to node) and s the blur's standard deviation,
//!
//! ```text
//! I = offset + contrast/2 * E((v - shift - w turn) / s),   E(x) = erf(x / sqrt 2)
//! ```
//!
//! to first order in shift, turn and ln s, so that five parameters are found by one linear
//! regression of the pixels on (1, E, -dE/d ln s, dE/dv, w dE/dv). The pixel's own box is part of
//! s: its variance, 1/12 px^2, is the same in every direction. The lens's curvature along the edge
//! is subtracted from v.
//!
//! The light's slope is removed from I: what it adds to the mean of both sides is subtracted, and
//! what it adds to the contrast is divided out. As columns of their own they would cost precision:
//! an edge alone cannot tell a slope of the light along it from a turn.

mod batch;
mod crossing;
mod lanes;
mod region;
mod regression;
#[cfg(test)]
mod tests;

pub use batch::Batch;

use crossing::EdgeEnd;
use region::{Region, Width};
use regression::{BLUR, Regression, SLOPE, STEP};

use crate::fit::edge::appearance::Appearance;
use crate::fit::edge::light::Light;
use crate::fit::edge::seen::{CONTRAST_MIN, SeenEdge};
use crate::fit::nodes::{Direction, Edge, Nodes};
use crate::model::image::{GreyImage, Pixel};

/// What the pixels of one edge tell besides its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFit {
    /// Variance of the pixels about the model, grey levels squared.
    pub noise_variance: f32,
    /// How much ln s should change.
    pub ln_blur: f32,
    /// Its precision for unit noise.
    pub ln_blur_weight: f32,
}

/// Largest shift for which the linear model holds, in s.
const SHIFT_IN_BLURS_MAX: f64 = 1.0;

/// Fits one edge, expected where the nodes put it; its precision is that for pixels with unit
/// noise. `None` where there is no edge with its colours, or too little of it.
pub fn fit_edge<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    edge: &Edge,
    appearance: &Appearance,
    light: Option<&Light>,
    batch: &mut Batch,
) -> Option<(SeenEdge, PixelFit)> {
    let chord = nodes.chord(edge);
    let end_nodes = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let blur_px = appearance.blur_px(edge.direction);
    let crossing_blur_px = match edge.direction {
        Direction::X => appearance.y_blur_px,
        Direction::Y => appearance.x_blur_px,
    };
    let ends = edge.nodes.map(|node| match nodes.corner(node) {
        Some(_) => EdgeEnd::Corner,
        None if appearance.has_border => EdgeEnd::Border,
        None => EdgeEnd::Unknown,
    });
    let sign = if edge.is_right_light { 1.0 } else { -1.0 };
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    let levels = light.and_then(|light| light.beside(nodes, edge, &middle_px));
    let width = if levels.is_some() { Width::KNOWN_LEVELS } else { Width::UNKNOWN_LEVELS };
    let region = Region::new(&chord, [blur_px, crossing_blur_px], ends, sign, &width);
    // By reference: taking the region out of its option would copy it.
    let mut sums = batch.sums(image, region.as_ref()?, levels.as_ref(), sign);
    if let Some(levels) = levels {
        sums.add_levels(&levels, sign);
    }
    let blur_precision = levels
        .as_ref()
        .map_or(0.0, |levels| appearance.ln_blur_precision() * levels.noise_per_contrast());
    let regression = Regression::new(&sums, blur_precision)?;
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
    // A whitener may change its sign as long as the seen values change theirs.
    let whitener = regression.factor.map(|value| value * per_px.abs());
    let [shift, turn] = regression.seen.map(|value| value * per_px.signum());
    let growth = whitener[0] * sign * appearance.growth_px;
    let seen = SeenEdge::new(*edge, end_nodes, &chord.right, whitener, [shift - growth, turn]);
    let pixels = PixelFit {
        noise_variance: regression.noise_variance as f32,
        ln_blur: (-regression.coefficients[BLUR] / (sign * half_contrast)) as f32,
        ln_blur_weight: (regression.blur_pivot * half_contrast * half_contrast) as f32,
    };
    Some((seen, pixels))
}
