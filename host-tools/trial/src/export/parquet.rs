//! The table of [`csv`](super::csv) as Parquet: null where there is no value.

use std::path::Path;

use plumbline_files::BadInput;

use super::orientation::{QUATERNION, components};
use super::rows::Rows;
use super::{BODY_AXES, csv};
use crate::Verdict;
use crate::parquet::{self, Values};

/// The file.
///
/// # Errors
/// When the writer fails.
pub fn bytes(rows: &Rows, verdict: &Verdict, place: &Path) -> Result<Vec<u8>, BadInput> {
    let values = rows.points.iter().flat_map(|point| {
        let turned: Vec<Option<[f64; 4]>> =
            point.orientation.iter().map(|it| it.as_ref().map(components)).collect();
        columns(&point.position_mm).into_iter().chain(columns(&turned))
    });
    let time_s = ("time_s".to_owned(), Values::Numbers(rows.time_s.clone()));
    let columns: Vec<(String, Values)> =
        [time_s].into_iter().chain(csv::columns(rows).into_iter().zip(values)).collect();
    let mut about = vec![
        ("axes", BODY_AXES.to_owned()),
        ("orientations", QUATERNION.to_owned()),
        ("verdict", verdict.line()),
    ];
    about.extend(rows.moved().map(|moved| ("times", moved)));
    parquet::bytes("positions", &columns, about)
        .map_err(|error| BadInput::whole(place.display(), error, "report it: rows can be written"))
}

/// A column for each of the numbers; null where a row has none.
fn columns<const N: usize>(rows: &[Option<[f64; N]>]) -> [Values; N] {
    std::array::from_fn(|at| Values::SomeNumbers(rows.iter().map(|it| Some((*it)?[at])).collect()))
}
