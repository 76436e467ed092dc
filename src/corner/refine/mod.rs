//! Sub-pixel refinement: a seed a pixel or two off becomes a position good to a
//! hundredth of a pixel.
//!
//! In goes a [`CornerSeed`] (where, which way the edges run, how large a window),
//! out comes a [`RefinedCorner`] or the reason why there is none. All methods
//! work on one square window of raw pixels, copied once and re-centred on the
//! nearest pixel as the estimate moves; nothing is resampled.
//!
//! Spread per coordinate and bias, px, of corners of contrast 120 (light minus
//! dark), blur 0.7 px before the pixel's box, noise 2 grey levels, 8 bits,
//! window +-6 px, edges 20 degrees off the rows; and of a board tilted by 60
//! degrees (edges 53 degrees apart). The tests hold these figures.
//!
//! | method | spread | bias up to | tilted: spread | bias up to |
//! |---|---|---|---|---|
//! | [`Refinement::GradientOrthogonality`], the paper's | 0.024 | 0.020 | 0.028 | 0.035 |
//! | [`Refinement::Saddle`], linear | 0.011 | 0.055 | 0.013 | 0.035 |
//! | [`Refinement::ModelFit`], the default, also the Cramer-Rao bound | 0.0077 | 0.002 | 0.0094 | 0.002 |
//!
//! The fit's bias over sub-pixel phases, which all corners of an axis-aligned
//! grid share, is below 0.003 px for blurs of 0.5 to 1.5 px, and 0.005 px at 0.4.
//!
//! Basin of the fit in a window of +-6 px: 1 px and 15 degrees always, 2 px in
//! nine of ten cases; in windows of +-3 and +-4 px 1 px, and 15 degrees only for
//! edges near right angles. What is outside is refused, not mistaken.
//!
//! It cannot tell a hair of half a pixel from noise (up to 0.25 px of error), and
//! in a window of +-3 px it misses most covers: 49 pixels hold too little to
//! judge seven parameters by. The pose's robust weights are there for those.

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

/// Pixels closer to an edge than this are blurred and not counted as flat; in a
/// small window less is asked, so that some are left.
fn flat_distance_px(radius: usize) -> f32 {
    (0.35 * radius as f32).min(2.0)
}

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
            let fitted = fit_model(image, seed, &mut patch, edges_rad)?;
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
        // One window sees no farther than this.
        if farthest.is_nan() || farthest >= radius as f32 {
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

fn fit_model<P: Pixel>(
    image: &GreyImage<'_, P>,
    seed: &CornerSeed,
    patch: &mut Patch,
    edges_rad: [f32; 2],
) -> Result<model_fit::Fitted, RefineFailure> {
    let (offset_px, _) = locate_saddle(image, seed, patch, edges_rad)?;
    model_fit::fit(patch, &model_fit::start(offset_px, edges_rad))
}

/// The flat parts of a window, light and dark, away from the edges.
struct Flats {
    contrast: f32,
    /// Standard deviation within the flat parts, grey levels.
    noise: f32,
}

impl Flats {
    fn measure(
        patch: &Patch,
        offset_px: [f32; 2],
        edges_rad: [f32; 2],
    ) -> Result<Self, RefineFailure> {
        let coordinates = Coordinates::of(patch.radius);
        let distance_px = flat_distance_px(patch.radius);
        let directions = edges_rad.map(libm::sincosf);
        let (mut sums, mut squares, mut counts) = ([0.0_f32; 2], [0.0_f32; 2], [0_u16; 2]);
        for (index, &value) in patch.pixels().iter().enumerate() {
            let x = coordinates.x[index / LANES][index % LANES] - offset_px[0];
            let y = coordinates.y[index / LANES][index % LANES] - offset_px[1];
            let [a, b] = directions.map(|(sine, cosine)| cosine * y - sine * x);
            if a.abs().min(b.abs()) < distance_px {
                continue;
            }
            // Signs equal: light, by the seed's convention.
            let part = usize::from((a > 0.0) == (b > 0.0));
            sums[part] += value;
            squares[part] += value * value;
            counts[part] += 1;
        }
        // Too narrow a sector in too small a window.
        if counts.iter().any(|&count| count < 2) {
            return Err(RefineFailure::Seed);
        }
        let mean = |part: usize| sums[part] / f32::from(counts[part]);
        let contrast = mean(1) - mean(0);
        if contrast.abs() < CONTRAST_MIN * patch.white_level {
            return Err(RefineFailure::LowContrast);
        }
        if contrast < 0.0 {
            return Err(RefineFailure::WrongPolarity);
        }
        let within = squares[0] + squares[1] - sums[0] * mean(0) - sums[1] * mean(1);
        let noise = libm::sqrtf(within.max(0.0) / f32::from(counts[0] + counts[1] - 2));
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
