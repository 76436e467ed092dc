//! What a study asks of a trial, wherever that is kept.

use plumbline_files::BadInput;
use plumbline_trial::points::Points;
use plumbline_trial::{Trial, Verdict};

use crate::manifest::{Entry, Recordings, Source};

/// A trial that can take part in a study.
pub trait Candidate: Sync {
    /// Its place, for messages, and the verdict on it; a table of another system has none.
    ///
    /// # Errors
    /// When it cannot be read.
    fn verdict(&self) -> Result<Option<(String, Verdict)>, BadInput>;

    /// Reads it.
    ///
    /// # Errors
    /// When it cannot be read.
    fn read(&self) -> Result<Measured, BadInput>;

    /// Its physiological recordings.
    fn recordings(&self) -> Option<&Recordings>;
}

/// A trial that was read.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Its points.
    pub points: Points,
    /// Who was measured, if that is known.
    pub participant: Option<String>,
    /// Under which condition, likewise.
    pub condition: Option<String>,
}

impl Candidate for Entry {
    fn verdict(&self) -> Result<Option<(String, Verdict)>, BadInput> {
        let Source::Trial(folder) = &self.source else { return Ok(None) };
        let trial = Trial::open(folder)?;
        Ok(Some((folder.display().to_string(), trial.manifest.verdict())))
    }

    /// The study's entry takes precedence over what the trial says. As in tables, blanks around a
    /// name are ignored.
    fn read(&self) -> Result<Measured, BadInput> {
        let (points, participant, condition) = match &self.source {
            Source::Table(table) => (Points::of_table(table)?, None, None),
            Source::Trial(folder) => {
                let trial = Trial::open(folder)?;
                let points = Points::of(&trial, trial.manifest.zero)?;
                (points, trial.manifest.participant, trial.manifest.condition)
            }
        };
        let named = |names: [Option<&String>; 2]| {
            let mut names = names.into_iter().flatten().map(|it| it.trim());
            names.find(|it| !it.is_empty()).map(str::to_owned)
        };
        Ok(Measured {
            participant: named([self.participant.as_ref(), participant.as_ref()]),
            condition: named([self.condition.as_ref(), condition.as_ref()]),
            points,
        })
    }

    fn recordings(&self) -> Option<&Recordings> {
        self.physiology.as_ref()
    }
}
