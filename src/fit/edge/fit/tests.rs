mod sums;

extern crate std;
use std::vec;

use nalgebra::Vector2;

use super::batch::BATCH;
use super::region::{CLEAR_OF_UNKNOWN, HALF_LENGTH_PX_MAX};
use super::*;
use crate::fit::edge::appearance::{BLUR_PX_MAX, BLUR_PX_MIN, GROWTH_PX_MAX, LN_BLUR_STEP_MAX};
use crate::fit::edge::rendered::{HEIGHT, Scene, WIDTH};
use crate::fit::nodes::Chord;
use crate::test_support::Random;

/// How many edges use each pixel of a frame, row by row.
fn looks(scene: &Scene, blur_px: f64) -> vec::Vec<u8> {
    let nodes = scene.nodes(&scene.cam_from_target);
    let [width, height] = [WIDTH, HEIGHT].map(usize::from);
    let mut looks = vec![0; width * height];
    for edge in nodes.edges(scene.first_square_dark) {
        let chord = nodes.chord(&edge);
        let ends = edge.nodes.map(|node| match nodes.corner(node) {
            Some(_) => EdgeEnd::Corner,
            None => EdgeEnd::Border,
        });
        let Some(region) = Region::new(&chord, [blur_px; 2], ends, 1.0, &Width::UNKNOWN_LEVELS)
        else {
            continue;
        };
        region.each_band([width, height], |band| {
            let lines = band.first_line..band.first_line + band.lines;
            for (line, place) in
                lines.flat_map(|line| band.places.clone().map(move |place| (line, place)))
            {
                let [x, y] = if region.are_lines_rows { [place, line] } else { [line, place] };
                looks[y * width + x] += 1;
            }
        });
    }
    looks
}

#[test]
fn no_pixel_speaks_about_two_edges() {
    // Also squares so small that the blur fills them, where regions touch.
    for (pitch_px, blur_px) in [(21.0, 0.75), (21.0, 1.5), (10.0, 0.6), (9.0, 0.5), (14.0, 1.0)] {
        for [tilt, turn] in [[0.0, 0.013], [0.2, 0.3], [0.5, 0.7], [-0.6, 0.4], [0.7, 2.0]] {
            let scene = Scene::new(pitch_px, tilt, turn);
            let looks = looks(&scene, blur_px);
            let used = looks.iter().filter(|&&count| count == 1).count();
            let shared = looks.iter().filter(|&&count| count > 1).count();
            // Except for one or two on the line between both, which perspective bends.
            assert!(used > 500 && 500 * shared <= used, "{pitch_px} {tilt} {turn}: {shared}");
        }
    }
}

/// A chord of a target upright in the picture.
fn chord(start_px: [f64; 2], end_px: [f64; 2], across_px: [f64; 2]) -> Chord {
    straight(start_px.into(), end_px.into(), across_px.into())
}

fn straight(start_px: Vector2<f64>, end_px: Vector2<f64>, across_px: Vector2<f64>) -> Chord {
    let along = (end_px - start_px).normalize();
    let right = Vector2::new(-along.y, along.x);
    Chord { start_px, end_px, across_px, right, bend_px: 0.0 }
}

/// The number of pixels that an edge has in a frame.
fn pixels_of(chord: &Chord, blur_px: f64, width: usize, height: usize) -> f64 {
    let pixels = vec![100_u8; width * height];
    let image = GreyImage::new(&pixels, width, height, width).unwrap();
    let ends = [EdgeEnd::Unknown; 2];
    let region = Region::new(chord, [blur_px; 2], ends, 1.0, &Width::UNKNOWN_LEVELS);
    region.map_or(0.0, |region| Batch::new().sums(&image, &region, None, 1.0).products[0])
}

#[test]
fn a_region_ends_where_the_frame_does() {
    // The whole region, and one whose line is the middle of the first or last row or column:
    // half of it and that row or column.
    let whole = pixels_of(&chord([22.0, 32.0], [42.0, 32.0], [0.0, 20.0]), 0.75, 64, 64);
    let line = 2.0 * (10.0 - CLEAR_OF_UNKNOWN * 0.75).floor() + 1.0;
    let half = 0.5 * (whole - line) + line;
    for (start, end, across) in [
        ([22.0, 0.0], [42.0, 0.0], [0.0, 20.0]),
        ([22.0, 63.0], [42.0, 63.0], [0.0, 20.0]),
        ([0.0, 22.0], [0.0, 42.0], [20.0, 0.0]),
        ([63.0, 22.0], [63.0, 42.0], [20.0, 0.0]),
    ] {
        assert_eq!(pixels_of(&chord(start, end, across), 0.75, 64, 64), half, "{start:?}");
    }
    // An edge whose middle is outside the frame is less than half visible.
    for middle in [[-0.1, 30.0], [64.0, 30.0], [30.0, -0.1], [30.0, 64.0], [4e9, 30.0]] {
        let [x, y] = middle;
        let beyond = chord([x - 10.0, y], [x + 10.0, y], [0.0, 20.0]);
        assert_eq!(pixels_of(&beyond, 0.75, 64, 64), 0.0, "{middle:?}");
    }
}

#[test]
fn a_near_edge_takes_no_more_pixels_than_there_is_room_for() {
    for angle in 0..16 {
        let (sine, cosine) = libm::sincos(f64::from(angle) * 0.2);
        let middle = Vector2::new(2000.0, 60.0);
        let half = Vector2::new(cosine, sine) * 1000.0;
        let across = Vector2::new(-sine, cosine) * 2000.0;
        let near = straight(middle - half, middle + half, across);
        let region =
            Region::new(&near, [BLUR_PX_MAX; 2], [EdgeEnd::Corner; 2], 1.0, &Width::UNKNOWN_LEVELS)
                .unwrap();
        region.each_band([4096; 2], |band| assert!(band.places.len() <= BATCH));
        let count = pixels_of(&near, BLUR_PX_MAX, 4096, 120);
        let area = 4.0 * HALF_LENGTH_PX_MAX * Width::UNKNOWN_LEVELS.at_px(BLUR_PX_MAX);
        // As many pixels as its area, to within half a pixel along two sides.
        assert!((count / area - 1.0).abs() < 0.03, "{angle}: {count} of {area}");
    }
}

/// An edge of 40 px, turned away from the columns, its corners at right angles.
fn turned(angle: f64) -> Chord {
    let (sine, cosine) = libm::sincos(angle);
    let middle = Vector2::new(100.3, 80.2);
    let half = Vector2::new(sine, cosine) * 20.0;
    straight(middle - half, middle + half, Vector2::new(cosine, -sine) * 40.0)
}

#[test]
fn lines_are_averaged_where_that_blurs_little_and_no_crossing_line_reaches() {
    const BLUR_PX: f64 = 0.7;
    // With s = 0.7 px, 0.05 s^2 is the variance of 5 lines whose places differ by 0.111 px from line
    // to line, of 4 by 0.140, of 3 by 0.192 and of 2 by 0.313.
    for (angle, most) in
        [(0.0, 5), (0.1, 5), (0.13, 4), (0.18, 3), (0.3, 2), (0.34, 1), (0.7, 1), (1.4708, 5)]
    {
        let ends = [EdgeEnd::Corner; 2];
        let region =
            Region::new(&turned(angle), [BLUR_PX; 2], ends, 1.0, &Width::KNOWN_LEVELS).unwrap();
        let (mut lines, mut next) = (0, None);
        region.each_band([200, 160], |band| {
            assert!(next.is_none_or(|next| next == band.first_line), "{angle}: a gap");
            next = Some(band.first_line + band.lines);
            lines = lines.max(band.lines);
            let count = band.lines as f64;
            let (sine, cosine) = libm::sincos(angle);
            let slope = sine.min(cosine) / BLUR_PX;
            let blur = libm::sqrt(1.0 + (count * count - 1.0) * slope * slope / 12.0);
            assert!((f64::from(band.sharpness) * blur - 1.0).abs() < 1e-4, "{angle}");
            let from_end = 20.0 - f64::from(band.from_middle[0]).abs() - 0.5 * (count - 1.0);
            assert!(band.lines == 1 || from_end > 3.4 * BLUR_PX, "{angle}: {from_end}");
        });
        assert_eq!(lines, most, "{angle}");
    }
}

#[test]
fn all_lines_that_no_crossing_line_reaches_are_averaged() {
    // The lines across an upright edge from 60 to 100; a crossing line reaches 3.4 blurs far.
    let free = 63..98;
    for middle in [80.0, 80.2] {
        let upright = straight(
            [50.0, middle - 20.0].into(),
            [50.0, middle + 20.0].into(),
            [40.0, 0.0].into(),
        );
        let ends = [EdgeEnd::Corner; 2];
        let region = Region::new(&upright, [0.7; 2], ends, 1.0, &Width::KNOWN_LEVELS).unwrap();
        let mut averaged = vec::Vec::new();
        region.each_band([200, 160], |band| {
            if band.lines > 1 {
                averaged.extend(band.first_line..band.first_line + band.lines);
            }
        });
        assert!(averaged.into_iter().eq(free.clone()), "{middle}");
    }
}

#[test]
fn every_band_has_a_place() {
    let mut random = Random::new(40);
    for _ in 0..200 {
        let angle = random.uniform(0.0, core::f64::consts::PI);
        let blur_px = random.uniform(0.5, 1.5);
        let ends = [EdgeEnd::Corner, EdgeEnd::Border];
        let width = Width::UNKNOWN_LEVELS;
        let Some(region) = Region::new(&turned(angle), [blur_px; 2], ends, 1.0, &width) else {
            panic!("{angle} {blur_px}");
        };
        // Some are cut by the frame.
        region.each_band([105, 90], |band| assert!(!band.places.is_empty(), "{angle} {blur_px}"));
    }
}

#[test]
fn what_is_no_chord_has_no_region() {
    let (zero, nan, far) = ([0.0; 2], [f64::NAN; 2], [f64::INFINITY; 2]);
    let (start, end, across) = ([22.0, 32.0], [42.0, 32.0], [0.0, 20.0]);
    for (start, end, across) in [
        (start, start, across),
        (start, end, zero),
        (start, end, [20.0, 0.0]),
        (nan, end, across),
        (start, nan, across),
        (start, end, nan),
        (far, end, across),
        (start, far, across),
        (start, end, far),
        (start, start.map(|value| value + 1.0), [-1.0, 1.0]),
    ] {
        let found = pixels_of(&chord(start, end, across), 0.75, 64, 64);
        assert_eq!(found, 0.0, "{start:?} {end:?} {across:?}");
    }
    for blur_px in [f64::NAN, f64::INFINITY] {
        assert_eq!(pixels_of(&chord(start, end, across), blur_px, 64, 64), 0.0, "{blur_px}");
    }
}

#[test]
fn an_appearance_moves_in_bounded_steps_and_nothing_moves_it_astray() {
    let start = Appearance::START;
    let mut plain = start;
    let change = plain.correct([0.1, -0.05], 0.02);
    assert!((plain.x_blur_px / start.x_blur_px - libm::exp(0.1)).abs() < 1e-12);
    assert!((plain.y_blur_px / start.y_blur_px - libm::exp(-0.05)).abs() < 1e-12);
    assert!((change - (libm::exp(0.1) - 1.0)).abs() < 1e-12 && plain.growth_px == 0.02);

    let mut stepped = start;
    stepped.correct([5.0, -5.0], 0.0);
    assert!((stepped.x_blur_px / start.x_blur_px - libm::exp(LN_BLUR_STEP_MAX)).abs() < 1e-12);
    assert!((stepped.y_blur_px / start.y_blur_px - libm::exp(-LN_BLUR_STEP_MAX)).abs() < 1e-12);

    let mut far = start;
    for _ in 0..20 {
        far.correct([1.0, -1.0], 0.3);
    }
    assert_eq!((far.x_blur_px, far.y_blur_px), (BLUR_PX_MAX, BLUR_PX_MIN));
    assert!(far.growth_px > 0.6 && far.growth_px <= GROWTH_PX_MAX);

    let mut odd = plain;
    assert_eq!(odd.correct([f64::NAN; 2], f64::NAN), 0.0);
    assert_eq!(odd, plain);
    odd.correct([f64::NAN, 0.0], f64::INFINITY);
    assert_eq!(odd, plain);
}
