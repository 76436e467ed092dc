//! Cameras that are known, from rendered photographs of a board; and real photographs.

#[path = "common/repetitions.rs"]
mod repetitions;

use nalgebra::Vector3;
use plumb::calibrate::{Calibration, Failure, Picture, calibrate};
use plumb::simulate::render::{Board, Ink, Picture as Rendered, PlacedBoard, render_targets};
use plumb::simulate::sensor::Sensor;
use plumbline::lens::{Distortion, Lens};
use plumbline::nodes::points_mm;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use repetitions::repetitions;

const PITCH_MM: f64 = 20.0;

fn board() -> TargetGeometry {
    TargetGeometry::checker(9, 7, PITCH_MM, Origin::Center, Role::Scene, [0.0; 3]).unwrap()
}

/// A usual lens, a wide one, and one whose pixels are no rectangles.
fn lenses() -> [Lens; 3] {
    let mild = Lens {
        width_px: 800,
        height_px: 600,
        fx_px: 1000.0,
        fy_px: 1002.0,
        cx_px: 408.0,
        cy_px: 293.0,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-0.12, 0.08]),
    };
    let wide = Distortion::Radial2([-0.28, 0.09]);
    [
        mild,
        Lens { fx_px: 520.0, fy_px: 521.0, distortion: wide, ..mild },
        Lens { fy_px: 990.0, skew_px: 3.0, ..mild },
    ]
}

/// A pose that shows all of the board.
fn random_pose(lens: &Lens, random: &mut ChaCha8Rng) -> Pose<Cam, Target> {
    let points: Vec<Vector3<f64>> = points_mm(&board()).collect();
    loop {
        let mut tilt = || random.random_range(-0.6..0.6);
        let [yaw, pitch] = [tilt(), tilt()];
        let roll = random.random_range(-0.3..0.3);
        let z_mm = random.random_range(0.45..0.9) * lens.fx_px;
        let mut side_mm = |side_px: u16| {
            random.random_range(-0.4..0.4) * f64::from(side_px) / lens.fx_px * z_mm
        };
        let place = [side_mm(lens.width_px), side_mm(lens.height_px)];
        let pose = Pose::from_theta([roll, yaw, pitch, place[0], place[1], z_mm]);
        let inside = |point: &Vector3<f64>| {
            lens.project(&pose.transform(point)).is_some_and(|px| {
                (12.0..f64::from(lens.width_px) - 12.0).contains(&px.x)
                    && (12.0..f64::from(lens.height_px) - 12.0).contains(&px.y)
            })
        };
        if points.iter().all(inside) {
            return pose;
        }
    }
}

/// Photographs of a board at random poses.
fn photographs(lens: &Lens, board: &Board, count: usize, seed: u64) -> Vec<Picture> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (width, height) = (usize::from(lens.width_px), usize::from(lens.height_px));
    (0..count)
        .map(|index| {
            let cam_from_target = random_pose(lens, &mut random);
            let mut picture = Rendered::uniform(width, height, 110.0);
            let placed = PlacedBoard { board, cam_from_target };
            render_targets(lens, 0.6, &[placed], |_, _| 1.0, &mut picture);
            let mut samples = vec![0_u8; width * height];
            Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, seed, index as u64, &mut samples);
            Picture { place: format!("{index}.png"), samples, width, height }
        })
        .collect()
}

fn printed(geometry: &TargetGeometry) -> Board {
    Board::new(geometry, 15.0, Ink { black: 30.0, white: 210.0 })
}

fn calibrated(lens: &Lens, photographs: &[Picture]) -> Calibration {
    let start = match lens.distortion {
        Distortion::Radial2(_) => Distortion::Radial2([0.0; 2]),
        Distortion::Brown5(_) => Distortion::Brown5([0.0; 5]),
    };
    calibrate(photographs, &board(), start, || ()).unwrap_or_else(|failure| panic!("{failure:?}"))
}

/// The errors of 100 calibrations, in the standard deviations that each states.
#[test]
fn errors_are_as_large_as_they_are_said_to_be() {
    let seeds = repetitions(100) as u64;
    let print = printed(&board());
    let errors: Vec<[f64; 3]> = (0..seeds)
        .into_par_iter()
        .map(|seed| {
            let truth = lenses()[(seed % 3) as usize];
            let found = calibrated(&truth, &photographs(&truth, &print, 10, seed));
            let k1 = |lens: &Lens| lens.distortion.coefficients()[0];
            [
                (found.lens.fx_px - truth.fx_px) / found.sd[0],
                (found.lens.cx_px - truth.cx_px) / found.sd[2],
                (k1(&found.lens) - k1(&truth)) / found.sd[5],
            ]
        })
        .collect();
    for (place, name) in ["fx", "cx", "k1"].into_iter().enumerate() {
        let squares: f64 = errors.iter().map(|error| error[place] * error[place]).sum();
        let sd = (squares / errors.len() as f64).sqrt();
        println!("{name}: normalised errors' SD {sd:.3} of {}", errors.len());
        // 100 of them know it to 7 %; in an emulator there are 10.
        let off = if errors.len() < 100 { 0.6 } else { 0.2 };
        assert!((sd - 1.0).abs() < off, "{name}: {sd}");
    }
}

#[test]
fn a_bent_board_is_told_and_a_flat_one_is_not() {
    let lens = lenses()[0];
    let flat = calibrated(&lens, &photographs(&lens, &printed(&board()), 12, 5));
    let (shape, sd) = flat.shape.expect("a shape");
    for (value, sd) in shape.bend_per_mm.iter().chain([&shape.stretch]).zip(&sd) {
        // Four numbers: one in 4,000 such tests would fail by chance.
        assert!(value.abs() < 4.0 * sd, "{value} +- {sd}");
    }
}

#[test]
fn boards_that_do_not_make_a_camera_are_refused() {
    let lens = lenses()[0];
    let print = printed(&board());
    let two = photographs(&lens, &print, 2, 1);
    let refused = |pictures: &[Picture]| {
        calibrate(pictures, &board(), Distortion::Radial2([0.0; 2]), || ()).err()
    };
    assert_eq!(refused(&two), Some(Failure::TooFew(2)));
}
