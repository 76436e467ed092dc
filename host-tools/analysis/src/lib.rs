//! Computes from positions over time the figures that posturography reports, and from the figures
//! of many trials the statistics.
//!
//! ```text
//! recording ─▶ series ─▶ filter ─▶ sway ────────┐
//! reference ─▶ series ─────────▶ agreement      ├─▶ statistics
//! ECG, pressure ... ──────────▶ physiology ─────┘
//! ```
//!
//! Nothing here reads a file, prints or draws. Lengths are millimetres, times seconds,
//! frequencies hertz; positions are along the body's axes: AP (anterior-posterior, forward), ML
//! (medial-lateral, to the person's right), SI (superior-inferior, up).
//!
//! What cannot be computed is absent (`None`, or an error that says why), never a made-up number.

pub mod agreement;
pub mod filter;
pub mod onset;
pub mod physiology;
pub mod series;
pub mod standard;
pub mod statistics;
pub mod sway;
