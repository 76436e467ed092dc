//! The sway figures of a cohort's trials, as its table of figures has them.

use plumbline_study::method::Choice;
use plumbline_study::tidy::{self, About};
use plumbline_trial::parquet::Values;
use plumbline_trial::points::Points;

use crate::key::Key;
use crate::row::Row;

/// Far more rows than trials have figures.
pub(crate) const ROWS_MAX: u64 = 10_000_000_000;

/// The figures of a trial, whose points these are.
#[must_use]
pub fn of(row: &Row, points: &Points, choice: &Choice) -> Vec<tidy::Row> {
    let about = About {
        participant: row.key.participant.clone(),
        condition: row.key.condition.clone(),
        trial: row.trial.clone(),
        verdict: row.verdict.grade(),
    };
    tidy::rows(about, points, &choice.settings(points))
}

/// The columns of `plumb figures`, with the key's other parts: `keys` has that of each row.
#[must_use]
pub fn columns(keys: &[Key], rows: &[tidy::Row]) -> Vec<(String, Values)> {
    let sessions = Values::Texts(keys.iter().map(|it| it.session.clone()).collect());
    let runs = Values::Integers(keys.iter().map(|it| i64::from(it.run)).collect());
    let mut columns = tidy::columns(rows);
    columns.insert(1, ("session".to_owned(), sessions));
    columns.insert(3, ("run".to_owned(), runs));
    columns
}
