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
    if fields.fisheye_model.unwrap_or(0) != 0 {
        return Err(unsupported_model(place, "fisheye_model", "a fisheye lens"));
    }
    if let Some(model) = &fields.distortion_model {
        // Both of ROS's rational names may hold five coefficients and zeros.
        if !["plumb_bob", "rational_polynomial"].contains(&model.as_str()) {
            return Err(unsupported_model(place, "distortion_model", &format!("{model:?}")));
        }
    }
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
            distortion: distortion(&fields.distortion_coefficients, place)?,
        },
        provenance: Provenance {
            rms_px: fields.avg_reprojection_error,
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

fn unsupported_model(place: &str, field: &str, found: &str) -> BadInput {
    BadInput::new(
        place,
        field,
        format!("{found}, a lens model that is not supported"),
        "calibrate with the model k1 k2 p1 p2 k3 (OpenCV's calibrateCamera with its default flags, ROS's plumb_bob)",
    )
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

/// k1 k2 p1 p2 \[k3 \[further ones, if all zero\]\].
fn distortion(matrix: &Matrix, place: &str) -> Result<Distortion, BadInput> {
    let wrong = |found: String, remedy: &str| {
        Err(BadInput::new(place, "distortion_coefficients", found, remedy))
    };
    let values = matrix.data.as_slice();
    let &[k1, k2, p1, p2, ref more @ ..] = values else {
        return wrong(
            counted(values.len(), "coefficient"),
            "give 4 or 5: k1, k2, p1, p2 and, if calibrated, k3",
        );
    };
    let k3 = more.first().copied().unwrap_or(0.0);
    if more.iter().skip(1).any(|&value| value != 0.0) {
        return wrong(
            format!("{} coefficients, of which those after the fifth are not zero", values.len()),
            "the rational, thin-prism and tilted lens models are not supported: calibrate without CALIB_RATIONAL_MODEL, CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL",
        );
    }
    Ok(Distortion::Brown5([k1, k2, p1, p2, k3]))
}
