//! The pages and pictures of what was measured.
//!
//! ```text
//!  trial, table ─▶ trial::report ◀─ budget, agreement, reference
//!  study ────────▶ study::report
//!  calibration ──▶ calibration::svg
//! ```
//!
//! In: what [`plumbline_trial`], [`plumbline_study`], [`plumbline_uncertainty`] and
//! [`plumbline_calibration`] give. Out: HTML and SVG as strings, each whole by itself: a page needs no
//! other file and no network. [`page`], [`drawing`] and [`palette`] are what every page is made of.
//!
//! Nothing here prints, reads a command line or writes a file.

pub mod agreement;
pub mod budget;
pub mod calibration;
pub mod drawing;
mod labels;
pub mod page;
pub mod palette;
mod plots;
mod reference;
pub mod study;
pub mod trial;
mod verdict;
