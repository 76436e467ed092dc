//! The times of a protocol, and their names.

use std::ops::Range;

/// One day: the greatest distance from a trial's t = 0.
pub const SECONDS_MAX: f64 = 86_400.0;

/// The name of a time, as in the paper's Table II: the first is T1.
#[must_use]
pub fn time_name(at: usize) -> String {
    format!("T{}", at + 1)
}

/// From the beginning of the first of these times to the end of the last.
#[must_use]
pub fn whole(bins_s: &[Range<f64>]) -> Option<Range<f64>> {
    bins_s.iter().cloned().reduce(|all, it| all.start.min(it.start)..all.end.max(it.end))
}
