//! A camera that reads its rows one after the other, while the target moves.

use common::booth::{Booth, Shot};
use nalgebra::Vector3;
use plumbline::pose::{Cam, Pose, Target};

const RATE_HZ: f64 = 60.0;

/// Of the whole picture's 1088 rows.
const READOUT_NS: i32 = 16_000_000;

/// Motions to and fro, 0.9 times a second, at up to 200 mm/s or 1.7 rad/s.
const OMEGA_PER_S: f64 = 5.7;
const REACH_MM: f64 = 200.0 / OMEGA_PER_S;
const REACH_RAD: f64 = 0.3;

const FRAMES: usize = 56;

/// The velocity is known from three frames.
const FIRST_FRAMES: usize = 3;

/// How much of its reach a motion uses along each of theta1..6.
type Along = [f64; 6];

fn pose_at(along: &Along, time_s: f64) -> Pose<Cam, Target> {
    // From rest, as a person would.
    let swing = -(OMEGA_PER_S * time_s).cos();
    let [turn1, turn2, turn3, x, y, z] = *along;
    Pose::from_theta([
        0.03 + turn1 * REACH_RAD * swing,
        0.2 + turn2 * REACH_RAD * swing,
        -0.25 + turn3 * REACH_RAD * swing,
        2.0 + x * REACH_MM * swing,
        -1.0 + y * REACH_MM * swing,
        1000.0 + z * REACH_MM * swing,
    ])
}

fn velocity_mm_per_s(along: &Along, time_s: f64) -> Vector3<f64> {
    let [.., x, y, z] = *along;
    Vector3::new(x, y, z) * REACH_MM * OMEGA_PER_S * (OMEGA_PER_S * time_s).sin()
}

#[test]
fn a_moving_target_is_measured_as_well_as_a_still_one() {
    for (along, readout_ns) in [
        ([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], READOUT_NS),
        ([0.0, 0.0, 0.0, 0.0, 1.0, 0.0], READOUT_NS),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], READOUT_NS),
        ([1.0, 0.5, -0.5, 0.5, -0.5, 0.5], READOUT_NS),
        ([-0.5, 0.5, 0.5, 0.5, 0.5, -0.5], -READOUT_NS),
    ] {
        let mut rolling = Booth::rolling(6, 5, RATE_HZ, readout_ns);
        let mut global = Booth::at_hz(6, 5, RATE_HZ);
        let [mut squares, mut still_squares] = [Vector3::zeros(); 2];
        let (mut error_by_velocity, mut velocity_square) = (0.0, 0.0);
        for frame in 0..FRAMES {
            let moving = rolling.moving_error_mm(|time_s| pose_at(&along, time_s), &Shot::STANDARD);
            let (error_mm, time_s) = moving.expect("a whole target");
            // At rest at the same pose, with the same noise.
            let still = global.error_mm(&pose_at(&along, time_s), &Shot::STANDARD);
            let (still_mm, _) = still.expect("a whole target");
            if frame < FIRST_FRAMES {
                continue;
            }
            squares += error_mm.component_mul(&error_mm);
            still_squares += still_mm.component_mul(&still_mm);
            let velocity = velocity_mm_per_s(&along, time_s);
            error_by_velocity += error_mm.dot(&velocity);
            velocity_square += velocity.norm_squared();
        }
        // Without the rows' own times, the depth would be wrong by a hundred times the noise (see
        // below), and a position by 0.2 mm for each millisecond. What is left is the noise of the
        // velocity.
        let ratio = squares.component_div(&still_squares).map(f64::sqrt);
        let late_ms = 1e3 * error_by_velocity / velocity_square;
        println!("{along:?}: {:.3?} times as noisy, {late_ms:.4} ms late", ratio.as_slice());
        assert!(ratio.max() < 1.1, "{along:?}: {ratio}");
        assert!(late_ms.abs() < 0.1, "{along:?}: {late_ms} ms");
    }
}

/// What README says of a camera file without the setting.
#[test]
fn without_the_setting_depths_are_wrong_by_nearly_two_millimetres() {
    // Upwards and downwards: the rows draw the target higher or lower than it is.
    let along = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut booth = Booth::taken_for_global(6, 5, RATE_HZ, READOUT_NS);
    let mut worst_mm = 0.0_f64;
    // Half a period, with the fastest moment in its middle.
    for _ in 0..34 {
        let moving = booth.moving_error_mm(|time_s| pose_at(&along, time_s), &Shot::STANDARD);
        worst_mm = worst_mm.max(moving.expect("a whole target").0.z.abs());
    }
    println!("{worst_mm:.2} mm");
    // The largest of the errors: three deviations of 0.04 mm to either side.
    assert!((worst_mm - 1.86).abs() < 0.12, "{worst_mm}");
}
