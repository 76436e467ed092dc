//! The box's pipeline over arrays of frames.

use std::path::PathBuf;

use numpy::{Element, PyArray2};
use plumbline::config::Config;
use plumbline::image::{GreyImage, ImageError, Pixel};
use plumbline::report::{Measurement, Report, TargetReport};
use plumbline::scene::Anatomical;
use plumbline_bedside::Told;
use plumbline_bedside::setup::{self, Descriptions, Places};
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_files::poses::{PoseRow, number_columns};
use plumbline_stream::recorder::role_word;
use plumbline_tracking::Image;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{shaped, vector};
use crate::camera::Camera;
use crate::error::{Raise as _, bad_argument, raised};
use crate::frame::{self, Samples};

/// Tracks targets from frame to frame, as the box and `plumb track` do.
///
/// `camera`: a Camera or its file; `targets`: targets.toml; `scene`: scene.toml, without which there
/// are no trunk points; `independent`: whether the frames are photographs that do not follow each
/// other; `scale_camera`: the columns and rows of the frames, where these are the picture of the
/// camera's own size resampled.
#[pyclass(module = "plumbline")]
pub struct Tracker {
    config: Config,
    tracker: plumbline_tracking::Tracker,
    camera_place: String,
    /// Copies of the frame: another thread may write into the array meanwhile.
    grey8: Vec<u8>,
    grey16: Vec<u16>,
    frames: u64,
    warnings: Vec<String>,
}

/// A camera, or where its file is.
#[derive(FromPyObject)]
enum CameraOrFile<'py> {
    Camera(Bound<'py, Camera>),
    File(PathBuf),
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (camera, targets, scene = None, *, independent = false, scale_camera = None))]
    fn new(
        py: Python<'_>,
        camera: CameraOrFile<'_>,
        targets: PathBuf,
        scene: Option<PathBuf>,
        independent: bool,
        scale_camera: Option<(u16, u16)>,
    ) -> PyResult<Self> {
        let (camera, place) = match camera {
            CameraOrFile::Camera(it) => (it.get().inner.clone(), it.get().place.clone()),
            CameraOrFile::File(path) => {
                let Camera { inner, place } = Camera::read(&path)?;
                (inner, place)
            }
        };
        let mut warnings = Vec::new();
        let made = py.detach(|| {
            let descriptions = Descriptions { camera: PathBuf::from(&place), targets, scene };
            let places: Places = descriptions.places();
            let mut tell = |told: Told| {
                if let Told::Warning(warning) = told {
                    warnings.push(warning);
                }
            };
            let (targets, scene) = descriptions.read_for(&camera.lens, &mut tell)?;
            let camera = match scale_camera {
                None => camera,
                Some((width_px, height_px)) => {
                    camera::scaled(&camera, width_px.into(), height_px.into(), &place)?
                }
            };
            let config = setup::config(&camera, &targets, scene.as_ref(), &places)?;
            let tracker = plumbline_tracking::Tracker::new(&config, independent, &places)?;
            Ok::<_, BadInput>((config, tracker))
        });
        let (config, tracker) = made.raise()?;
        Ok(Self {
            config,
            tracker,
            camera_place: place,
            grey8: Vec::new(),
            grey16: Vec::new(),
            frames: 0,
            warnings,
        })
    }

    /// Measures one frame: a two-dimensional array of uint8 or uint16, rows first.
    ///
    /// `time_s` is its capture time; only differences matter. `white_level` is the brightest possible
    /// sample: 255 or 65535 unless it is given, 1023 for samples of 10 bits.
    #[pyo3(signature = (frame, time_s, *, white_level = None))]
    fn step(
        &mut self,
        py: Python<'_>,
        frame: &Bound<'_, PyAny>,
        time_s: f64,
        white_level: Option<u16>,
    ) -> PyResult<Tracked> {
        let time_ns = nanoseconds(time_s)?;
        let Self { config, tracker, grey8, grey16, .. } = self;
        let mut step = Step { py, config, tracker, place: &self.camera_place, time_ns };
        let report = match Samples::of("step: frame", frame)? {
            Samples::Grey8(frame) => step.of(&frame, grey8, white_level.unwrap_or(u8::MAX.into())),
            Samples::Grey16(frame) => step.of(&frame, grey16, white_level.unwrap_or(u16::MAX)),
        }?;
        let index = self.frames;
        self.frames += 1;
        let rows = PoseRow::of_report(&self.config, index, &report).collect();
        let names = self.config.targets.iter().map(|target| target.name.to_string()).collect();
        Ok(Tracked { index, time_s, report, names, rows })
    }

    /// Forgets where the targets are: the next frame is searched afresh.
    fn forget(&mut self) {
        self.tracker.forget();
    }

    /// The names of the targets, in the order of their file.
    #[getter]
    fn targets(&self) -> Vec<String> {
        self.config.targets.iter().map(|target| target.name.to_string()).collect()
    }

    /// What a user should know of the files.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }
}

/// What one step needs besides the frame.
struct Step<'a, 'py> {
    py: Python<'py>,
    config: &'a Config,
    tracker: &'a mut plumbline_tracking::Tracker,
    place: &'a str,
    time_ns: u64,
}

impl Step<'_, '_> {
    fn of<'a, P: Pixel + Element>(
        &mut self,
        frame: &Bound<'_, PyArray2<P>>,
        copy: &'a mut Vec<P>,
        white_level: u16,
    ) -> PyResult<Report>
    where
        GreyImage<'a, P>: Into<Image<'a>>,
    {
        let [width, height] = frame::copy(frame, copy, |width, height| {
            let lens = &self.config.lens;
            let checked = camera::check_frame_size(lens, self.place, width, height, "the frame");
            checked.map_err(|mut error| {
                error.remedy += ", or scale_camera=(columns, rows) if these frames are the same \
                                 picture resampled";
                raised(error)
            })
        })?;
        let image = GreyImage::with_white_level(copy, width, height, width, white_level);
        let image = image.map_err(|error: ImageError| {
            let remedy = "give frames of the camera's size, and the brightest possible sample";
            bad_argument("step", "frame, white_level", error, remedy)
        })?;
        let (tracker, image) = (&mut *self.tracker, image.into());
        Ok(self.py.detach(|| tracker.step_image(&image, self.time_ns)))
    }
}

/// The latest time that a frame can have: a century.
const TIME_S_MAX: f64 = 3.2e9;

/// A capture time as the pipeline takes it.
fn nanoseconds(time_s: f64) -> PyResult<u64> {
    if (0.0..=TIME_S_MAX).contains(&time_s) {
        return Ok((time_s * 1e9).round() as u64);
    }
    Err(bad_argument("step", "time_s", time_s, "give seconds from 0 on, such as index / 60"))
}

/// What was found in one frame.
#[pyclass(frozen, module = "plumbline")]
pub struct Tracked {
    /// The number of the frame, from 0.
    #[pyo3(get)]
    index: u64,
    /// Its capture time, as it was given.
    #[pyo3(get)]
    time_s: f64,
    report: Report,
    names: Vec<String>,
    rows: Vec<PoseRow>,
}

#[pymethods]
impl Tracked {
    /// Each target, in the order of their file.
    #[getter]
    fn targets(&self) -> Vec<TargetPose> {
        let named = self.names.iter().zip(&self.rows).zip(&self.report.targets);
        named
            .map(|((name, row), report)| TargetPose {
                name: name.clone(),
                time_s: row.time_s,
                report: *report,
            })
            .collect()
    }

    /// The lower trunk's point: AP, ML, SI in millimetres; `None` without a pose or a scene.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        trunk(py, self.report.lower_trunk.as_ref())
    }

    /// The upper trunk's point, likewise.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        trunk(py, self.report.upper_trunk.as_ref())
    }

    /// The rows of poses.csv, as `plumb track` writes them: one for each target, by column; `None`
    /// where a cell is empty.
    fn rows<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let row = |row: &PoseRow| {
            let columns = PyDict::new(py);
            columns.set_item("frame", row.frame)?;
            columns.set_item("time_s", row.time_s)?;
            columns.set_item("target", &row.target)?;
            columns.set_item("state", &row.state)?;
            for (name, number) in number_columns().iter().zip(row.numbers()) {
                columns.set_item(name, number)?;
            }
            Ok(columns)
        };
        self.rows.iter().map(row).collect()
    }
}

fn trunk<'py>(py: Python<'py>, point: Option<&Anatomical>) -> Option<Bound<'py, PyAny>> {
    let Anatomical { ap_mm, ml_mm, si_mm } = point?;
    Some(vector(py, vec![*ap_mm, *ml_mm, *si_mm]))
}

/// One target in one frame.
#[pyclass(frozen, module = "plumbline")]
pub struct TargetPose {
    /// Its name.
    #[pyo3(get)]
    name: String,
    /// When it was exposed; without a pose, the frame's time.
    #[pyo3(get)]
    time_s: f64,
    report: TargetReport,
}

impl TargetPose {
    fn measured(&self) -> Option<&Measurement> {
        self.report.measurement.as_ref().ok()
    }
}

#[pymethods]
impl TargetPose {
    /// `lower`, `upper` or `scene`.
    #[getter]
    fn role(&self) -> &'static str {
        role_word(self.report.role)
    }

    /// `acquiring`, `tracking` or `coasting`.
    #[getter]
    fn state(&self) -> &'static str {
        self.report.state.word()
    }

    /// Why there is no pose; `None` where there is one.
    #[getter]
    fn no_pose(&self) -> Option<&'static str> {
        self.report.measurement.as_ref().err().map(|reason| reason.words())
    }

    /// theta1, theta2, theta3 in radians and x, y, z in millimetres of cam_from_target: (6,).
    #[getter]
    fn theta<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        Some(vector(py, self.measured()?.cam_from_target.theta().to_vec()))
    }

    /// The rotation of cam_from_target: (3, 3), its columns the target's axes.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let rows = self.measured().map(|it| it.cam_from_target.rotation.transpose());
        rows.map(|rows| shaped(py, rows.iter().copied().collect(), [3, 3])).transpose()
    }

    /// The target's origin in the camera's frame, millimetres: (3,).
    #[getter]
    fn translation_mm<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        let [x, y, z] = self.measured()?.cam_from_target.translation_mm.into();
        Some(vector(py, vec![x, y, z]))
    }

    /// Covariance of small turns about the target's axes (radians) and moves along the camera's
    /// (millimetres): (6, 6).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let rows = self.measured().map(|it| it.covariance.transpose());
        rows.map(|rows| shaped(py, rows.iter().copied().collect(), [6, 6])).transpose()
    }

    /// Reprojection error in pixels.
    #[getter]
    fn rms_px(&self) -> Option<f64> {
        Some(self.measured()?.rms_px)
    }

    /// Corners used.
    #[getter]
    fn corners(&self) -> Option<u8> {
        Some(self.measured()?.corners)
    }

    /// Corners of the target.
    #[getter]
    fn corners_total(&self) -> Option<u8> {
        Some(self.measured()?.corners_total)
    }

    fn __repr__(&self) -> String {
        match self.no_pose() {
            None => format!("<{}: {}>", self.name, self.state()),
            Some(reason) => format!("<{}: {}: {reason}>", self.name, self.state()),
        }
    }
}
