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
        (sum.is_finite() && light.variance > 0.0 && dark.variance > 0.0).then_some(Self {
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
    /// pixels' noise gives each level, `floor` the smallest variance of the result.
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
mod tests {
    extern crate std;
    use std::vec::Vec as Pixels;

    use super::*;
    use crate::fit::edge::rendered::{HEIGHT, Scene, WHITE, WIDTH, image};
    use crate::test_support::Random;

    const NOISE: f64 = 0.01;

    fn lit() -> Scene {
        Scene { light_gain: 0.2, dark_gain: -0.05, ..Scene::new(21.0, 0.2, 0.15) }
    }

    fn measured(scene: &Scene, pixels: &[u16]) -> Option<Light> {
        Light::measure(&image(pixels), &scene.nodes(&scene.cam_from_target), true, scene.blur_px())
    }

    /// Largest errors of the light and the dark level at the target's corners, parts of white.
    fn errors(scene: &Scene, light: &Light) -> [f64; 2] {
        let mut worst = [0.0_f64; 2];
        for node in scene.nodes(&scene.cam_from_target).as_slice() {
            let part = node.raw_px.x / f64::from(WIDTH) - 0.5;
            let levels = light.at(&node.raw_px);
            let true_light = scene.light + scene.light_gain * part;
            let true_dark = scene.dark + scene.dark_gain * part;
            let white = f64::from(WHITE);
            worst[0] = worst[0].max((levels.light / white - true_light).abs());
            worst[1] = worst[1].max((levels.dark / white - true_dark).abs());
        }
        worst
    }

    #[test]
    fn planes_follow_light_and_dark_separately() {
        let scene = lit();
        let picture = scene.render();
        let exact = measured(&scene, &picture.noise_free()).unwrap();
        let mut random = Random::new(3);
        let mut squares = [0.0; 2];
        for _ in 0..100 {
            let light = measured(&scene, &picture.sampled(NOISE, &mut random)).unwrap();
            for (square, error) in squares.iter_mut().zip(errors(&scene, &light)) {
                *square += error * error / 100.0;
            }
        }
        let rms = squares.map(|square| libm::sqrt(square) / NOISE);
        assert!(errors(&scene, &exact).iter().all(|error| *error < 2e-3));
        // Ten squares of 49 pixels each: 1 / sqrt(490) = 0.045 of the noise in their middle,
        // and some four times as much at the worst node, beyond the squares' middles.
        assert!(rms.iter().all(|rms| *rms < 0.2), "{rms:?}");
    }

    #[test]
    fn what_covers_a_third_of_the_squares_changes_nothing() {
        let scene = lit();
        let picture = scene.render();
        let mut pixels = picture.sampled(NOISE, &mut Random::new(4));
        // A grey hand over the left column and some of the last row.
        let width = usize::from(WIDTH);
        for (place, pixel) in pixels.iter_mut().enumerate() {
            let (x, y) = (place % width, place / width);
            if x < 70 || (y > 100 && x < 92) {
                *pixel = WHITE / 2;
            }
        }
        let after = measured(&scene, &pixels).unwrap();
        // At the worst node, in the noise of one pixel: see above.
        let worst = errors(&scene, &after).map(|error| error / NOISE);
        assert!(worst.iter().all(|worst| *worst < 0.7), "{worst:?}");
    }

    #[test]
    fn a_plane_is_hardly_believed_where_half_of_its_squares_are_in_the_shade() {
        let scene = lit();
        let pixels = scene.render().sampled(NOISE, &mut Random::new(5));
        let open = measured(&scene, &pixels).unwrap().at(&Vector2::new(100.0, 80.0));
        let width = usize::from(WIDTH);
        let shaded: Pixels<u16> = pixels
            .iter()
            .enumerate()
            .map(
                |(place, &pixel)| {
                    if place % width + place / width < 180 { pixel / 2 } else { pixel }
                },
            )
            .collect();
        let levels = measured(&scene, &shaded).unwrap().at(&Vector2::new(100.0, 80.0));
        let Certainty { light_weight, dark_weight, .. } = open.certainty;
        assert!(light_weight > 20.0 && dark_weight > 20.0, "{open:?}");
        assert!(levels.certainty.light_weight < 3.0, "{levels:?}");
        // Nor are its slopes, which are not those of the light.
        assert_eq!(
            (levels.mean_per_px, levels.contrast_per_px),
            (Vector2::zeros(), Vector2::zeros())
        );
    }

    #[test]
    fn too_few_squares_are_none() {
        let scene = lit();
        let pixels = scene.render().noise_free();
        // Two columns of squares inside the frame: four of each colour.
        let moved = Scene { cam_from_target: scene.moved_px([116.0, 0.0]), ..scene.clone() };
        assert!(measured(&moved, &pixels).is_none());
        let outside = scene.moved_px([0.0, f64::from(HEIGHT) * 2.0]);
        assert!(measured(&Scene { cam_from_target: outside, ..scene.clone() }, &pixels).is_none());
        // Squares whose middle is a single pixel.
        let tiny = Scene::new(4.5, 0.0, 0.0);
        assert!(measured(&tiny, &tiny.render().noise_free()).is_none());
        assert!(Light::measure(&image(&pixels), &Nodes::new(), true, 0.7).is_none());
    }

    #[test]
    fn the_middle_noise_and_its_contrast_are_those_of_both_levels() {
        let of = |light, dark| {
            let noise = Noise { light, dark };
            (noise.middle(), noise.contrast())
        };
        // Halfway between 6 and 2 are 4, from which either is half of 4 away.
        assert_eq!(of(6.0, 2.0), (4.0, 0.5));
        assert_eq!(of(2.0, 6.0), (4.0, -0.5));
        assert_eq!(of(3.0, 3.0), (3.0, 0.0));
        // Black pixels that seem to have no noise, saturated ones, and a drawing.
        assert_eq!(of(2.0, 0.0), (1.0, 0.8));
        assert_eq!(of(0.0, 2.0), (1.0, -0.8));
        assert_eq!(of(0.0, 0.0), (0.0, 0.0));
    }

    #[test]
    fn the_noise_of_a_blur_is_that_of_a_pixel_in_half_the_contrast() {
        let certainty = Certainty {
            light_weight: 1.0,
            dark_weight: 1.0,
            noise_contrast: 0.0,
            noise_variance: 8.0,
        };
        let levels = Levels {
            light: 7.0,
            dark: 3.0,
            mean_per_px: Vector2::zeros(),
            contrast_per_px: Vector2::zeros(),
            certainty,
        };
        // Half the contrast is 2; so that its square differs from its double, also 3.
        assert_eq!(levels.noise_per_contrast(), 8.0 / 4.0);
        assert_eq!(Levels { light: 9.0, ..levels }.noise_per_contrast(), 8.0 / 9.0);
    }

    #[test]
    fn a_window_is_clear_of_the_blur_and_bounded() {
        for (width_px, blur_px, expected) in [
            // Too small for a window.
            (4.9, 1.0, 0),
            // A fifth of the width, where the blur leaves less.
            (5.1, 1.0, 1),
            (10.1, 1.6, 2),
            (18.0, 2.8, 3),
            (60.0, 9.9, 3),
            // (0.5 width - 3 blurs) / sqrt 2, which is 3.96, 4.10, 5.98 and 7.07.
            (17.2, 1.0, 3),
            (17.6, 1.0, 4),
            (21.0, 0.68, 5),
            (32.0, 2.0, 6),
        ] {
            assert_eq!(reach_px(width_px, blur_px), expected, "{width_px} {blur_px}");
        }
    }

    /// A plane with the level, its increase per 100 px, and the variance of squares about it.
    fn plane(coefficients: [f64; 3], variance: f64, spread: f64) -> Plane {
        Plane { coefficients: coefficients.into(), variance, spread }
    }

    #[test]
    fn a_plane_is_borne_out_by_little_scatter_or_a_large_slope() {
        for (variance, noise, spread, is_borne_out) in [
            (1.9, 2.0, 0.0, true),
            (2.1, 2.0, 0.0, false),
            (2.1, 2.0, 16.0, true),
            (3.1, 2.0, 16.0, false),
            (0.9, 0.0, 16.0, true),
        ] {
            let plane = plane([0.0; 3], variance, spread);
            assert_eq!(plane.is_borne_out(noise), is_borne_out, "{variance} {noise} {spread}");
        }
    }

    #[test]
    fn levels_and_slopes_are_those_of_the_planes() {
        let certainty = Certainty {
            light_weight: 1.0,
            dark_weight: 1.0,
            noise_contrast: 0.0,
            noise_variance: 1.0,
        };
        let (light, dark) =
            (plane([90.0, 20.0, 40.0], 1.0, 0.0), plane([30.0, 4.0, -8.0], 1.0, 0.0));
        let even = Light {
            origin_px: Vector2::new(50.0, 150.0),
            light,
            dark,
            certainty,
            is_even: true,
            agree: [true; TARGET_NODES_MAX],
        };
        // Half a hundred pixels right and below.
        let place_px = Vector2::new(100.0, 200.0);
        let levels = even.at(&place_px);
        assert_eq!((levels.light, levels.dark), (120.0, 28.0));
        // The mean increases by 0.12 per px and by 0.16, the difference of 92 by 0.16 and by 0.48.
        assert!((levels.mean_per_px - Vector2::new(0.12, 0.16)).norm() < 1e-15);
        assert!((levels.contrast_per_px - Vector2::new(0.16, 0.48) / 92.0).norm() < 1e-15);
        let zero = (Vector2::zeros(), Vector2::zeros());
        // Where they are not confirmed, and where light is not lighter, there are no slopes.
        let uneven = Light { is_even: false, ..even };
        let swapped = Light { light: dark, dark: light, ..even };
        let equal = Light { dark: light, ..even };
        for light in [uneven, swapped, equal] {
            let levels = light.at(&place_px);
            assert_eq!((levels.mean_per_px, levels.contrast_per_px), zero);
        }
    }

    fn square(place: [f64; 2], level: f64) -> Square {
        Square { node: 0, place: Vector3::new(1.0, place[0], place[1]), level }
    }

    /// The reweighted fit by its definition, from the median on.
    fn plane_by_definition(squares: &[Square], of_mean: f64, floor: f64) -> Plane {
        let median = |mut values: Pixels<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let all = |of: &dyn Fn(&Square) -> f64| squares.iter().map(of).collect::<Pixels<f64>>();
        let mut coefficients = Vector3::new(median(all(&|it| it.level)), 0.0, 0.0);
        let mut variance = 0.0;
        for _ in 0..4 {
            let off = |it: &Square| it.level - coefficients.dot(&it.place);
            variance = (median(all(&|it| off(it).powi(2))) / 0.455).max(of_mean);
            // Tukey's biweight of the distance in 5 standard deviations.
            let weights = all(&|it| match off(it).powi(2) / variance / 25.0 {
                share if share < 1.0 => (1.0 - share).powi(2),
                _ => 0.0,
            });
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for (it, weight) in squares.iter().zip(weights) {
                normal += weight * it.place * it.place.transpose();
                right += weight * it.level * it.place;
            }
            coefficients = normal.try_inverse().unwrap() * right;
        }
        let levels = all(&|it| coefficients.dot(&it.place));
        let count = levels.len() as f64;
        let mean = levels.iter().sum::<f64>() / count;
        let spread = levels.iter().map(|level| level * level).sum::<f64>() / count - mean * mean;
        let variance = if variance - of_mean > floor { variance - of_mean } else { floor };
        Plane { coefficients, variance, spread }
    }

    fn assert_same(one: &Plane, other: &Plane, relative: f64) {
        let is_same = |one: f64, other: f64| (one - other).abs() <= relative * other.abs();
        let off = (one.coefficients - other.coefficients).norm();
        assert!(off <= relative * other.coefficients.norm(), "{one:?} {other:?}");
        assert!(is_same(one.variance, other.variance), "{one:?} {other:?}");
        assert!(is_same(one.spread, other.spread), "{one:?} {other:?}");
    }

    #[test]
    fn a_plane_is_fitted_by_tukeys_biweight() {
        let mut random = Random::new(32);
        for case in 0..200 {
            let count = 5 + case % 6;
            let squares: Pixels<Square> = (0..count)
                .map(|place| {
                    let place = [0.3 * (place % 3) as f64 - 0.3, 0.25 * (place / 3) as f64];
                    let wrong = if random.uniform(0.0, 1.0) < 0.1 { 9.0 } else { 0.0 };
                    let level = 100.0 + 8.0 * place[0] - 5.0 * place[1] + random.normal() + wrong;
                    square(place, level)
                })
                .collect();
            let of_mean = random.uniform(0.0, 0.5);
            let floor = random.uniform(0.0, 0.5);
            let expected = plane_by_definition(&squares, of_mean, floor);
            // Rounding, in the inverse of a matrix whose condition is some hundred.
            assert_same(&Plane::fit(&squares, of_mean, floor).unwrap(), &expected, 1e-9);
        }
        // Four squares do not tell whether one of them is wrong.
        let four = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let four = four.map(|place| square(place, 100.0 + place[0]));
        assert!(Plane::fit(&four, 0.1, 0.1).is_none());
    }

    /// What the squares of one colour tell by the definitions: themselves, the variance of pixels, and
    /// both sums from which that is.
    struct Colour {
        squares: Pixels<Square>,
        deviations: f64,
        distances_px2: f64,
        degrees_of_freedom: f64,
    }

    impl Colour {
        fn of(scene: &Scene, pixels: &[u16], origin_px: &Vector2<f64>, is_dark: bool) -> Self {
            let nodes = scene.nodes(&scene.cam_from_target);
            let mut colour = Self {
                squares: Pixels::new(),
                deviations: 0.0,
                distances_px2: 0.0,
                degrees_of_freedom: 0.0,
            };
            for found in nodes.squares(true).filter(|square| square.is_dark == is_dark) {
                // Windows of 11 x 11 pixels.
                assert_eq!(reach_px(found.width_px, scene.blur_px()), 5);
                let middle_px = found.middle_px.map(f64::round);
                let window: Pixels<[f64; 2]> = (0..121)
                    .map(|place| {
                        let [x, y] = [place % 11, place / 11].map(|at| f64::from(at) - 5.0);
                        let (column, row) = (middle_px.x + x, middle_px.y + y);
                        let at = row as usize * usize::from(WIDTH) + column as usize;
                        [x, f64::from(pixels[at])]
                    })
                    .collect();
                let mean = window.iter().map(|[_, level]| level).sum::<f64>() / 121.0;
                colour.deviations += window.iter().map(|[_, it]| (it - mean).powi(2)).sum::<f64>();
                colour.distances_px2 += window.iter().map(|[x, _]| x * x).sum::<f64>();
                colour.degrees_of_freedom += 120.0;
                let offset = (middle_px - origin_px) / 100.0;
                let place = Vector3::new(1.0, offset.x, offset.y);
                colour.squares.push(Square { node: found.node, place, level: mean });
            }
            colour
        }

        /// The variance of pixels about a slope.
        fn variance(&self, per_px: &Vector2<f64>) -> f64 {
            let sloping = per_px.norm_squared() * self.distances_px2;
            (self.deviations - sloping).max(0.0) / self.degrees_of_freedom
        }
    }

    #[test]
    fn the_light_is_measured_as_it_is_defined() {
        // A slope of the light that scatters pixels as much as their noise does.
        let scene =
            Scene { dark_gain: 0.1, ..Scene { light_gain: 0.4, ..Scene::new(21.0, 0.0, 0.1) } };
        let picture = scene.render();
        let mut random = Random::new(33);
        let (mut agreeing, mut floors) = (0, 0);
        for case in 0..30 {
            let noise = [0.001, 0.003, 0.01][case % 3];
            let mut pixels = picture.sampled(noise, &mut random);
            // Something paler or darker over the upper left.
            let gone = [0.0, 1.0, 3.0, 10.0, 100.0][case % 5] * noise * f64::from(WHITE);
            let width = usize::from(WIDTH);
            for (place, pixel) in pixels.iter_mut().enumerate() {
                if place % width + place / width < 130 {
                    *pixel = (f64::from(*pixel) - gone).max(0.0) as u16;
                }
            }
            let light = measured(&scene, &pixels).unwrap();
            let colours =
                [false, true].map(|dark| Colour::of(&scene, &pixels, &light.origin_px, dark));
            let [of_light, of_dark] = &colours;
            let apart = colours.each_ref().map(|colour| colour.variance(&Vector2::zeros()));
            // A twentieth of the pixels' deviation.
            let floor = 0.05 * 0.05 * (apart[0] + apart[1]) / 2.0;
            let planes = [of_light, of_dark].map(|colour| {
                let of_mean = colour.variance(&Vector2::zeros()) / 121.0;
                Plane::fit(&colour.squares, of_mean, floor).unwrap()
            });
            for (plane, expected) in [light.light, light.dark].iter().zip(&planes) {
                // Sums of 121 numbers in 24 bits.
                assert_same(plane, expected, 1e-4);
                floors += usize::from(expected.variance == floor);
            }
            let variances =
                [of_light.variance(&planes[0].per_px()), of_dark.variance(&planes[1].per_px())];
            let noise = Noise { light: variances[0], dark: variances[1] };
            let expected = [
                noise.middle(),
                noise.middle() / planes[0].variance,
                noise.middle() / planes[1].variance,
                1.0 + noise.contrast(),
            ];
            let Certainty { light_weight, dark_weight, noise_contrast, noise_variance } =
                light.certainty;
            let found = [noise_variance, light_weight, dark_weight, 1.0 + noise_contrast];
            for (found, expected) in found.iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
            }
            for (colour, (plane, variance)) in colours.iter().zip(planes.iter().zip(apart)) {
                for square in &colour.squares {
                    let off = square.level - plane.coefficients.dot(&square.place);
                    let agrees = off * off < 16.0 * (plane.variance + variance / 121.0);
                    assert_eq!(light.agree[usize::from(square.node)], agrees, "{off}");
                    agreeing += usize::from(agrees);
                }
            }
        }
        // Of 20 squares in each of 30 pictures.
        assert!((500..580).contains(&agreeing), "{agreeing}");
        assert!(floors > 5, "{floors}");
    }
}
