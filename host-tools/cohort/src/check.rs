//! Whether a cohort is whole: its three tables agree.

use std::collections::{HashMap, HashSet};

use plumbline_files::BadInput;
use plumbline_study::method::Choice;
use plumbline_trial::frame::Trunk;
use plumbline_trial::parquet::Reader;
use rayon::prelude::*;

use crate::folder::{Cohort, files};
use crate::row::Row;
use crate::{figures, names};

/// What the table of figures has of a trial.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Summary {
    rows: u64,
    /// The sum of the bits of all values, wrapped around, each with its place.
    bits: u64,
}

impl Summary {
    fn add(&mut self, value: Option<f64>) {
        self.rows += 1;
        let bits = value.map_or(u64::MAX, f64::to_bits);
        self.bits = self.bits.rotate_left(5).wrapping_add(bits);
    }
}

/// What is amiss, one line for each; `advance` is called after each trial.
///
/// # Errors
/// When a table cannot be read.
pub fn check(
    cohort: &Cohort,
    rows: &[Row],
    advance: &(dyn Fn() + Sync),
) -> Result<Vec<String>, BadInput> {
    let kept = kept(cohort)?;
    let faults: Vec<Option<String>> = rows
        .par_iter()
        .map(|row| {
            let found = of_trial(cohort, row, kept.get(&row.trial));
            advance();
            found.err()
        })
        .collect();
    let mut faults: Vec<String> = faults.into_iter().flatten().collect();
    let known: HashSet<&str> = rows.iter().map(|it| &*it.trial).collect();
    let unknown = kept.keys().filter(|it| !known.contains(it.as_str())).count();
    if unknown > 0 {
        let place = cohort.path().join(names::FIGURES);
        faults.push(format!(
            "{}: figures of {unknown} trials that the table of trials lacks",
            place.display()
        ));
    }
    let expected: HashSet<_> = rows.iter().map(|it| cohort.points_file(it)).collect();
    for file in files(&cohort.path().join(names::POINTS))? {
        if !expected.contains(&file) {
            faults.push(format!("{}: it belongs to no trial of the table", file.display()));
        }
    }
    Ok(faults)
}

/// What the table of figures has, by trial.
fn kept(cohort: &Cohort) -> Result<HashMap<String, Summary>, BadInput> {
    let mut found: HashMap<String, Summary> = HashMap::new();
    for path in cohort.tables(names::FIGURES)? {
        let reader = Reader::open(&path, figures::ROWS_MAX)?;
        for group in 0..reader.groups() {
            let table = reader.group(group, &["trial", "value"])?;
            for (trial, value) in table.texts("trial")?.iter().zip(table.some_numbers("value")?) {
                match found.get_mut(trial) {
                    Some(summary) => summary.add(*value),
                    None => {
                        let mut summary = Summary::default();
                        summary.add(*value);
                        found.insert(trial.clone(), summary);
                    }
                }
            }
        }
    }
    Ok(found)
}

/// What is amiss of one trial.
fn of_trial(cohort: &Cohort, row: &Row, kept: Option<&Summary>) -> Result<(), String> {
    let points = cohort.points(row).map_err(|error| error.to_string())?;
    for (trunk, seen) in Trunk::ALL.into_iter().zip(&row.seen) {
        let point = points.points.iter().find(|it| it.name == trunk.word());
        let samples = point.map_or(0, |it| it.series.samples() as i64);
        if samples != seen.samples {
            return Err(format!(
                "{}: {} trunk: {samples} positions, and the table of trials says {}",
                row.key,
                trunk.word(),
                seen.samples
            ));
        }
    }
    let mut computed = Summary::default();
    let rows = figures::of(row, &points, &Choice::default());
    rows.iter().for_each(|it| computed.add(it.value));
    match kept {
        None => Err(format!("{}: the table of figures lacks it", row.key)),
        Some(kept) if *kept != computed => Err(format!(
            "{}: its figures are not those of its points; they were computed by {}",
            row.key, row.program
        )),
        Some(_) => Ok(()),
    }
}
