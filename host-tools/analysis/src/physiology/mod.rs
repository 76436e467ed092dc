//! Computes beat-wise and breath-wise figures from physiological recordings, and from those the
//! means over the parts of a stand trial: the figures of the paper's Table I.
//!
//! ```text
//! ECG ─▶ ecg ─────────┬─▶ cycles ─▶ heart rate ──▶ cardiac_output ─┐
//! pressure, flow ─────┴───────────▶ pressure ──────────────────────┤
//! CO2 ────────────────────────────▶ respiration ───────────────────┼─▶ bins ─▶ means
//! oxygenation ─────────────────────────────────────────────────────┘
//! ```
//!
//! Every quantity over time is a [`signal::Signal`], sampled by a device or once per beat or
//! breath; what is missing stays missing. The figures of a cycle are given at its middle, where a
//! steadily changing quantity takes its mean value.

pub mod bins;
pub mod cardiac_output;
pub mod cycles;
mod detector;
pub mod ecg;
pub mod pressure;
pub mod respiration;
mod running;
pub mod signal;
