//! Studies of a cohort's trials.

use std::path::Path;

use plumbline_files::BadInput;
use plumbline_study::candidate::{Candidate, Measured};
use plumbline_study::figures::{self, StudyFigures};
use plumbline_study::manifest::{Recordings, Study};
use plumbline_study::verdict;
use plumbline_trial::Verdict;

use crate::folder::Cohort;
use crate::row::Row;

/// A trial of a cohort.
struct Kept<'a> {
    cohort: &'a Cohort,
    row: &'a Row,
}

impl Candidate for Kept<'_> {
    fn verdict(&self) -> Result<Option<(String, Verdict)>, BadInput> {
        Ok(Some((self.row.key.to_string(), self.row.verdict.clone())))
    }

    fn read(&self) -> Result<Measured, BadInput> {
        Ok(Measured {
            points: self.cohort.points(self.row)?,
            participant: Some(self.row.key.participant.clone()),
            condition: Some(self.row.key.condition.clone()),
        })
    }

    fn recordings(&self) -> Option<&Recordings> {
        None
    }
}

/// The figures of a study, whether its trials are in a cohort or in folders. `begin` is told the
/// number of trials, and gives what is called after each.
///
/// # Errors
/// As [`figures::analyze`]; when the cohort cannot be read, or none of its trials is chosen.
pub fn analyze<A: Fn() + Sync>(
    study: &Study,
    begin: impl FnOnce(usize) -> A,
) -> Result<StudyFigures, BadInput> {
    let Some(path) = &study.cohort else {
        return figures::analyze_trials(study, &study.trials, &begin(study.trials.len()));
    };
    let cohort = Cohort::open(path)?;
    let rows = cohort.rows()?;
    let chosen = chosen(study, &rows)?;
    let trials: Vec<Kept<'_>> =
        chosen.into_iter().map(|row| Kept { cohort: &cohort, row }).collect();
    figures::analyze_trials(study, &trials, &begin(trials.len()))
}

/// The trials that a study chooses from a cohort's.
///
/// # Errors
/// When it chooses none.
pub fn chosen<'a>(study: &Study, rows: &'a [Row]) -> Result<Vec<&'a Row>, BadInput> {
    let is_chosen = |row: &&Row| {
        study.conditions.contains(&row.key.condition) && study.choose.takes(&row.known())
    };
    let chosen: Vec<&Row> = rows.iter().filter(is_chosen).collect();
    if chosen.is_empty() {
        let place = study.cohort.as_deref().unwrap_or(Path::new("the cohort")).display();
        return Err(BadInput::new(
            &study.place,
            "conditions",
            format!("none of the {} trials of {place} is chosen", rows.len()),
            "write the conditions as `plumb cohort list` shows them, and see what [choose] asks for",
        ));
    }
    Ok(chosen)
}

/// Those of them that take part, by the verdicts on them, and the warnings.
///
/// # Errors
/// When it chooses none, or some are unusable and the study refuses such trials.
pub fn admitted<'a>(
    study: &Study,
    rows: &'a [Row],
) -> Result<(Vec<&'a Row>, Vec<String>), BadInput> {
    let chosen = chosen(study, rows)?;
    let verdicts = chosen.iter().map(|it| Some((it.key.to_string(), it.verdict.clone())));
    let (is_admitted, warnings) = verdict::admit(study, verdicts.collect())?;
    let admitted = chosen.into_iter().zip(is_admitted).filter(|(_, it)| *it).map(|(row, _)| row);
    Ok((admitted.collect(), warnings))
}
