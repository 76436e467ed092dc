//! Is everything as it should be with a box, and if not, what is to be done?
//!
//! ```text
//!  link ─▶ watch ─▶ findings: figures ─▶ judge ─▶ checks: verdict, what was seen, what to do
//! ```

mod beside;
mod check;
mod findings;
#[cfg(test)]
mod fixture;
mod judge;
mod watch;

use std::path::PathBuf;
use std::time::Duration;

use jiff::civil::Date;
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;

pub(crate) use beside::Beside;
pub use beside::Examining;
pub use check::{Check, Verdict};
pub use findings::{Background, Expected, Findings, FrameSeen, TargetSeen};
pub use judge::{SCALE, TAPE_MM_MAX, TAPE_MM_MIN, Tape, all as judged};
pub use watch::watch;
pub(crate) use watch::{LAST_ANSWERS, VIEW_EVERY};

use crate::scale;
pub use crate::scale::Compared;
use crate::told::Tell;

/// Watches a box for this time, and judges what was seen.
///
/// # Errors
/// When the link cannot be used any more.
pub fn examine(
    link: &mut BoxLink,
    duration: Duration,
    tell: &mut Tell<'_>,
) -> Result<Vec<Check>, BadInput> {
    Ok(judged(&watch(link, duration, None, tell)?))
}

/// Keeps a comparison with a tape on this computer if both agreed, and returns its file; forgets
/// those of its sheet if not.
///
/// # Errors
/// When a file cannot be written or removed.
pub fn remember(findings: &Findings, today: Date) -> Result<Option<PathBuf>, BadInput> {
    let Some((config, comparison)) = findings.config().zip(judge::comparison(findings)) else {
        return Ok(None);
    };
    let (lens, target) = (&config.lens, &comparison.target.geometry);
    if !comparison.agrees() {
        let mut sheet = comparison.sheet(config);
        sheet.try_for_each(|target| scale::forget(lens, &target.geometry))?;
        return Ok(None);
    }
    let compared = Compared {
        date: today.to_string(),
        tape_mm: comparison.tape_mm,
        measured_mm: comparison.measured_mm,
    };
    scale::keep(lens, target, &compared).map(Some)
}
