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
        .map(|(place, &pixel)| if place % width + place / width < 180 { pixel / 2 } else { pixel })
        .collect();
    let levels = measured(&scene, &shaded).unwrap().at(&Vector2::new(100.0, 80.0));
    let Certainty { light_weight, dark_weight, .. } = open.certainty;
    assert!(light_weight > 20.0 && dark_weight > 20.0, "{open:?}");
    assert!(levels.certainty.light_weight < 3.0, "{levels:?}");
    // Nor are its slopes, which are not those of the light.
    assert_eq!((levels.mean_per_px, levels.contrast_per_px), (Vector2::zeros(), Vector2::zeros()));
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
fn levels_without_any_scatter_have_no_precision() {
    // A drawing, the pixels of whose squares are all alike: only levels that scatter from square to square
    // have a variance.
    let scene = Scene { light_gain: 0.0, dark_gain: 0.0, ..Scene::new(21.0, 0.0, 0.0) };
    let nodes = scene.nodes(&scene.cam_from_target);
    let width = usize::from(WIDTH);
    let measured = |scatter: [u16; 2]| {
        let mut pixels = std::vec![WHITE / 2; width * usize::from(HEIGHT)];
        for (number, square) in nodes.squares(true).enumerate() {
            let level = [700, 200][usize::from(square.is_dark)]
                + scatter[usize::from(square.is_dark)] * (number * number % 7) as u16;
            let [x, y] = <[f64; 2]>::from(square.middle_px).map(|at| at as usize);
            for row in y - 8..y + 8 {
                pixels[row * width + x - 8..][..16].fill(level);
            }
        }
        Light::measure(&image(&pixels), &nodes, true, scene.blur_px())
    };
    for scatter in [[0, 0], [9, 0], [0, 9]] {
        assert!(measured(scatter).is_none(), "{scatter:?}");
    }
    assert!(measured([9, 9]).is_some());
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
    let certainty =
        Certainty { light_weight: 1.0, dark_weight: 1.0, noise_contrast: 0.0, noise_variance: 8.0 };
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
    let certainty =
        Certainty { light_weight: 1.0, dark_weight: 1.0, noise_contrast: 0.0, noise_variance: 1.0 };
    let (light, dark) = (plane([90.0, 20.0, 40.0], 1.0, 0.0), plane([30.0, 4.0, -8.0], 1.0, 0.0));
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
    let scene = Scene { dark_gain: 0.1, ..Scene { light_gain: 0.4, ..Scene::new(21.0, 0.0, 0.1) } };
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
        let colours = [false, true].map(|dark| Colour::of(&scene, &pixels, &light.origin_px, dark));
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
