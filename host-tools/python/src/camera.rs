//! A camera and its calibration.

use std::path::{Path, PathBuf};

use numpy::{Element, PyArray2, PyUntypedArray};
use plumbline_bedside::calibration;
use plumbline_calibration::models::MODELS;
use plumbline_calibration::{Choice, Picture};
use plumbline_files::camera::{self, Details, Deviations};
use plumbline_files::frames::{Frame, Pixels};
use plumbline_files::write_all;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::arrays::{object, shaped, vector};
use crate::error::{Raise as _, bad_argument};
use crate::frame::{self, Samples};

/// The camera's numbers before those of the distortion.
const NUMBERS: [&str; 5] = ["fx_px", "fy_px", "cx_px", "cy_px", "skew_px"];

/// A calibrated camera.
#[pyclass(frozen, module = "plumbline")]
pub struct Camera {
    pub(crate) inner: camera::Camera,
    /// Its file, for messages.
    pub(crate) place: String,
}

impl Camera {
    /// The camera of a file.
    ///
    /// # Errors
    /// When it cannot be read or used.
    pub(crate) fn read(path: &Path) -> PyResult<Self> {
        let inner = camera::read(path).raise()?;
        Ok(Self { inner, place: path.display().to_string() })
    }

    fn details(&self) -> Option<&Details> {
        self.inner.provenance.details.as_ref()
    }
}

/// Calibrates a camera from photographs of a checkerboard, as `plumb calibrate` does.
///
/// `images`: files, or two-dimensional arrays of uint8 or uint16, whose brightest possible sample is
/// `white_level`: 255 or 65535 unless it is given; `board`: columns and rows of INNER corners; `pitch_mm`: from one inner corner to the next; `model`:
/// "auto", or the name of a lens model.
#[pyfunction]
#[pyo3(signature = (images, board = (9, 6), pitch_mm = 20.0, *, model = "auto", white_level = None))]
pub fn calibrate(
    py: Python<'_>,
    images: Vec<Bound<'_, PyAny>>,
    board: (u8, u8),
    pitch_mm: f64,
    model: &str,
    white_level: Option<u16>,
) -> PyResult<Camera> {
    let choice = if model == "auto" {
        Choice::Supported
    } else {
        let named = MODELS.into_iter().find(|it| it.name() == model).ok_or_else(|| {
            let names = MODELS.map(|it| it.name()).join(", ");
            let remedy = format!("give auto, or one of {names}");
            bad_argument("calibrate", "model", format!("{model:?}"), &remedy)
        })?;
        Choice::Compared(named)
    };
    let images = Images::of(&images, white_level)?;
    let today = jiff::Zoned::now().date();
    let calibrated = py.detach(|| {
        let board = calibration::board(board.into(), pitch_mm)?;
        let pictures = match images {
            Images::Files(paths) => calibration::read(&paths)?,
            Images::Pictures(pictures) => pictures,
        };
        calibration::camera_from(&pictures, &board, choice, today, || ())
    });
    Ok(Camera { inner: calibrated.raise()?.camera, place: "the calibration".to_owned() })
}

/// Photographs.
enum Images {
    Files(Vec<PathBuf>),
    Pictures(Vec<Picture>),
}

impl Images {
    /// From a list of arrays, or of files.
    fn of(images: &[Bound<'_, PyAny>], white_level: Option<u16>) -> PyResult<Self> {
        let arrays = images.iter().filter(|it| it.cast::<PyUntypedArray>().is_ok()).count();
        if (1..images.len()).contains(&arrays) {
            let found = "calibrate: images: files and arrays; give the one or the other";
            return Err(PyTypeError::new_err(found));
        }
        if arrays == 0 {
            if white_level.is_some() {
                let remedy = "leave it out: a file says it itself";
                return Err(bad_argument("calibrate", "white_level", "files are given", remedy));
            }
            let files = images.iter().map(|it| it.extract()).collect::<PyResult<_>>()?;
            return Ok(Self::Files(files));
        }
        let mut pictures = Vec::new();
        for (at, image) in images.iter().enumerate() {
            let place = format!("images[{at}]");
            match Samples::of(&format!("calibrate: {place}"), image)? {
                Samples::Grey8(image) => {
                    add(&mut pictures, place, &image, white_level.unwrap_or(255), |it| {
                        Pixels::Grey8(it)
                    })?;
                }
                Samples::Grey16(image) => {
                    add(&mut pictures, place, &image, white_level.unwrap_or(u16::MAX), |it| {
                        Pixels::Grey16(it)
                    })?;
                }
            }
        }
        Ok(Self::Pictures(pictures))
    }
}

/// Adds a photograph to others.
fn add<P: Element + Copy>(
    pictures: &mut Vec<Picture>,
    place: String,
    image: &Bound<'_, PyArray2<P>>,
    white_level: u16,
    pixels: impl Fn(&[P]) -> Pixels<'_>,
) -> PyResult<()> {
    if white_level == 0 {
        let remedy = "give the brightest possible sample, 255 in 8 bits";
        return Err(bad_argument("calibrate", "white_level", white_level, remedy));
    }
    let mut samples = Vec::new();
    let [width, height] = frame::copy(image, &mut samples, |_, _| Ok(()))?;
    let pixels = pixels(&samples);
    let index = pictures.len() as u64;
    let frame = Frame { index, capture_time_ns: 0, width, height, white_level, pixels };
    calibration::add(pictures, place, &frame).raise()
}

#[pymethods]
impl Camera {
    /// Reads a camera's file: camera.toml, or of OpenCV (YAML, JSON) or ROS (YAML).
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Self::read(&path))
    }

    /// Writes camera.toml; one that exists is replaced only with `force`.
    #[pyo3(signature = (path, *, force = false))]
    fn save(&self, path: PathBuf, force: bool) -> PyResult<()> {
        write_all(&[(path, self.to_toml().into_bytes())], force).raise()
    }

    /// The text of camera.toml.
    fn to_toml(&self) -> String {
        camera::to_toml(&self.inner)
    }

    /// Columns of a frame.
    #[getter]
    fn width_px(&self) -> u16 {
        self.inner.lens.width_px
    }

    /// Rows of a frame.
    #[getter]
    fn height_px(&self) -> u16 {
        self.inner.lens.height_px
    }

    /// The name of the lens model.
    #[getter]
    fn model(&self) -> &'static str {
        self.inner.lens.distortion.name()
    }

    /// The pinhole's matrix: (3, 3).
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let it = &self.inner.lens;
        let rows = [it.fx_px, it.skew_px, it.cx_px, 0.0, it.fy_px, it.cy_px, 0.0, 0.0, 1.0];
        shaped(py, rows.to_vec(), [3, 3])
    }

    /// The coefficients of the lens model.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        vector(py, self.inner.lens.distortion.coefficients().to_vec())
    }

    /// The names of the camera's numbers.
    #[getter]
    fn names(&self) -> Vec<&'static str> {
        NUMBERS.into_iter().chain(self.inner.lens.distortion.names().iter().copied()).collect()
    }

    /// The camera's numbers, in the order of `names`.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        let it = &self.inner.lens;
        let pinhole = [it.fx_px, it.fy_px, it.cx_px, it.cy_px, it.skew_px];
        vector(py, [&pinhole[..], it.distortion.coefficients()].concat())
    }

    /// Their standard deviations; `None` where the file does not say them.
    #[getter]
    fn sd<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        let Deviations { fx_px, fy_px, cx_px, cy_px, skew_px, distortion } = &self.details()?.sd;
        let pinhole = [*fx_px, *fy_px, *cx_px, *cy_px, *skew_px];
        Some(vector(py, [&pinhole[..], distortion].concat()))
    }

    /// Their correlations, a square; `None` where the file does not say them.
    #[getter]
    fn correlations<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(rows) = self.details().map(|it| &it.correlations).filter(|it| !it.is_empty())
        else {
            return Ok(None);
        };
        let count = rows.len();
        // The file has, of each number, those with the numbers before it.
        let of = |row: usize, column: usize| match row.cmp(&column) {
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => rows[row][column],
            std::cmp::Ordering::Less => rows[column][row],
        };
        let places = (0..count).flat_map(|row| (0..count).map(move |column| (row, column)));
        let all = places.map(|(row, column)| of(row, column)).collect();
        shaped(py, all, [count, count]).map(Some)
    }

    /// The readout of a rolling shutter in milliseconds; 0 for a global one.
    #[getter]
    fn readout_ms(&self) -> f64 {
        f64::from(self.inner.readout_ns) / 1e6
    }

    /// Root mean square reprojection error of the calibration.
    #[getter]
    fn rms_px(&self) -> Option<f64> {
        self.inner.provenance.rms_px
    }

    /// The number of photographs that were used.
    #[getter]
    fn images(&self) -> Option<u32> {
        self.inner.provenance.images
    }

    /// The calibration's date, in words.
    #[getter]
    fn date(&self) -> Option<&str> {
        self.inner.provenance.date.as_deref()
    }

    /// What is wrong with the photographs or the board; empty where it is good, `None` where the file
    /// does not say.
    #[getter]
    fn concerns(&self) -> Option<Vec<String>> {
        Some(self.details()?.verdict.clone())
    }

    /// What each photograph contributed; `None` where the file does not say.
    #[getter]
    fn photographs<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.details().map(|details| object(py, &details.photographs)).transpose()
    }

    fn __repr__(&self) -> String {
        let (width, height, model) = (self.width_px(), self.height_px(), self.model());
        format!("<Camera of {width} x {height} px, {model}>")
    }
}
