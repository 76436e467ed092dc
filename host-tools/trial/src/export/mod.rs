//! Writes a trial for other programs: the trunk points over time.

use std::path::Path;

use plumbline_files::{BadInput, write_all};

use crate::Trial;
use crate::manifest::Zero;
use crate::points::Points;
use crate::verdict::Grade;

mod bids;
mod c3d;
mod csv;
mod events;
mod orientation;
mod parquet;
mod rows;
mod trc;

pub use bids::{MISSING, Table};
use rows::Rows;

/// A format that other programs read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// A table, for every program.
    Csv,
    /// A table, for data analysis.
    Parquet,
    /// Track row column, of OpenSim and motion capture.
    Trc,
    /// The Coordinate 3D file of motion capture.
    C3d,
    /// A folder that follows the Brain Imaging Data Structure for motion.
    Bids,
}

/// What has been written.
#[derive(Debug, Clone)]
pub struct Exported {
    /// The number of rows, one for each frame.
    pub rows: usize,
    /// Rows per second.
    pub rate_hz: f64,
    /// What t = 0 is, in words.
    pub zero: String,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// Where an export goes.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// The session in a data set.
    pub session: Option<&'a str>,
    /// The number of the run in a data set; without it the next one.
    pub run: Option<u32>,
    /// Replaces what is there: the file or, in a data set, the run.
    pub force: bool,
}

impl Recording<'_> {
    /// Refuses what only a data set has, where a file is made.
    fn check(&self, format: Format) -> Result<(), BadInput> {
        let given = [("--session", self.session.is_some()), ("--run", self.run.is_some())];
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) if format != Format::Bids => Err(BadInput::whole(
                option,
                "only a data set has sessions and runs",
                "leave it out, or give --format bids",
            )),
            _ => Ok(()),
        }
    }
}

/// Writes a trial in this format: a file or, for BIDS, a recording in the data set of a folder. The
/// verdict on the trial goes with it where the format has room: in Parquet's metadata, a parameter of
/// C3D, the JSON of BIDS; a CSV or a TRC has none.
///
/// # Errors
/// When the trial has nothing to write, the output is there and may not be replaced, or cannot be
/// written.
pub fn export(
    trial: &Trial,
    zero: Zero,
    format: Format,
    out: &Path,
    recording: &Recording<'_>,
) -> Result<Exported, BadInput> {
    recording.check(format)?;
    let points = Points::of(trial, zero)?;
    let turned = orientation::of(trial, &points);
    let rows = Rows::of(&points, &turned)?;
    let events = events::of(&points, &rows);
    let mut warnings = points.warnings.clone();
    warnings.extend(rows.moved());
    let has_orientations = matches!(format, Format::Csv | Format::Parquet | Format::Bids);
    if has_orientations && turned.iter().flatten().flatten().next().is_none() {
        warnings.push(
            "the orientations are missing: the trial does not tell the pose of the scene's board"
                .to_owned(),
        );
    }
    let verdict = trial.manifest.verdict();
    let bytes = match format {
        Format::Csv => Some(csv::bytes(&rows)),
        Format::Parquet => Some(parquet::bytes(&rows, &verdict, out)?),
        Format::Trc => Some(trc::bytes(&rows, out)),
        Format::C3d => {
            warnings.extend(rows.unevenness());
            let (bytes, left_out) = c3d::bytes(&rows, &events, &verdict);
            warnings.extend(left_out);
            Some(bytes)
        }
        Format::Bids => {
            warnings.extend(bids::write(&rows, &events, trial, &points.zero, out, recording)?);
            None
        }
    };
    if let Some(bytes) = bytes {
        write_all(&[(out.to_owned(), bytes)], recording.force)?;
    }
    if verdict.grade() != Grade::Good {
        warnings.push(format!("the verdict on this trial is {}", verdict.line()));
    }
    Ok(Exported { rows: rows.time_s.len(), rate_hz: rows.rate_hz, zero: points.zero, warnings })
}

/// AP, ML and SI in the right-handed frame of other programs: X forward, Y to the left, Z up.
fn right_handed([ap, ml, si]: [f64; 3]) -> [f64; 3] {
    [ap, -ml, si]
}

/// That frame in words, for files that have room for them.
const RIGHT_HANDED: &str = "X forward (AP), Y to the left (-ML), Z up (SI)";

/// What the axes of the body are, for files that keep them.
const BODY_AXES: &str = "ap: forward; ml: to the person's right; si: up; millimetres";
