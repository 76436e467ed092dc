//! The command line of `plumb calibrate`.

use std::mem::discriminant;
use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};
use plumbline::lens::Distortion;
use plumbline::target::TargetGeometry;
use plumbline_bedside::calibration::{self, Calibrated, camera_from, reason, refused};
use plumbline_calibration::models::{self, MODELS};
use plumbline_calibration::verdict::Concern;
use plumbline_calibration::{Calibration, Choice, Contribution};
use plumbline_files::camera;
use plumbline_files::{refuse_overwriting, targets};

mod readout;

/// Calibrate the camera from photographs of a checkerboard.
///
/// Take 10 to 20 sharp photographs at the size that the box records at: the board in the
/// middle, in every corner and at every side of the frame, near and far, tilted by 20 to 40
/// degrees about both axes. The lens must not be touched afterwards.
///
/// The camera comes out as camera.toml, with the standard deviation of every number, the
/// reprojection error of every photograph, a map of where the board was seen, and a verdict:
/// what is wrong with the photographs or the board, and what to do about it.
///
/// With --readout, a camera that is calibrated learns how long its rolling shutter takes to read a
/// frame, from a video of the board that it takes in the same mode: the same frame size and rate,
/// since the readout depends on them. Hold the board so close that it fills a third to a half of the
/// frame, and wave it for 5 to 10 seconds, by a hand's breadth and about once a second, to and fro,
/// up and down and slightly tilted, without leaving the frame. Good light and a short exposure keep
/// it sharp. The frame rate must be constant; of a video in slow motion, --fps gives the true one.
/// The readout and its standard deviation are added to what the camera's file says. For a fast board
/// the deviation may be too small, by a factor of two or three. The speed is printed.
///
/// With --flicker-hz as well, the readout comes from a video of a bright, plain wall in the light of
/// a lamp that flickers at this frequency: 100 or 120, twice that of the mains. At an exposure
/// shorter than 3 ms, light and dark bands then move through the picture.
///
/// Exit code 0: a calibration was written (look at its verdict); 2: there is none.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  plumb aim --stills photos --count 15 --every 5 --board 9x7    the photographs, taken by a box
  plumb calibrate --board 9x7 --pitch-mm 20 --out camera.toml photos/*.png
  plumb calibrate --board 9x7 --pitch-mm 20 --out camera.toml photos/*.jpg
  plumb calibrate --board 9x7 --pitch-mm 20 --model brown5 --plot residuals.svg --out camera.toml photos/*.png
  plumb calibrate --readout --camera camera.toml --board 9x7 --pitch-mm 20 --out camera.toml --force waved.y4m
  plumb calibrate --readout --camera camera.toml --flicker-hz 100 --out camera.toml --force wall.y4m

  ffmpeg -i waved.mp4 -pix_fmt gray -strict -1 -f yuv4mpegpipe waved.y4m    converts another video

Print a board with `plumb target`, and glue it to something flat: glass, or an aluminium plate.")]
pub struct Arguments {
    /// Columns x rows of INNER corners, where four squares meet: 9x7 for 10 x 8 squares.
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = targets::grid_size, required_unless_present = "flicker_hz")]
    board: Option<[u8; 2]>,
    /// From one inner corner to the next, measured on the print over many squares. The camera comes
    /// out the same with any other value; distances and speeds that are printed do not.
    #[arg(long, value_name = "MM", required_unless_present = "flicker_hz")]
    pitch_mm: Option<f64>,
    /// Lens distortion. Every model is fitted, and each is tried on photographs that it was not
    /// fitted to; `auto` takes the smallest one that no larger one beats beyond chance.
    #[arg(long, value_enum, default_value = "auto")]
    model: Model,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Draw residuals and coverage (SVG, for any browser).
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Replace the files of --out and --plot if they exist.
    #[arg(long)]
    force: bool,
    /// Measure the readout of a rolling shutter from a video, for a camera that is calibrated.
    #[arg(long, requires = "camera", conflicts_with_all = ["model", "plot"])]
    readout: bool,
    /// The file of that camera: camera.toml, or of OpenCV or ROS.
    #[arg(long, value_name = "FILE", requires = "readout")]
    camera: Option<PathBuf>,
    /// The rate at which the video was recorded, if its file says another.
    #[arg(long, value_name = "HZ", requires = "readout")]
    fps: Option<f64>,
    /// The frequency at which a lamp flickers: measure the readout by its light on a wall, without a
    /// board.
    #[arg(long, value_name = "HZ", requires = "readout", conflicts_with_all = ["board", "pitch_mm"])]
    flicker_hz: Option<f64>,
    /// Photographs (PNG, JPEG, PGM), or a Y4M video of them.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Model {
    /// The one that the photographs support.
    Auto,
    /// k1 k2: the paper's.
    Radial2,
    /// k1 k2 p1 p2 k3: OpenCV's default, ROS's plumb_bob.
    Brown5,
    /// k1 k2 p1 p2 k3 k4 k5 k6: OpenCV's and ROS's rational model.
    Rational8,
    /// The same and s1 s2 s3 s4: OpenCV's thin prism.
    #[value(name = "thin_prism12")]
    ThinPrism12,
    /// k1 k2 k3 k4: OpenCV's fisheye model, ROS's equidistant.
    Fisheye4,
}

impl Model {
    fn choice(self) -> Choice {
        Choice::Compared(match self {
            Self::Auto => return Choice::Supported,
            Self::Radial2 => Distortion::Radial2([0.0; 2]),
            Self::Brown5 => Distortion::Brown5([0.0; 5]),
            Self::Rational8 => Distortion::Rational8([0.0; 8]),
            Self::ThinPrism12 => Distortion::ThinPrism12([0.0; 12]),
            Self::Fisheye4 => Distortion::Fisheye4([0.0; 4]),
        })
    }
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used, the photographs do not make a calibration, or an output cannot
/// be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    for out in [Some(&arguments.out), arguments.plot.as_ref()].into_iter().flatten() {
        refuse_overwriting(out, &arguments.images)?;
    }
    if let Some(camera) = &arguments.camera {
        return readout::run(arguments, camera);
    }
    let (size, pitch_mm) = printed(arguments);
    let board = calibration::board(size, pitch_mm)?;
    let pictures = calibration::read(&arguments.images)?;
    let calibrated = {
        let bar = ProgressBar::new((pictures.len() + MODELS.len()) as u64).with_style(
            ProgressStyle::with_template(
                "searching and fitting {wide_bar} {pos}/{len} photographs and models",
            )
            .expect("a template that is right"),
        );
        let today = jiff::Zoned::now().date();
        let choice = arguments.model.choice();
        let calibrated = camera_from(&pictures, &board, choice, today, || bar.inc(1));
        bar.finish_and_clear();
        calibrated?
    };
    let Calibrated { calibration, places, concerns, camera } = calibrated;
    let mut outputs = vec![(arguments.out.clone(), camera::to_toml(&camera).into_bytes())];
    if let Some(path) = &arguments.plot {
        let plot = plumbline_report::calibration::svg(&calibration, &places)?;
        outputs.push((path.clone(), plot.into_bytes()));
    }
    plumbline_files::write_all(&outputs, arguments.force)?;
    print(&calibration, &board, &places, &concerns);
    eprintln!("written to {}", arguments.out.display());
    Ok(())
}

/// The corners and the pitch of the board.
fn printed(arguments: &Arguments) -> ([u8; 2], f64) {
    arguments.board.zip(arguments.pitch_mm).expect("required without --flicker-hz")
}

fn print(
    calibration: &Calibration,
    board: &TargetGeometry,
    places: &[String],
    concerns: &[Concern],
) {
    let all = board.corner_count();
    let lens = &calibration.lens;
    let sd = &calibration.sd;
    for (place, outcome) in places.iter().zip(&calibration.outcomes) {
        match (outcome.used(), refused(outcome)) {
            (Some(used), _) => {
                let Contribution { corners, rms_px, .. } = used;
                eprintln!("{place}: {corners} of {all} corners, RMS {rms_px:.3} px");
            }
            (None, why) => eprintln!("{place}: not used: {}", why.unwrap_or_default()),
        }
    }
    eprintln!("\nwhere the board was seen (photographs per cell of the frame):");
    for line in calibration.coverage.lines() {
        eprintln!("  {line}");
    }
    eprintln!();
    let numbers = [
        ("fx", lens.fx_px),
        ("fy", lens.fy_px),
        ("cx", lens.cx_px),
        ("cy", lens.cy_px),
        ("skew", lens.skew_px),
    ];
    for ((name, value), sd) in numbers.iter().zip(sd) {
        eprintln!("{name:>4} {value:10.3} +- {sd:.3} px");
    }
    let coefficients = lens.distortion.coefficients();
    eprintln!("\nlens models, and their error in photographs that they were not fitted to:");
    for fit in &calibration.models {
        let is_taken = discriminant(&fit.model) == discriminant(&lens.distortion);
        let mark = if is_taken { "<- taken" } else { "" };
        let name = fit.model.name();
        match &fit.figures {
            Ok(models::Figures { rms_px, held_out_px }) => {
                eprintln!("{name:>12} {held_out_px:.4} px (fitted: {rms_px:.4} px) {mark}");
            }
            Err(failure) => eprintln!("{name:>12} not determined: {}", reason(failure)),
        }
    }
    eprintln!();
    let names = lens.distortion.names();
    for ((name, value), sd) in names.iter().zip(coefficients).zip(&sd[5..]) {
        eprintln!("{name:>4} {value:10.6} +- {sd:.6}");
    }
    eprintln!(" RMS {:10.3} px (reprojection error of all corners)\n", calibration.rms_px);
    if concerns.is_empty() {
        eprintln!("verdict: good");
    }
    for concern in concerns {
        eprintln!("warning: {concern}");
    }
}
