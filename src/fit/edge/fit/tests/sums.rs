//! The inner products of an edge's pixels, by their definition and in double precision.

use super::super::batch::{BATCH, Batch};
use super::super::crossing::EdgeEnd;
use super::super::region::{Region, Width};
use super::*;
use crate::fit::edge::light::{Levels, Light};
use crate::fit::edge::profile::blurred_step;
use crate::fit::edge::rendered::{corner_of_bedside_lens, image};
use crate::test_support::Random;

/// The sums of products of one, the step, its derivatives by the blur, the shift and the turn, and
/// the pixel; for each, also that of the absolute products.
fn sums_by_definition(
    image: &GreyImage<'_, u16>,
    region: &Region,
    levels: Option<&Levels>,
    sign: f64,
) -> (vec::Vec<[f64; 2]>, f64) {
    let by_lines = |[x, y]: [f64; 2]| if region.are_lines_rows { [y, x] } else { [x, y] };
    let pixel = |line: usize, place: usize| {
        let [x, y] = if region.are_lines_rows { [place, line] } else { [line, place] };
        f64::from(image.pixel(x, y))
    };
    let base = levels.map_or_else(
        || pixel(region.origin[0], region.origin[1]),
        |levels| f64::from((0.5 * (levels.light + levels.dark)) as f32),
    );
    let [mean, contrast] = levels.map_or([[0.0; 2]; 2], |levels| {
        [levels.mean_per_px, levels.contrast_per_px].map(|slope| by_lines(slope.into()))
    });
    let noise = levels.map_or(0.0, |levels| sign * levels.certainty.noise_contrast);
    let dot = |slope: [f64; 2], [line, place]: [f64; 2]| slope[0] * line + slope[1] * place;
    let [right, along] = [region.right, region.along].map(|unit| unit.map(f64::from));
    let (per_blur, per_length) = (f64::from(region.per_blur), f64::from(region.per_length));
    let mut sums = vec![[0.0; 2]; 21];
    let mut samples = 0.0;
    region.each_band([image.width(), image.height()], |band| {
        for place in band.places.clone() {
            let lines = band.first_line..band.first_line + band.lines;
            let grey = lines.map(|line| pixel(line, place)).sum::<f64>() / band.lines as f64;
            let beyond_first = (place - band.places.start) as f64;
            let [line, first] = band.from_middle.map(f64::from);
            let from_middle = [line, first + beyond_first];
            let w = dot(along, from_middle) * per_length;
            // An arc through both ends of the edge.
            let arc_px = f64::from(region.bend_px) * (1.0 - 4.0 * w * w);
            let sharpness = f64::from(band.sharpness);
            let v = (dot(right, from_middle) - arc_px) * per_blur * sharpness;
            let (step, slope) = blurred_step(v as f32);
            let (height, lift, turn) = region.crossings.at::<false>(v as f32, w as f32);
            let profile = f64::from(height * step + lift + turn * slope);
            let slope = f64::from(height * slope) * sharpness;
            let flattened =
                (grey - base - dot(mean, from_middle)) * (1.0 - dot(contrast, from_middle));
            let row = [1.0, profile, v * slope, slope, w * slope, flattened];
            let weight = band.lines as f64 / (1.0 + noise * profile);
            let pairs = (0..6).flat_map(|first| (first..6).map(move |second| (first, second)));
            for (sum, (first, second)) in sums.iter_mut().zip(pairs) {
                let product = weight * row[first] * row[second];
                sum[0] += product;
                sum[1] += product.abs();
            }
            samples += 1.0;
        }
    });
    (sums, samples)
}

fn assert_by_definition(
    image: &GreyImage<'_, u16>,
    region: &Region,
    levels: Option<&Levels>,
    sign: f64,
) {
    let found = Batch::new().sums(image, region, levels, sign);
    let (expected, samples) = sums_by_definition(image, region, levels, sign);
    assert_eq!(found.count, samples);
    for (place, (found, [expected, all])) in found.products.iter().zip(expected).enumerate() {
        // Rounding to 24 bits: of up to a hundred sums in each lane, and of positions of 40 px.
        assert!((found - expected).abs() <= 2e-5 * all, "{place}: {found} {expected} {all}");
    }
}

/// The edges of a scene, upright and lying, whole and cut by the frame on any side.
#[test]
fn products_are_summed_as_they_are_defined() {
    let mut random = Random::new(41);
    let scene = Scene { light_gain: 0.4, dark_gain: 0.1, ..Scene::new(21.0, 0.2, 0.1) };
    for (scene, off_px) in [
        (scene.clone(), [0.0, 0.0]),
        (scene.clone(), [42.0, 0.0]),
        (scene.clone(), [0.0, 40.0]),
        (scene.seen_at(corner_of_bedside_lens(), [110.0, 70.0]), [-45.0, -35.0]),
    ] {
        let scene = Scene { cam_from_target: scene.moved_px(off_px), ..scene.clone() };
        let pixels = scene.render().sampled(0.01, &mut random);
        let image = image(&pixels);
        let nodes = scene.nodes(&scene.cam_from_target);
        let light = Light::measure(&image, &nodes, true, scene.blur_px()).unwrap();
        let (mut with_levels, mut without) = (0, 0);
        for edge in nodes.edges(true) {
            let chord = nodes.chord(&edge);
            // Enough of a bend to be seen.
            let chord = Chord { bend_px: 4.0 * chord.bend_px + 0.05, ..chord };
            let sign = if edge.is_right_light { 1.0 } else { -1.0 };
            let ends = edge.nodes.map(|node| match nodes.corner(node) {
                Some(_) => EdgeEnd::Corner,
                None => EdgeEnd::Border,
            });
            let blurs_px = [scene.blur_px(), 1.1 * scene.blur_px()];
            let Some(region) = Region::new(&chord, blurs_px, ends, sign, &Width::UNKNOWN_LEVELS)
            else {
                continue;
            };
            if region.origin[0] >= image.height() || region.origin[1] >= image.height() {
                continue;
            }
            assert_by_definition(&image, &region, None, sign);
            without += 1;
            let middle_px = (chord.start_px + chord.end_px) * 0.5;
            if let Some(mut levels) = light.beside(&nodes, &edge, &middle_px) {
                levels.certainty.noise_contrast = 0.6;
                assert_by_definition(&image, &region, Some(&levels), sign);
                with_levels += 1;
            }
        }
        assert!(without > 10 && with_levels > 5, "{off_px:?}: {without} {with_levels}");
    }
}

/// Bands of one place to many, in batches of which one is full to the last place when a band of one
/// follows.
#[test]
fn products_of_several_batches_are_those_of_all_pixels() {
    let mut random = Random::new(42);
    let pixels: vec::Vec<u16> = (0..256 * 128).map(|_| (random.bits() % 1000) as u16).collect();
    let image = GreyImage::with_white_level(&pixels, 256, 128, 256, 1000).unwrap();
    let mut is_followed_by_one = false;
    for (angle, blur_px) in [(0.0, 3.5), (0.0, 1.0), (0.3, 2.5), (1.2, 4.0), (0.6, 2.0)] {
        let (sine, cosine) = libm::sincos(angle);
        // In the frame's middle, and where its right border cuts each line.
        for x in [120.0, 250.0] {
            let middle = Vector2::new(x, 60.0);
            let half = Vector2::new(sine, cosine) * 100.0;
            let across = Vector2::new(cosine, -sine) * 100.0;
            let near = straight(middle - half, middle + half, across);
            let ends = [EdgeEnd::Unknown; 2];
            let width = Width::UNKNOWN_LEVELS;
            let region = Region::new(&near, [blur_px, 1.0], ends, 1.0, &width).unwrap();
            assert_by_definition(&image, &region, None, 1.0);
            let mut count = 0;
            region.each_band([256, 128], |band| {
                if count + band.places.len() > BATCH {
                    is_followed_by_one |= count == BATCH && band.places.len() == 1;
                    count = 0;
                }
                count += band.places.len();
            });
        }
    }
    assert!(is_followed_by_one);
}
