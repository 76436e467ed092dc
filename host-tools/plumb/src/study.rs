//! A study's figures, with a progress bar.

use std::path::Path;

use plumbline_cohort::studied;
use plumbline_files::BadInput;
use plumbline_study::figures::StudyFigures;
use plumbline_study::manifest::{self, Study};

use crate::ui::progress::Progress;

/// Reads a study; with a cohort, of its trials.
///
/// # Errors
/// When it is invalid.
pub fn read(path: &Path, cohort: Option<&Path>) -> Result<Study, BadInput> {
    match cohort {
        Some(cohort) => manifest::read_of_cohort(path, cohort),
        None => manifest::read(path),
    }
}

/// The figures of a study, whose trials are in folders or in a cohort.
///
/// # Errors
/// When a trial cannot be used, or data are missing.
pub fn analyze(study: &Study) -> Result<StudyFigures, BadInput> {
    studied::analyze(study, |trials| {
        let progress = Progress::of_trials("analysing", trials);
        move || {
            progress.advance();
            if progress.is_full() {
                progress.finish();
            }
        }
    })
}
