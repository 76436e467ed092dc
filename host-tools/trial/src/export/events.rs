//! What happened in a trial, on the clock of its rows.

use super::rows::Rows;
use crate::points::Points;

/// The label of the trial's t = 0.
pub const ZERO: &str = "t_zero";

/// An event of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Seconds from the first row.
    pub time_s: f64,
    /// [`ZERO`], or the label of a mark.
    pub label: String,
}

/// t = 0 and the marks, in the order of their times.
pub fn of(points: &Points, rows: &Rows) -> Vec<Event> {
    let zero = std::iter::once((0.0, ZERO.to_owned()));
    let marks = points.events.iter().map(|event| (event.time_s, event.label.clone()));
    let since_first = |(time_s, label)| Event { time_s: time_s - rows.first_s(), label };
    let mut events: Vec<Event> = zero.chain(marks).map(since_first).collect();
    events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    events
}
