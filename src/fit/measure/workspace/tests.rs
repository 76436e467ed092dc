//! Measurements of a target that is drawn: each row at a pose of its own.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::*;
use crate::fit::measure::measurement::{Rolling, delay_ns};
use crate::model::image::GreyImage;
use crate::model::lens::{Distortion, Lens};
use crate::model::shutter::Shutter;
use crate::model::target::{Origin, Role, TargetGeometry};
use crate::test_support::table;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const PITCH_MM: f64 = 12.0;
const COLUMNS: u8 = 6;
const ROWS: u8 = 5;

fn lens() -> Lens {
    Lens {
        width_px: WIDTH as u16,
        height_px: HEIGHT as u16,
        fx_px: 500.0,
        fy_px: 500.0,
        cx_px: 159.5,
        cy_px: 119.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    }
}

fn target() -> TargetGeometry {
    let origin = Origin::FirstCorner;
    TargetGeometry::checker(COLUMNS, ROWS, PITCH_MM, origin, Role::Upper, [0.0; 3]).unwrap()
}

/// Tilted, and seen beside the middle of the picture.
fn pose() -> Pose<Cam, Target> {
    Pose::from_theta([0.3, -0.4, 0.15, -30.0, -20.0, 420.0])
}

/// 16 ms for all rows, from the top.
fn shutter() -> Shutter {
    Shutter::new(16_000_000, HEIGHT as u16)
}

/// The target in the picture, if it moves by `per_row` from one row to the next, and is at [`pose`]
/// in the row of its middle.
fn drawn(per_row: &Vector6<f64>) -> Vec<u8> {
    const FINE: usize = 7;
    let lens = lens();
    let middle_row_px =
        lens.project(&pose().transform(&target().middle_mm())).expect("in the picture").y;
    let level = |u: f64, v: f64| {
        let is_within =
            (-1.0..f64::from(COLUMNS)).contains(&u) && (-1.0..f64::from(ROWS)).contains(&v);
        let is_dark = (libm::floor(u) + libm::floor(v)) % 2.0 == 0.0;
        if is_within && is_dark { 40.0 } else { 200.0 }
    };
    // Pixels are squares that are sampled finely; a binomial blurs them.
    let mut sharp = Vec::new();
    for row in 0..HEIGHT {
        let pose = pose().moved_by(&(per_row * (row as f64 - middle_row_px)));
        let picture_from_target = Matrix3::from_columns(&[
            pose.rotation.column(0).into_owned(),
            pose.rotation.column(1).into_owned(),
            pose.translation_mm,
        ]);
        let target_from_picture = picture_from_target.try_inverse().unwrap();
        for column in 0..WIDTH {
            let samples = (0..FINE * FINE).map(|sample| {
                let fine = |n: usize| (n as f64 + 0.5) / FINE as f64 - 0.5;
                let x = column as f64 + fine(sample % FINE) - lens.cx_px;
                let y = row as f64 + fine(sample / FINE) - lens.cy_px;
                let at = target_from_picture * Vector3::new(x / lens.fx_px, y / lens.fy_px, 1.0);
                level(at.x / at.z / PITCH_MM, at.y / at.z / PITCH_MM)
            });
            sharp.push(samples.sum::<f64>() / (FINE * FINE) as f64);
        }
    }
    let at = |column: usize, row: usize| sharp[row.min(HEIGHT - 1) * WIDTH + column.min(WIDTH - 1)];
    let across = |column: usize, row: usize| {
        (at(column.saturating_sub(1), row) + 2.0 * at(column, row) + at(column + 1, row)) / 4.0
    };
    (0..WIDTH * HEIGHT)
        .map(|n| {
            let (column, row) = (n % WIDTH, n / WIDTH);
            let rows = [row.saturating_sub(1), row, row + 1].map(|row| across(column, row));
            libm::round((rows[0] + 2.0 * rows[1] + rows[2]) / 4.0) as u8
        })
        .collect()
}

/// Measures the target in a picture, from a pose a little beside where it is.
fn measured(pixels: &[u8], rolling: Option<Rolling<'_>>) -> Fitted {
    let image = GreyImage::new(pixels, WIDTH, HEIGHT, WIDTH).unwrap();
    let (lens, target) = (table(&lens()), target());
    let view =
        View { image: &image, lens: &lens, target: &target, first_square_dark: true, rolling };
    let expected = pose().moved_by(&Vector6::new(2e-3, -1e-3, 1e-3, 0.2, -0.1, 0.3));
    let mut workspace = Box::new(Workspace::new());
    workspace.track(&view, &expected, Appearance::START).expect("a target that is seen")
}

#[test]
fn a_target_that_stands_still_is_where_it_is() {
    let found = measured(&drawn(&Vector6::zeros()), None);
    let off = pose().increment_to(&found.measurement.cam_from_target);
    let sd = found.measurement.covariance.diagonal().map(libm::sqrt);
    // Without noise: only the grey levels are rounded.
    assert!(off.iter().zip(&sd).all(|(off, sd)| off.abs() < *sd), "{off} {sd}");
    assert!(found.measurement.sd_mm().max() < 0.03, "{sd}");
    assert_eq!((found.measurement.corners, found.used.count_ones()), (30, 30));
}

/// Where the velocity is not known, each of its components may be as large as its standard deviation,
/// and move the pose by what it moves that of a target which has this velocity.
#[test]
fn an_unknown_velocity_adds_to_the_covariance_what_it_does_to_a_pose() {
    /// Of a velocity, in radians and millimetres per second.
    const SD_PER_S: [f64; 6] = [0.012, 0.012, 0.012, 12.0, 12.0, 12.0];
    /// So many times as fast, so that the last digit of the pixels matters less.
    const FASTER: f64 = 5.0;
    let rolling = Rolling { shutter: shutter(), time_ns: 0, motion: None };
    let still = drawn(&Vector6::zeros());
    let [known, unknown] = [None, Some(rolling)].map(|it| measured(&still, it).measurement);
    // It has been solved once more.
    let more = known.cam_from_target.increment_to(&unknown.cam_from_target);
    assert!(more.norm() < 0.01 * known.sd_mm().norm(), "{more}");
    assert_eq!(known.delay_ns, 0);
    let (lens, target) = (table(&lens()), target());
    assert_eq!(unknown.delay_ns, delay_ns(&shutter(), &lens, &target, &unknown.cam_from_target));
    let mut expected = Matrix6::zeros();
    for (component, sd_per_s) in SD_PER_S.into_iter().enumerate() {
        let mut per_row = Vector6::zeros();
        per_row[component] = FASTER * sd_per_s * shutter().row_s();
        let moving = measured(&drawn(&per_row), None).measurement;
        let moved = known.cam_from_target.increment_to(&moving.cam_from_target) / FASTER;
        expected += moved * moved.transpose();
    }
    let added = unknown.covariance - known.covariance;
    let sd = expected.diagonal().map(libm::sqrt);
    let off = Matrix6::from_fn(|a, b| (added[(a, b)] - expected[(a, b)]) / (sd[a] * sd[b]));
    // What a pass neglects of so large a motion, and what is left of the rounding.
    assert!(off.abs().max() < 0.1, "{off}");
}
