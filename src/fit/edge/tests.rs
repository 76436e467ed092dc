mod limits;

extern crate std;
use std::vec::Vec;

use nalgebra::{Vector2, Vector6};

use super::rendered::{HEIGHT, Scene, WHITE, WIDTH, corner_of_bedside_lens, image};
use super::*;
use crate::fit::nodes::Direction;
use crate::fit::solve::Observations;
use crate::model::pose::{Cam, Pose, Target};
use crate::test_support::{Random, repetitions};

/// Tilt and turn of targets that a camera sees: upright, turned, and both tilted and turned.
const VIEWS: [[f64; 2]; 5] = [[0.0, 0.0], [0.0, 0.2], [0.4, 0.1], [-0.4, 0.8], [0.3, -2.3]];

const EDGES: usize = 40;

/// The residual of an edge at the true pose.
fn residual(seen: &SeenEdge, scene: &Scene) -> [f64; 2] {
    let nodes = scene.nodes(&scene.cam_from_target);
    seen.residual(seen.edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)].ray))
}

/// How far a found edge is from the truth in the middle and at the worse of both ends, px.
fn errors_px(seen: &SeenEdge, scene: &Scene) -> [f64; 2] {
    let [first, second] = residual(seen, scene);
    let [shift_by_shift, shift_by_turn, turn_by_turn] = seen.whitener;
    let turn = second / turn_by_turn;
    let shift = (first - shift_by_turn * turn) / shift_by_shift;
    [shift, shift.abs() + 0.5 * turn.abs()]
}

/// The true appearance of the scene.
fn appearance(scene: &Scene) -> Appearance {
    let growth_px = scene.growth_mm * scene.lens.fx_px / scene.cam_from_target.translation_mm.z;
    Appearance {
        x_blur_px: scene.blur_px(),
        y_blur_px: scene.blur_px(),
        growth_px,
        growth_estimates: 0,
        ln_blur_sd: 0.3,
        has_border: true,
    }
}

/// Fits every edge of a picture; with the light's planes or without.
fn fit_all(
    scene: &Scene,
    pixels: &[u16],
    expected: &Pose<Cam, Target>,
    appearance: &Appearance,
    has_light: bool,
) -> Vec<(SeenEdge, PixelFit)> {
    let nodes = scene.nodes(expected);
    let image = image(pixels);
    let light = Light::measure(&image, &nodes, scene.first_square_dark, scene.blur_px())
        .filter(|_| has_light);
    let mut batch = Batch::new();
    let fitted = |edge| fit_edge(&image, &nodes, &edge, appearance, light.as_ref(), &mut batch);
    nodes.edges(scene.first_square_dark).filter_map(fitted).collect()
}

fn locate_all(scene: &Scene, pixels: &[u16], expected: &Pose<Cam, Target>) -> Vec<SeenEdge> {
    let nodes = scene.nodes(expected);
    let image = image(pixels);
    nodes
        .edges(scene.first_square_dark)
        .filter_map(|edge| locate_edge(&image, &nodes, &edge))
        .collect()
}

#[test]
fn edges_are_located_from_3_px_away() {
    for [tilt, turn] in VIEWS {
        let scene = Scene::new(21.0, tilt, turn);
        let pixels = scene.render().noise_free();
        for (off_px, bound_px) in [(0.0, 0.25), (3.0, 0.4)] {
            let (mut found, mut worst_px) = (0, 0.0_f64);
            for direction in 0..8 {
                let angle = f64::from(direction) * core::f64::consts::FRAC_PI_4;
                let (sine, cosine) = libm::sincos(angle);
                let expected = scene.moved_px([off_px * cosine, off_px * sine]);
                for seen in locate_all(&scene, &pixels, &expected) {
                    found += 1;
                    worst_px = worst_px.max(errors_px(&seen, &scene)[0].abs());
                }
            }
            assert_eq!(found, 8 * EDGES, "{tilt} {turn} {off_px}");
            assert!(worst_px < bound_px, "{tilt} {turn} {off_px}: {worst_px}");
        }
    }
}

#[test]
fn what_is_no_edge_is_not_located() {
    let scene = Scene::new(21.0, 0.1, 0.1);
    let pixels = scene.render().noise_free();
    let upright = appearance(&scene);
    let pose = &scene.cam_from_target;
    assert_eq!(locate_all(&scene, &pixels, pose).len(), EDGES);
    assert_eq!(fit_all(&scene, &pixels, pose, &upright, false).len(), EDGES);
    // The other colours: inner edges have their dark side where light is expected, and on the
    // border an edge is expected where there is none.
    let negative = Scene { first_square_dark: false, ..scene.clone() };
    assert_eq!(locate_all(&negative, &pixels, pose).len(), 0);
    assert_eq!(fit_all(&negative, &pixels, pose, &upright, false).len(), 0);
    // Even grey, and a contrast of 2 % of white.
    let pale = Scene { light: 0.52, dark: 0.5, ..scene.clone() }.render().noise_free();
    let grey = std::vec![WHITE / 2; pixels.len()];
    for pixels in [pale, grey] {
        assert_eq!(locate_all(&scene, &pixels, pose).len(), 0);
        assert_eq!(fit_all(&scene, &pixels, pose, &upright, false).len(), 0);
    }
    // Expected outside the frame.
    for off in [[400.0, 0.0], [-400.0, 0.0], [0.0, 300.0], [0.0, -300.0]] {
        assert_eq!(locate_all(&scene, &pixels, &scene.moved_px(off)).len(), 0);
        assert_eq!(fit_all(&scene, &pixels, &scene.moved_px(off), &upright, false).len(), 0);
    }
    // Squares so small that on each side there are fewer than two pixels before the next line.
    let tiny = Scene::new(4.5, 0.0, 0.0);
    assert_eq!(locate_all(&tiny, &tiny.render().noise_free(), &tiny.cam_from_target).len(), 0);
}

#[test]
fn a_target_at_the_frames_border_shows_the_edges_inside() {
    let scene = Scene::new(21.0, 0.1, 0.1);
    for off in [[70.0, 0.0], [-70.0, 0.0], [0.0, 60.0], [0.0, -60.0]] {
        let part = Scene { cam_from_target: scene.moved_px(off), ..scene.clone() };
        let pixels = part.render().noise_free();
        let fitted = fit_all(&part, &pixels, &part.cam_from_target, &appearance(&part), true);
        assert!((EDGES / 4..EDGES).contains(&fitted.len()), "{}", fitted.len());
        for (seen, _) in fitted {
            // An edge cut by the frame has its pixels all on one side.
            assert!(errors_px(&seen, &part)[0].abs() < 0.01);
            let inside = seen.edge.nodes.map(|node| {
                let [x, y] =
                    part.nodes(&part.cam_from_target).as_slice()[usize::from(node)].raw_px.into();
                (-12.0..f64::from(WIDTH) + 12.0).contains(&x)
                    && (-12.0..f64::from(HEIGHT) + 12.0).contains(&y)
            });
            assert_eq!(inside, [true; 2]);
        }
    }
}

#[test]
fn a_fit_without_noise_gives_the_truth() {
    let phases = repetitions(4);
    for psf_px in [0.5, 0.7, 1.0, 1.5] {
        let (mut worst_px, mut worst_end_px) = ([0.0_f64; 2], [0.0_f64; 2]);
        // The last is the most oblique.
        for [tilt, turn] in VIEWS.into_iter().rev().take(repetitions(VIEWS.len())) {
            for phase in 0..phases {
                let phase = phase as f64 / phases as f64;
                let mut scene = Scene { psf_px, ..Scene::new(21.0, tilt, turn) };
                scene.cam_from_target = scene.moved_px([phase, 0.6 * phase]);
                let pixels = scene.render().noise_free();
                for (case, off_px) in [0.0, 0.1].into_iter().enumerate() {
                    let expected = scene.moved_px([off_px, -off_px]);
                    let fitted = fit_all(&scene, &pixels, &expected, &appearance(&scene), false);
                    assert_eq!(fitted.len(), EDGES);
                    for (seen, _) in fitted {
                        let [shift, end] = errors_px(&seen, &scene);
                        worst_px[case] = worst_px[case].max(shift.abs());
                        worst_end_px[case] = worst_end_px[case].max(end);
                    }
                }
            }
        }
        // A pixel's box is not a Gaussian, which matters where the blur is small; and the model is
        // linear, which leaves a term with the cube of the displacement over the square of the
        // blur.
        assert!(worst_px[0] < 0.0025 && worst_px[1] < 0.004, "{psf_px}: {worst_px:?}");
        assert!(worst_end_px[0] < 0.011 && worst_end_px[1] < 0.012, "{psf_px}: {worst_end_px:?}");
    }
}

/// The scene in light that increases by 30 % of its mean from one side of the target to the other.
fn graded(scene: Scene) -> Scene {
    // Five squares lie beside each other.
    let per_picture = 0.3 * f64::from(WIDTH) / (5.0 * 21.0);
    Scene { light_gain: scene.light * per_picture, dark_gain: scene.dark * per_picture, ..scene }
}

#[test]
fn graded_light_neither_shifts_nor_turns_edges() {
    for [tilt, turn] in VIEWS {
        let scene = graded(Scene::new(21.0, tilt, turn));
        let pixels = scene.render().noise_free();
        let pose = &scene.cam_from_target;
        let contrast = (scene.light - scene.dark) * f64::from(WHITE);
        let [known, unknown] = [true, false].map(|has_light| {
            let fitted = fit_all(&scene, &pixels, pose, &appearance(&scene), has_light);
            assert_eq!(fitted.len(), EDGES);
            fitted.iter().fold([0.0_f64; 3], |[shift_px, end_px, scatter], (seen, pixels)| {
                let [shift, end] = errors_px(seen, &scene);
                let off = libm::sqrt(f64::from(pixels.noise_variance)) / contrast;
                [shift_px.max(shift.abs()), end_px.max(end), scatter.max(off)]
            })
        });
        // As in even light: the pixel's box, which is not a Gaussian, and the model's polynomial.
        let [shift_px, end_px, scatter] = known;
        assert!(shift_px < 6e-4 && end_px < 0.002 && scatter < 8e-4, "{tilt} {turn}: {known:?}");
        // Where the light is not known, its slope appears as a turn.
        assert!(unknown[1] > 0.05 && unknown[2] > 0.005, "{tilt} {turn}: {unknown:?}");
    }
}

#[test]
fn the_lenss_bend_is_no_shift() {
    // Squares of 40 px, of which the whole length is used, where the lens bends lines most.
    let scene = Scene::new(40.0, 0.1, 0.1).seen_at(corner_of_bedside_lens(), [110.0, 70.0]);
    let pixels = scene.render().noise_free();
    let fitted = fit_all(&scene, &pixels, &scene.cam_from_target, &appearance(&scene), false);
    let worst = fitted.iter().map(|(seen, _)| errors_px(seen, &scene)[0].abs());
    let worst = worst.fold(0.0, f64::max);
    assert!(fitted.len() > 20 && worst < 0.003, "{worst}");
}

/// Standard deviations of shift and turn relative to those that the edges state, and the mean
/// estimate of the noise variance relative to the true one.
fn normalised(scene: &Scene, has_light: bool) -> ([f64; 2], f64) {
    const NOISE: f64 = 0.01;
    let picture = scene.render();
    let mut random = Random::new(11);
    let (mut squares, mut variance, mut count) = ([0.0; 2], 0.0, 0.0);
    let noise = NOISE * f64::from(WHITE);
    for _ in 0..repetitions(300) {
        let pixels = picture.sampled(NOISE, &mut random);
        let pose = &scene.cam_from_target;
        for (seen, pixels) in fit_all(scene, &pixels, pose, &appearance(scene), has_light) {
            let residual = residual(&seen, scene).map(|value| value / noise);
            for (square, value) in squares.iter_mut().zip(residual) {
                *square += value * value;
            }
            variance += f64::from(pixels.noise_variance) / (noise * noise);
            count += 1.0;
        }
    }
    (squares.map(|square| libm::sqrt(square / count)), variance / count)
}

#[test]
fn edges_are_as_precise_as_they_say() {
    for psf_px in [0.5, 1.0] {
        let even = Scene { psf_px, ..Scene::new(21.0, 0.2, 0.15) };
        let graded = graded(even.clone());
        for (scene, has_light) in [(&even, false), (&even, true), (&graded, true)] {
            let (sd, variance) = normalised(scene, has_light);
            // 12,000 edges give a standard deviation to 1 / sqrt(24,000) = 0.65 %, 1,200 to
            // 2 %; a hundred pixels each the noise's variance to 0.13 % and 0.4 %.
            assert!(sd.iter().all(|sd| (sd - 1.0).abs() < 0.06), "{psf_px} {has_light}: {sd:?}");
            assert!((variance - 1.0).abs() < 0.02, "{psf_px} {has_light}: {variance}");
        }
    }
}

#[test]
fn knowing_the_light_makes_edges_more_precise() {
    let scene = Scene::new(21.0, 0.2, 0.15);
    let pixels = scene.render().sampled(0.01, &mut Random::new(5));
    let precision = |has_light| -> f64 {
        let fitted =
            fit_all(&scene, &pixels, &scene.cam_from_target, &appearance(&scene), has_light);
        fitted.iter().map(|(seen, _)| seen.whitener[0] * seen.whitener[0]).sum()
    };
    let gain = libm::sqrt(precision(true) / precision(false));
    assert!((1.05..1.5).contains(&gain), "{gain}");
}

#[test]
fn a_wrong_blur_is_corrected() {
    for psf_px in [0.6, 1.0, 1.4] {
        let scene = Scene { psf_px, ..Scene::new(21.0, 0.1, 0.2) };
        let pixels = scene.render().noise_free();
        for wrong in [0.9, 1.0, 1.1] {
            let mut appearance = appearance(&scene);
            appearance.x_blur_px *= wrong;
            let fitted = fit_all(&scene, &pixels, &scene.cam_from_target, &appearance, false);
            let mean = |direction| {
                let of = |(seen, pixels): &(SeenEdge, PixelFit)| {
                    (seen.edge.direction == direction).then_some(f64::from(pixels.ln_blur))
                };
                let all: Vec<f64> = fitted.iter().filter_map(of).collect();
                all.iter().sum::<f64>() / all.len() as f64
            };
            let (x, y) = (mean(Direction::X), mean(Direction::Y));
            // Linear in ln s: half the error's square is left; and the pixel's box is
            // wider in its middle than the Gaussian of its variance.
            assert!((x + libm::log(wrong)).abs() < 0.014, "{psf_px} {wrong}: {x}");
            // The other direction's blur is that of the lines across these edges.
            assert!(y.abs() < 0.009, "{psf_px} {wrong}: {y}");
        }
    }
}

#[test]
fn ink_that_spreads_is_told_from_a_shift() {
    const GROWTH_PX: f64 = 0.1;
    let exact = Scene::new(21.0, 0.05, 0.15);
    let growth_mm = GROWTH_PX * exact.cam_from_target.translation_mm.z / exact.lens.fx_px;
    let scene = Scene { growth_mm, ..exact.clone() };
    let pixels = scene.render().noise_free();
    let pose = &scene.cam_from_target;
    for (known, left_px) in [(&exact, GROWTH_PX), (&scene, 0.0)] {
        let fitted = fit_all(&scene, &pixels, pose, &appearance(known), false);
        assert_eq!(fitted.len(), EDGES);
        for (seen, _) in &fitted {
            // All edges, border or not: dark reaches farther. The scale varies by 2 % over
            // the target.
            let (growth_px, _) = seen.growth_px(&residual(seen, &scene));
            assert!((growth_px - left_px).abs() < 0.005, "{growth_px} {:?}", seen.edge);
        }
    }
}

#[test]
fn one_edge_in_three_has_the_residuals_of_these_edges() {
    let scene = Scene::new(21.0, 0.1, 0.1);
    let nodes = scene.nodes(&scene.cam_from_target);
    let edges = fit_all(
        &scene,
        &scene.render().noise_free(),
        &scene.moved_px([0.1, 0.0]),
        &appearance(&scene),
        false,
    );
    let edges: Vec<SeenEdge> = edges.into_iter().map(|(seen, _)| seen).collect();
    let residuals = |seen: &SeenEdges<'_>| {
        let mut residuals = Vec::new();
        seen.residuals(&scene.cam_from_target, |place, residual| {
            assert_eq!(place, residuals.len());
            residuals.push(residual);
        })
        .unwrap();
        assert_eq!(seen.count(), residuals.len());
        residuals
    };
    let all = SeenEdges::new(&nodes, &edges);
    let third: Vec<_> = residuals(&all).into_iter().step_by(3).collect();
    assert_eq!(residuals(&all.one_in(3)), third);
    assert_eq!(third.len(), EDGES.div_ceil(3));
}

/// Largest difference between the Jacobian and central differences, relative to
/// the column's length, with column `spoiled` deliberately 1e-4 too large.
fn jacobian_error(spoiled: Option<usize>) -> f64 {
    let scene = Scene::new(21.0, 0.3, 0.2).seen_at(corner_of_bedside_lens(), [100.0, 80.0]);
    let nodes = scene.nodes(&scene.cam_from_target);
    let right = Vector2::new(0.8, -0.6);
    let edges: Vec<_> = nodes
        .edges(true)
        .map(|edge| {
            let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
            SeenEdge::new(edge, ends, &right, [5.0, 0.7, 1.5], [0.3, -0.2])
        })
        .collect();
    let seen = SeenEdges::new(&nodes, &edges);
    let residuals = |pose: &Pose<Cam, Target>| {
        let mut residuals = Vec::new();
        seen.residuals(pose, |_, residual| residuals.push(Vector2::from(residual))).unwrap();
        residuals
    };
    // Not where the edges were expected.
    let pose = scene.moved_px([1.5, -1.0]);
    let mut worst = 0.0_f64;
    for axis in 0..6 {
        let step = if axis < 3 { 1e-5 } else { 1e-2 };
        // A motion along the camera's axes, as an increment about the target's.
        let mut increment = Vector6::zeros();
        if axis < 3 {
            increment.fixed_rows_mut::<3>(0).tr_copy_from(&pose.rotation.row(axis));
        } else {
            increment[axis] = 1.0;
        }
        increment *= step;
        let here = residuals(&pose);
        let ahead = residuals(&pose.moved_by(&increment));
        let behind = residuals(&pose.moved_by(&-increment));
        let scale = if spoiled == Some(axis) { 1.0001 } else { 1.0 };
        seen.residuals_with_jacobian(&pose, |place, residual, rows| {
            assert_eq!(Vector2::from(*residual), here[place]);
            let column = Vector2::new(rows[0][axis], rows[1][axis]) * scale;
            let difference = (ahead[place] - behind[place]) / (2.0 * step);
            worst = worst.max((column - difference).norm() / column.norm().max(1.0));
        })
        .unwrap();
    }
    worst
}

#[test]
fn the_jacobian_matches_differences_and_a_wrong_one_does_not() {
    // Third derivatives times the squared step, and rounding over the step.
    assert!(jacobian_error(None) < 3e-8, "{}", jacobian_error(None));
    for axis in 0..6 {
        assert!(jacobian_error(Some(axis)) > 3e-5, "{axis}");
    }
}
