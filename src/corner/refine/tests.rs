extern crate std;

use core::f64::consts::{FRAC_PI_2, PI, TAU};
use std::vec::Vec;

use super::rendered::{Random, SIDE, Scene, fine_image, image};
use super::*;
use crate::test_support::repetitions;

/// The tilt that brings the edges of a square to 53 degrees.
const TILT_RAD: f64 = PI / 3.0;

/// Root-mean-square spread per coordinate and length of the mean error, px, and
/// the root mean square of the sigma reported, over pictures with noise 2.
struct Sampled {
    spread_px: f64,
    bias_px: f64,
    sigma_px: f64,
}

fn sample(scene: &Scene, radius_px: usize, method: Refinement, pictures: usize) -> Sampled {
    let picture = scene.render();
    let mut random = Random(1);
    let (mut sums, mut squares, mut variances) = ([0.0; 2], 0.0, 0.0);
    for _ in 0..pictures {
        let pixels = picture.sampled(2.0, &mut random);
        let mut seed = scene.seed(radius_px);
        for value in &mut seed.position_px {
            *value += random.uniform() - 0.5;
        }
        let corner = refine(&image(&pixels), &seed, method).unwrap();
        for (axis, sum) in sums.iter_mut().enumerate() {
            let error_px = corner.position_px[axis] - scene.position_px[axis];
            *sum += error_px;
            squares += error_px * error_px;
        }
        variances += corner.sigma_px * corner.sigma_px;
    }
    let count = pictures as f64;
    let bias_px = libm::hypot(sums[0], sums[1]) / count;
    let spread_px = libm::sqrt((squares / count - bias_px * bias_px) / 2.0);
    Sampled { spread_px, bias_px, sigma_px: libm::sqrt(variances / count) }
}

/// 400 pictures give the spread of two coordinates to 2.5 % (one standard deviation).
const PICTURES: usize = 400;

#[test]
fn each_method_has_the_spread_and_bias_of_the_module_table() {
    let square = Scene::new([31.3, 31.8], 0.35, 0.7);
    let tilted = square.tilted(TILT_RAD, 0.2);
    // Spread and bias at most, px. The spreads are the measured ones + 10 %
    // (four standard deviations of the sampling); the fit's are also the bound.
    let rows = [
        (square, Refinement::GradientOrthogonality, 0.026, 0.020),
        (square, Refinement::Saddle, 0.0114, 0.055),
        (square, Refinement::ModelFit, 0.0085, 0.002),
        (tilted, Refinement::GradientOrthogonality, 0.031, 0.035),
        (tilted, Refinement::Saddle, 0.0140, 0.035),
        (tilted, Refinement::ModelFit, 0.0104, 0.002),
    ];
    for (scene, method, spread_px_max, bias_px_max) in rows {
        let sampled = sample(&scene, 6, method, PICTURES);
        std::println!(
            "{method:?}: spread {:.4} px, bias {:.4} px, sigma {:.4} px",
            sampled.spread_px,
            sampled.bias_px,
            sampled.sigma_px
        );
        assert!(sampled.spread_px < spread_px_max, "{method:?}");
        assert!(sampled.bias_px < bias_px_max, "{method:?}");
        // Blur 0.7: the flat parts that the two older methods take the noise from are flat.
        assert!((sampled.sigma_px / sampled.spread_px - 1.0).abs() < 0.15, "{method:?}");
    }
}

#[test]
fn the_fit_knows_its_spread_at_every_radius_and_blur() {
    let windows = [(3, 0.5), (3, 1.0), (4, 0.7), (6, 1.5), (8, 0.7)];
    for (radius_px, blur_px) in windows.into_iter().take(repetitions(5)) {
        for scene in [
            Scene::new([31.3, 31.8], 0.0, blur_px),
            Scene::new([31.3, 31.8], 0.0, blur_px).tilted(TILT_RAD, 0.2),
        ] {
            let sampled = sample(&scene, radius_px, Refinement::ModelFit, PICTURES);
            let ratio = sampled.sigma_px / sampled.spread_px;
            std::println!(
                "radius {radius_px} blur {blur_px}: {:.4} px {ratio:.2}",
                sampled.spread_px
            );
            assert!((ratio - 1.0).abs() < 0.15, "radius {radius_px} blur {blur_px}: {ratio}");
        }
    }
}

/// Largest error of the fit without noise, px, over sub-pixel phases.
fn phase_error_px(radius_px: usize, scene_at: impl Fn([f64; 2]) -> Scene) -> f64 {
    let mut worst_px = 0.0_f64;
    for phase in 0..25 {
        // Off the half pixel, at which the window's choice would be rounding.
        let position_px = [31.03 + f64::from(phase % 5) / 5.0, 31.07 + f64::from(phase / 5) / 5.0];
        let scene = scene_at(position_px);
        let pixels = scene.render().fine();
        let corner =
            refine(&fine_image(&pixels), &scene.seed(radius_px), Refinement::ModelFit).unwrap();
        let [x, y] = [0, 1].map(|axis| corner.position_px[axis] - position_px[axis]);
        worst_px = worst_px.max(libm::hypot(x, y));
    }
    worst_px
}

#[test]
fn bias_over_subpixel_phases_is_below_three_thousandths() {
    // All corners of an axis-aligned grid share a phase, so that this error does
    // not average out. It comes from the box, taken as Gaussian: it grows as the
    // blur falls, and is largest when the edges follow the pixel rows.
    let windows = [(3, 0.5), (3, 1.5), (6, 0.5), (6, 0.7), (6, 1.5)];
    for (radius_px, blur_px) in windows.into_iter().take(repetitions(5)) {
        for angle_rad in [0.0, 0.35, 0.785] {
            let square = phase_error_px(radius_px, |at| Scene::new(at, angle_rad, blur_px));
            let tilted = phase_error_px(radius_px, |at| {
                Scene::new(at, 0.0, blur_px).tilted(TILT_RAD, angle_rad)
            });
            assert!(square < 0.003, "{square} at {angle_rad} rad, blur {blur_px} px");
            assert!(tilted < 0.003, "{tilted} tilted at {angle_rad} rad, blur {blur_px} px");
        }
    }
}

#[test]
fn every_method_beats_a_seed_that_is_a_pixel_off() {
    let mut random = Random(3);
    for method in [Refinement::GradientOrthogonality, Refinement::Saddle, Refinement::ModelFit] {
        for turn in 0..24 {
            let position_px = [31.0 + random.uniform(), 31.0 + random.uniform()];
            let scene = Scene::new(position_px, f64::from(turn) * PI / 24.0, 0.7);
            let pixels = scene.render().sampled(2.0, &mut random);
            let mut seed = scene.seed(6);
            let direction_rad = TAU * random.uniform();
            seed.position_px[0] += libm::cos(direction_rad);
            seed.position_px[1] += libm::sin(direction_rad);
            let corner = refine(&image(&pixels), &seed, method).unwrap();
            let [x, y] = [0, 1].map(|axis| corner.position_px[axis] - position_px[axis]);
            // The saddle's pull, 0.08 px at half a pixel, is the largest of the three.
            assert!(libm::hypot(x, y) < 0.12, "{method:?} {x} {y}");
        }
    }
}

#[test]
fn the_basin_reaches_a_pixel_and_fifteen_degrees_and_mostly_two_pixels() {
    let mut random = Random(4);
    for (distance_px, found_min) in [(1.0, 40), (2.0, 34)] {
        let mut found = 0;
        for turn in 0..40 {
            let position_px = [31.0 + random.uniform(), 31.0 + random.uniform()];
            let scene = Scene::new(position_px, 0.0, 0.7);
            let scene = scene.tilted(0.4, f64::from(turn));
            let pixels = scene.render().sampled(2.0, &mut random);
            let direction_rad = TAU * random.uniform();
            let error_rad = if turn % 2 == 0 { 0.26 } else { -0.26 };
            let seed = CornerSeed {
                position_px: [
                    position_px[0] + distance_px * libm::cos(direction_rad),
                    position_px[1] + distance_px * libm::sin(direction_rad),
                ],
                edges_rad: [scene.edges_rad[0] + 0.26, scene.edges_rad[1] + error_rad],
                radius_px: 6,
            };
            let Ok(corner) = refine(&image(&pixels), &seed, Refinement::ModelFit) else {
                continue;
            };
            found += 1;
            // What is found is right: 5 standard deviations.
            for (found_px, true_px) in corner.position_px.iter().zip(position_px) {
                let error_px = found_px - true_px;
                assert!(error_px.abs() < 5.0 * corner.sigma_px, "{error_px} {turn}");
            }
            for (found_rad, true_rad) in corner.edges_rad.iter().zip(scene.edges_rad) {
                let turned_rad = libm::remainder(f64::from(*found_rad) - true_rad, PI);
                assert!(turned_rad.abs() < 0.02, "{turned_rad}");
            }
        }
        assert!(found >= found_min, "{found} of 40 from {distance_px} px");
    }
}

#[test]
fn a_good_start_needs_two_evaluations() {
    let scene = Scene::new([31.3, 31.8], 0.35, 0.7);
    let pixels = scene.render().sampled(2.0, &mut Random(1));
    let mut patch = Patch::new();
    let edges_rad = usable_edges(&scene.seed(6)).unwrap();
    let fitted = fit_model(&image(&pixels), &scene.seed(6), &mut patch, edges_rad).unwrap();
    assert!(fitted.evaluations <= 3, "{}", fitted.evaluations);
}

#[test]
fn ten_bit_pixels_give_the_same_corner() {
    let scene = Scene::new([31.3, 31.8], 0.35, 0.7);
    let pixels = scene.render().sampled(2.0, &mut Random(1));
    let wide: Vec<u16> = pixels.iter().map(|&level| u16::from(level) * 4).collect();
    let wide = GreyImage::with_white_level(&wide, SIDE, SIDE, SIDE, 1020).unwrap();
    let narrow = refine(&image(&pixels), &scene.seed(6), Refinement::ModelFit).unwrap();
    let wide = refine(&wide, &scene.seed(6), Refinement::ModelFit).unwrap();
    for axis in 0..2 {
        // Single precision throughout: rounding only.
        assert!((wide.position_px[axis] - narrow.position_px[axis]).abs() < 1e-4);
    }
    assert!((wide.contrast / narrow.contrast - 4.0).abs() < 1e-3);
    assert!((narrow.contrast - 120.0).abs() < 2.0);
}

/// What each method says, in the order of their enum.
fn failures(pixels: &[u8], seed: &CornerSeed) -> [Option<RefineFailure>; 3] {
    [Refinement::GradientOrthogonality, Refinement::Saddle, Refinement::ModelFit]
        .map(|method| refine(&image(pixels), seed, method).err())
}

#[test]
fn what_is_no_corner_is_refused_with_its_reason() {
    let mut random = Random(8);
    let scene = Scene::new([31.3, 31.8], 0.35, 0.7);
    let seed = scene.seed(6);
    let all = |reason| [Some(reason); 3];

    let black = [0_u8; SIDE * SIDE];
    assert_eq!(failures(&black, &seed), all(RefineFailure::NotASaddle));
    let white = [255_u8; SIDE * SIDE];
    assert_eq!(failures(&white, &seed), all(RefineFailure::NotASaddle));
    for _ in 0..50 {
        let flat: Vec<u8> =
            (0..SIDE * SIDE).map(|_| (120.5 + 2.0 * random.normal()) as u8).collect();
        assert!(failures(&flat, &seed).iter().all(Option::is_some));
        let edge: Vec<u8> = (0..SIDE * SIDE)
            .map(|index| {
                let level = if index % SIDE > 31 { 180.5 } else { 60.5 };
                (level + 2.0 * random.normal()) as u8
            })
            .collect();
        assert!(failures(&edge, &seed).iter().all(Option::is_some));
        let noise: Vec<u8> = (0..SIDE * SIDE).map(|_| (255.0 * random.uniform()) as u8).collect();
        assert!(failures(&noise, &seed)[2].is_some());
    }

    let corner = scene.render().sampled(2.0, &mut random);
    assert_eq!(failures(&corner, &seed), [None; 3]);
    let exchanged = CornerSeed { edges_rad: [scene.edges_rad[1], scene.edges_rad[0]], ..seed };
    assert_eq!(failures(&corner, &exchanged), all(RefineFailure::WrongPolarity));

    let faint = Scene { dark: 118.0, light: 122.0, ..scene }.render().sampled(0.3, &mut random);
    assert_eq!(failures(&faint, &seed), all(RefineFailure::LowContrast));

    for position_px in [[5.2, 31.0], [31.0, 57.7], [-1e9, 31.0], [31.0, 1e300]] {
        let outside = CornerSeed { position_px, ..seed };
        assert_eq!(failures(&corner, &outside), all(RefineFailure::OutsideFrame));
    }
    for unusable in [
        CornerSeed { position_px: [f64::NAN, 31.0], ..seed },
        CornerSeed { position_px: [31.0, f64::INFINITY], ..seed },
        CornerSeed { edges_rad: [f64::NAN, 0.0], ..seed },
        CornerSeed { edges_rad: [0.0, f64::INFINITY], ..seed },
        CornerSeed { edges_rad: [0.5, 0.7], ..seed },
        CornerSeed { radius_px: 2, ..seed },
        CornerSeed { radius_px: usize::MAX, ..seed },
    ] {
        assert_eq!(failures(&corner, &unusable), all(RefineFailure::Seed), "{unusable:?}");
    }
}

#[test]
fn a_covered_window_is_refused() {
    let mut random = Random(5);
    let (mut refused, mut found_wrong) = (0, 0);
    for turn in 0..40 {
        let position_px = [31.0 + random.uniform(), 31.0 + random.uniform()];
        let scene = Scene::new(position_px, f64::from(turn), 0.7);
        let mut picture = scene.render();
        // A finger whose border passes up to 3 px from the corner.
        let direction_rad = TAU * random.uniform();
        let distance_px = 3.0 * random.uniform();
        for (index, level) in picture.levels.iter_mut().enumerate() {
            let x = (index % SIDE) as f64 - position_px[0];
            let y = (index / SIDE) as f64 - position_px[1];
            let inside_px =
                libm::cos(direction_rad) * x + libm::sin(direction_rad) * y - distance_px;
            let cover = 0.5 * (1.0 + libm::erf(inside_px));
            *level += cover * (90.0 - *level);
        }
        let pixels = picture.sampled(2.0, &mut random);
        match refine(&image(&pixels), &scene.seed(6), Refinement::ModelFit) {
            Ok(corner) => {
                let [x, y] = [0, 1].map(|axis| corner.position_px[axis] - position_px[axis]);
                found_wrong += usize::from(libm::hypot(x, y) > 0.3);
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused >= 38 && found_wrong == 0, "{refused} refused, {found_wrong} wrong");
}

#[test]
fn edges_may_be_any_directions() {
    let scene = Scene::new([31.3, 31.8], 0.35, 0.7);
    let pixels = scene.render().sampled(2.0, &mut Random(1));
    let expected = refine(&image(&pixels), &scene.seed(6), Refinement::ModelFit).unwrap();
    for turns in [[1.0, 0.0], [0.0, -1.0], [-7.0, 12.0]] {
        let edges_rad = [0.35 + PI * turns[0], 0.35 + FRAC_PI_2 + PI * turns[1]];
        let seed = CornerSeed { edges_rad, ..scene.seed(6) };
        let corner = refine(&image(&pixels), &seed, Refinement::ModelFit).unwrap();
        for axis in 0..2 {
            assert!((corner.position_px[axis] - expected.position_px[axis]).abs() < 1e-4);
        }
        assert!(corner.edges_rad.iter().all(|edge_rad| (0.0..PI as f32).contains(edge_rad)));
    }
}
