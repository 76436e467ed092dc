//! The command line of `plumb calibrate`.

use std::mem::discriminant;
use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};
use plumbline::lens::{Distortion, LensError};
use plumbline::parts::points_mm;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_calibration::models::{self, MODELS};
use plumbline_calibration::verdict::{self, Concern};
use plumbline_calibration::{
    Calibration, Choice, Contribution, Failure, Outcome, PHOTOGRAPHS_MIN, Picture,
};
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera, Details, DetailsOfPhotograph, Deviations, Provenance};
use plumbline_files::frames::{Frame, FrameSource, IMAGE_RATE_HZ, Pixels};
use plumbline_files::{refuse_overwriting, targets};

mod plot;
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

/// Below this a square of a target at the bedside is too few pixels wide.
const WIDTH_PX_MIN: usize = 640;

/// More photographs than this add nothing and fill the memory.
const IMAGES_MAX: usize = 200;

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
    let board = board(arguments)?;
    let pictures = read(arguments)?;
    let places: Vec<String> = pictures.iter().map(|picture| picture.place.clone()).collect();
    let calibration = {
        let bar = ProgressBar::new((pictures.len() + MODELS.len()) as u64).with_style(
            ProgressStyle::with_template(
                "searching and fitting {wide_bar} {pos}/{len} photographs and models",
            )
            .expect("a template that is right"),
        );
        let choice = arguments.model.choice();
        let calibrated = plumbline_calibration::calibrate(&pictures, &board, choice, || bar.inc(1));
        bar.finish_and_clear();
        calibrated.map_err(|failure| refusal(failure, arguments, pictures.len()))?
    };
    calibration.lens.check().map_err(|error| {
        let remedy = "take photographs in which the board reaches the frame's corners, or try the other --model";
        BadInput::whole("the calibration", error, remedy)
    })?;
    let points_mm: Vec<_> = points_mm(&board).collect();
    let concerns = verdict::concerns(&calibration, &places, &points_mm);
    let camera = camera_of(&calibration, &places, &concerns);
    let mut outputs = vec![(arguments.out.clone(), camera::to_toml(&camera).into_bytes())];
    if let Some(path) = &arguments.plot {
        outputs.push((path.clone(), plot::svg(&calibration, &places)?.into_bytes()));
    }
    plumbline_files::write_all(&outputs, arguments.force)?;
    print(&calibration, &board, &places, &concerns);
    eprintln!("written to {}", arguments.out.display());
    Ok(())
}

/// The board of the command line.
fn board(arguments: &Arguments) -> Result<TargetGeometry, BadInput> {
    let ([columns, rows], pitch_mm) = printed(arguments);
    TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Scene, [0.0; 3]).map_err(
        |error| {
            let found = format!("{columns} x {rows} corners, {pitch_mm} mm");
            BadInput::whole("--board, --pitch-mm", found, error)
        },
    )
}

/// The corners and the pitch of the board.
fn printed(arguments: &Arguments) -> ([u8; 2], f64) {
    arguments.board.zip(arguments.pitch_mm).expect("required without --flicker-hz")
}

/// All photographs into memory.
fn read(arguments: &Arguments) -> Result<Vec<Picture>, BadInput> {
    // It does not matter when photographs were taken, nor at which rate a video of them runs.
    let mut source = FrameSource::open(&arguments.images, Some(IMAGE_RATE_HZ))?;
    let (width, height) = (source.width(), source.height());
    if width.max(height) < WIDTH_PX_MIN {
        return Err(BadInput::new(
            source.place(),
            "image size",
            format!("{width} x {height} px"),
            format!(
                "a calibration below {WIDTH_PX_MIN} px is refused: its corners are not known well \
                 enough for the box; photograph the board at the size that the box records at"
            ),
        ));
    }
    let mut pictures: Vec<Picture> = Vec::new();
    while let Some(frame) = source.next_frame()? {
        let index = frame.index;
        let samples = in_8_bits(&frame);
        let mut place = source.place().to_owned();
        if pictures.len() == IMAGES_MAX {
            return Err(BadInput::new(
                place,
                "images",
                format!("more than {IMAGES_MAX}"),
                "10 to 20 photographs at different places and tilts are enough",
            ));
        }
        if pictures.iter().any(|picture| picture.place.starts_with(&place)) {
            place += &format!(", frame {index}");
        }
        pictures.push(Picture { place, samples, width, height });
    }
    Ok(pictures)
}

/// The samples of a frame, those of more than 8 bits rounded down.
fn in_8_bits(frame: &Frame<'_>) -> Vec<u8> {
    let white = u32::from(frame.white_level);
    match frame.pixels {
        Pixels::Grey8(samples) => samples.to_vec(),
        Pixels::Grey16(samples) => {
            let in_8_bits = |&value: &u16| (u32::from(value) * 255 / white).min(255) as u8;
            samples.iter().map(in_8_bits).collect()
        }
    }
}

fn refusal(failure: Failure, arguments: &Arguments, pictures: usize) -> BadInput {
    let ([columns, rows], _) = printed(arguments);
    match failure {
        Failure::TooFew(count) => BadInput::new(
            "IMAGE",
            "photographs",
            format!(
                "{count} of {pictures} show the whole board of {columns} x {rows} inner corners, and a calibration needs {PHOTOGRAPHS_MIN}"
            ),
            "check --board (count the INNER corners), focus and light; 10 to 20 photographs are good",
        ),
        Failure::NoTilt => BadInput::new(
            "IMAGE",
            "photographs",
            "the board has the same tilt in all of them, so the focal length is undetermined",
            "tilt the board by 20 to 40 degrees about both axes",
        ),
        Failure::Lens(error) => BadInput::whole(
            "the calibration",
            error,
            "take photographs in which the board reaches the frame's corners, or try another --model",
        ),
        Failure::Unsettled => BadInput::new(
            "IMAGE",
            "photographs",
            "they do not determine a camera",
            "take photographs with the board at different places and tilts, or try --model radial2",
        ),
    }
}

fn camera_of(calibration: &Calibration, places: &[String], concerns: &[Concern]) -> Camera {
    let sd = &calibration.sd;
    let photographs = places.iter().zip(&calibration.outcomes).map(|(place, outcome)| {
        let used = outcome.used();
        DetailsOfPhotograph {
            file: place.clone(),
            rms_px: used.map(|used| used.rms_px),
            corners: used.map(|used| used.corners as u32),
            refused: refused(outcome),
        }
    });
    let used = calibration.outcomes.iter().filter(|outcome| outcome.used().is_some()).count();
    Camera {
        lens: calibration.lens,
        readout_ns: 0,
        provenance: Provenance {
            readout_sd_ms: None,
            rms_px: Some(calibration.rms_px),
            images: Some(used as u32),
            date: Some(jiff::Zoned::now().date().to_string()),
            source: Some("plumb calibrate".to_owned()),
            details: Some(Details {
                verdict: concerns.iter().map(ToString::to_string).collect(),
                coverage: calibration.coverage.lines(),
                correlations: correlations(calibration),
                freedom: u32::try_from(calibration.freedom).ok(),
                sd: Deviations {
                    fx_px: sd[0],
                    fy_px: sd[1],
                    cx_px: sd[2],
                    cy_px: sd[3],
                    skew_px: sd[4],
                    distortion: sd[5..].to_vec(),
                },
                photographs: photographs.collect(),
            }),
        },
    }
}

/// Of each number of the camera, the correlations with those before it.
fn correlations(calibration: &Calibration) -> Vec<Vec<f64>> {
    let all = &calibration.correlations;
    (0..all.nrows()).map(|row| (0..row).map(|column| all[(row, column)]).collect()).collect()
}

/// Why a model was not fitted, in a few words.
fn reason(failure: &Failure) -> String {
    match failure {
        Failure::TooFew(count) => format!("only {count} photographs can be used with it"),
        Failure::NoTilt => "the board has the same tilt in all photographs".into(),
        Failure::Unsettled => "the photographs do not settle its coefficients".into(),
        Failure::Lens(LensError::Table) => "it bends too steeply where no board was".into(),
        Failure::Lens(LensError::Folds) => "it folds back inside the frame".into(),
        Failure::Lens(error) => error.to_string(),
    }
}

fn refused(outcome: &Outcome) -> Option<String> {
    match outcome {
        Outcome::Used(_) => None,
        Outcome::NotFound(why) => Some(why.to_string()),
        Outcome::Unusable => Some("the board's edges are hidden or blurred".to_owned()),
    }
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
