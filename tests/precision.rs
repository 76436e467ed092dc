//! How good a pose is, and whether it knows: one target at many poses, in all kinds of light.

#[path = "common/booth.rs"]
mod booth;
#[path = "common/repetitions.rs"]
mod repetitions;

use booth::{Booth, Shot};
use nalgebra::{Vector3, Vector6};
use plumbline::pose::{Cam, Pose, Target};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use repetitions::repetitions;

fn pose(tilt_deg: [f64; 2], place_mm: [f64; 3]) -> Pose<Cam, Target> {
    let [yaw, pitch] = tilt_deg.map(f64::to_radians);
    let [x, y, z] = place_mm;
    Pose::from_theta([0.03, yaw, pitch, x, y, z])
}

/// Errors in the deviations that each pose states for itself, over noises, blurs, distances
/// and tilts.
#[test]
fn poses_are_as_good_as_they_say() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut groups: Vec<(String, Vec<Vector3<f64>>)> = Vec::new();
    let scenes = 40;
    let frames = repetitions(27);
    for scene in 0..scenes {
        let [columns, rows] = if scene % 2 == 0 { [6, 5] } else { [5, 4] };
        let mut booth = Booth::new(columns, rows);
        let z_mm = [600.0, 800.0, 1000.0, 1400.0, 2000.0][scene % 5];
        let shot = Shot {
            noise_levels: [1.0, 2.0, 3.5][scene % 3],
            psf_sigma_px: [0.5, 0.7, 1.0, 1.5][scene % 4],
            ..Shot::default()
        };
        let tilt_deg =
            [(); 2].map(|()| random.random_range(5.0..25.0) * [1.0, -1.0][scene / 2 % 2]);
        let mut place = |side: f64| random.random_range(-side..side) * z_mm / 1000.0;
        let middle = pose(tilt_deg, [place(20.0), place(15.0), z_mm]);
        let mut normalised = Vec::new();
        for frame in 0..=frames {
            let sway = Vector6::from_fn(|_, _| random.random_range(-1.0..1.0))
                .component_mul(&Vector6::new(1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3));
            let truth = middle.moved_by(&sway);
            let (error_mm, found) = booth.error_mm(&truth, &shot).expect("a whole target");
            if frame > 0 {
                normalised.push(error_mm.component_div(&found.sd_mm()));
            }
        }
        groups.push((
            format!("{columns}x{rows} {z_mm} {} {}", shot.noise_levels, shot.psf_sigma_px),
            normalised,
        ));
    }
    for (name, normalised) in &groups {
        let sd: Vec<f64> = (0..3)
            .map(|axis| {
                (normalised.iter().map(|n| n[axis] * n[axis]).sum::<f64>()
                    / normalised.len() as f64)
                    .sqrt()
            })
            .collect();
        println!("{name}: {sd:.2?}");
    }
    let all: Vec<_> = groups.iter().flat_map(|(_, normalised)| normalised).collect();
    for axis in 0..3 {
        let square = all.iter().map(|n| n[axis] * n[axis]).sum::<f64>() / all.len() as f64;
        println!("axis {axis}: SD {:.3} of {}", square.sqrt(), all.len());
        assert!((0.9..1.1).contains(&square.sqrt()));
    }
}

fn path() -> Vec<Pose<Cam, Target>> {
    (0..120)
        .map(|step| {
            let t = f64::from(step) / 119.0;
            let swing = |turns: f64| (t * turns * std::f64::consts::TAU).sin();
            pose(
                [12.5 + 12.5 * swing(1.0), -10.0 + 15.0 * swing(0.7)],
                [15.0 * swing(1.3), 10.0 * swing(0.9), 980.0 + 40.0 * t],
            )
        })
        .collect()
}

#[test]
fn a_path_shows_no_bias_at_any_blur() {
    for [columns, rows] in [[6, 5], [5, 4]] {
        for psf_sigma_px in [0.5, 0.75, 1.0, 1.5] {
            let mut booth = Booth::new(columns, rows);
            let shot = Shot { psf_sigma_px, noise_levels: 0.0, ..Shot::default() };
            let mut worst = Vector3::zeros();
            let mut mean = Vector3::zeros();
            let _ = booth.error_mm(&path()[0], &shot);
            for truth in path() {
                let (error_mm, _) = booth.error_mm(&truth, &shot).expect("a whole target");
                worst = worst.sup(&error_mm.abs());
                mean += error_mm / 120.0;
            }
            println!("{columns}x{rows} psf {psf_sigma_px}: worst {worst:.4?} mean {mean:.4?}");
        }
    }
}

#[test]
fn what_light_and_motion_do() {
    let still = Shot { noise_levels: 0.0, ..Shot::default() };
    let shots = [
        ("plain", still),
        ("30 % less light", Shot { light: 0.7, ..still }),
        ("30 % more light", Shot { light: 1.3, ..still }),
        ("gradient of 30 % across the target", Shot { gradient: 0.3 * 400.0 / 146.0, ..still }),
        ("1 px of motion to the side", Shot { motion_mm: Vector3::new(0.575, 0.0, 0.0), ..still }),
        ("1 px of motion downwards", Shot { motion_mm: Vector3::new(0.0, 0.575, 0.0), ..still }),
        ("1 px more defocus", Shot { psf_sigma_px: 1.6, ..still }),
    ];
    for [columns, rows] in [[6, 5], [5, 4]] {
        for (name, shot) in &shots {
            let mut booth = Booth::new(columns, rows);
            let (mut worst, mut mean) = (Vector3::<f64>::zeros(), Vector3::<f64>::zeros());
            let _ = booth.error_mm(&path()[0], shot);
            for truth in path().iter() {
                let (error_mm, _) = booth.error_mm(truth, shot).expect("a whole target");
                worst = worst.sup(&error_mm.abs());
                mean += error_mm / 120.0;
            }
            println!("{columns}x{rows} {name}: worst {worst:.4?} mean {mean:.4?}");
        }
    }
}
