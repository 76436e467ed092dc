//! Tables made by a formula, for the tests.

use super::within::{Observation, WithinDesign};

/// Factors, each with its levels.
pub(super) const LEVELS: [(&str, [&str; 5]); 2] =
    [("condition", ["a", "b", "c", "d", "e"]), ("time", ["1", "2", "3", "4", "5"])];

/// A table with these numbers of levels of each factor and of subjects.
pub(super) fn table(
    levels: &[usize],
    subjects: usize,
    value: impl Fn(usize, usize) -> f64,
) -> WithinDesign {
    let names: Vec<&str> = LEVELS[..levels.len()].iter().map(|(name, _)| *name).collect();
    let people: Vec<String> = (0..subjects).map(|it| format!("P{it}")).collect();
    let cells = levels.iter().zip(LEVELS).fold(vec![Vec::new()], |cells, (&count, (_, levels))| {
        let longer = |cell: &Vec<_>| {
            levels[..count].iter().map(|it| [&cell[..], &[*it]].concat()).collect::<Vec<_>>()
        };
        cells.iter().flat_map(longer).collect()
    });
    let mut rows = Vec::new();
    for (person, subject) in people.iter().enumerate() {
        for (cell, levels) in cells.iter().enumerate() {
            rows.push(Observation { subject, levels: levels.clone(), value: value(person, cell) });
        }
    }
    WithinDesign::new(&names, &rows).unwrap()
}
