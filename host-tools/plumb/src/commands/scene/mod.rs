//! `plumb scene`: where the scene board stands, which gives the body's axes.

mod recorded;

use std::path::PathBuf;
use std::time::Duration;

use plumbline_bedside::delivery;
use plumbline_bedside::scene::{self, Seen};
use plumbline_bedside::setup::{self, Descriptions};
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_files::refuse_overwriting;
use plumbline_files::scene::SceneFile;

use crate::arguments::{LinkArguments, seconds};
use crate::ui::waiting;

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
    /// Replace the file of --out if it exists; with --store, also change the box while somebody records
    /// a trial, which that spoils.
    #[arg(long)]
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
    if arguments.force && arguments.store {
        link.force();
    }
    let mut told = waiting::shown();
    let hello = delivery::greet(&mut link, &mut told)?;
    scene::check_board(link.place(), &hello)?;
    let old = if arguments.store { link.config_to_change()? } else { link.config()? };
    if camera::is_stand_in(&old.lens) {
        return Err(setup::not_calibrated(link.place()));
    }
    let seen = scene::listen(&mut link, &hello, old.lens, arguments.seconds, &mut told)?;
    let measured = measure(arguments, &seen)?;
    if !arguments.store {
        return Ok(());
    }
    scene::store(&mut link, hello, old, &measured, !arguments.no_restart, &mut told)
}

/// The scene of what was seen: judged, shown, and written to the file of --out, if any.
fn measure(arguments: &Arguments, seen: &Seen) -> Result<SceneFile, BadInput> {
    let today = jiff::Zoned::now().date();
    let measured = scene::measure(seen, arguments.camera_pitch_deg, arguments.upright_deg, today)?;
    let file = &measured.file;
    if let Some(out) = &arguments.out {
        let text = plumbline_files::scene::to_toml(file).into_bytes();
        plumbline_files::write_all(&[(out.clone(), text)], arguments.force)?;
    }
    eprintln!("{}", measured.words());
    for warning in &measured.warnings {
        eprintln!("warning: {warning}");
    }
    if let Some(out) = &arguments.out {
        eprintln!("written to {}", out.display());
    }
    if let Some(background) = &seen.background {
        match scene::keep_background(file, background) {
            Ok(path) => {
                eprintln!("a small picture of the background is kept in {}", path.display())
            }
            Err(error) => eprintln!("warning: no picture of the background is kept: {error}"),
        }
    }
    Ok(measured.file)
}
