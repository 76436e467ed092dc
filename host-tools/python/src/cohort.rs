//! A cohort, and the figures of its trials: here, or of a trial's row and points wherever these are.

use std::path::PathBuf;

use plumbline_cohort::row::{self, Row};
use plumbline_cohort::{figures, folder, samples};
use plumbline_files::BadInput;
use plumbline_study::tidy;
use plumbline_trial::parquet::Values;
use plumbline_trial::points::Points;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arrays::table;
use crate::error::{Raise as _, bad_argument, raised};
use crate::given;
use crate::method::choice;

/// A cohort: opened by `plumbline.open_cohort`.
#[pyclass(frozen, module = "plumbline")]
pub struct Cohort {
    inner: folder::Cohort,
    rows: Vec<Row>,
}

/// Opens a cohort, as `plumb cohort add` has made it, and reads its table of trials.
#[pyfunction]
pub fn open_cohort(py: Python<'_>, path: PathBuf) -> PyResult<Cohort> {
    let open = || {
        let inner = folder::Cohort::open(&path)?;
        let rows = inner.rows()?;
        Ok::<_, BadInput>(Cohort { inner, rows })
    };
    py.detach(open).raise()
}

#[pymethods]
impl Cohort {
    /// The cohort's folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.inner.path().to_owned()
    }

    /// The columns of the table of trials.
    fn _trials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        table(py, row::columns(&self.rows))
    }

    /// The figures of all trials, or of those with these `trial`, from their points.
    #[pyo3(signature = (*, trials = None, **method))]
    fn _figures<'py>(
        &self,
        py: Python<'py>,
        trials: Option<Vec<String>>,
        method: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let choice = choice("figures", method)?;
        let unknown = |it: &&String| self.rows.iter().all(|row| row.trial != **it);
        if let Some(other) = trials.iter().flatten().find(unknown) {
            let remedy = "give values of the column trial of the table of trials";
            return Err(bad_argument("figures", "trials", format!("{other:?}"), remedy));
        }
        let is_asked = |row: &&Row| trials.as_ref().is_none_or(|it| it.contains(&row.trial));
        let rows: Vec<&Row> = self.rows.iter().filter(is_asked).collect();
        let of = |row: &&Row| {
            let points = self.inner.points(row)?;
            Ok::<_, BadInput>(figures::of(row, &points, &choice))
        };
        let found: Vec<Result<Vec<tidy::Row>, BadInput>> =
            py.detach(|| rows.par_iter().map(of).collect());
        let (mut keys, mut all) = (Vec::new(), Vec::new());
        for (row, found) in rows.into_iter().zip(found) {
            let found = found.raise()?;
            keys.extend(std::iter::repeat_n(row.key.clone(), found.len()));
            all.extend(found);
        }
        table(py, figures::columns(&keys, &all))
    }

    fn __len__(&self) -> usize {
        self.rows.len()
    }

    fn __repr__(&self) -> String {
        format!("<Cohort of {} trials>", self.rows.len())
    }
}

/// The columns of a table of a cohort, and what they hold: "text", "number", "integer", "flag" or
/// "instant".
#[pyfunction]
pub fn cohort_columns(table: &str) -> PyResult<Vec<(String, &'static str)>> {
    let columns = match table {
        "trials" => row::columns(&[]),
        "figures" => figures::columns(&[], &[]),
        "points" => samples::columns(),
        other => {
            let remedy = "give \"trials\", \"figures\" or \"points\"";
            return Err(bad_argument("cohort_columns", "table", format!("{other:?}"), remedy));
        }
    };
    Ok(columns.into_iter().map(|(name, kind)| (name, given::kind_word(&kind))).collect())
}

/// The rows of a table of trials, in the order of their keys.
pub fn rows(columns: &Bound<'_, PyDict>) -> PyResult<Vec<Row>> {
    const PLACE: &str = "the table of trials";
    let table = given::table(PLACE, columns, row::columns(&[]))?;
    let mut rows = row::rows(&table, PLACE).raise()?;
    rows.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(rows)
}

/// A trial from its row and the columns of its points.
///
/// # Errors
/// When they do not belong together.
pub fn trial(row: &Bound<'_, PyDict>, points: &Bound<'_, PyDict>) -> PyResult<(Row, Points)> {
    let wrong = |place: &str, found: String| {
        let remedy = "the cohort was being changed, or is damaged: `plumb cohort check` says which";
        raised(BadInput::whole(place, found, remedy))
    };
    let mut rows = rows(row)?;
    let (Some(row), true) = (rows.pop(), rows.is_empty()) else {
        return Err(wrong("the table of trials", "a trial has not one row".to_owned()));
    };
    let place = row.key.to_string();
    let is_read = |(name, _): &(String, Values)| name != "trial";
    let kinds = samples::columns().into_iter().filter(is_read).collect();
    let table = given::table(&place, points, kinds)?;
    let found = table.numbers("time_s").raise()?.len();
    if i64::try_from(found).ok() != Some(row.frames) {
        let found = format!("its points are of {found} frames, and its row says {}", row.frames);
        return Err(wrong(&place, found));
    }
    let points = samples::of_table(&table, &place, &row).raise()?;
    Ok((row, points))
}

/// The figures of one trial, from the columns of its row and of its points.
#[pyfunction]
#[pyo3(signature = (row, points, **method))]
pub fn figures_of_points<'py>(
    py: Python<'py>,
    row: &Bound<'py, PyDict>,
    points: &Bound<'py, PyDict>,
    method: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let choice = choice("figures", method)?;
    let (row, points) = trial(row, points)?;
    let found = py.detach(|| figures::of(&row, &points, &choice));
    let keys = vec![row.key; found.len()];
    table(py, figures::columns(&keys, &found))
}
