//! The arguments that say how figures are made.

use plumbline_study::method::{Choice, Part};
use plumbline_trial::manifest::Zero;
use pyo3::prelude::*;

use crate::error::{bad_argument, word};

/// The time that is analysed: the word "all", or seconds from and to.
#[derive(FromPyObject)]
pub enum Span {
    /// A word.
    Word(String),
    /// From and to.
    Between([f64; 2]),
}

/// What was chosen by the arguments of `function`; the paper's for what is `None`.
///
/// # Errors
/// When an argument cannot be used; it is named.
pub fn choice(
    function: &str,
    filter: Option<&str>,
    span: Option<Span>,
    bins: Option<Vec<[f64; 2]>>,
    covered_min: Option<f64>,
    radius_mm: Option<f64>,
) -> PyResult<Choice> {
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
