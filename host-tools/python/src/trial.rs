//! A trial as Python has it.

use std::path::PathBuf;
use std::sync::Arc;

use plumbline_files::BadInput;
use plumbline_study::analysis::Analysis;
use plumbline_study::tidy;
use plumbline_trial::export::{self, Format, Recording};
use plumbline_trial::frame::Trunk as Which;
use plumbline_trial::manifest::{EventSeen, Zero};
use plumbline_trial::points::Points;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};

use crate::arrays::{object, shaped, table, vector};
use crate::columns::Columns;
use crate::error::{Raise as _, bad_argument};
use crate::method::{choice, zero};
use crate::rows::{self, Row};

/// One trunk's points, a row for each frame of the trial.
#[pyclass(frozen, get_all, module = "plumbline")]
pub struct Trunk {
    /// `lower` or `upper`.
    name: &'static str,
    /// When the target was exposed, seconds from t = 0: (rows,).
    time_s: Py<PyAny>,
    /// AP, ML, SI in millimetres: (rows, 3).
    position_mm: Py<PyAny>,
    /// Covariance of AP, ML, SI in mm²: (rows, 3, 3).
    covariance_mm2: Py<PyAny>,
    /// theta1, theta2, theta3 in radians and x, y, z in millimetres of the target's pose: (rows, 6).
    theta: Py<PyAny>,
    /// Reprojection error in pixels: (rows,).
    rms_px: Py<PyAny>,
    /// The state in words; empty for a frame that never came.
    state: Py<PyAny>,
}

impl Trunk {
    fn new(py: Python<'_>, which: Which, columns: Columns) -> PyResult<Self> {
        let count = columns.time_s.len();
        let words: Vec<_> = columns.words.iter().map(|it| PyString::new(py, it)).collect();
        let state = PyList::new(py, columns.states.iter().map(|at| &words[*at]))?;
        Ok(Self {
            name: which.word(),
            time_s: vector(py, columns.time_s).unbind(),
            position_mm: shaped(py, columns.position_mm, [count, 3])?.unbind(),
            covariance_mm2: shaped(py, columns.covariance_mm2, [count, 3, 3])?.unbind(),
            theta: shaped(py, columns.theta, [count, 6])?.unbind(),
            rms_px: vector(py, columns.rms_px).unbind(),
            state: state.into_any().unbind(),
        })
    }
}

/// What has been exported.
#[pyclass(frozen, get_all, module = "plumbline")]
pub struct Exported {
    /// The number of rows, one for each frame.
    rows: usize,
    /// Rows per second.
    rate_hz: f64,
    /// What t = 0 is, in words.
    zero: String,
    /// What a user should know.
    warnings: Vec<String>,
}

/// A trial: read by `plumbline.open_trial`.
#[pyclass(frozen, module = "plumbline")]
pub struct Trial {
    inner: Arc<plumbline_trial::Trial>,
    zero: Zero,
    about: About,
    /// When each frame was taken, seconds from t = 0: (rows,).
    #[pyo3(get)]
    time_s: Py<PyAny>,
    /// The box's run, from 1: (rows,).
    #[pyo3(get)]
    session: Py<PyAny>,
    /// The number that the box gave the frame: (rows,).
    #[pyo3(get)]
    frame: Py<PyAny>,
    /// Whether the frame came: (rows,).
    #[pyo3(get)]
    received: Py<PyAny>,
    /// The lower trunk's points.
    #[pyo3(get)]
    lower: Py<Trunk>,
    /// The upper trunk's points.
    #[pyo3(get)]
    upper: Py<Trunk>,
}

/// What is known of the whole.
struct About {
    zero: String,
    zero_s: f64,
    zero_utc_s: Option<f64>,
    events: Vec<EventSeen>,
    warnings: Vec<String>,
}

impl About {
    /// From the points; a trial that has none, as without a scene, begins at its first frame.
    fn of(trial: &plumbline_trial::Trial, zero: Zero) -> Result<Self, BadInput> {
        match Points::of(trial, zero) {
            Ok(points) => Ok(Self {
                zero: points.zero,
                zero_s: points.zero_s,
                zero_utc_s: points.zero_utc_s,
                events: points.events,
                warnings: points.warnings,
            }),
            Err(error) if zero == Zero::Onset => Err(error),
            Err(BadInput { found, remedy, .. }) => Ok(Self {
                zero: "the first frame".to_owned(),
                zero_s: 0.0,
                zero_utc_s: trial.first_frame_utc_s,
                events: trial.manifest.events.clone(),
                warnings: [trial.warnings.clone(), vec![format!("{found}; {remedy}")]].concat(),
            }),
        }
    }
}

/// Reads a trial's folder, as `plumb receive --out` has made it.
///
/// `zero` is what t = 0 is: "mark", "start" or "onset"; without it, as trial.toml says.
#[pyfunction]
#[pyo3(signature = (path, *, zero = None))]
pub fn open_trial(py: Python<'_>, path: PathBuf, zero: Option<&str>) -> PyResult<Trial> {
    let zero = self::zero("open_trial", zero)?;
    let read = || {
        let trial = plumbline_trial::Trial::open(&path)?;
        let zero = zero.unwrap_or(trial.manifest.zero);
        let about = About::of(&trial, zero)?;
        let rows = rows::of(&trial)?;
        let of_rows = Arrays::of(&rows, about.zero_s);
        Ok::<_, BadInput>((trial, zero, about, of_rows))
    };
    let (trial, zero, about, arrays) = py.detach(read).raise()?;
    let Arrays { time_s, session, frame, received, lower, upper } = arrays;
    Ok(Trial {
        inner: Arc::new(trial),
        zero,
        about,
        time_s: vector(py, time_s).unbind(),
        session: vector(py, session).unbind(),
        frame: vector(py, frame).unbind(),
        received: vector(py, received).unbind(),
        lower: Py::new(py, Trunk::new(py, Which::Lower, lower)?)?,
        upper: Py::new(py, Trunk::new(py, Which::Upper, upper)?)?,
    })
}

/// The numbers of all rows.
struct Arrays {
    time_s: Vec<f64>,
    session: Vec<u32>,
    frame: Vec<u32>,
    received: Vec<bool>,
    lower: Columns,
    upper: Columns,
}

impl Arrays {
    fn of(rows: &[Row<'_>], zero_s: f64) -> Self {
        Self {
            time_s: rows.iter().map(|row| row.time_s - zero_s).collect(),
            session: rows.iter().map(|row| row.session).collect(),
            frame: rows.iter().map(|row| row.sequence).collect(),
            received: rows.iter().map(|row| row.frame.is_some()).collect(),
            lower: Columns::of(rows, Which::Lower, zero_s),
            upper: Columns::of(rows, Which::Upper, zero_s),
        }
    }
}

#[pymethods]
impl Trial {
    /// The trial's folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.inner.folder.clone()
    }

    /// The participant and the condition or, without them, the folder's name.
    #[getter]
    fn title(&self) -> String {
        self.inner.title()
    }

    /// Who was measured, as a code.
    #[getter]
    fn participant(&self) -> Option<&str> {
        self.inner.manifest.participant.as_deref()
    }

    /// The condition under which.
    #[getter]
    fn condition(&self) -> Option<&str> {
        self.inner.manifest.condition.as_deref()
    }

    /// trial.toml, made of the packets anew, by the names of its fields.
    #[getter]
    fn manifest<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &self.inner.manifest)
    }

    /// The verdict, by the names of its fields in trial.toml.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &self.inner.manifest.verdict())
    }

    /// The grade that counts: good, doubtful or unusable.
    #[getter]
    fn grade(&self) -> &'static str {
        self.inner.manifest.verdict().grade().word()
    }

    /// The marks and triggers, their times from t = 0.
    #[getter]
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &self.about.events)
    }

    /// What t = 0 is, in words.
    #[getter]
    fn zero(&self) -> &str {
        &self.about.zero
    }

    /// The time of day of t = 0, seconds since 1970.
    #[getter]
    fn zero_utc_s(&self) -> Option<f64> {
        self.about.zero_utc_s
    }

    /// Frames per second on average, those that were lost included.
    #[getter]
    fn rate_hz(&self) -> Option<f64> {
        self.inner.rate_hz()
    }

    /// What a user should know.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.about.warnings.clone()
    }

    /// The figures as `plumb figures` gives them.
    #[pyo3(signature = (**method))]
    fn _figures<'py>(
        &self,
        py: Python<'py>,
        method: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
        let choice = choice("figures", method)?;
        let found = py.detach(|| {
            let points = Points::of(&self.inner, self.zero)?;
            let settings = choice.settings(&points);
            Ok::<_, BadInput>(tidy::of_points(&self.inner, points, &settings))
        });
        let tidy::Found { rows, warnings } = found.raise()?;
        Ok((table(py, tidy::columns(&rows))?, warnings))
    }

    /// All figures, filtered and unfiltered, as `plumb analyze --json` writes them.
    #[pyo3(signature = (**method))]
    fn analyze<'py>(
        &self,
        py: Python<'py>,
        method: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let choice = choice("analyze", method)?;
        let analysis = py.detach(|| {
            let points = Points::of(&self.inner, self.zero)?;
            Analysis::of(&points, &choice.settings(&points))
        });
        object(py, &analysis.raise()?)
    }

    /// Writes the trial for other programs, as `plumb export` does.
    #[pyo3(signature = (format, path, *, session = None, run = None, force = false))]
    fn export(
        &self,
        py: Python<'_>,
        format: &str,
        path: PathBuf,
        session: Option<&str>,
        run: Option<u32>,
        force: bool,
    ) -> PyResult<Exported> {
        let format = match format {
            "csv" => Format::Csv,
            "parquet" => Format::Parquet,
            "trc" => Format::Trc,
            "c3d" => Format::C3d,
            "bids" => Format::Bids,
            other => {
                let remedy = "give \"csv\", \"parquet\", \"trc\", \"c3d\" or \"bids\"";
                return Err(bad_argument("export", "format", format!("{other:?}"), remedy));
            }
        };
        if run == Some(0) {
            return Err(bad_argument("export", "run", 0, "runs are counted from 1"));
        }
        let write = || {
            let recording = Recording { session, run, force };
            export::export(&self.inner, self.zero, format, &path, &recording)
        };
        let export::Exported { rows, rate_hz, zero, warnings } = py.detach(write).raise()?;
        Ok(Exported { rows, rate_hz, zero, warnings })
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.time_s.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (title, rows, grade) = (self.inner.title(), self.__len__(py)?, self.grade());
        Ok(format!("<Trial {title:?}: {rows} frames, {grade}>"))
    }
}
