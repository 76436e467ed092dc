//! Numbers and texts as Python's arrays and objects.

use numpy::ndarray::IntoDimension;
use numpy::{Element, PyArray1, PyArrayMethods as _};
use plumbline_trial::parquet::Values;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;

/// An array of one dimension.
pub fn vector<'py, T: Element>(py: Python<'py>, values: Vec<T>) -> Bound<'py, PyAny> {
    PyArray1::from_vec(py, values).into_any()
}

/// An array of these dimensions, whose last index runs fastest.
///
/// # Errors
/// When there are more or fewer values than places.
pub fn shaped<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    shape: impl IntoDimension,
) -> PyResult<Bound<'py, PyAny>> {
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}

/// What a file of JSON would hold, as Python's own objects: numbers with all their digits.
///
/// # Errors
/// When it cannot be written as JSON.
pub fn object<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value)
        .map_err(|error| pyo3::exceptions::PyValueError::new_err(error.to_string()))?;
    from_json(py, &text)
}

/// A text of JSON as Python's own objects.
///
/// # Errors
/// When it is none.
pub fn from_json<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}

/// Columns by their names: arrays of numbers, NaN where there is none, of whole numbers and of flags;
/// lists of texts, and of whole numbers that may be absent, None where there is none.
///
/// # Errors
/// When Python has no memory for them.
pub fn table<'py>(py: Python<'py>, columns: Vec<(String, Values)>) -> PyResult<Bound<'py, PyDict>> {
    let table = PyDict::new(py);
    for (name, values) in columns {
        match values {
            Values::Texts(texts) => table.set_item(name, texts)?,
            Values::SomeTexts(texts) => table.set_item(name, texts)?,
            Values::Integers(numbers) => table.set_item(name, vector(py, numbers))?,
            Values::SomeIntegers(numbers) | Values::SomeInstants(numbers) => {
                table.set_item(name, numbers)?;
            }
            Values::Flags(flags) => table.set_item(name, vector(py, flags))?,
            Values::Numbers(numbers) => table.set_item(name, vector(py, numbers))?,
            Values::SomeNumbers(numbers) => {
                let numbers = numbers.into_iter().map(|it| it.unwrap_or(f64::NAN)).collect();
                table.set_item(name, vector(py, numbers))?;
            }
        }
    }
    Ok(table)
}
