//! One trial: a folder with everything that is known about it.
//!
//! | file | content |
//! |---|---|
//! | `packets.bin` | every packet as it came, with its time; the marks; who was measured: see [`journal`] |
//! | `trial.toml` | participant, condition, box, clocks, events: see [`manifest`] |
//! | `config.plb` | the box's configuration: its lens, its targets, which way is forward |
//! | `corrected.plb` | the configuration that should have been: see [`correction`] |
//! | `samples.csv` | the poses as a table, as they come: see [`plumbline_stream::recorder`] |
//! | `samples.parquet` | the same table, once the trial is over |
//!
//! `trial.toml` ends with a [`verdict`] on the trial.
//!
//! The packets are the only source. Everything else can be made from them again (`plumb replay
//! --tables`), and every analysis reads only them: a recording that was cut off is as good as any
//! other, as far as it goes.

pub mod body;
mod c3d;
pub mod correction;
pub mod derived;
pub mod export;
pub mod frame;
pub mod journal;
pub mod manifest;
pub mod mark;
pub mod markers;
pub mod parquet;
pub mod points;
pub mod poses;
pub mod positions;
mod reading;
pub mod recording;
mod run;
pub mod tables;
#[cfg(any(test, feature = "fixture"))]
pub mod test_trial;
mod trial;
mod triggers;
pub mod verdict;

pub use manifest::Manifest;
pub use recording::Recording;
pub use trial::{Observed, Trial};
pub use verdict::Verdict;

/// The names of the files in a trial's folder.
pub mod names {
    /// The packets, the marks, and what was said of the trial.
    pub const JOURNAL: &str = "packets.bin";
    /// What is known about the trial as a whole.
    pub const MANIFEST: &str = "trial.toml";
    /// The box's configuration.
    pub const CONFIG: &str = "config.plb";
    /// The configuration that takes its place, once something in it was found to be wrong.
    pub const CORRECTED: &str = "corrected.plb";
    /// The poses, for every program that reads tables.
    pub const CSV: &str = "samples.csv";
    /// The poses, for large analyses.
    pub const PARQUET: &str = "samples.parquet";
}
