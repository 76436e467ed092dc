//! How bright the light and the dark squares are, across one target.
//!
//! An edge's two grey levels follow from its own pixels, but their uncertainty costs a fifth of its
//! precision. Under even light the whole target determines them far better. So the middle of each
//! square is measured first, a plane is fitted to the light squares and one to the dark ones, and
//! each edge gets their levels as prior knowledge. It is trusted as far as the squares agree with
//! the planes, and not at all beside a square that does not agree: under a shadow, or behind
//! something. Where the squares confirm the planes, their slopes are also subtracted from the
//! edges' pixels: a slope of the light along an edge looks like a turn of it.

use heapless::Vec;
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::common::statistics::{median, order_of_positive};
use crate::fit::nodes::{Edge, Nodes};
use crate::limits::{TARGET_NODES_MAX, TARGET_SQUARES_MAX};
use crate::model::image::{GreyImage, Pixel};

/// Half width of the window in a square's middle: at least this share of the square, up to so many
/// pixels,
const REACH_SHARE: f64 = 0.2;
const SMALL_REACH_PX_MAX: usize = 3;
/// and as much as stays clear of the edges' blur, up to a bound. The error of a level is common to
/// all edges and puts those of the border too far out or in: 49 pixels per square, where 121 are
/// clear, would cost 4 % of the depth's precision.
const REACH_PX_MAX: usize = 6;

/// Pixels nearer to an edge than this, in blurs, are not of one colour: at this distance 0.2 % of
/// the contrast are left.
const CLEAR_OF_EDGES: f64 = 3.0;

/// How far beyond the border's nodes the pixels of their edges usually reach. Those farther out are
/// only read more slowly.
const BEYOND_BORDER_PX: f64 = 4.0;

/// Fewest squares of one colour to which a plane is fitted.
const SQUARES_MIN: usize = 5;

/// A square agrees with its plane within this many standard deviations, squared.
const AGREEMENT_SQUARE: f64 = 16.0;

/// Iterations of the reweighted fit of a plane.
const ITERATIONS: usize = 4;

/// Variance about a plane, as a share of the plane's own variance over the squares, above which it
/// does not describe the light.
const SLOPELESS_SHARE: f64 = 1.0 / 16.0;

/// The planes are never trusted to better than this share of the pixels' own noise: neither squares
/// nor light are that even.
const DEVIATION_IN_NOISE_MIN: f64 = 0.05;

/// Grey levels of one colour: a plane over the picture, and how far squares are from it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    /// At the origin, and per 100 px to the right and down.
    coefficients: Vector3<f64>,
    /// Variance of the squares' levels about it, without the pixels' noise.
    variance: f64,
    /// Variance of its own levels over the squares.
    spread: f64,
}

/// The light on one target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    origin_px: Vector2<f64>,
    light: Plane,
    dark: Plane,
    certainty: Certainty,
    /// Whether the squares confirm the slopes of both planes.
    is_even: bool,
    /// The squares, by their nodes, that agree with their colour's plane.
    agree: [bool; TARGET_NODES_MAX],
}

/// The sensor's noise: variances of the pixels within squares of either colour, grey levels squared.
///
/// Two points of the photon transfer curve (Janesick 2007): a pixel that has caught more light also
/// scatters more, and its variance grows linearly with its level from that of the readout.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    light: f64,
    dark: f64,
}

/// The largest share by which a level's variance may differ from the mean of both levels'. Pixels
/// that are black or saturated seem to have none, but an edge's must not rest on them alone.
const CONTRAST_OF_NOISE_MAX: f64 = 0.8;

impl Noise {
    /// Halfway between both levels.
    fn middle(&self) -> f64 {
        0.5 * (self.light + self.dark)
    }

    /// How much more a pixel at the light level scatters than one halfway, as a share of the
    /// latter's variance.
    fn contrast(&self) -> f64 {
        let contrast = 0.5 * (self.light - self.dark) / self.middle();
        // Without any noise, as in a drawing, all pixels are alike.
        let contrast = if contrast.is_nan() { 0.0 } else { contrast };
        contrast.clamp(-CONTRAST_OF_NOISE_MAX, CONTRAST_OF_NOISE_MAX)
    }
}

/// Squared deviations of pixels from their squares' means.
#[derive(Debug, Clone, Copy, Default)]
struct Scatter {
    squares: f64,
    degrees_of_freedom: f64,
    /// The sum of the pixels' squared distances from the middle of their squares, along one axis.
    squares_px2: f64,
}

impl Scatter {
    /// The pixels' variance, without what a slope of the light adds to it.
    fn variance(&self, per_px: &Vector2<f64>) -> f64 {
        let slope = per_px.norm_squared() * self.squares_px2;
        (self.squares - slope).max(0.0) / self.degrees_of_freedom
    }
}

/// Pixels of a row that are added together: no fewer than a window has. Those beyond the window go
/// into sums that nobody reads, which costs less than to leave them out.
const SPAN: usize = 16;
const _: () = assert!(2 * REACH_PX_MAX < SPAN);

/// For each column of a window, the sums of the pixels' differences from a base, and of their
/// squares.
struct Columns {
    values: [f32; SPAN],
    squares: [f32; SPAN],
}

impl Columns {
    /// The columns of a window whose first pixel is at (`left`, `top`).
    #[inline]
    fn of<P: Pixel>(
        image: &GreyImage<'_, P>,
        [left, top]: [usize; 2],
        side: usize,
        base: f32,
    ) -> Self {
        let mut columns = Self { values: [0.0; SPAN], squares: [0.0; SPAN] };
        for row in top..top + side {
            let pixels = &image.row(row)[left..];
            match pixels.first_chunk() {
                Some(span) => columns.add(span, base),
                None => {
                    // At the frame's right border.
                    let mut span = [pixels[0]; SPAN];
                    span[..pixels.len()].copy_from_slice(pixels);
                    columns.add(&span, base);
                }
            }
        }
        columns
    }

    #[inline(always)]
    fn add<P: Pixel>(&mut self, pixels: &[P; SPAN], base: f32) {
        for (column, &pixel) in pixels.iter().enumerate() {
            let value: f32 = pixel.into();
            let difference = value - base;
            self.values[column] += difference;
            self.squares[column] += difference * difference;
        }
    }

    /// The sums over the first columns.
    fn total(&self, side: usize) -> [f64; 2] {
        [&self.values, &self.squares].map(|columns| f64::from(columns[..side].iter().sum::<f32>()))
    }
}

/// How certain the levels are: the same at all edges, and so computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Certainty {
    /// Weight of each level, in pixels.
    pub(super) light_weight: f64,
    pub(super) dark_weight: f64,
    /// How much more a pixel at the light level scatters than one halfway between both, as a share
    /// of the latter's variance.
    pub(super) noise_contrast: f64,
    /// Variance of a pixel halfway between both, grey levels squared.
    noise_variance: f64,
}

/// What is known beforehand about the levels at an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Levels {
    pub(super) light: f64,
    pub(super) dark: f64,
    /// Slope of their mean in the picture, per px.
    pub(super) mean_per_px: Vector2<f64>,
    /// Slope of their difference, relative to the difference, per px.
    pub(super) contrast_per_px: Vector2<f64>,
    pub(super) certainty: Certainty,
}

impl Levels {
    /// The inverse square of half the contrast, in units of the noise: what the precision of a
    /// number in blurs is to be multiplied with to be that of a coefficient of the pixels.
    pub(super) fn noise_per_contrast(&self) -> f64 {
        let half_contrast = 0.5 * (self.light - self.dark);
        self.certainty.noise_variance / (half_contrast * half_contrast)
    }
}

/// One square's middle.
#[derive(Clone, Copy)]
struct Square {
    node: u8,
    place: Vector3<f64>,
    level: f64,
}

impl Light {
    /// Measures the middle of each square, whose edges have this blur. `None` where too few squares
    /// are inside the frame and large enough; each edge then has only its own pixels.
    #[must_use]
    pub fn measure<P: Pixel>(
        image: &GreyImage<'_, P>,
        nodes: &Nodes,
        first_square_dark: bool,
        blur_px: f64,
    ) -> Option<Self> {
        let origin_px = nodes.as_slice().get(nodes.as_slice().len() / 2)?.raw_px;
        // While a target is tracked, these are the first of its pixels to be read; those beside the
        // edges follow.
        let [low_px, high_px] = nodes.extent_px();
        let beyond_px = Vector2::repeat(BEYOND_BORDER_PX);
        image.fetch((low_px - beyond_px).into(), (high_px + beyond_px).into());
        let mut squares: [Vec<Square, TARGET_SQUARES_MAX>; 2] = [Vec::new(), Vec::new()];
        let mut scatters = [Scatter::default(); 2];
        let mut pixels_per_square = 0.0;
        for square in nodes.squares(first_square_dark) {
            let reach = reach_px(square.width_px, blur_px);
            let middle_px = square.middle_px;
            let Some((x, y)) = image.window_centre(middle_px.into(), reach) else { continue };
            if reach == 0 {
                continue;
            }
            let base: f32 = image.row(y)[x].into();
            let side = 2 * reach + 1;
            let columns = Columns::of(image, [x - reach, y - reach], side, base);
            let [sum, sum_squares] = columns.total(side);
            let count = (side * side) as f64;
            let mean = sum / count;
            let scatter = &mut scatters[usize::from(square.is_dark)];
            scatter.squares += sum_squares - mean * mean * count;
            scatter.degrees_of_freedom += count - 1.0;
            scatter.squares_px2 += count * (count - 1.0) / 12.0;
            pixels_per_square = count;
            // The position of the window, not of the square: their middles differ by up to half a
            // pixel.
            let offset = (Vector2::new(x as f64, y as f64) - origin_px) / 100.0;
            let level = f64::from(base) + mean;
            let _ = squares[usize::from(square.is_dark)].push(Square {
                node: square.node,
                place: Vector3::new(1.0, offset.x, offset.y),
                level,
            });
        }
        let of_means =
            scatters.map(|scatter| scatter.variance(&Vector2::zeros()) / pixels_per_square);
        let floor = 0.5
            * DEVIATION_IN_NOISE_MIN
            * DEVIATION_IN_NOISE_MIN
            * pixels_per_square
            * (of_means[0] + of_means[1]);
        let light = Plane::fit(&squares[0], of_means[0], floor)?;
        let dark = Plane::fit(&squares[1], of_means[1], floor)?;
        let noise = Noise {
            light: scatters[0].variance(&light.per_px()),
            dark: scatters[1].variance(&dark.per_px()),
        };
        let mut agree = [false; TARGET_NODES_MAX];
        for ((plane, of_mean), squares) in [light, dark].iter().zip(of_means).zip(&squares) {
            for square in squares {
                let off = square.level - plane.coefficients.dot(&square.place);
                let is_near = off * off < AGREEMENT_SQUARE * (plane.variance + of_mean);
                agree[usize::from(square.node)] = is_near;
            }
        }
        let sum = light.coefficients.sum() + dark.coefficients.sum() + noise.middle();
        sum.is_finite().then_some(Self {
            origin_px,
            light,
            dark,
            certainty: Certainty {
                light_weight: noise.middle() / light.variance,
                dark_weight: noise.middle() / dark.variance,
                noise_contrast: noise.contrast(),
                noise_variance: noise.middle(),
            },
            is_even: light.is_borne_out(noise.light) && dark.is_borne_out(noise.dark),
            agree,
        })
    }

    /// The levels at an edge whose middle is at a place in the picture; `None` where one of its
    /// squares does not agree with them.
    pub(super) fn beside(
        &self,
        nodes: &Nodes,
        edge: &Edge,
        raw_px: &Vector2<f64>,
    ) -> Option<Levels> {
        if nodes.squares_beside(edge).any(|square| !self.agree[usize::from(square)]) {
            return None;
        }
        Some(self.at(raw_px))
    }

    /// The planes' levels at a place in the picture.
    fn at(&self, raw_px: &Vector2<f64>) -> Levels {
        let offset = (raw_px - self.origin_px) / 100.0;
        let place = Vector3::new(1.0, offset.x, offset.y);
        let [light, dark] = [self.light, self.dark].map(|plane| plane.coefficients.dot(&place));
        let (mean_per_px, contrast_per_px) = if self.is_even && light > dark {
            let [light_per_px, dark_per_px] = [self.light, self.dark].map(|plane| plane.per_px());
            ((light_per_px + dark_per_px) * 0.5, (light_per_px - dark_per_px) / (light - dark))
        } else {
            (Vector2::zeros(), Vector2::zeros())
        };
        Levels { light, dark, mean_per_px, contrast_per_px, certainty: self.certainty }
    }
}

/// Half width of the window in the middle of a square of this width.
fn reach_px(width_px: f64, blur_px: f64) -> usize {
    let small = ((REACH_SHARE * width_px) as usize).min(SMALL_REACH_PX_MAX);
    // A window that is turned by an eighth of a turn against the square reaches sqrt 2 farther.
    let clear_px = 0.5 * width_px - CLEAR_OF_EDGES * blur_px;
    let clear = (clear_px * core::f64::consts::FRAC_1_SQRT_2) as usize;
    clear.min(REACH_PX_MAX).max(small)
}

impl Plane {
    /// Robust: squares that something covers do not count. `of_mean` is the variance that the
    /// pixels' noise gives each level, `floor` the smallest variance of the result. `None` where the
    /// levels do not scatter at all, as those of a drawing: they would have no variance.
    fn fit(squares: &[Square], of_mean: f64, floor: f64) -> Option<Self> {
        if squares.len() < SQUARES_MIN {
            return None;
        }
        let mut levels: Vec<f64, TARGET_SQUARES_MAX> =
            squares.iter().map(|square| square.level).collect();
        let mut coefficients = Vector3::new(median(&mut levels, f64::total_cmp)?, 0.0, 0.0);
        let mut variance = 0.0;
        for _ in 0..ITERATIONS {
            let mut scatter: Vec<f64, TARGET_SQUARES_MAX> = squares
                .iter()
                .map(|square| {
                    let off = square.level - coefficients.dot(&square.place);
                    off * off
                })
                .collect();
            // The median of a squared normal is 0.455 of its variance.
            variance = (median(&mut scatter, order_of_positive)? / 0.455).max(of_mean);
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for square in squares {
                let off = square.level - coefficients.dot(&square.place);
                // Tukey's biweight, which vanishes at 5 standard deviations.
                let left = (1.0 - off * off / (25.0 * variance)).max(0.0);
                let weight = left * left;
                normal += square.place * square.place.transpose() * weight;
                right += square.place * (square.level * weight);
            }
            coefficients = normal.cholesky()?.solve(&right);
        }
        let levels = || squares.iter().map(|square| coefficients.dot(&square.place));
        let mean = levels().sum::<f64>() / squares.len() as f64;
        let spread = levels().map(|level| (level - mean) * (level - mean)).sum::<f64>();
        Some(Self {
            coefficients,
            variance: (variance - of_mean).max(floor),
            spread: spread / squares.len() as f64,
        })
    }

    /// Whether the squares scatter about the plane no more than pixels do within a square, or much
    /// less than they would without a slope. With a shadow's edge through the middle, even the best
    /// plane leaves a quarter of the squares' variance.
    fn is_borne_out(&self, noise_variance: f64) -> bool {
        self.variance < noise_variance + SLOPELESS_SHARE * self.spread
    }

    fn per_px(&self) -> Vector2<f64> {
        self.coefficients.yz() / 100.0
    }
}

#[cfg(test)]
mod tests;
