//! The part of the Python package `plumbline` that is written in Rust: `plumbline._plumbline`.
//!
//! ```text
//! trial ─▶ rows, columns: arrays, a row for each frame, gaps as NaN
//!      └─▶ figures: sway figures and statistics       frame ─▶ camera, tracker: calibration, poses
//! cohort ─▶ the same figures of many trials, here or of columns on other computers (given);
//!        └─▶ study: the statistics in steps for a cluster
//! live: a box's poses while they come
//! ```
//!
//! Nothing is computed here: every number comes from the library from which `plumb` has it, so that
//! both are equal to the last bit. What takes long releases Python's lock. What is not good enough is
//! the exception `BadInput` of `plumbline/_errors.py`; types and units are in `plumbline/*.pyi`.

use pyo3::prelude::*;

mod arrays;
mod camera;
mod cohort;
mod columns;
mod error;
mod figures;
mod frame;
mod given;
mod live;
mod method;
mod rows;
mod study;
mod tracker;
mod trial;

/// The functions and classes that `plumbline` offers.
#[pymodule]
mod _plumbline {
    #[pymodule_export]
    use crate::camera::{Camera, calibrate};
    #[pymodule_export]
    use crate::cohort::{Cohort, cohort_columns, figures_of_points, open_cohort};
    #[pymodule_export]
    use crate::figures::{figures, study, study_of_table};
    #[pymodule_export]
    use crate::live::{Reception, receive};
    #[pymodule_export]
    use crate::study::{CohortStudy, adjusted};
    #[pymodule_export]
    use crate::tracker::{TargetPose, Tracked, Tracker};
    #[pymodule_export]
    use crate::trial::{Exported, Trial, Trunk, open_trial};

    /// The version of the package.
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
