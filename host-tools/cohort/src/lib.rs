//! A data set of many trials, as Parquet files that every data program reads.
//!
//! ```text
//! trial folders ─▶ given: key and participant ─▶ add: row, samples, figures ─┐
//!                  keys and participants ─▶ remove: the tables without them ─┴▶ change: staged, then
//!                                                                               made as a whole
//! folder ─▶ studied: the statistics of a study
//!        ─▶ check: whether everything is there
//!        ─▶ reference: percentiles by age and condition
//! ```
//!
//! The layout and the columns are written down in this crate's `README.md`.

pub mod add;
pub mod change;
pub mod check;
mod content;
pub mod figures;
pub mod folder;
pub mod given;
pub mod key;
pub mod reference;
pub mod remove;
pub mod row;
pub mod samples;
pub mod studied;

/// The names of files and folders in a cohort. Names that begin with a dot are hidden from every
/// program that reads the data set.
pub mod names {
    /// What the folder is.
    pub const ABOUT: &str = "cohort.toml";
    /// The table of trials.
    pub const TRIALS: &str = "trials";
    /// The table of figures.
    pub const FIGURES: &str = "figures";
    /// The trials' points.
    pub const POINTS: &str = "points";
    /// The points of a trial, in its own folder.
    pub const POINTS_FILE: &str = "points.parquet";
    /// Whoever changes the cohort holds a lock on it.
    pub const LOCK: &str = ".lock";
    /// An addition that is being written.
    pub const ADDING: &str = ".adding";
    /// An addition whose files move to their places.
    pub const ADDED: &str = ".added";
    /// A removal that is being written.
    pub const REMOVING: &str = ".removing";
    /// A removal whose files replace those in their places, or delete them.
    pub const REMOVED: &str = ".removed";
}
