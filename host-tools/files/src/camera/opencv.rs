//! Calibrations as OpenCV's `FileStorage` (YAML, JSON) and ROS's `camera_info`
//! files (YAML) hold them.
//!
//! The two share their field names: `image_width`, `image_height`,
//! `camera_matrix` and `distortion_coefficients`, each matrix with `rows`,
//! `cols` and `data`. JSON is read by the YAML parser, as YAML 1.2 contains it.

use plumbline::lens::{Distortion, Lens};
use serde::Deserialize;

use super::{Camera, Provenance};
use crate::BadInput;
use crate::counting::counted;

const REMEDY: &str = "a calibration of OpenCV or ROS has image_width, image_height, camera_matrix and distortion_coefficients (each with rows, cols, data)";

#[derive(Deserialize)]
struct Matrix {
    rows: usize,
    cols: usize,
    data: Vec<f64>,
}

/// What is used of the file; other entries are the calibration's by-products.
#[derive(Deserialize)]
struct Fields {
    #[serde(alias = "image_Width")]
    image_width: u32,
    #[serde(alias = "image_Height")]
    image_height: u32,
    #[serde(alias = "Camera_Matrix")]
    camera_matrix: Matrix,
    #[serde(alias = "Distortion_Coefficients")]
    distortion_coefficients: Matrix,
    /// ROS.
    distortion_model: Option<String>,
    /// OpenCV's calibration sample.
    fisheye_model: Option<i64>,
    #[serde(alias = "Avg_Reprojection_Error")]
    avg_reprojection_error: Option<f64>,
    #[serde(alias = "nframes", alias = "nrOfFrames")]
    nr_of_frames: Option<u32>,
    #[serde(alias = "calibration_Time")]
    calibration_time: Option<String>,
    camera_name: Option<String>,
}

/// The camera of a YAML or JSON text, not yet checked.
pub(super) fn parse(text: &str, place: &str) -> Result<Camera, BadInput> {
    // OpenCV up to 4 starts with `%YAML:1.0`, which is no YAML directive.
    let body = match text.strip_prefix("%YAML:") {
        Some(rest) => rest.split_once('\n').map_or("", |(_, body)| body),
        None => text,
    };
    let dropped_lines = u64::from(text.starts_with("%YAML:"));
    let fields: Fields = serde_saphyr::from_str(body).map_err(|error| {
        let message = error.without_snippet().to_string();
        let first_line = message.lines().next().unwrap_or("not YAML");
        let named = first_line.starts_with("missing field");
        let field = if named { first_line.split('`').nth(1).unwrap_or_default() } else { "" };
        let field = match error.location() {
            Some(location) if !named => format!("line {}", location.line() + dropped_lines),
            _ => field.to_owned(),
        };
        BadInput::new(place, field, first_line, REMEDY)
    })?;
    let family = family(&fields, place)?;
    let k = matrix_3x3(&fields.camera_matrix, place)?;
    let side = |name: &str, value: u32| {
        u16::try_from(value).map_err(|_| {
            BadInput::new(
                place,
                name,
                format!("{value} px"),
                "give the size of the camera's frames",
            )
        })
    };
    Ok(Camera {
        lens: Lens {
            width_px: side("image_width", fields.image_width)?,
            height_px: side("image_height", fields.image_height)?,
            fx_px: k[0],
            skew_px: k[1],
            cx_px: k[2],
            fy_px: k[4],
            cy_px: k[5],
            distortion: distortion(family, &fields.distortion_coefficients, place)?,
        },
        readout_ns: 0,
        provenance: Provenance {
            readout_sd_ms: None,
            rms_px: fields.avg_reprojection_error.filter(|it| it.is_finite() && *it >= 0.0),
            images: fields.nr_of_frames,
            date: fields.calibration_time,
            source: Some(match fields.camera_name {
                Some(name) => format!("{place}, camera {name}"),
                None => place.to_owned(),
            }),
            details: None,
        },
    })
}

/// The two families of lens models.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Family {
    /// k1 k2 p1 p2 and more.
    Polynomial,
    /// k1 k2 k3 k4.
    Fisheye,
}

/// Which family the file names; four or five coefficients alone do not tell, and are those of a
/// polynomial in most files.
fn family(fields: &Fields, place: &str) -> Result<Family, BadInput> {
    if fields.fisheye_model.unwrap_or(0) != 0 {
        return Ok(Family::Fisheye);
    }
    match fields.distortion_model.as_deref() {
        // Both of ROS's polynomial names may hold five coefficients and zeros.
        None | Some("plumb_bob" | "rational_polynomial" | "thin_prism") => Ok(Family::Polynomial),
        Some("equidistant" | "fisheye") => Ok(Family::Fisheye),
        Some(model) => Err(BadInput::new(
            place,
            "distortion_model",
            format!("{model:?}, a lens model that is not supported"),
            "calibrate with plumb_bob, rational_polynomial, thin_prism or equidistant",
        )),
    }
}

/// K, row by row.
fn matrix_3x3(matrix: &Matrix, place: &str) -> Result<[f64; 9], BadInput> {
    let wrong = |found: String| {
        BadInput::new(
            place,
            "camera_matrix",
            found,
            "it must be 3 x 3: [fx, skew, cx, 0, fy, cy, 0, 0, 1]",
        )
    };
    let k: [f64; 9] = matrix.data.as_slice().try_into().map_err(|_| {
        wrong(format!("{} x {}, {} numbers", matrix.rows, matrix.cols, matrix.data.len()))
    })?;
    if [k[3], k[6], k[7], k[8]] != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(format!("{k:?}")));
    }
    Ok(k)
}

/// The model that the number of coefficients that are not zero calls for: Brown's with up to five,
/// the rational one with up to eight, with up to twelve the thin prism's.
fn distortion(family: Family, matrix: &Matrix, place: &str) -> Result<Distortion, BadInput> {
    let values = matrix.data.as_slice();
    let wrong = |found: String, remedy: &str| {
        Err(BadInput::new(place, "distortion_coefficients", found, remedy))
    };
    if family == Family::Fisheye {
        return match values.try_into() {
            Ok(coefficients) => Ok(Distortion::Fisheye4(coefficients)),
            Err(_) => {
                wrong(counted(values.len(), "coefficient"), "a fisheye lens has 4: k1, k2, k3, k4")
            }
        };
    }
    if ![4, 5, 8, 12, 14].contains(&values.len()) {
        return wrong(
            counted(values.len(), "coefficient"),
            "give 4, 5, 8, 12 or 14, as OpenCV does: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y",
        );
    }
    let used = values.iter().rposition(|&value| value != 0.0).map_or(0, |last| last + 1);
    let first = |count: usize| values.iter().copied().chain(std::iter::repeat(0.0)).take(count);
    let mut distortion = match used {
        0..=5 => Distortion::Brown5([0.0; 5]),
        6..=8 => Distortion::Rational8([0.0; 8]),
        9..=12 => Distortion::ThinPrism12([0.0; 12]),
        _ => {
            return wrong(
                format!("a tilted sensor: the last two are {:?}", &values[12..]),
                "the tilted lens model is not supported: calibrate without CALIB_TILTED_MODEL",
            );
        }
    };
    let own = distortion.coefficients_mut();
    let count = own.len();
    own.iter_mut().zip(first(count)).for_each(|(own, value)| *own = value);
    Ok(distortion)
}
