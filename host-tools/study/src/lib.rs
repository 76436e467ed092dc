//! From trials to figures, and from many trials to statistics.
//!
//! ```text
//! a trial's points ─▶ analysis: the sway figures of one trial
//!
//! study.toml ─▶ manifest, protocol ─▶ verdict: which trials take part ─▶ sway, physiology: each trial's values ─▶ values: averaged
//!            by participant, condition and time, and compared ─▶ figures ─▶ tables, inference
//!
//! any long table ─▶ long ─▶ the same comparisons
//! ```
//!
//! Results are plain values that can be serialised; [`grid`] is the form in which they are shown.

pub mod analysis;
pub mod figures;
pub mod grid;
pub mod inference;
pub mod long;
pub mod manifest;
pub mod physiology;
pub mod protocol;
mod signals;
pub mod sway;
pub mod tables;
mod time;
pub mod values;
pub mod verdict;
