//! `plumb scene`: where the scene board stands, which gives the body's axes.

mod live;
mod recorded;

use std::path::PathBuf;
use std::time::Duration;

use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Target};

use crate::arguments::{LinkArguments, seconds};
use crate::background;
use crate::delivery::{self, Before};
use crate::setup::{self, Descriptions};
use plumbline_calibration::background::Picture;
use plumbline_calibration::scene::{Mean, lean_deg};
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_files::counting::counted;
use plumbline_files::lens_id::LensId;
use plumbline_files::refuse_overwriting;
use plumbline_files::scene::{self, SceneFile};

/// Measure where the scene board stands, and so which way is forward, to the right and up.
///
/// Stand the board (role "scene" in the targets file) upright where the person will stand, its
/// face towards the camera, its columns' axis level, with nobody near. The mean pose of the
/// board becomes scene.toml, which `plumb track` and `plumb provision` take: trunk points are
/// given along its axes. It holds for the camera that it was measured with, and names it: with the
/// file of another camera, or of another calibration, it is refused.
///
/// Without INPUT the box that this computer hears is watched while it looks at the board.
/// --store then puts the scene into the box's own configuration, and restarts it.
///
/// A warning says when the board leans, or when it or the camera moved meanwhile.
///
/// A small picture of the background is kept on this computer, so that `plumb doctor` and `plumb
/// receive` see whether the camera was moved since. To take it, the box is in set-up mode for a
/// moment.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    group(clap::ArgGroup::new("outputs").args(["out", "store"]).required(true).multiple(true)),
    after_help = "Examples:
  plumb scene --store                    # the box that sends to this computer
  plumb scene --serial /dev/ttyUSB0 --seconds 3 --out scene.toml
  plumb scene --camera camera.toml --targets targets.toml --out scene.toml board.y4m
  plumb scene --camera camera.toml --targets targets.toml --camera-pitch-deg 10 --out scene.toml board/*.png"
)]
pub struct Arguments {
    /// With INPUT: camera.toml, OpenCV (YAML or JSON), or ROS camera_info (YAML).
    #[arg(long, value_name = "FILE", requires = "inputs")]
    camera: Option<PathBuf>,
    /// With INPUT: the targets file, with the scene board.
    #[arg(long, value_name = "FILE", requires = "inputs")]
    targets: Option<PathBuf>,
    /// Where the box is heard.
    #[command(flatten)]
    link: LinkArguments,
    /// How long the box is watched.
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = seconds,
        default_value = "1",
        conflicts_with = "inputs"
    )]
    seconds: Duration,
    /// How far the camera looks down: 0 when it is level.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    camera_pitch_deg: f64,
    /// Warn when the board leans by more than this.
    #[arg(long, value_name = "DEGREES", default_value_t = 3.0)]
    upright_deg: f64,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the file of --out if it exists.
    #[arg(long, requires = "out")]
    force: bool,
    /// Put the scene into the box's configuration, and restart the box.
    #[arg(long, conflicts_with = "inputs")]
    store: bool,
    /// With --store: do not restart the box; it takes effect at its next start.
    #[arg(long, requires = "store")]
    no_restart: bool,
    /// Y4M videos or images; - is standard input.
    #[arg(
        value_name = "INPUT",
        requires_all = ["camera", "targets"],
        conflicts_with_all = ["udp", "serial"]
    )]
    inputs: Vec<PathBuf>,
}

/// Fewer poses say nothing about whether the board stood still.
const POSES_MIN: usize = 10;

/// A board and a camera at rest show less than this (standard deviations of one frame).
const SPREAD_DEG_MAX: f64 = 0.2;
const SPREAD_MM_MAX: f64 = 0.5;

/// What varies by this is no board at rest, and nothing can be made of its mean.
const MOVED_DEG: f64 = 10.0 * SPREAD_DEG_MAX;
const MOVED_MM: f64 = 10.0 * SPREAD_MM_MAX;

/// A board that leans further has not slipped: it was put there the wrong way round.
const OVERTURNED_DEG: f64 = 45.0;

/// What was seen of the board.
struct Seen {
    /// The recording or the box.
    place: String,
    /// What it was seen through.
    lens: Lens,
    frames: usize,
    poses: Vec<Pose<Cam, Target>>,
    /// What the camera saw, small; `None` where no picture came.
    background: Option<Picture>,
    /// What to do where these poses are too few.
    remedy: String,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used, the board is not seen often enough, the file cannot be
/// written, or the box does not take the scene.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    for (option, value) in [
        ("--camera-pitch-deg", arguments.camera_pitch_deg),
        ("--upright-deg", arguments.upright_deg),
    ] {
        if !(-90.0..=90.0).contains(&value) {
            return Err(BadInput::whole(option, value, "give degrees, within -90 to 90").into());
        }
    }
    let (Some(camera), Some(targets)) = (&arguments.camera, &arguments.targets) else {
        return Ok(of_a_box(arguments)?);
    };
    if let Some(out) = &arguments.out {
        refuse_overwriting(out, [camera, targets].into_iter().chain(&arguments.inputs))?;
    }
    let descriptions = Descriptions::of(camera, targets, None);
    let seen = recorded::track(&descriptions, &arguments.inputs)?;
    measure(arguments, &seen)?;
    Ok(())
}

/// As [`run`], with the poses of a live box.
fn of_a_box(arguments: &Arguments) -> Result<(), BadInput> {
    let mut link = arguments.link.open()?;
    let hello = delivery::greet(&mut link)?;
    live::check_board(link.place(), &hello)?;
    let old = if arguments.store { link.config_to_change()? } else { link.config()? };
    if camera::is_stand_in(&old.lens) {
        return Err(setup::not_calibrated(link.place()));
    }
    let seen = live::listen(&mut link, &hello, old.lens, arguments.seconds)?;
    let measured = measure(arguments, &seen)?;
    if !arguments.store {
        return Ok(());
    }
    let mut config = old.clone();
    config.cam_from_scene_theta = Some(measured.cam_from_scene_theta);
    let before = Before { hello: Some(hello), config: Some(old) };
    delivery::deliver(&mut link, &before, &config, !arguments.no_restart)
}

/// What to do where the board is seen too seldom.
fn too_few(poses: usize, frames: usize, remedy: &str) -> String {
    if poses == frames && frames > 0 {
        return format!(
            "{POSES_MIN} are needed, to see that it stands still: give more, as a video or at least \
             {POSES_MIN} pictures, or watch for longer with --seconds"
        );
    }
    format!("{POSES_MIN} are needed: {remedy}")
}

/// The scene of what was seen: judged, shown, and written to the file of --out, if any.
fn measure(arguments: &Arguments, seen: &Seen) -> Result<SceneFile, BadInput> {
    let Seen { place, poses, remedy, .. } = seen;
    let frames = counted(seen.frames, "frame");
    if poses.len() < POSES_MIN {
        return Err(BadInput::whole(
            place,
            format!("the scene board is seen in {} of {frames}", poses.len()),
            too_few(poses.len(), seen.frames, remedy),
        ));
    }
    let mean = Mean::of(poses);
    if mean.spread_deg > MOVED_DEG || mean.spread_mm > MOVED_MM {
        return Err(BadInput::whole(
            place,
            format!(
                "the board's pose varies by {:.1} degrees and {:.1} mm: it was moved",
                mean.spread_deg, mean.spread_mm
            ),
            "nothing is kept; let board and camera stand still, and try again",
        ));
    }
    let file = SceneFile {
        cam_from_scene_theta: mean.cam_from_scene.theta(),
        source: format!(
            "{place}, {}, spread {:.3} degrees and {:.3} mm, {}",
            counted(poses.len(), "frame"),
            mean.spread_deg,
            mean.spread_mm,
            jiff::Zoned::now().date()
        ),
        camera: Some(LensId::of(&seen.lens)),
    };
    if let Some(out) = &arguments.out {
        plumbline_files::write_all(
            &[(out.clone(), scene::to_toml(&file).into_bytes())],
            arguments.force,
        )?;
    }
    let leans_deg = lean_deg(&mean.cam_from_scene, arguments.camera_pitch_deg);
    eprintln!(
        "{} of {frames}; spread of one frame {:.3} degrees and {:.3} mm; the board leans by {leans_deg:.1} degrees",
        poses.len(),
        mean.spread_deg,
        mean.spread_mm
    );
    if leans_deg > arguments.upright_deg {
        let remedy = if leans_deg > OVERTURNED_DEG {
            "it stands on its side or upside down, unless the camera does: turn it so that its arrow points up, and measure again"
        } else {
            "set it upright with a level, or say with --camera-pitch-deg how far the camera looks down"
        };
        eprintln!(
            "warning: the board leans by {leans_deg:.1} degrees from upright (more than --upright-deg {}); up and forward lean with it: {remedy}",
            arguments.upright_deg
        );
    }
    if 2 * poses.len() < seen.frames {
        eprintln!(
            "warning: the board was found in {} of {frames} only: check its light, and that nothing hides it",
            poses.len()
        );
    }
    if mean.spread_deg > SPREAD_DEG_MAX || mean.spread_mm > SPREAD_MM_MAX {
        eprintln!(
            "warning: the board's pose varies by {:.2} degrees and {:.2} mm; board or camera moved, or the board is too small or too far away: let both stand still, and go nearer",
            mean.spread_deg, mean.spread_mm
        );
    }
    if let Some(out) = &arguments.out {
        eprintln!("written to {}", out.display());
    }
    if let Some(background) = &seen.background {
        match background::keep(&file.cam_from_scene_theta, background) {
            Ok(path) => {
                eprintln!("a small picture of the background is kept in {}", path.display())
            }
            Err(error) => eprintln!("warning: no picture of the background is kept: {error}"),
        }
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board that every frame shows has the right columns, and light enough.
    #[test]
    fn too_few_frames_and_a_board_that_is_not_seen_have_different_remedies() {
        let more = too_few(1, 1, "check its columns");
        assert!(more.contains("10 are needed") && more.contains("give more"), "{more}");
        assert!(!more.contains("columns"), "{more}");
        for (poses, frames) in [(0, 0), (0, 1), (3, 40)] {
            let remedy = too_few(poses, frames, "check its columns");
            assert_eq!(remedy, "10 are needed: check its columns");
        }
    }
}
