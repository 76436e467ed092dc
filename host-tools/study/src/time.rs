//! The times of a protocol: their names, and how long one may be.

/// One day: the longest time from a trial's t = 0.
pub const SECONDS_MAX: f64 = 86_400.0;

/// A time's name, as in the paper's Table II: T1 is the first.
#[must_use]
pub fn time_name(at: usize) -> String {
    format!("T{}", at + 1)
}
