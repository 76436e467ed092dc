//! One trial: a folder with everything that is known of it.
//!
//! | file | what |
//! |---|---|
//! | `packets.bin` | every packet as it came, and when; the marks: see [`journal`] |
//! | `trial.toml` | who, what, which box, how its clock stands, what happened: see [`manifest`] |
//! | `config.plb` | the box's configuration: its lens, its targets, which way is forward |
//! | `samples.csv` | the poses as a table, as they come: see [`plumbline_stream::recorder`] |
//! | `samples.parquet` | the same table, once the trial is over |
//!
//! The packets are the one truth. All else can be made of them again (`plumb replay --tables`), and
//! every analysis reads them alone, so that a recording that was cut off is as good as another
//! up to its end.

mod c3d;
pub mod export;
pub mod journal;
pub mod manifest;
pub mod mark;
pub mod markers;
pub mod points;
pub mod positions;
pub mod reading;
pub mod recording;
mod run;
pub mod tables;

pub use manifest::Manifest;
pub use reading::Trial;
pub use recording::Recording;

/// The names of the files in a trial's folder.
pub mod names {
    /// Everything that came.
    pub const JOURNAL: &str = "packets.bin";
    /// What is known of the trial as a whole.
    pub const MANIFEST: &str = "trial.toml";
    /// The box's configuration.
    pub const CONFIG: &str = "config.plb";
    /// The poses, for every program that reads tables.
    pub const CSV: &str = "samples.csv";
    /// The poses, for large analyses.
    pub const PARQUET: &str = "samples.parquet";
}
