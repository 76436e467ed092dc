//! Shared by the tests that compare with published results.

pub mod table_2;

use std::path::Path;

use plumbline_analysis::statistics::within::{Observation, WithinDesign};

/// The columns of a CSV file with these headers, as text, by row.
pub fn columns(path: &Path, headers: &[&str]) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let found = reader.headers().unwrap().clone();
    let places: Vec<usize> =
        headers.iter().map(|header| found.iter().position(|it| it == *header).unwrap()).collect();
    let rows = reader.records().map(Result::unwrap);
    rows.map(|row| places.iter().map(|&place| row[place].trim().to_owned()).collect()).collect()
}

/// The within-subject table of a long CSV file.
pub fn design(path: &Path, subject: &str, factors: &[&str], value: &str) -> WithinDesign {
    let headers: Vec<&str> = [subject, value].iter().chain(factors).copied().collect();
    design_of(factors, &columns(path, &headers))
}

/// The within-subject table of rows with subject, value and the factors' levels.
pub fn design_of(factors: &[&str], rows: &[Vec<String>]) -> WithinDesign {
    let observations: Vec<Observation<'_>> = rows
        .iter()
        .map(|row| Observation {
            subject: &row[0],
            levels: row[2..].iter().map(String::as_str).collect(),
            value: row[1].parse().unwrap(),
        })
        .collect();
    WithinDesign::new(factors, &observations).unwrap()
}

/// Asserts that two numbers differ by no more than this fraction of the second.
#[track_caller]
pub fn assert_close(found: f64, expected: f64, relative: f64, what: &str) {
    let error = (found - expected).abs();
    assert!(
        error <= relative * expected.abs(),
        "{what}: {found} instead of {expected}, relative error {:e}",
        error / expected.abs()
    );
}
