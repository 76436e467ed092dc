//! A camera that reads its rows one after the other, while the target moves.

use common::booth::{Booth, Shot};
use nalgebra::{Vector3, Vector6};
use plumbline::pose::{Cam, Pose, Target};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
            let moving = rolling.moving_error(|time_s| pose_at(&along, time_s), &Shot::STANDARD);
            let (error, time_s, _) = moving.expect("a whole target");
            let error_mm = error.fixed_rows::<3>(3).into_owned();
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
        let moving = booth.moving_error(|time_s| pose_at(&along, time_s), &Shot::STANDARD);
        worst_mm = worst_mm.max(moving.expect("a whole target").0[5].abs());
    }
    println!("{worst_mm:.2} mm");
    // The largest of the errors: three deviations of 0.04 mm to either side.
    assert!((worst_mm - 1.86).abs() < 0.12, "{worst_mm}");
}

/// Of each component of a sway's velocity: 12 mm/s along each axis, as in a brisk one, and about each
/// as at a metre from the ankles.
const SWAY_SD_PER_S: [f64; 6] = [0.012, 0.012, 0.012, 12.0, 12.0, 12.0];

const TRIALS: u64 = 120;

/// What the errors of a target that sways are, over many trials.
#[derive(Debug, Default)]
struct Errors {
    depth_mm: f64,
    /// The same in standard deviations as stated.
    depth_in_sd: f64,
    /// Root mean square of all six components, independent of each other.
    in_sd: f64,
}

/// The errors of each of the first frames that see a target that moves as in a sway.
fn first_errors<const N: usize>(rate_hz: f64, readout_ns: i32) -> [Errors; N] {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    // Numbers uniform from -1 to 1 have a standard deviation of 1 / sqrt(3).
    let mut drawn =
        || SWAY_SD_PER_S.map(|sd| sd * 3.0_f64.sqrt() * random.random_range(-1.0..1.0)).into();
    let middle = pose_at(&[0.0; 6], 0.0);
    let mut errors = std::array::from_fn(|_| Errors::default());
    for trial in 0..TRIALS {
        let readout_ns = if trial % 2 == 0 { readout_ns } else { -readout_ns };
        let mut booth = Booth::rolling(6, 5, rate_hz, readout_ns).with_noise(trial);
        let velocity_per_s: Vector6<f64> = drawn();
        let change_per_s2: Vector6<f64> = OMEGA_PER_S * drawn();
        let pose_at = |time_s: f64| {
            middle.moved_by(&((velocity_per_s + change_per_s2 * (0.5 * time_s)) * time_s))
        };
        for errors in &mut errors {
            let moving = booth.moving_error(pose_at, &Shot::STANDARD);
            let (error, _, found) = moving.expect("a whole target");
            let depth_square_mm2 = error[5] * error[5];
            errors.depth_mm += depth_square_mm2;
            errors.depth_in_sd += depth_square_mm2 / found.covariance[(5, 5)];
            let precision = found.covariance.try_inverse().expect("a covariance");
            errors.in_sd += error.dot(&(precision * error)) / 6.0;
        }
    }
    errors.map(|squares| {
        let root = |sum: f64| (sum / TRIALS as f64).sqrt();
        let Errors { depth_mm, depth_in_sd, in_sd } = squares;
        Errors { depth_mm: root(depth_mm), depth_in_sd: root(depth_in_sd), in_sd: root(in_sd) }
    })
}

/// The first pose takes the target to stand still, and its covariance says what that costs.
#[test]
fn a_first_pose_says_how_much_an_unknown_velocity_may_move_it() {
    let [first] = first_errors(RATE_HZ, READOUT_NS);
    println!("{first:?}");
    // A vertical velocity alone moves the depth by 0.012 mm per mm/s, ten times the noise; the other
    // components add less than as much again.
    assert!((0.144..0.2).contains(&first.depth_mm), "{first:?}");
    // The trials determine the first to 4 %, and the second to 3 %.
    assert!((first.depth_in_sd - 1.0).abs() < 0.15, "{first:?}");
    assert!((first.in_sd - 1.0).abs() < 0.1, "{first:?}");
}

/// From the second on, a velocity is known: half an interval ago. With a shutter that takes up all of
/// the time between frames, what has changed since then moves the depth by more than the noise; without
/// that, the errors of second poses were 1.7 SD. From the third pose on, also the change is known.
#[test]
fn a_second_pose_says_how_much_an_unknown_acceleration_may_move_it() {
    let [_, second, third] = first_errors(30.0, 2 * READOUT_NS);
    println!("{second:?}, {third:?}");
    assert!(second.depth_mm > 1.4 * third.depth_mm, "{second:?}, {third:?}");
    for errors in [second, third] {
        // The bounds of the first pose.
        assert!((errors.depth_in_sd - 1.0).abs() < 0.15, "{errors:?}");
        assert!((errors.in_sd - 1.0).abs() < 0.1, "{errors:?}");
    }
}
