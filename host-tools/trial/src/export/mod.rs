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
mod parquet;
mod rows;
mod trc;

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

/// Writes a trial in this format: a file or, for BIDS, the folder of a new data set. A file that
/// exists is replaced only with `force`, a folder never. The verdict on the trial goes with it where
/// the format has room: in Parquet's metadata, a parameter of C3D, the JSON of BIDS; a CSV or a TRC
/// has none.
///
/// # Errors
/// When the trial has nothing to write, or the output cannot be written.
pub fn export(
    trial: &Trial,
    zero: Zero,
    format: Format,
    out: &Path,
    force: bool,
) -> Result<Exported, BadInput> {
    let points = Points::of(trial, zero)?;
    let rows = Rows::of(&points)?;
    let mut warnings = points.warnings.clone();
    warnings.extend(rows.moved());
    let verdict = trial.manifest.verdict();
    let bytes = match format {
        Format::Csv => Some(csv::bytes(&rows)),
        Format::Parquet => Some(parquet::bytes(&rows, &verdict, out)?),
        Format::Trc => Some(trc::bytes(&rows, out)),
        Format::C3d => {
            warnings.extend(rows.unevenness());
            Some(c3d::bytes(&rows, &verdict))
        }
        Format::Bids => {
            warnings.extend(bids::write(&rows, trial, &points, out)?);
            None
        }
    };
    if let Some(bytes) = bytes {
        write_all(&[(out.to_owned(), bytes)], force)?;
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
