//! `plumb scene`: where the scene board stands, which gives the body's axes.

use std::path::PathBuf;

use nalgebra::{Matrix3, Vector3};
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::target::Role;

use crate::error::BadInput;
use crate::files::frames::FrameSource;
use crate::files::scene::{self, SceneFile};
use crate::files::{self, refuse_overwriting};
use crate::setup::{self, Descriptions};
use crate::track;

/// Measure where the scene board stands, and so which way is forward, to the right and up.
///
/// Stand the board (role "scene" in the targets file) upright where the person will stand, its
/// face towards the camera, its columns' axis level. Record a second of frames with nobody
/// near. The mean pose of the board becomes scene.toml, which `plumb track` and `plumb
/// provision` take: trunk points are given along its axes.
///
/// A warning says when the board leans, or when it or the camera moved meanwhile.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:
  plumb scene --camera camera.toml --targets targets.toml --out scene.toml board.y4m
  plumb scene --camera camera.toml --targets targets.toml --camera-pitch-deg 10 --out scene.toml board/*.png"
)]
pub struct Arguments {
    #[command(flatten)]
    descriptions: Descriptions,
    /// How far the camera looks down: 0 when it is level.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    camera_pitch_deg: f64,
    /// Warn when the board leans by more than this.
    #[arg(long, value_name = "DEGREES", default_value_t = 3.0)]
    upright_deg: f64,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the file of --out if it exists.
    #[arg(long)]
    force: bool,
    /// Y4M videos or images; - is standard input.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
}

/// Fewer poses say nothing about whether the board stood still.
const POSES_MIN: usize = 10;

/// A board and a camera at rest show less than this (standard deviations of one frame).
const SPREAD_DEG_MAX: f64 = 0.2;
const SPREAD_MM_MAX: f64 = 0.5;

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used, the board is not seen often enough, or the file cannot be
/// written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let places = arguments.descriptions.places();
    refuse_overwriting(&arguments.out, arguments.descriptions.paths().chain(&arguments.inputs))?;
    for (option, value) in [
        ("--camera-pitch-deg", arguments.camera_pitch_deg),
        ("--upright-deg", arguments.upright_deg),
    ] {
        if !(-90.0..=90.0).contains(&value) {
            return Err(BadInput::whole(option, value, "give degrees, within -90 to 90").into());
        }
    }
    let (camera, mut targets, _) = arguments.descriptions.read()?;
    targets.targets.retain(|target| target.geometry.role() == Role::Scene);
    if targets.targets.is_empty() {
        return Err(BadInput::new(
            &places.targets,
            "role",
            "no target has the role \"scene\"",
            "add the board: name, role = \"scene\", columns, rows, pitch_mm",
        )
        .into());
    }
    let mut source = FrameSource::open(&arguments.inputs, None)?;
    let (_, mut pipeline) = setup::pipeline(&camera, &targets, None, &source, &places)?;
    let mut poses = Vec::new();
    let mut frames = 0;
    while let Some(frame) = source.next_frame()? {
        frames += 1;
        let report = track::step(&mut pipeline, &frame);
        poses.extend(report.targets[0].measurement.iter().map(|found| found.cam_from_target));
    }
    if poses.len() < POSES_MIN {
        return Err(BadInput::whole(
            arguments.inputs[0].display(),
            format!("the scene board is seen in {} of {frames} frames", poses.len()),
            format!(
                "{POSES_MIN} are needed: check its columns, rows and light; `plumb track --draw` shows the frames"
            ),
        )
        .into());
    }
    let mean = Mean::of(&poses);
    let name = arguments.inputs[0].display();
    let file = SceneFile {
        cam_from_scene_theta: mean.cam_from_scene.theta(),
        source: format!(
            "{name}, {} frames, spread {:.3} degrees and {:.3} mm, {}",
            poses.len(),
            mean.spread_deg,
            mean.spread_mm,
            jiff::Zoned::now().date()
        ),
    };
    files::write_all(
        &[(arguments.out.clone(), scene::to_toml(&file).into_bytes())],
        arguments.force,
    )?;
    let leans_deg = lean_deg(&mean.cam_from_scene, arguments.camera_pitch_deg);
    eprintln!(
        "{} of {frames} frames; spread of one frame {:.3} degrees and {:.3} mm; the board leans by {leans_deg:.1} degrees",
        poses.len(),
        mean.spread_deg,
        mean.spread_mm
    );
    if leans_deg > arguments.upright_deg {
        eprintln!(
            "warning: the board leans by {leans_deg:.1} degrees from upright (more than --upright-deg {}); up and forward lean with it: set it upright with a level, or say with --camera-pitch-deg how far the camera looks down",
            arguments.upright_deg
        );
    }
    if mean.spread_deg > SPREAD_DEG_MAX || mean.spread_mm > SPREAD_MM_MAX {
        eprintln!(
            "warning: the board's pose varies by {:.2} degrees and {:.2} mm; board or camera moved, or the board is too small or too far away: let both stand still, and go nearer",
            mean.spread_deg, mean.spread_mm
        );
    }
    eprintln!("written to {}", arguments.out.display());
    Ok(())
}

/// The mean pose of a board at rest, and how single ones are spread about it.
struct Mean {
    cam_from_scene: Pose<Cam, Scene>,
    /// Root mean square angle from the mean.
    spread_deg: f64,
    /// Root mean square distance from the mean.
    spread_mm: f64,
}

impl Mean {
    /// The rotation is the nearest one to the mean of the matrices (chordal mean).
    fn of(poses: &[Pose<Cam, Target>]) -> Self {
        let count = poses.len() as f64;
        let sum: Matrix3<f64> = poses.iter().map(|pose| pose.rotation).sum();
        let decomposed = sum.svd(true, true);
        let (left, right) = decomposed.u.zip(decomposed.v_t).expect("both were asked for");
        let rotation = left * right;
        let translation_mm =
            poses.iter().map(|pose| pose.translation_mm).sum::<Vector3<f64>>() / count;
        let angle = |pose: &Pose<Cam, Target>| {
            // The chord of an angle a between two rotations is sqrt(8) sin(a / 2).
            2.0 * ((pose.rotation - rotation).norm() / 8.0_f64.sqrt()).min(1.0).asin()
        };
        let squares: f64 = poses.iter().map(|pose| angle(pose).powi(2)).sum();
        let squares_mm2: f64 =
            poses.iter().map(|pose| (pose.translation_mm - translation_mm).norm_squared()).sum();
        Self {
            cam_from_scene: Pose::new(rotation, translation_mm),
            spread_deg: (squares / count).sqrt().to_degrees(),
            spread_mm: (squares_mm2 / count).sqrt(),
        }
    }
}

/// The angle between the board's downward axis and where gravity is expected to pull.
fn lean_deg(cam_from_scene: &Pose<Cam, Scene>, camera_pitch_deg: f64) -> f64 {
    let (sine, cosine) = camera_pitch_deg.to_radians().sin_cos();
    let gravity = Vector3::new(0.0, cosine, sine);
    gravity.dot(&cam_from_scene.rotation.column(1)).clamp(-1.0, 1.0).acos().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_poses_about_one_is_that_one() {
        let middle = Pose::<Cam, Target>::from_theta([0.1, 0.3, -0.2, 10.0, 20.0, 900.0]);
        let off = |sign: f64| {
            middle.moved_by(&(nalgebra::Vector6::new(0.01, -0.02, 0.02, 0.3, 0.4, 0.0) * sign))
        };
        let mean = Mean::of(&[off(1.0), off(-1.0)]);
        assert!((mean.cam_from_scene.rotation - middle.rotation).norm() < 1e-12);
        assert!((mean.cam_from_scene.translation_mm - middle.translation_mm).norm() < 1e-12);
        // Each is turned by 0.03 rad and moved by 0.5 mm.
        assert!((mean.spread_deg - 0.03_f64.to_degrees()).abs() < 1e-9);
        assert!((mean.spread_mm - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_board_leans_by_its_angle_to_gravity() {
        let upright = Pose::<Cam, Scene>::from_theta([0.0, 0.4, 0.0, 0.0, 0.0, 900.0]);
        assert!(lean_deg(&upright, 0.0) < 1e-6);
        // A camera that looks down by 10 degrees sees an upright board tilted.
        assert!((lean_deg(&upright, 10.0) - 10.0).abs() < 1e-9);
        let tilt = 10.0_f64.to_radians();
        let seen = Pose::<Cam, Scene>::from_theta([0.0, 0.0, tilt, 0.0, 0.0, 900.0]);
        assert!(lean_deg(&seen, 10.0) < 1e-6, "{}", lean_deg(&seen, 10.0));
    }
}
