//! From trials to figures, and from many trials to statistics.
//!
//! ```text
//! a trial's points ─▶ method: how its figures are made ─▶ analysis: the sway figures of one trial
//!
//! study.toml ─▶ manifest, patterns, measures, protocol ─▶ candidate: its trials ─▶ verdict: which
//!            take part ─▶ sway, physiology: each trial's values ─▶ complete: who has which trials ─▶
//!            values: averaged by participant, condition and time, and compared ─▶ figures ─▶
//!            tables, inference
//!
//! many trials ─▶ tidy: a table of all their figures ─▶ reference: percentiles of them, and where a
//!                trial lies among them
//!
//! any long table ─▶ long ─▶ the same comparisons
//! ```
//!
//! Results are plain values that can be serialised; [`grid`] is the form in which they are shown.

pub mod analysis;
pub mod candidate;
pub mod choose;
pub mod complete;
pub mod figures;
#[cfg(any(test, feature = "fixture"))]
pub mod fixture;
pub mod grid;
pub mod inference;
pub mod long;
pub mod manifest;
pub mod measures;
pub mod method;
mod patterns;
pub mod physiology;
pub mod protocol;
pub mod reference;
mod signals;
pub mod sway;
pub mod tables;
pub mod tidy;
mod time;
pub mod values;
pub mod verdict;
