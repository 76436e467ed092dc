//! Sub-pixel refinement: a seed within a pixel or two becomes a position good
//! to a hundredth of a pixel.
//!
//! | method | spread per coordinate at full contrast 120, blur 0.7 px, noise 2 grey levels, window +-6 px |
//! |---|---|
//! | [`Refinement::GradientOrthogonality`], the paper's | see `tests` |
//! | [`Refinement::Saddle`], linear | |
//! | [`Refinement::ModelFit`], the default | |
//!
//! All three work on one square window of raw pixels, re-centred on the nearest
//! pixel as the estimate moves. Nothing is resampled.

mod fast_math;
mod gradient_orthogonality;
mod model_fit;
mod patch;
mod saddle;

pub use patch::{RADIUS_PX_MAX, RADIUS_PX_MIN};

use core::f32::consts::PI;

use crate::image::{GreyImage, Pixel};
use patch::{Coordinates, LANES, Patch};

/// Windows looked at, at most: each one re-centres by a pixel or two.
const WINDOWS_MAX: usize = 4;

/// Difference between light and dark below which there is no corner, as a part
/// of the white level: 6 of 255 grey levels.
const CONTRAST_MIN: f32 = 0.025;

/// Pixels closer to an edge than this are blurred and not counted as flat, px.
const FLAT_DISTANCE_PX: f32 = 1.5;

/// How to refine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refinement {
    /// The paper's step: the point to which all gradients are at right angles.
    GradientOrthogonality,
    /// The saddle of a quadratic fitted to the cone-smoothed window.
    Saddle,
    /// A blurred corner fitted to the raw pixels, started from the saddle.
    #[default]
    ModelFit,
}

/// Where to look for a corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerSeed {
    /// Raw pixels.
    pub position_px: [f64; 2],
    /// Directions of the two edges, x towards y; the sector swept from edge 0
    /// to edge 1 by increasing angle (mod pi) is dark.
    pub edges_rad: [f64; 2],
    /// Half width of the window, [`RADIUS_PX_MIN`]`..=`[`RADIUS_PX_MAX`]; the
    /// window must not reach the neighbouring corners' edges.
    pub radius_px: usize,
}

/// A refined corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinedCorner {
    /// Raw pixels.
    pub position_px: [f64; 2],
    /// Standard deviation of one coordinate caused by the pixels' noise, which
    /// is measured in the window itself.
    pub sigma_px: f64,
    /// Light minus dark, grey levels.
    pub contrast: f32,
    /// Edge directions, [0, pi), in the seed's order; the model fit refines
    /// them, the other methods hand back the seed's.
    pub edges_rad: [f32; 2],
}

/// Why there is no refined corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefineFailure {
    /// The seed is not usable: not finite, a radius out of range, or edges
    /// less than 20 degrees apart.
    Seed,
    /// The window reaches out of the frame.
    OutsideFrame,
    /// Light and dark differ too little.
    LowContrast,
    /// An edge, a blob or nothing, but no crossing of two edges.
    NotASaddle,
    /// Light and dark are exchanged against the seed's edges.
    WrongPolarity,
    /// The estimate left the seed's surroundings or did not settle.
    Diverged,
    /// Something other than a corner covers part of the window.
    Obstructed,
}

impl core::fmt::Display for RefineFailure {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::Seed => "the seed's position, radius or edges are not usable",
            Self::OutsideFrame => "the window reaches out of the frame",
            Self::LowContrast => "light and dark differ too little",
            Self::NotASaddle => "no crossing of two edges",
            Self::WrongPolarity => "light and dark are exchanged",
            Self::Diverged => "the estimate left the seed's surroundings",
            Self::Obstructed => "part of the window is covered",
        })
    }
}

impl core::error::Error for RefineFailure {}

/// Refines one corner.
///
/// # Errors
/// [`RefineFailure`] says why there is none.
pub fn refine<P: Pixel>(
    image: &GreyImage<'_, P>,
    seed: &CornerSeed,
    method: Refinement,
) -> Result<RefinedCorner, RefineFailure> {
    let edges_rad = usable_edges(seed)?;
    let mut patch = Patch::new();
    match method {
        Refinement::GradientOrthogonality => {
            let minimum = locate(image, seed, &mut patch, |patch| {
                let minimum = gradient_orthogonality::solve(patch)?;
                Ok((minimum.offset_px, minimum))
            })?;
            let flats = Flats::measure(&patch, minimum.offset_px, edges_rad)?;
            let sigma_px = minimum.sigma_px(&patch, flats.noise);
            Ok(flats.corner(&patch, minimum.offset_px, sigma_px, edges_rad))
        }
        Refinement::Saddle => {
            let (offset_px, quadratic) = locate_saddle(image, seed, &mut patch, edges_rad)?;
            let flats = Flats::measure(&patch, offset_px, edges_rad)?;
            let sigma_px = quadratic.sigma_px(patch.radius, flats.noise);
            Ok(flats.corner(&patch, offset_px, sigma_px, edges_rad))
        }
        Refinement::ModelFit => {
            let (offset_px, _) = locate_saddle(image, seed, &mut patch, edges_rad)?;
            let fitted = model_fit::fit(&patch, &model_fit::start(offset_px, edges_rad))?;
            let contrast = 2.0 * fitted.half_contrast;
            if contrast < CONTRAST_MIN * patch.white_level {
                return Err(RefineFailure::LowContrast);
            }
            Ok(RefinedCorner {
                position_px: patch.position_px(fitted.shape.offset_px),
                sigma_px: f64::from(fitted.sigma_px),
                contrast,
                edges_rad: fitted.shape.edges_rad.map(direction_rad),
            })
        }
    }
}

/// The seed's edges with the second within (0, pi) above the first.
fn usable_edges(seed: &CornerSeed) -> Result<[f32; 2], RefineFailure> {
    let [first, second] = seed.edges_rad.map(|edge_rad| edge_rad as f32);
    let gap_rad = direction_rad(second - first);
    let is_usable = (RADIUS_PX_MIN..=RADIUS_PX_MAX).contains(&seed.radius_px)
        && seed.position_px.iter().all(|value| value.is_finite())
        && first.is_finite()
        && libm::sinf(gap_rad) > model_fit::EDGES_SINE_MIN;
    let first = direction_rad(first);
    if is_usable { Ok([first, first + gap_rad]) } else { Err(RefineFailure::Seed) }
}

/// An angle as a direction, [0, pi).
fn direction_rad(angle_rad: f32) -> f32 {
    let rest = libm::fmodf(angle_rad, PI);
    let positive = if rest < 0.0 { rest + PI } else { rest };
    // A tiny negative rest rounds to pi itself.
    if positive >= PI { 0.0 } else { positive }
}

/// Copies the window, lets `step` find the corner in it, and moves the window
/// until its middle pixel is the nearest one.
fn locate<P: Pixel, T>(
    image: &GreyImage<'_, P>,
    seed: &CornerSeed,
    patch: &mut Patch,
    step: impl Fn(&Patch) -> Result<([f32; 2], T), RefineFailure>,
) -> Result<T, RefineFailure> {
    let radius = seed.radius_px;
    let mut position_px = seed.position_px;
    for window in 1..=WINDOWS_MAX {
        let centre = image.window_centre(position_px, radius).ok_or(RefineFailure::OutsideFrame)?;
        patch.copy_from(image, centre, radius);
        let (offset_px, found) = step(patch)?;
        let farthest = offset_px[0].abs().max(offset_px[1].abs());
        // Between two pixels noise may send the window back and forth: a corner
        // a little beyond the half is well inside either window.
        let enough = if window == 1 { 0.5 } else { 0.75 };
        if farthest <= enough {
            return Ok(found);
        }
        // Written so that a NaN ends here; one window sees no farther than this.
        if !(farthest < radius as f32) {
            return Err(RefineFailure::Diverged);
        }
        position_px = patch.position_px(offset_px);
        let moved_px = [0, 1].map(|axis| position_px[axis] - seed.position_px[axis]);
        // Farther than a window's half width is another corner.
        if moved_px.iter().any(|moved| moved.abs() > radius as f64) {
            return Err(RefineFailure::Diverged);
        }
    }
    Err(RefineFailure::Diverged)
}

fn locate_saddle<P: Pixel>(
    image: &GreyImage<'_, P>,
    seed: &CornerSeed,
    patch: &mut Patch,
    edges_rad: [f32; 2],
) -> Result<([f32; 2], saddle::Quadratic), RefineFailure> {
    let (sine, cosine) = libm::sincosf(0.5 * (edges_rad[0] + edges_rad[1]));
    locate(image, seed, patch, |patch| {
        let quadratic = saddle::fit(patch);
        let offset_px = quadratic.saddle_px()?;
        if !quadratic.agrees_with([cosine, sine]) {
            return Err(RefineFailure::WrongPolarity);
        }
        Ok((offset_px, (offset_px, quadratic)))
    })
}

/// The flat parts of a window: the four sectors away from the edges.
struct Flats {
    contrast: f32,
    /// Standard deviation within the sectors, grey levels.
    noise: f32,
}

impl Flats {
    fn measure(
        patch: &Patch,
        offset_px: [f32; 2],
        edges_rad: [f32; 2],
    ) -> Result<Self, RefineFailure> {
        let coordinates = Coordinates::of(patch.radius);
        let directions = edges_rad.map(libm::sincosf);
        let (mut sums, mut squares, mut counts) = ([0.0_f32; 4], [0.0_f32; 4], [0_u16; 4]);
        for (index, &value) in patch.pixels().iter().enumerate() {
            let x = coordinates.x[index / LANES][index % LANES] - offset_px[0];
            let y = coordinates.y[index / LANES][index % LANES] - offset_px[1];
            let [a, b] = directions.map(|(sine, cosine)| cosine * y - sine * x);
            if a.abs() < FLAT_DISTANCE_PX || b.abs() < FLAT_DISTANCE_PX {
                continue;
            }
            let sector = usize::from(a > 0.0) + 2 * usize::from(b > 0.0);
            sums[sector] += value;
            squares[sector] += value * value;
            counts[sector] += 1;
        }
        if counts.contains(&0) {
            return Err(RefineFailure::Seed);
        }
        let mean = |sector: usize| sums[sector] / f32::from(counts[sector]);
        // Signs equal: light, by the seed's convention.
        let contrast = 0.5 * (mean(0) + mean(3) - mean(1) - mean(2));
        if contrast.abs() < CONTRAST_MIN * patch.white_level {
            return Err(RefineFailure::LowContrast);
        }
        if contrast < 0.0 {
            return Err(RefineFailure::WrongPolarity);
        }
        let within: f32 = (0..4).map(|sector| squares[sector] - sums[sector] * mean(sector)).sum();
        let free = counts.iter().sum::<u16>().saturating_sub(4).max(1);
        let noise = libm::sqrtf(within.max(0.0) / f32::from(free));
        Ok(Self { contrast, noise })
    }

    fn corner(
        &self,
        patch: &Patch,
        offset_px: [f32; 2],
        sigma_px: f32,
        edges_rad: [f32; 2],
    ) -> RefinedCorner {
        RefinedCorner {
            position_px: patch.position_px(offset_px),
            sigma_px: f64::from(sigma_px),
            contrast: self.contrast,
            edges_rad: edges_rad.map(direction_rad),
        }
    }
}

#[cfg(test)]
mod rendered;
#[cfg(test)]
mod tests;
