//! From physiological recordings to beat-wise and breath-wise figures, and from those to the
//! means of a stand's parts: the figures of the paper's Table I.
//!
//! ```text
//! ECG ─▶ ecg ─────────┬─▶ cycles ─▶ heart rate ──▶ cardiac_output ─┐
//! pressure, flow ─────┴───────────▶ pressure ──────────────────────┤
//! CO2 ────────────────────────────▶ respiration ───────────────────┼─▶ bins ─▶ means
//! oxygenation ─────────────────────────────────────────────────────┘
//! ```
//!
//! Every quantity over time is a [`signal::Signal`], sampled by a device or once in each beat or
//! breath; what is missing in it stays missing. A cycle's figures stand at its middle, where a
//! steadily changing quantity has its mean.

pub mod bins;
pub mod cardiac_output;
pub mod cycles;
mod detector;
pub mod ecg;
pub mod pressure;
pub mod respiration;
mod running;
pub mod signal;
