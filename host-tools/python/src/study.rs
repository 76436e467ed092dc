//! A study of a cohort in steps: what each trial contributes, and what comes of it for each response.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use plumbline_cohort::studied;
use plumbline_files::BadInput;
use plumbline_study::complete;
use plumbline_study::figures::{NotCompared, SwayResponse, compare_sway, settings};
use plumbline_study::manifest::{self, Study};
use plumbline_study::sway::{self, SwayFigure};
use plumbline_study::values::{self, TrialValues, Value};
use plumbline_trial::parquet::Values;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use serde_json::json;

use crate::arrays::{object, table};
use crate::cohort::{rows, trial};
use crate::error::{Raise as _, bad_argument};
use crate::given;

/// A study of a cohort, whose steps can be taken on different computers.
// Where Python finds it, since it travels between them.
#[pyclass(frozen, module = "plumbline._plumbline")]
pub struct CohortStudy {
    inner: Study,
    text: String,
    place: PathBuf,
    cohort: PathBuf,
}

/// A trial that takes part: `trial`, its place in messages, its participant and its condition.
type TakesPart = (String, String, String, String);

#[pymethods]
impl CohortStudy {
    /// Of the text of a study.toml, which `place` is the name of; `cohort` takes the place of the
    /// trials or the cohort that it names.
    #[new]
    fn new(text: String, place: PathBuf, cohort: PathBuf) -> PyResult<Self> {
        let inner = manifest::parse_of_cohort(&text, Path::new(&place), &cohort).raise()?;
        Ok(Self { inner, text, place, cohort })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (String, PathBuf, PathBuf)) {
        let made_of = (self.text.clone(), self.place.clone(), self.cohort.clone());
        (py.get_type::<Self>(), made_of)
    }

    /// The study's name.
    #[getter]
    fn title(&self) -> &str {
        &self.inner.title
    }

    /// Of the table of trials those that take part, in the order in which they are compared, and
    /// the warnings.
    fn admitted(&self, trials: &Bound<'_, PyDict>) -> PyResult<(Vec<TakesPart>, Vec<String>)> {
        let rows = rows(trials)?;
        let (admitted, warnings) = studied::admitted(&self.inner, &rows).raise()?;
        let values: Vec<TrialValues<()>> = admitted
            .iter()
            .map(|row| TrialValues {
                place: row.key.to_string(),
                participant: row.key.participant.clone(),
                condition: row.key.condition.clone(),
                responses: Vec::new(),
            })
            .collect();
        complete::check(&self.inner, &values).raise()?;
        let admitted = admitted.iter().zip(values);
        let takes_part =
            admitted.map(|(row, TrialValues { place, participant, condition, .. })| {
                (row.trial.clone(), place, participant, condition)
            });
        Ok((takes_part.collect(), warnings))
    }

    /// What a trial contributes, from the columns of its row and of its points: for each point,
    /// figure of the study and time a value, or why there is none; and the warnings.
    fn values<'py>(
        &self,
        py: Python<'py>,
        row: &Bound<'py, PyDict>,
        points: &Bound<'py, PyDict>,
    ) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
        let (row, points) = trial(row, points)?;
        let study = &self.inner;
        let found = py.detach(|| sway::of_trial(&points, &settings(study), &study.figures));
        let place = &points.place;
        let own = points.warnings.iter().map(|warning| format!("{place}: {warning}"));
        let warnings = own.chain(found.warnings).collect();
        let (mut of_point, mut chosen, mut times) = (Vec::new(), Vec::new(), Vec::new());
        let (mut numbers, mut absent) = (Vec::new(), Vec::new());
        for (at, (figure, values)) in found.responses.into_iter().enumerate() {
            for (time, value) in values.into_iter().enumerate() {
                of_point.push(figure.point.clone());
                chosen.push((at % study.figures.len()) as i64);
                times.push(time as i64);
                numbers.push(value.as_ref().ok().copied());
                absent.push(value.err());
            }
        }
        let trials = vec![row.trial; times.len()];
        let columns = [
            ("trial", Values::Texts(trials)),
            ("point", Values::Texts(of_point)),
            ("chosen", Values::Integers(chosen)),
            ("time", Values::Integers(times)),
            ("value", Values::SomeNumbers(numbers)),
            ("absent", Values::SomeTexts(absent)),
        ];
        let columns = columns.map(|(name, values)| (name.to_owned(), values));
        Ok((table(py, columns.into())?, warnings))
    }

    /// The statistics of one response, the figure `chosen` of `point`, from the values that the
    /// trials of the study contribute: `trial`, `time`, `value`, `absent`.
    fn compare<'py>(
        &self,
        py: Python<'py>,
        point: &str,
        chosen: usize,
        takes_part: Vec<TakesPart>,
        columns: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let Some(it) = self.inner.figures.get(chosen) else {
            return Err(bad_argument("compare", "chosen", chosen, "give that of the values"));
        };
        let figure = SwayFigure::new(*it, point);
        let mut by_trial = by_trial(columns)?;
        let mut first = None;
        let trials: Vec<TrialValues<SwayFigure>> = takes_part
            .into_iter()
            .enumerate()
            .map(|(at, (trial, place, participant, condition))| {
                let values = by_trial.remove(&trial);
                first = first.or(values.as_ref().map(|_| at));
                let responses = values.into_iter().map(|it| (figure.clone(), it)).collect();
                TrialValues { place, participant, condition, responses }
            })
            .collect();
        let compared = py.detach(|| compare_sway(&self.inner, &trials, &figure)).raise()?;
        let said = match compared {
            Err(NotCompared { name, reason }) => json!({ "name": name, "reason": reason }),
            Ok((name, response)) => {
                let tested = values::p_of_effects(&response);
                let response = SwayResponse { figure: figure.clone(), response };
                json!({ "name": name, "tested": tested, "statistics": response })
            }
        };
        let said = object(py, &said)?;
        for (name, text) in
            [("figure", figure.figure), ("direction", figure.direction), ("unit", figure.unit)]
        {
            said.set_item(name, text)?;
        }
        said.set_item("first", first)?;
        Ok(said)
    }
}

/// The values of each trial, by time.
fn by_trial(columns: &Bound<'_, PyDict>) -> PyResult<HashMap<String, Vec<Value>>> {
    let kinds = [
        ("trial", Values::Texts(Vec::new())),
        ("time", Values::Integers(Vec::new())),
        ("value", Values::SomeNumbers(Vec::new())),
        ("absent", Values::SomeTexts(Vec::new())),
    ];
    let kinds = kinds.map(|(name, kind)| (name.to_owned(), kind));
    let table = given::table("the values", columns, kinds.into())?;
    let read = || {
        let (trials, times) = (table.texts("trial")?, table.integers("time")?);
        let (numbers, absent) = (table.some_numbers("value")?, table.some_texts("absent")?);
        let mut order: Vec<usize> = (0..trials.len()).collect();
        order.sort_by_key(|at| times[*at]);
        let mut by_trial: HashMap<String, Vec<Value>> = HashMap::new();
        for at in order {
            let value = numbers[at].ok_or_else(|| absent[at].clone().unwrap_or_default());
            by_trial.entry(trials[at].clone()).or_default().push(value);
        }
        Ok::<_, BadInput>(by_trial)
    };
    read().raise()
}

/// The p of one effect in many responses, adjusted for their number, after Holm and after Benjamini
/// and Hochberg.
#[pyfunction]
pub fn adjusted(p: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let tested: Vec<_> = p.into_iter().map(|it| vec![(String::new(), it)]).collect();
    let adjusted = values::adjusted(&tested).into_iter().flatten();
    adjusted.map(|it| (it.p_holm, it.p_benjamini_hochberg)).unzip()
}
