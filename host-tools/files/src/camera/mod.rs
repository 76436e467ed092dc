//! Camera files: `camera.toml`, and what OpenCV and ROS write.
//!
//! ```toml
//! width_px = 1456
//! height_px = 1088
//! fx_px = 1740.0
//! fy_px = 1740.0
//! cx_px = 727.5
//! cy_px = 543.5
//! skew_px = 0.0                      # optional
//! model = "brown5"                   # or radial2, rational8, thin_prism12, fisheye4
//! distortion = [-0.1, 0.02, 0.0, 0.0, 0.0]   # k1 k2 p1 p2 k3; see `Distortion`
//! readout_ms = 16.0                  # optional: rolling shutter, first row to last; see below
//! readout_sd_ms = 0.02               # optional: its standard deviation, if it was measured
//! rms_px = 0.12                      # optional, as images, date and source:
//! images = 40                        # where the calibration came from
//! date = "2026-11-21"
//! source = "plumb calibrate"
//! [calibration]                      # optional: what `plumb calibrate` says of it
//! ```
//!
//! A *rolling shutter* reads one row after the other, from the top: `readout_ms` is the delay from
//! one row to the next times `height_px`. It is negative where the bottom row is read first, as in
//! a camera that hangs upside down and turns its picture, and 0 or absent for a global shutter,
//! which reads all rows at once. OpenCV's and ROS's files do not say.
//!
//! The content, not the file's name, tells the format: `{` begins OpenCV's JSON;
//! `%YAML`, `---` or a line `key:` begins OpenCV's or ROS's YAML; everything
//! else is TOML. All three formats put pixel (0, 0) at the centre of the
//! top-left pixel, so that no number changes on the way.

use std::path::Path;

use plumbline::config::READOUT_NS_MAX;
use plumbline::lens::{Distortion, Lens, LensError};
use plumbline::lens_table::LensTable;
use serde::{Deserialize, Serialize};

use crate::BadInput;
use crate::counting::counted;
use crate::{from_toml, read_text, write_text};

mod opencv;

const REMEDY: &str = "a camera file has width_px, height_px, fx_px, fy_px, cx_px, cy_px, model (radial2, brown5, rational8, thin_prism12 or fisheye4), distortion, and optionally skew_px, readout_ms, readout_sd_ms, rms_px, images, date, source; files of OpenCV (YAML, JSON) and ROS (camera_info YAML) are read too";

const NS_PER_MS: f64 = 1e6;

const READOUT_MS_MAX: f64 = READOUT_NS_MAX as f64 / NS_PER_MS;

/// Where a calibration came from; all of it may be unknown.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Provenance {
    /// Standard deviation of the readout, if it was measured.
    pub readout_sd_ms: Option<f64>,
    /// Root mean square reprojection error of the calibration.
    pub rms_px: Option<f64>,
    /// Number of images.
    pub images: Option<u32>,
    /// Its date, in words.
    pub date: Option<String>,
    /// The program that made it, in words.
    pub source: Option<String>,
    /// What `plumb calibrate` says of it.
    pub details: Option<Details>,
}

/// How certain a calibration is, and from which photographs it was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Details {
    /// Warnings about the photographs or the board.
    pub verdict: Vec<String>,
    /// A map of the frame: in how many photographs each cell showed a part of the board.
    pub coverage: Vec<String>,
    /// Correlations of the camera's numbers, in the order fx fy cx cy skew and the distortion: of
    /// each number, those with the numbers before it. Empty where they are not known, as in files
    /// of older programs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub correlations: Vec<Vec<f64>>,
    /// Degrees of freedom of the fit: the number of measured quantities less that of the unknowns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub freedom: Option<u32>,
    /// Standard deviations of the camera's numbers.
    pub sd: Deviations,
    /// Each photograph.
    pub photographs: Vec<DetailsOfPhotograph>,
}

/// Standard deviations of a camera's numbers, by the same names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Deviations {
    pub fx_px: f64,
    pub fy_px: f64,
    pub cx_px: f64,
    pub cy_px: f64,
    pub skew_px: f64,
    pub distortion: Vec<f64>,
}

/// What one photograph contributed to a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetailsOfPhotograph {
    /// Its name.
    pub file: String,
    /// Root mean square reprojection error of its corners.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_px: Option<f64>,
    /// How many of them were used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corners: Option<u32>,
    /// Why it was not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// A camera that passed [`Lens::check`], and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The model.
    pub lens: Lens,
    /// How long it takes to read a frame, as in [`Config`](plumbline::config::Config); 0 for a
    /// global shutter.
    pub readout_ns: i32,
    /// Its origin.
    pub provenance: Provenance,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Model {
    Radial2,
    Brown5,
    Rational8,
    #[serde(rename = "thin_prism12")]
    ThinPrism12,
    Fisheye4,
}

impl Model {
    /// The model with these coefficients; `Err` with those that it has.
    fn distortion(self, coefficients: &[f64]) -> Result<Distortion, Distortion> {
        let mut distortion = match self {
            Self::Radial2 => Distortion::Radial2([0.0; 2]),
            Self::Brown5 => Distortion::Brown5([0.0; 5]),
            Self::Rational8 => Distortion::Rational8([0.0; 8]),
            Self::ThinPrism12 => Distortion::ThinPrism12([0.0; 12]),
            Self::Fisheye4 => Distortion::Fisheye4([0.0; 4]),
        };
        let own = distortion.coefficients_mut();
        if own.len() != coefficients.len() {
            return Err(distortion);
        }
        own.copy_from_slice(coefficients);
        Ok(distortion)
    }

    fn of(distortion: &Distortion) -> Self {
        match distortion {
            Distortion::Radial2(_) => Self::Radial2,
            Distortion::Brown5(_) => Self::Brown5,
            Distortion::Rational8(_) => Self::Rational8,
            Distortion::ThinPrism12(_) => Self::ThinPrism12,
            Distortion::Fisheye4(_) => Self::Fisheye4,
        }
    }
}

/// The fields of `camera.toml`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    width_px: u16,
    height_px: u16,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    #[serde(default)]
    skew_px: f64,
    model: Model,
    distortion: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    readout_ms: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    readout_sd_ms: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rms_px: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    images: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    date: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    source: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    calibration: Option<Details>,
}

/// The camera of a file in any of the formats.
///
/// # Errors
/// When the file cannot be read, its format or lens model is not supported, a
/// field is missing, unknown or absurd.
pub fn read(path: &Path) -> Result<Camera, BadInput> {
    parse(&read_text(path)?, &path.display().to_string())
}

/// The stand-in for the lens of a camera that is not calibrated yet: 53 degrees wide, without
/// distortion.
#[must_use]
pub fn stand_in(width_px: u16, height_px: u16) -> Lens {
    let middle_px = |side_px: u16| (f64::from(side_px) - 1.0) / 2.0;
    Lens {
        width_px,
        height_px,
        fx_px: f64::from(width_px),
        fy_px: f64::from(width_px),
        cx_px: middle_px(width_px),
        cy_px: middle_px(height_px),
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    }
}

/// Whether a lens is the stand-in for its size; no calibration gives that.
#[must_use]
pub fn is_stand_in(lens: &Lens) -> bool {
    *lens == stand_in(lens.width_px, lens.height_px)
}

/// The camera of a text in any of the formats; `place` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, place: &str) -> Result<Camera, BadInput> {
    let text = text.trim_start_matches('\u{feff}');
    let start = text.trim_start();
    let camera = if start.is_empty() {
        return Err(BadInput::whole(place, "the file is empty", REMEDY));
    } else if start.starts_with('<') {
        return Err(BadInput::whole(
            place,
            "an XML file",
            "write the calibration as YAML or JSON: cv::FileStorage does when the file's name ends in .yml or .json",
        ));
    } else if start.starts_with('{') || looks_like_yaml(text) {
        opencv::parse(text, place)?
    } else {
        parse_toml(text, place)?
    };
    check(&camera.lens, place)?;
    Ok(camera)
}

/// True when a line says `key:`, as no line of a camera.toml does.
fn looks_like_yaml(text: &str) -> bool {
    text.starts_with("%YAML")
        || text.lines().any(|line| {
            let key_end = line.find(|letter: char| !(letter.is_alphanumeric() || letter == '_'));
            line == "---"
                || key_end.is_some_and(|end| end > 0 && line[end..].trim_start().starts_with(':'))
        })
}

/// Whether standard deviations and correlations belong to a lens with this many coefficients.
fn check_details(details: &Details, coefficients: usize, place: &str) -> Result<(), BadInput> {
    let remedy = "`plumb calibrate` writes it: calibrate again, or leave out [calibration]";
    let bad = |field: &str, found: String| Err(BadInput::new(place, field, found, remedy));
    let Deviations { fx_px, fy_px, cx_px, cy_px, skew_px, distortion } = &details.sd;
    if distortion.len() != coefficients {
        let found = format!("{}, but {coefficients} coefficients", counted(distortion.len(), "sd"));
        return bad("calibration.sd.distortion", found);
    }
    let all = [fx_px, fy_px, cx_px, cy_px, skew_px].into_iter().chain(distortion);
    if let Some(sd) = all.clone().find(|sd| !sd.is_finite() || **sd < 0.0) {
        return bad("calibration.sd", format!("{sd}, which is not a standard deviation"));
    }
    if details.freedom == Some(0) {
        return bad("calibration.freedom", "0, with which no sd is known".to_owned());
    }
    let (rows, numbers) = (&details.correlations, all.count());
    if rows.is_empty() {
        return Ok(());
    }
    if rows.len() != numbers || rows.iter().enumerate().any(|(at, row)| row.len() != at) {
        let found = format!("they are not those of {numbers} numbers, each with those before it");
        return bad("calibration.correlations", found);
    }
    // Rounding takes a correlation of one a little beyond it; NaN is in no range.
    let range = -1.0 - CORRELATION_ROUNDING..=1.0 + CORRELATION_ROUNDING;
    match rows.iter().flatten().find(|it| !range.contains(*it)) {
        Some(value) => bad("calibration.correlations", format!("{value}, beyond -1 to 1")),
        None => Ok(()),
    }
}

/// The inverse of normal equations has this relative error where parameters are all but dependent.
const CORRELATION_ROUNDING: f64 = 1e-6;

fn parse_toml(text: &str, place: &str) -> Result<Camera, BadInput> {
    let fields: Fields = from_toml(text, place, REMEDY)?;
    let distortion = fields.model.distortion(&fields.distortion).map_err(|model| {
        let names = model.names();
        BadInput::new(
            place,
            "distortion",
            counted(fields.distortion.len(), "coefficient"),
            format!("this model has {}: [{}]", names.len(), names.join(", ")),
        )
    })?;
    if let Some(details) = &fields.calibration {
        check_details(details, fields.distortion.len(), place)?;
    }
    if let Some(sd_ms) = fields.readout_sd_ms.filter(|it| !it.is_finite() || *it < 0.0) {
        let remedy = "`plumb calibrate --readout` writes it: measure again, or leave it out";
        return Err(BadInput::new(place, "readout_sd_ms", sd_ms, remedy));
    }
    if let Some(rms_px) = fields.rms_px.filter(|it| !it.is_finite() || *it < 0.0) {
        let remedy = "`plumb calibrate` writes it: calibrate again, or leave it out";
        return Err(BadInput::new(place, "rms_px", rms_px, remedy));
    }
    Ok(Camera {
        lens: Lens {
            width_px: fields.width_px,
            height_px: fields.height_px,
            fx_px: fields.fx_px,
            fy_px: fields.fy_px,
            cx_px: fields.cx_px,
            cy_px: fields.cy_px,
            skew_px: fields.skew_px,
            distortion,
        },
        readout_ns: readout_ns(fields.readout_ms.unwrap_or(0.0), place)?,
        provenance: Provenance {
            readout_sd_ms: fields.readout_sd_ms,
            rms_px: fields.rms_px,
            images: fields.images,
            date: fields.date,
            source: fields.source,
            details: fields.calibration,
        },
    })
}

/// A readout in nanoseconds, from a finite number of milliseconds that a box would take.
fn readout_ns(readout_ms: f64, place: &str) -> Result<i32, BadInput> {
    if !(-READOUT_MS_MAX..=READOUT_MS_MAX).contains(&readout_ms) {
        return Err(BadInput::new(
            place,
            "readout_ms",
            readout_ms,
            "give the milliseconds between the first row's exposure and the last's, at most 1,000; negative where the bottom row is read first, 0 for a global shutter",
        ));
    }
    Ok((readout_ms * NS_PER_MS).round() as i32)
}

/// [`Lens::check`], and whether the lens has a table, with the offending fields and their values.
fn check(lens: &Lens, place: &str) -> Result<(), BadInput> {
    let mut table = Box::new(LensTable::new());
    lens.check().and_then(|()| table.fill(lens)).map_err(|error| {
        let pair = |one: &dyn std::fmt::Display, two: &dyn std::fmt::Display| {
            format!("{one} and {two}")
        };
        let (field, found) = match error {
            LensError::FrameSize => ("width_px, height_px", pair(&lens.width_px, &lens.height_px)),
            LensError::FocalLength => ("fx_px, fy_px", pair(&lens.fx_px, &lens.fy_px)),
            LensError::PrincipalPoint => ("cx_px, cy_px", pair(&lens.cx_px, &lens.cy_px)),
            LensError::Skew => ("skew_px", lens.skew_px.to_string()),
            LensError::Coefficient | LensError::Folds | LensError::Table => {
                ("distortion", format!("{:?}", lens.distortion.coefficients()))
            }
        };
        let remedy = match error {
            LensError::Folds => format!(
                "{error}; calibrate again with images in which the board reaches the frame's corners"
            ),
            other => other.to_string(),
        };
        BadInput::new(place, field, found, remedy)
    })
}

/// Writes `camera.toml`.
///
/// # Errors
/// When the operating system refuses.
pub fn write(path: &Path, camera: &Camera) -> Result<(), BadInput> {
    write_text(path, &to_toml(camera))
}

/// The text of `camera.toml`.
#[must_use]
pub fn to_toml(camera: &Camera) -> String {
    let Camera { lens, readout_ns, provenance } = camera;
    let fields = Fields {
        width_px: lens.width_px,
        height_px: lens.height_px,
        fx_px: lens.fx_px,
        fy_px: lens.fy_px,
        cx_px: lens.cx_px,
        cy_px: lens.cy_px,
        skew_px: lens.skew_px,
        model: Model::of(&lens.distortion),
        distortion: lens.distortion.coefficients().to_vec(),
        // A global shutter is stated if it was measured.
        readout_ms: (*readout_ns != 0 || provenance.readout_sd_ms.is_some())
            .then(|| f64::from(*readout_ns) / NS_PER_MS),
        readout_sd_ms: provenance.readout_sd_ms,
        rms_px: provenance.rms_px,
        images: provenance.images,
        date: provenance.date.clone(),
        source: provenance.source.clone(),
        calibration: provenance.details.clone(),
    };
    toml::to_string(&fields).expect("numbers and texts are TOML")
}

/// The same camera for frames of another size that show the same area of the sensor.
///
/// With s the ratio of the sizes, f' = s f and c' = s c + (s - 1)/2: pixel
/// centres lie at integers, so that the frame's edge, not its first pixel's
/// centre, keeps its place. Distortion acts on rays and stays, and so does the readout: fewer rows
/// then take as long as the rows that each of them is made of. A *cropped*
/// frame, or one binned on the sensor with another field of view, is not this.
///
/// # Errors
/// When the two sizes differ in shape by more than the rounding of a pixel.
pub fn scaled(
    camera: &Camera,
    width_px: usize,
    height_px: usize,
    place: &str,
) -> Result<Camera, BadInput> {
    let lens = &camera.lens;
    let scale = |wanted_px: usize, side_px: u16| wanted_px as f64 / f64::from(side_px);
    let (sx, sy) = (scale(width_px, lens.width_px), scale(height_px, lens.height_px));
    let rounding_px = (sy * f64::from(lens.width_px) - width_px as f64).abs();
    if rounding_px > 1.0 {
        return Err(BadInput::new(
            place,
            "width_px, height_px",
            format!(
                "{} x {} px has another shape than the frames' {width_px} x {height_px} px",
                lens.width_px, lens.height_px
            ),
            "frames that were cropped need their own calibration: calibrate the camera at the size it records",
        ));
    }
    let centre = |centre_px: f64, scale: f64| scale * centre_px + (scale - 1.0) / 2.0;
    let side = |side_px: usize| u16::try_from(side_px).unwrap_or(u16::MAX);
    let lens = Lens {
        width_px: side(width_px),
        height_px: side(height_px),
        fx_px: sx * lens.fx_px,
        fy_px: sy * lens.fy_px,
        cx_px: centre(lens.cx_px, sx),
        cy_px: centre(lens.cy_px, sy),
        skew_px: sx * lens.skew_px,
        distortion: lens.distortion,
    };
    check(&lens, place)?;
    Ok(Camera { lens, ..camera.clone() })
}

/// Refuses frames of another size than the camera file's.
///
/// # Errors
/// An error that names both sizes.
pub fn check_frame_size(
    lens: &Lens,
    camera_place: &str,
    width_px: usize,
    height_px: usize,
    frames_place: &str,
) -> Result<(), BadInput> {
    if (usize::from(lens.width_px), usize::from(lens.height_px)) == (width_px, height_px) {
        return Ok(());
    }
    Err(BadInput::new(
        frames_place,
        "frame size",
        format!(
            "{width_px} x {height_px} px, but {camera_place} (width_px, height_px) was calibrated at {} x {} px",
            lens.width_px, lens.height_px
        ),
        "use the calibration made at this size",
    ))
}

#[cfg(test)]
mod tests;
