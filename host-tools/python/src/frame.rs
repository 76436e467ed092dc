//! Frames in NumPy's arrays.

use numpy::{Element, PyArray2, PyArrayMethods as _, PyUntypedArray};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// A frame: a two-dimensional array, rows first, of one of the two types.
pub enum Samples<'py> {
    /// Of uint8.
    Grey8(Bound<'py, PyArray2<u8>>),
    /// Of uint16.
    Grey16(Bound<'py, PyArray2<u16>>),
}

impl<'py> Samples<'py> {
    /// Those of an argument, which `place` names.
    ///
    /// # Errors
    /// `TypeError`, when it is no such array.
    pub fn of(place: &str, frame: &Bound<'py, PyAny>) -> PyResult<Self> {
        // Samples that do not begin where a processor expects it, as in a file behind an odd header.
        let is_aligned = match frame.cast::<PyUntypedArray>() {
            Ok(_) => frame.getattr("flags")?.getattr("aligned")?.extract()?,
            Err(_) => true,
        };
        let frame = if is_aligned { frame } else { &frame.call_method0("copy")? };
        if let Ok(frame) = frame.cast::<PyArray2<u8>>() {
            return Ok(Self::Grey8(frame.clone()));
        }
        if let Ok(frame) = frame.cast::<PyArray2<u16>>() {
            return Ok(Self::Grey16(frame.clone()));
        }
        let about = |name: &str| frame.getattr(name).map_or("none".to_owned(), |it| it.to_string());
        let found = match frame.hasattr("dtype")? {
            true => format!("an array of {} and the shape {}", about("dtype"), about("shape")),
            false => frame.get_type().name()?.to_string(),
        };
        Err(PyTypeError::new_err(format!(
            "{place}: {found}; give a two-dimensional numpy array of uint8 or uint16"
        )))
    }
}

/// Copies a frame's samples row by row, since another thread may write into the array meanwhile; its
/// columns and rows. `check` looks at these first.
///
/// # Errors
/// When the check fails, or something else is writing into the array now.
pub fn copy<P: Element + Copy>(
    frame: &Bound<'_, PyArray2<P>>,
    into: &mut Vec<P>,
    check: impl FnOnce(usize, usize) -> PyResult<()>,
) -> PyResult<[usize; 2]> {
    let frame = frame.try_readonly()?;
    let frame = frame.as_array();
    let (height, width) = frame.dim();
    check(width, height)?;
    into.clear();
    match frame.as_slice() {
        Some(samples) => into.extend_from_slice(samples),
        // A part or a turned view of another array.
        None => into.extend(frame.iter()),
    }
    Ok([width, height])
}
