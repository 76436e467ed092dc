//! How a frame and the targets in it look: how bright, how sharp, how large. This serves to aim,
//! focus and expose a camera; it is not needed for a pose.
//!
//! Levels are fractions of the white level, 0 to 1.

use nalgebra::Vector2;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::fit::nodes::Nodes;
use crate::model::image::{GreyImage, Pixel};
use crate::model::target::Role;

/// One row in this many is sampled for the frame as a whole.
const ROW_STEP: usize = 4;

/// Half the distances over which grey levels are compared: within an edge, and across all
/// of it.
const NEAR_PX: usize = 1;
const FAR_PX: usize = 4;

/// Smallest difference that counts as an edge, as a fraction of the white level.
const EDGE_MIN: f32 = 0.1;

/// Fewest places at edges from which their blur is estimated.
const EDGE_PLACES_MIN: u32 = 100;

/// The range of blurs that [`edge_blur_px`] covers.
const BLUR_PX: [f64; 2] = [0.2, 12.0];

/// Half width of the window in a square's middle, as a share of the square, and its upper bound.
const REACH_SHARE: f64 = 0.25;
const REACH_PX_MAX: usize = 8;

/// A frame as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FrameView {
    /// Mean level.
    pub level: f32,
    /// Part of the pixels that are at the white level.
    pub saturated: f32,
    /// Standard deviation of the blur of the edges that cross its rows, whatever they belong to,
    /// raw pixels; `None` where there are hardly any.
    pub blur_px: Option<f32>,
}

/// A target in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct TargetView {
    /// Which target.
    pub role: Role,
    /// Mean level of the light squares.
    pub light: f32,
    /// Mean level of the dark squares.
    pub dark: f32,
    /// Part of the light squares' pixels that are at the white level.
    pub saturated: f32,
    /// Standard deviation of the blur of its edges, the pixel's own extent included, raw
    /// pixels: of the edges along its x axis, and along y.
    pub blur_px: [f32; 2],
    /// Mean distance of two corners, raw pixels.
    pub pitch_px: f32,
}

/// How a frame looks as a whole.
#[must_use]
pub(crate) fn frame_view<P: Pixel>(image: &GreyImage<'_, P>) -> FrameView {
    let white = f32::from(image.white_level());
    let white_sample = u32::from(image.white_level());
    let (mut sum, mut saturated, mut pixels) = (0.0_f64, 0_u32, 0_u32);
    let (mut near, mut far, mut places) = (0.0_f64, 0.0_f64, 0_u32);
    for y in (0..image.height()).step_by(ROW_STEP) {
        let row = image.row(y);
        // Single precision is faster, and enough for a row, but not for a frame.
        let (mut row_sum, mut row_near, mut row_far) = (0.0_f32, 0.0_f32, 0.0_f32);
        for &pixel in row {
            row_sum += Into::<f32>::into(pixel);
            saturated += u32::from(Into::<u32>::into(pixel) >= white_sample);
        }
        sum += f64::from(row_sum / white / row.len() as f32);
        pixels += row.len() as u32;
        for x in FAR_PX..row.len() - FAR_PX {
            let difference = |reach: usize| -> f32 {
                let [after, before]: [f32; 2] = [row[x + reach].into(), row[x - reach].into()];
                (after - before) / white
            };
            let across = difference(FAR_PX);
            if across.abs() >= EDGE_MIN {
                let within = difference(NEAR_PX);
                row_near += within * within;
                row_far += across * across;
                places += 1;
            }
        }
        near += f64::from(row_near);
        far += f64::from(row_far);
    }
    let rows = image.height().div_ceil(ROW_STEP);
    FrameView {
        level: (sum / rows as f64) as f32,
        saturated: saturated as f32 / pixels as f32,
        blur_px: (places >= EDGE_PLACES_MIN).then(|| edge_blur_px(near / far) as f32),
    }
}

/// The blur of a step, by the ratio of the sums of its squared differences over twice
/// [`NEAR_PX`] and over twice [`FAR_PX`].
///
/// Over a distance d the sum is that of a box of width d, blurred, squared:
/// d erf(d / 2s) - 2s / sqrt(pi) (1 - exp(-d^2 / 4s^2)). The ratio falls with s.
fn edge_blur_px(ratio: f64) -> f64 {
    let sum = |reach: usize, sigma: f64| {
        let half = reach as f64 / sigma;
        let tail = -libm::expm1(-half * half);
        2.0 * reach as f64 * libm::erf(half)
            - 2.0 * sigma / libm::sqrt(core::f64::consts::PI) * tail
    };
    let [mut sharp, mut blurred] = BLUR_PX;
    // To half a thousandth of a pixel.
    for _ in 0..15 {
        let middle = 0.5 * (sharp + blurred);
        if sum(NEAR_PX, middle) / sum(FAR_PX, middle) > ratio {
            sharp = middle;
        } else {
            blurred = middle;
        }
    }
    0.5 * (sharp + blurred)
}

/// What the squares of a target show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Squares {
    /// Mean level of the light ones.
    pub light: f32,
    /// Mean level of the dark ones.
    pub dark: f32,
    /// Part of the light ones' pixels that are at the white level.
    pub saturated: f32,
    /// Mean distance of two corners.
    pub pitch_px: f32,
}

/// Measures the middle of each square; `None` where no square of one of the colours is inside the
/// frame.
#[must_use]
pub(crate) fn squares<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    first_square_dark: bool,
) -> Option<Squares> {
    let white = f32::from(image.white_level());
    let mut sums = [0.0_f64; 2];
    let mut counts = [0_u32; 2];
    let mut saturated = 0_u32;
    for square in nodes.squares(first_square_dark) {
        let reach = ((REACH_SHARE * square.width_px) as usize).min(REACH_PX_MAX);
        let Some((x, y)) = image.window_centre(square.middle_px.into(), reach) else { continue };
        for row in y - reach..=y + reach {
            for &pixel in &image.row(row)[x - reach..=x + reach] {
                sums[usize::from(square.is_dark)] += f64::from(Into::<f32>::into(pixel) / white);
                let is_white = Into::<u32>::into(pixel) >= u32::from(image.white_level());
                saturated += u32::from(is_white && !square.is_dark);
            }
        }
        counts[usize::from(square.is_dark)] += (2 * reach as u32 + 1).pow(2);
    }
    if counts.contains(&0) {
        return None;
    }
    let level = |colour: usize| (sums[colour] / f64::from(counts[colour])) as f32;
    Some(Squares {
        light: level(0),
        dark: level(1),
        saturated: saturated as f32 / counts[0] as f32,
        pitch_px: pitch_px(nodes)?,
    })
}

/// Mean length of the grid's steps in the picture.
fn pitch_px(nodes: &Nodes) -> Option<f32> {
    let (mut sum, mut count) = (0.0, 0_u32);
    for edge in nodes.edges(true) {
        let [start, end] = edge.nodes.map(|node| nodes.as_slice()[usize::from(node)].raw_px);
        let step: Vector2<f64> = end - start;
        sum += step.norm();
        count += 1;
    }
    (count > 0).then(|| (sum / f64::from(count)) as f32)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use super::*;
    use crate::model::pose::Pose;
    use crate::model::target::{Origin, TargetGeometry};
    use crate::test_support::{Random, bedside_lens, table};

    /// Vertical stripes of 24 px, blurred, with noise.
    fn stripes(blur_px: f64, dark: f64, light: f64) -> Vec<u8> {
        let mut random = Random::new(7);
        let edge = |distance: f64| 0.5 * (1.0 + libm::erf(distance / blur_px / libm::sqrt(2.0)));
        let mut pixel = |x: usize| {
            let within = (x % 48) as f64;
            let part = edge(within - 11.5) - edge(within - 35.5);
            dark + (light - dark) * part + 2.0 * random.normal()
        };
        (0..480 * 64).map(|at| pixel(at % 480).clamp(0.0, 255.0) as u8).collect()
    }

    #[test]
    fn the_blur_of_a_frame_is_that_of_its_edges() {
        for blur_px in [0.5, 0.7, 1.0, 1.5, 2.5] {
            let pixels = stripes(blur_px, 40.0, 200.0);
            let view = frame_view(&GreyImage::new(&pixels, 480, 64, 480).unwrap());
            let found_px = f64::from(view.blur_px.unwrap());
            // Only a few places have a difference just above the threshold.
            assert!((found_px / blur_px - 1.0).abs() < 0.08, "{blur_px} px: {found_px}");
        }
    }

    #[test]
    fn a_frame_says_how_bright_it_is_and_nothing_of_a_blur_it_cannot_see() {
        let pixels = stripes(0.7, 0.0, 300.0);
        let view = frame_view(&GreyImage::new(&pixels, 480, 64, 480).unwrap());
        // A little less than half is white: the edges are blurred.
        assert!((0.45..0.5).contains(&view.saturated), "{view:?}");
        let grey = [64_u16; 100 * 64];
        let image = GreyImage::with_white_level(&grey, 100, 64, 100, 128).unwrap();
        let expected = FrameView { level: 0.5, saturated: 0.0, blur_px: None };
        assert_eq!(frame_view(&image), expected);
    }

    /// A target of 12 mm squares, seen straight on from here.
    fn seen_from(translation_mm: [f64; 3]) -> Nodes {
        let origin = Origin::Center;
        let target = TargetGeometry::checker(3, 4, 12.0, origin, Role::Upper, [0.0; 3]).unwrap();
        let [x, y, z] = translation_mm;
        let pose = Pose::from_theta([0.0, 0.0, 0.0, x, y, z]);
        let mut nodes = Nodes::new();
        assert!(nodes.project(&table(&bedside_lens()), &target, &pose));
        nodes
    }

    /// Only the middles of the squares count, of those that are wholly in the frame: here they are white in
    /// their upper half where the square is light, and dark in all dark ones but the first, which is white.
    /// Everything else has a level that none of them has.
    #[test]
    fn a_targets_levels_are_those_of_its_squares_middles() {
        const WHITE: u16 = 1000;
        let (width, height) = (1456, 1088);
        for (translation_mm, reach, inside) in [
            // Squares of 23 px, and of 70 px.
            ([10.0, -5.0, 900.0], 5, 20),
            ([10.0, -5.0, 300.0], REACH_PX_MAX, 20),
        ] {
            let nodes = seen_from(translation_mm);
            let mut pixels = std::vec![900; width * height];
            let (mut lights, mut darks) = (0, 0);
            for square in nodes.squares(true) {
                let [x, y] = <[f64; 2]>::from(square.middle_px).map(|it| it.round() as isize);
                let (x, y) = (x as usize, y as usize);
                darks += u32::from(square.is_dark);
                lights += u32::from(!square.is_dark);
                for row in y - reach..=y + reach {
                    let level = match square.is_dark {
                        true if darks == 1 => WHITE,
                        true => 100,
                        false if row <= y => WHITE,
                        false => 500,
                    };
                    pixels[row * width + x - reach..][..2 * reach + 1].fill(level);
                }
            }
            assert_eq!(lights + darks, inside);
            let image = GreyImage::with_white_level(&pixels, width, height, width, WHITE).unwrap();
            let found = squares(&image, &nodes, true).unwrap();
            let (side, upper) = ((2 * reach + 1) as f32, (reach + 1) as f32);
            let near = |found: f32, expected: f32| (found - expected).abs() < 1e-5;
            assert!(near(found.saturated, upper / side), "{found:?}");
            assert!(near(found.light, (upper + 0.5 * (side - upper)) / side), "{found:?}");
            let darks = darks as f32;
            assert!(near(found.dark, (1.0 + 0.1 * (darks - 1.0)) / darks), "{found:?}");
            let pitch_px = (12.0 * 1740.0 / translation_mm[2]) as f32;
            assert!((found.pitch_px / pitch_px - 1.0).abs() < 0.03, "{found:?}");
        }
    }

    #[test]
    fn a_target_that_is_not_seen_has_no_levels() {
        let pixels = [0_u8; 100 * 64];
        let image = GreyImage::new(&pixels, 100, 64, 100).unwrap();
        assert_eq!(squares(&image, &Nodes::new(), true), None);
        assert_eq!(pitch_px(&Nodes::new()), None);
        // All of it is outside so small a frame.
        assert_eq!(squares(&image, &seen_from([10.0, -5.0, 900.0]), true), None);
    }
}
