//! What cannot be used, as Python's exception.

use plumbline_files::BadInput as Fault;
use pyo3::PyErr;
use pyo3::PyResult;
use serde::de::DeserializeOwned;

pyo3::import_exception!(plumbline._errors, BadInput);

/// The exception with the place, the field, what was found and the remedy.
pub fn raised(Fault { place, field, found, remedy, .. }: Fault) -> PyErr {
    BadInput::new_err((place, field, found, remedy))
}

/// A result whose error Python raises.
pub trait Raise<T> {
    /// The same with the exception.
    fn raise(self) -> PyResult<T>;
}

impl<T> Raise<T> for Result<T, Fault> {
    fn raise(self) -> PyResult<T> {
        self.map_err(raised)
    }
}

/// An argument that cannot be used.
pub fn bad_argument(
    function: &str,
    name: &str,
    found: impl std::fmt::Display,
    remedy: &str,
) -> PyErr {
    raised(Fault::new(function, name, found, remedy))
}

/// An argument that is one of some words, as files have them.
pub fn word<T: DeserializeOwned>(
    function: &str,
    name: &str,
    text: &str,
    remedy: &str,
) -> PyResult<T> {
    serde_json::from_value(text.into())
        .map_err(|_| bad_argument(function, name, format!("{text:?}"), remedy))
}
