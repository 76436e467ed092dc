//! Figures of many trials, and the statistics of studies.

use std::path::PathBuf;

use plumbline_cohort::studied;
use plumbline_files::BadInput;
use plumbline_study::tidy::{self, Found};
use plumbline_study::{long, manifest};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arrays::{object, table};
use crate::error::{Raise as _, bad_argument, raised, word};
use crate::method::{choice, zero};

/// What is found in many trials: the columns of the table, the warnings, the errors.
type Many<'py> = (Bound<'py, PyDict>, Vec<String>, Vec<Py<PyAny>>);

/// The figures of these trials, the warnings, and the errors of trials that cannot be read.
#[pyfunction]
#[pyo3(signature = (paths, *, zero = None, **method))]
pub fn figures<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    zero: Option<&str>,
    method: Option<&Bound<'py, PyDict>>,
) -> PyResult<Many<'py>> {
    let choice = choice("figures", method)?;
    let zero = self::zero("figures", zero)?;
    let found = py.detach(|| {
        tidy::refuse_twice(&paths)?;
        let of = |path: &PathBuf| tidy::of_trial(path, zero, |points| choice.settings(points));
        Ok::<_, BadInput>(paths.par_iter().map(of).collect::<Vec<Result<Found, BadInput>>>())
    });
    let (mut rows, mut warnings, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for (path, found) in paths.iter().zip(found.raise()?) {
        match found {
            Ok(found) => {
                rows.extend(found.rows);
                let said = found.warnings.into_iter();
                warnings.extend(said.map(|warning| format!("{}: {warning}", path.display())));
            }
            Err(error) => errors.push(raised(error).into_value(py).into_any()),
        }
    }
    Ok((table(py, tidy::columns(&rows))?, warnings, errors))
}

/// The statistics of a study, as `plumb study --json` writes them; of a `cohort`, whatever trials the
/// study names.
#[pyfunction]
#[pyo3(signature = (path, *, cohort = None))]
pub fn study(py: Python<'_>, path: PathBuf, cohort: Option<PathBuf>) -> PyResult<Bound<'_, PyAny>> {
    let figures = py.detach(|| {
        let study = match cohort {
            Some(cohort) => manifest::read_of_cohort(&path, &cohort)?,
            None => manifest::read(&path)?,
        };
        studied::analyze(&study, |_| || ())
    });
    object(py, &figures.raise()?)
}

/// The statistics of a table with one measurement per line, as `plumb study --long --json` writes
/// them.
#[pyfunction]
#[pyo3(signature = (path, *, response, within, subject, delimiter = "comma", drop_incomplete = false))]
pub fn study_of_table<'py>(
    py: Python<'py>,
    path: PathBuf,
    response: String,
    within: Vec<String>,
    subject: String,
    delimiter: &str,
    drop_incomplete: bool,
) -> PyResult<Bound<'py, PyAny>> {
    const NAME: &str = "study_of_table";
    if !(1..=2).contains(&within.len()) {
        let found = format!("{} factors", within.len());
        return Err(bad_argument(NAME, "within", found, "name one or two columns"));
    }
    let delimiter = word(NAME, "delimiter", delimiter, "give \"comma\", \"semicolon\" or \"tab\"")?;
    let columns = long::Columns { response, within, subject };
    let figures = py.detach(|| long::analyze(&path, &columns, delimiter, drop_incomplete));
    object(py, &figures.raise()?)
}
