//! A sudden step: a person who stumbles accelerates within one frame, and is not lost.

use common::booth::{Booth, Shot};
use nalgebra::{Vector3, Vector6};
use plumbline::pose::Pose;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Half of gravity: the largest acceleration of a standing person's trunk.
const STUMBLE_MM_PER_S2: f64 = 5_000.0;

/// How long it lasts, and the speed that is then kept for a moment: 0.5 m/s.
const STUMBLE_S: f64 = 0.1;

/// Where the stumble has taken the target, a time after its beginning.
fn moved_mm(time_s: f64) -> f64 {
    let pushed_s = time_s.clamp(0.0, STUMBLE_S);
    let coasting_s = (time_s - STUMBLE_S).max(0.0);
    STUMBLE_MM_PER_S2 * (0.5 * pushed_s * pushed_s + STUMBLE_S * coasting_s)
}

#[test]
fn a_stumble_is_followed_at_60_and_at_30_hz() {
    let directions =
        [Vector3::x(), -Vector3::y(), Vector3::new(0.6, 0.0, 0.8), Vector3::new(0.0, 0.3, -0.95)];
    for rate_hz in [60.0, 30.0] {
        for direction in directions {
            let mut booth = Booth::at_hz(6, 5, rate_hz);
            // The frames before, quietly, and those until the target has gone 45 mm.
            let quiet_frames = 4;
            let frames = quiet_frames + (0.14 * rate_hz) as i32;
            for frame in 0..=frames {
                let since_s = f64::from(frame - quiet_frames) / rate_hz;
                let start = Vector3::new(-20.0, 15.0, 1000.0);
                let at_mm = start + direction * moved_mm(since_s);
                let pose = Pose::from_theta([0.02, 0.1, -0.05, at_mm.x, at_mm.y, at_mm.z]);
                // The speed itself blurs the picture in an exposure of 4 ms.
                let speed = (moved_mm(since_s + 1e-3) - moved_mm(since_s - 1e-3)) / 2e-3;
                let shot = Shot { motion_mm: direction * speed * 4e-3, ..Shot::STANDARD };
                let found = booth.error_mm(&pose, &shot);
                let what = format!("{rate_hz} Hz, {direction:?}, frame {frame}");
                let (error_mm, measurement) =
                    found.unwrap_or_else(|reason| panic!("{what}: {reason:?}"));
                // Five standard deviations, and what a blur of 2 mm that is not a Gaussian leaves.
                let bound_mm = measurement.sd_mm() * 5.0 + Vector3::repeat(0.05);
                let is_right = (0..3).all(|axis| error_mm[axis].abs() < bound_mm[axis]);
                assert!(is_right, "{what}: {error_mm:?} of {bound_mm:?}");
            }
        }
    }
}

/// A camera that is knocked turns by a degree or two: farther in one frame than any person moves,
/// so that what was expected says nothing. A grid that is shifted by two squares, or by one across
/// and one down, has most of its edges where the target has some.
#[test]
fn after_a_jump_a_target_is_where_it_is_or_missed() {
    const PX_MM: f64 = 1000.0 / 1740.0;
    let start = Vector3::new(-5.0, 5.0, 1000.0);
    for (columns, rows) in [(6, 5), (5, 4)] {
        for eighth in 0..8 {
            let direction = f64::from(eighth) * std::f64::consts::FRAC_PI_4 + 0.1;
            for jump_px in (1..=20).map(|step| f64::from(step) * 2.5 - 0.4) {
                let mut booth = Booth::new(columns, rows);
                let side = Vector3::new(direction.cos(), direction.sin(), 0.0) * jump_px * PX_MM;
                let mut missed = 0;
                for frame in 0..7 {
                    let at_mm = if frame < 3 { start } else { start + side };
                    let pose = Pose::from_theta([0.03, 0.1, -0.08, at_mm.x, at_mm.y, at_mm.z]);
                    match booth.error_mm(&pose, &Shot::STANDARD) {
                        Ok((error_mm, measurement)) => {
                            let off = error_mm.component_div(&measurement.sd_mm()).abs().max();
                            let what = format!("{columns} x {rows}, {side:?}, frame {frame}");
                            // Only in one run of 170 is one of 10,000 correct numbers off by more
                            // than five deviations; a blur that is not known yet adds a little to
                            // the first ones.
                            assert!(off < 6.0, "{what}: {error_mm:?}, {off} deviations");
                        }
                        Err(_) => missed += 1,
                    }
                }
                // The region around the prediction is searched within a frame or two.
                assert!(missed <= 2, "{columns} x {rows}, {side:?}: missed in {missed} frames");
            }
        }
    }
}

/// The same for a target that is then up to half a square away in any direction, nearer or farther, and
/// turned: a few of its edges may lie where others were expected, and agree on a pose near the right one.
/// All six numbers must be right, not the position alone.
#[test]
fn after_a_jump_in_all_directions_a_pose_is_right_or_missing() {
    const JUMPS: u64 = 300;
    // Of a sum of six squares, chance has two in ten million above this, and here are 1,800.
    const SQUARE_MAX: f64 = 42.0;
    (0..JUMPS).into_par_iter().for_each(|jump| {
        let mut random = ChaCha8Rng::seed_from_u64(jump);
        let [columns, rows] = if jump % 2 == 0 { [6, 5] } else { [5, 4] };
        let mut booth = Booth::new(columns, rows).with_noise(jump);
        // Tilted, so that the mirror image is another pose.
        let z_mm = random.random_range(1200.0..2000.0);
        let start = Pose::from_theta([0.03, 0.35, -0.25, -5.0, 5.0, z_mm]);
        let reach = Vector6::new(0.1, 0.1, 0.1, 8.0, 8.0, 30.0);
        let away = reach.map(|reach| reach * random.random_range(-1.0..1.0));
        let mut missed = 0;
        for frame in 0..6 {
            let pose = if frame < 2 { start } else { start.moved_by(&away) };
            let Ok((_, found)) = booth.error_mm(&pose, &Shot::STANDARD) else {
                missed += 1;
                continue;
            };
            let error = pose.increment_to(&found.cam_from_target);
            let precision = found.covariance.cholesky().expect("a covariance").inverse();
            let square = error.dot(&(precision * error));
            assert!(
                square < SQUARE_MAX,
                "jump {jump} by {away:?}, frame {frame}: {error:?} is {square} in deviations squared"
            );
        }
        // The frame of the jump.
        assert!(missed <= 1, "jump {jump} by {away:?}: {missed} of 6 frames missed");
    });
}
