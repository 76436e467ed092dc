//! What is taken for an edge, what of it is looked at, and what is known of its blur.

use super::*;
use crate::fit::edge::rendered::PITCH_MM;

/// The edges that are fitted in a picture of the scene without noise, expected where they are.
fn fitted(scene: &Scene, appearance: &Appearance, has_light: bool) -> Vec<(SeenEdge, PixelFit)> {
    let pixels = scene.render().noise_free();
    fit_all(scene, &pixels, &scene.cam_from_target, appearance, has_light)
}

#[test]
fn an_edge_has_a_fortieth_of_white_as_its_contrast() {
    let scene = Scene::new(21.0, 0.1, 0.1);
    for (contrast, found) in [(0.026, EDGES), (0.024, 0)] {
        let pale = Scene { light: 0.5 + contrast, dark: 0.5, ..scene.clone() };
        assert_eq!(fitted(&pale, &appearance(&pale), false).len(), found, "{contrast}");
    }
}

#[test]
fn an_edge_is_fitted_up_to_one_blur_away() {
    for psf_px in [0.55, 1.5] {
        let scene = Scene { psf_px, ..Scene::new(30.0, 0.0, 0.0) };
        let pixels = scene.render().noise_free();
        for (blurs, found) in [(0.6, EDGES), (0.8, EDGES), (1.4, 0), (1.7, 0)] {
            let off_px = blurs * scene.blur_px();
            let expected = scene.moved_px([off_px, off_px]);
            let fitted = fit_all(&scene, &pixels, &expected, &appearance(&scene), false);
            assert_eq!(fitted.len(), found, "{psf_px} {blurs}");
        }
    }
}

/// Where the border has not been seen, nothing is known of what lies beyond it and just before it.
#[test]
fn a_border_that_was_not_seen_has_no_effect_on_the_edges_that_end_there() {
    let scene = Scene::new(21.0, 0.0, 0.1);
    let pixels = scene.render().noise_free();
    let reach_mm = 2.5 * scene.blur_px() * PITCH_MM / 21.0;
    let half_mm = [2.5, 2.0].map(|squares| squares * PITCH_MM - reach_mm);
    let mm_per_px = scene.cam_from_target.translation_mm.z / scene.lens.fx_px;
    let middle_px = scene.lens.project(&scene.cam_from_target.translation_mm).unwrap();
    let (sine, cosine) = libm::sincos(0.1);
    // White from 2.5 blurs before the border on.
    let mut changed = pixels.clone();
    for (place, pixel) in changed.iter_mut().enumerate() {
        let [x, y] = [place % usize::from(WIDTH), place / usize::from(WIDTH)];
        let off_mm = (Vector2::new(x as f64, y as f64) - middle_px) * mm_per_px;
        let on_target = [cosine * off_mm.x + sine * off_mm.y, cosine * off_mm.y - sine * off_mm.x];
        if on_target[0].abs() > half_mm[0] || on_target[1].abs() > half_mm[1] {
            *pixel = WHITE;
        }
    }
    let inner = |pixels: &[u16], has_border: bool| {
        let appearance = Appearance { has_border, ..appearance(&scene) };
        let mut all = fit_all(&scene, pixels, &scene.cam_from_target, &appearance, false);
        all.retain(|(seen, _)| !seen.edge.is_border);
        all
    };
    assert_eq!(inner(&pixels, false), inner(&changed, false));
    assert_ne!(inner(&pixels, true), inner(&changed, true));
}

/// Nearly without noise, the pixels of one edge tell far more of its blur than an earlier frame.
#[test]
fn what_is_known_of_the_blur_counts_as_much_as_the_noise_lets_it() {
    let upright = Scene { psf_px: 0.5, ..Scene::new(21.0, 0.0, 0.0) };
    let scene = Scene { cam_from_target: upright.moved_px([0.2, 0.3]), ..upright };
    let whiteners = |ln_blur_sd: f64, noise: f64| -> Vec<f64> {
        let pixels = scene.render().sampled(noise, &mut Random::new(51));
        let appearance = Appearance { ln_blur_sd, ..appearance(&scene) };
        let fitted = fit_all(&scene, &pixels, &scene.cam_from_target, &appearance, true);
        assert_eq!(fitted.len(), EDGES);
        fitted.iter().map(|(seen, _)| 1.0 / seen.shift_px().1).collect()
    };
    let farthest = |one: &[f64], other: &[f64]| {
        one.iter().zip(other).map(|(one, other)| (one / other - 1.0).abs()).fold(0.0, f64::max)
    };
    let [unknown, hardly, exactly] = [f64::INFINITY, 0.3, 1e-9].map(|sd| whiteners(sd, 1e-5));
    let matters = farthest(&unknown, &exactly);
    assert!(matters > 0.01, "{matters}");
    // A blur known to 30 %, where the pixels tell it to a ten-thousandth.
    assert!(farthest(&unknown, &hardly) < 1e-4 * matters, "{}", farthest(&unknown, &hardly));
    // In noise of 5 % of white the pixels tell it to 10 % or less, and an earlier frame to half a
    // percent.
    let [exactly, well] = [1e-9, 0.005].map(|sd| whiteners(sd, 0.05));
    assert!(farthest(&exactly, &well) < 0.05 * matters, "{}", farthest(&exactly, &well));
}

#[test]
fn a_blur_is_as_precise_as_it_says() {
    const NOISE: f64 = 0.01;
    let scene = Scene::new(21.0, 0.2, 0.15);
    let picture = scene.render();
    let exact = fitted(&scene, &appearance(&scene), false);
    let mut random = Random::new(52);
    let (mut squares, mut count) = (0.0, 0.0);
    for _ in 0..20 {
        let pixels = picture.sampled(NOISE, &mut random);
        let all = fit_all(&scene, &pixels, &scene.cam_from_target, &appearance(&scene), false);
        for ((_, found), (_, exact)) in all.iter().zip(&exact) {
            let off = f64::from(found.ln_blur - exact.ln_blur);
            let noise = NOISE * f64::from(WHITE);
            squares += off * off * f64::from(found.ln_blur_weight) / (noise * noise);
            count += 1.0;
        }
    }
    assert_eq!(count, 20.0 * EDGES as f64);
    // 800 edges give a standard deviation to 2.5 %.
    let sd = libm::sqrt(squares / count);
    assert!((sd - 1.0).abs() < 0.1, "{sd}");
}
