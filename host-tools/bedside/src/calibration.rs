//! A camera from photographs of a board: which of them were used, what came of them, and what is to
//! be known about it.
//!
//! In: photographs from files. Out: the camera for its file, with each photograph's error, the
//! coverage of the frame and the concerns; or for the box ([`store`]). The method is
//! [`plumbline_calibration`]'s.

use std::path::PathBuf;

use jiff::civil::Date;
use plumbline::config::{Config, TargetConfig};
use plumbline::lens::{Lens, LensError};
use plumbline::parts::points_mm;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_calibration::verdict::{self, Concern};
use plumbline_calibration::{
    Calibration, Choice, Failure, Outcome, PHOTOGRAPHS_MIN, Picture, calibrate,
};
use plumbline_files::BadInput;
use plumbline_files::camera::{Camera, Details, DetailsOfPhotograph, Deviations, Provenance};
use plumbline_files::frames::{Frame, FrameSource, IMAGE_RATE_HZ, Pixels};
use plumbline_files::targets::{self, Targets};
use plumbline_stream::link::BoxLink;

use crate::delivery::{self, Before};
use crate::setup::{self, Places};
use crate::told::Tell;

/// Below this a square of a target at the bedside is too few pixels wide.
const WIDTH_PX_MIN: usize = 640;

/// More photographs than this add nothing and fill the memory.
const IMAGES_MAX: usize = 200;

/// A camera that was calibrated.
pub struct Calibrated {
    /// The fit.
    pub calibration: Calibration,
    /// The names of the photographs, in their order.
    pub places: Vec<String>,
    /// What is to be known about it; none where it is good.
    pub concerns: Vec<Concern>,
    /// For the camera file.
    pub camera: Camera,
}

/// A camera from these photographs of a board. `done` is called after each photograph that was
/// searched, and after each model that was fitted.
///
/// # Errors
/// When the photographs do not make a calibration.
pub fn camera_from(
    pictures: &[Picture],
    board: &TargetGeometry,
    choice: Choice,
    today: Date,
    done: impl Fn() + Sync,
) -> Result<Calibrated, BadInput> {
    let places: Vec<String> = pictures.iter().map(|picture| picture.place.clone()).collect();
    let calibration = calibrate(pictures, board, choice, done)
        .map_err(|failure| refusal(failure, board, pictures.len()))?;
    calibration.lens.check().map_err(|error| {
        let remedy = "take photographs in which the board reaches the frame's corners, or try the other --model";
        BadInput::whole("the calibration", error, remedy)
    })?;
    let points_mm: Vec<_> = points_mm(board).collect();
    let concerns = verdict::concerns(&calibration, &places, &points_mm);
    let camera = camera_of(&calibration, &places, &concerns, today);
    Ok(Calibrated { calibration, places, concerns, camera })
}

/// A board of these columns and rows of inner corners, and this pitch.
///
/// # Errors
/// When there can be no such board.
pub fn board([columns, rows]: [u8; 2], pitch_mm: f64) -> Result<TargetGeometry, BadInput> {
    TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Scene, [0.0; 3]).map_err(
        |error| {
            let found = format!("{columns} x {rows} corners, {pitch_mm} mm");
            BadInput::whole("--board, --pitch-mm", found, error)
        },
    )
}

/// All photographs into memory.
///
/// # Errors
/// When one cannot be read, or they are too small or too many.
pub fn read(images: &[PathBuf]) -> Result<Vec<Picture>, BadInput> {
    // It does not matter when photographs were taken, nor at which rate a video of them runs.
    let mut source = FrameSource::open(images, Some(IMAGE_RATE_HZ))?;
    check_size(source.place(), source.width(), source.height())?;
    let mut pictures: Vec<Picture> = Vec::new();
    while let Some(frame) = source.next_frame()? {
        let index = frame.index;
        let samples = in_8_bits(&frame);
        let (width, height) = (frame.width, frame.height);
        let mut place = source.place().to_owned();
        check_count(&pictures, &place)?;
        if pictures.iter().any(|picture| picture.place.starts_with(&place)) {
            place += &format!(", frame {index}");
        }
        pictures.push(Picture { place, samples, width, height });
    }
    Ok(pictures)
}

/// Adds a photograph that is in memory; `place` is its name.
///
/// # Errors
/// When it is too small or one too many, or of another size than those before.
pub fn add(pictures: &mut Vec<Picture>, place: String, frame: &Frame<'_>) -> Result<(), BadInput> {
    let &Frame { width, height, .. } = frame;
    check_size(&place, width, height)?;
    check_count(pictures, &place)?;
    if let Some(first) = pictures.first()
        && (first.width, first.height) != (width, height)
    {
        let found = format!(
            "{width} x {height} px, but those before have {} x {} px",
            first.width, first.height
        );
        let remedy = "give photographs of one size: a calibration holds for one size";
        return Err(BadInput::new(place, "image size", found, remedy));
    }
    pictures.push(Picture { place, samples: in_8_bits(frame), width, height });
    Ok(())
}

fn check_size(place: &str, width: usize, height: usize) -> Result<(), BadInput> {
    if width.max(height) >= WIDTH_PX_MIN {
        return Ok(());
    }
    Err(BadInput::new(
        place,
        "image size",
        format!("{width} x {height} px"),
        format!(
            "a calibration below {WIDTH_PX_MIN} px is refused: its corners are not known well \
             enough for the box; photograph the board at the size that the box records at"
        ),
    ))
}

/// Checks that there may be one more.
fn check_count(pictures: &[Picture], place: &str) -> Result<(), BadInput> {
    if pictures.len() < IMAGES_MAX {
        return Ok(());
    }
    Err(BadInput::new(
        place,
        "images",
        format!("more than {IMAGES_MAX}"),
        "10 to 20 photographs at different places and tilts are enough",
    ))
}

/// The samples of a frame, those of more than 8 bits rounded down.
#[must_use]
pub fn in_8_bits(frame: &Frame<'_>) -> Vec<u8> {
    let white = u32::from(frame.white_level);
    match frame.pixels {
        Pixels::Grey8(samples) => samples.to_vec(),
        Pixels::Grey16(samples) => {
            let in_8_bits = |&value: &u16| (u32::from(value) * 255 / white).min(255) as u8;
            samples.iter().map(in_8_bits).collect()
        }
    }
}

fn refusal(failure: Failure, board: &TargetGeometry, pictures: usize) -> BadInput {
    let [columns, rows] = [board.columns(), board.rows()];
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

fn camera_of(
    calibration: &Calibration,
    places: &[String],
    concerns: &[Concern],
    today: Date,
) -> Camera {
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
            date: Some(today.to_string()),
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

/// Puts a camera that was calibrated into the configuration of the box that is heard, and restarts it.
/// `targets` replaces those that it looks for; without, a box that looks for the scene board alone gets
/// the standard pair beside it. A scene holds for the camera that it was measured with, so that the box
/// has none from then on.
///
/// # Errors
/// When the camera is for frames of another size, the targets cannot be used, or the box does not take
/// it.
pub fn store(
    link: &mut BoxLink,
    camera: &Camera,
    targets: Option<&Targets>,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    let hello = link.hello()?;
    let old = link.config_to_change()?;
    let config = with_camera(&old, camera, targets, link.place())?;
    let before = Before { hello: Some(hello), config: Some(old) };
    delivery::deliver(link, &before, &config, true, tell)
}

/// The same configuration with a camera that was calibrated.
fn with_camera(
    old: &Config,
    camera: &Camera,
    targets: Option<&Targets>,
    place: &str,
) -> Result<Config, BadInput> {
    let size_px = |lens: &Lens| (lens.width_px, lens.height_px);
    if size_px(&camera.lens) != size_px(&old.lens) {
        let ((width, height), (is_width, is_height)) = (size_px(&camera.lens), size_px(&old.lens));
        return Err(BadInput::whole(
            place,
            format!(
                "the camera is for {width} x {height} px, and the box's frames have {is_width} x {is_height}"
            ),
            "calibrate it with photographs that this box has taken",
        ));
    }
    let places = Places {
        camera: "the calibration".into(),
        targets: "the targets".into(),
        scene: String::new(),
        settings: place.to_owned(),
        udp: place.to_owned(),
        serial: place.to_owned(),
    };
    let is_board = |it: &TargetConfig| it.geometry.role() == Role::Scene;
    let mut config = Config {
        lens: camera.lens,
        readout_ns: camera.readout_ns,
        cam_from_scene_theta: None,
        ..old.clone()
    };
    let standard;
    let targets = match targets {
        Some(targets) => Some(targets),
        None if old.targets.iter().all(is_board) => {
            let boards = old.targets.iter();
            let boards = boards.map(|it| targets::description(&it.name, &it.geometry));
            let all: Vec<_> = targets::standard_pair().into_iter().chain(boards).collect();
            standard = targets::check(&all, &places.targets)?;
            Some(&standard)
        }
        None => None,
    };
    if let Some(targets) = targets {
        config.targets = setup::config(camera, targets, None, &places)?.targets;
    }
    setup::configured(&config, &places)?;
    Ok(config)
}

/// Why a model was not fitted, in a few words.
#[must_use]
pub fn reason(failure: &Failure) -> String {
    match failure {
        Failure::TooFew(count) => format!("only {count} photographs can be used with it"),
        Failure::NoTilt => "the board has the same tilt in all photographs".into(),
        Failure::Unsettled => "the photographs do not settle its coefficients".into(),
        Failure::Lens(LensError::Table) => "it bends too steeply where no board was".into(),
        Failure::Lens(LensError::Folds) => "it folds back inside the frame".into(),
        Failure::Lens(error) => error.to_string(),
    }
}

/// Why a photograph was not used, in a few words; `None` where it was.
#[must_use]
pub fn refused(outcome: &Outcome) -> Option<String> {
    match outcome {
        Outcome::Used(_) => None,
        Outcome::NotFound(why) => Some(why.to_string()),
        Outcome::Unusable => Some("the board's edges are hidden or blurred".to_owned()),
    }
}
