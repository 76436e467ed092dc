//! Columns that Python gives, as a table of the library.

use numpy::PyReadonlyArray1;
use plumbline_files::BadInput;
use plumbline_trial::parquet::{Table, Values};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::raised;

/// The table with the columns of `kinds`, each of its kind, from lists or arrays by their names;
/// `place` is where they are from. A number that is absent is `None` or NaN; an instant is
/// microseconds since 1970 UTC.
///
/// # Errors
/// When a column is absent or of another kind.
pub fn table(
    place: &str,
    columns: &Bound<'_, PyDict>,
    kinds: Vec<(String, Values)>,
) -> PyResult<Table> {
    let column = |(name, kind): (String, Values)| {
        let values = columns.get_item(&name)?.ok_or_else(|| {
            raised(BadInput::new(place, &name, "there is no such column", "give all columns"))
        })?;
        let values = of_kind(&values, &kind).map_err(|error| {
            let remedy = "give the columns as the cohort's Parquet has them";
            raised(BadInput::new(place, &name, error, remedy))
        })?;
        Ok((name, values))
    };
    let columns = kinds.into_iter().map(column).collect::<PyResult<_>>()?;
    Ok(Table::new(place.to_owned(), columns))
}

fn of_kind(values: &Bound<'_, PyAny>, kind: &Values) -> PyResult<Values> {
    Ok(match kind {
        Values::Texts(_) => Values::Texts(values.extract()?),
        Values::SomeTexts(_) => Values::SomeTexts(values.extract()?),
        Values::Numbers(_) => {
            let numbers = some_numbers(values)?.into_iter();
            Values::Numbers(numbers.map(|it| it.unwrap_or(f64::NAN)).collect())
        }
        Values::SomeNumbers(_) => Values::SomeNumbers(some_numbers(values)?),
        Values::Integers(_) => Values::Integers(values.extract()?),
        Values::SomeIntegers(_) => Values::SomeIntegers(values.extract()?),
        Values::Flags(_) => Values::Flags(values.extract()?),
        Values::SomeInstants(_) => Values::SomeInstants(values.extract()?),
    })
}

/// Numbers, none for NaN.
///
/// # Errors
/// When they are something else.
pub fn some_numbers(values: &Bound<'_, PyAny>) -> PyResult<Vec<Option<f64>>> {
    if let Ok(array) = values.extract::<PyReadonlyArray1<'_, f64>>() {
        return Ok(array.as_array().iter().map(|it| Some(*it).filter(|it| !it.is_nan())).collect());
    }
    let numbers: Vec<Option<f64>> = values.extract()?;
    Ok(numbers.into_iter().map(|it| it.filter(|it| !it.is_nan())).collect())
}

/// The word for what a column holds.
pub fn kind_word(values: &Values) -> &'static str {
    match values {
        Values::Texts(_) | Values::SomeTexts(_) => "text",
        Values::Numbers(_) | Values::SomeNumbers(_) => "number",
        Values::Integers(_) | Values::SomeIntegers(_) => "integer",
        Values::Flags(_) => "flag",
        Values::SomeInstants(_) => "instant",
    }
}
