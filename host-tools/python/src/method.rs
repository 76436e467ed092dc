//! The arguments that say how figures are made.

use plumbline_study::method::{Choice, Part};
use plumbline_trial::manifest::Zero;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{bad_argument, word};

/// The time that is analysed: the word "all", or seconds from and to.
#[derive(FromPyObject)]
pub enum Span {
    /// A word.
    Word(String),
    /// From and to.
    Between([f64; 2]),
}

/// What was chosen by these arguments of `function`, as Python gives them by their names: `filter`,
/// `span`, `bins`, `covered_min` and `radius_mm`; the paper's for what is absent or `None`.
///
/// # Errors
/// When there is another argument, or one cannot be used; it is named.
pub fn choice(function: &str, arguments: Option<&Bound<'_, PyDict>>) -> PyResult<Choice> {
    let mut filter: Option<String> = None;
    let mut span: Option<Span> = None;
    let mut bins: Option<Vec<[f64; 2]>> = None;
    let [mut covered_min, mut radius_mm] = [None::<f64>; 2];
    for (name, value) in arguments.into_iter().flatten() {
        let name: String = name.extract()?;
        let read = match &*name {
            "filter" => value.extract().map(|it| filter = it),
            "span" => value.extract().map(|it| span = it),
            "bins" => value.extract().map(|it| bins = it),
            "covered_min" => value.extract().map(|it| covered_min = it),
            "radius_mm" => value.extract().map(|it| radius_mm = it),
            _ => Err(PyTypeError::new_err("there is no such argument")),
        };
        read.map_err(|error| PyTypeError::new_err(format!("{function}: {name}: {error}")))?;
    }
    let filter = filter.as_deref();
    let filter = filter.map(str::parse).transpose().map_err(|error: String| {
        bad_argument(function, "filter", error, "such as filter=\"butterworth:10\"")
    })?;
    let in_order = |name: &str, [from, to]: [f64; 2]| {
        if from.is_finite() && to.is_finite() && from < to {
            return Ok(from..to);
        }
        let found = format!("({from}, {to})");
        Err(bad_argument(function, name, found, "give the earlier second first, such as (0, 20)"))
    };
    let part = match span {
        None => None,
        Some(Span::Word(word)) if word == "all" => Some(Part::All),
        Some(Span::Word(word)) => {
            let remedy = "give \"all\", or seconds from and to, such as (0, 30)";
            return Err(bad_argument(function, "span", format!("{word:?}"), remedy));
        }
        Some(Span::Between(span)) => Some(Part::Between(in_order("span", span)?)),
    };
    let bins = bins.unwrap_or_default().into_iter();
    let bins_s = bins.map(|bin| in_order("bins", bin)).collect::<PyResult<_>>()?;
    if let Some(share) = covered_min.filter(|it| !(0.0..=1.0).contains(it)) {
        let remedy = "give a share from 0 to 1, such as 0.9";
        return Err(bad_argument(function, "covered_min", share, remedy));
    }
    if let Some(radius_mm) = radius_mm.filter(|it| !(*it > 0.0 && it.is_finite())) {
        let remedy = "give millimetres, more than 0, such as 3";
        return Err(bad_argument(function, "radius_mm", radius_mm, remedy));
    }
    Ok(Choice { filter, part, bins_s, covered_min, radius_mm })
}

/// What t = 0 is to be, if it is said.
///
/// # Errors
/// When it is none of the words.
pub fn zero(function: &str, text: Option<&str>) -> PyResult<Option<Zero>> {
    let remedy = "give \"mark\", \"start\" or \"onset\"";
    text.map(|text| word(function, "zero", text, remedy)).transpose()
}
