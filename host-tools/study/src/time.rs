//! The times of a protocol: their names, and the longest time allowed.

/// One day: the greatest distance from a trial's t = 0.
pub const SECONDS_MAX: f64 = 86_400.0;

/// The name of a time, as in the paper's Table II: the first is T1.
#[must_use]
pub fn time_name(at: usize) -> String {
    format!("T{}", at + 1)
}
