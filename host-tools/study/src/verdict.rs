//! The verdict on each trial, as the study honours it.

use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_trial::verdict::{Grade, Verdict};
use rayon::prelude::*;

use crate::candidate::Candidate;
use crate::manifest::{Doubtful, Study, Unusable};

/// The trials that take part, and warnings that name those that are doubtful or left out.
///
/// Each trial is read for this alone, and again for its figures: the study stops before any are
/// computed, and memory holds only the trials that are being read.
///
/// # Errors
/// When a trial cannot be read, or some are unusable and the study refuses such trials: each is named.
pub fn admitted<'a, C: Candidate>(
    study: &Study,
    trials: &'a [C],
) -> Result<(Vec<&'a C>, Vec<String>), BadInput> {
    let verdicts: Vec<_> = trials.par_iter().map(Candidate::verdict).collect();
    let verdicts: Vec<_> = verdicts.into_iter().collect::<Result<_, _>>()?;
    let (is_admitted, warnings) = admit(study, verdicts)?;
    let admitted = trials.iter().zip(is_admitted);
    Ok((admitted.filter(|(_, is_admitted)| *is_admitted).map(|(it, _)| it).collect(), warnings))
}

/// Whether each of the trials with these places and verdicts takes part, and the warnings.
///
/// # Errors
/// When some are unusable and the study refuses such trials: each is named.
pub fn admit(
    study: &Study,
    verdicts: Vec<Option<(String, Verdict)>>,
) -> Result<(Vec<bool>, Vec<String>), BadInput> {
    let (mut warnings, mut refused) = (Vec::new(), Vec::new());
    let mut takes_part = |verdict: Option<(String, Verdict)>| {
        let Some((place, verdict)) = verdict else { return true };
        let line = verdict.line();
        match verdict.grade() {
            Grade::Unusable if study.unusable == Unusable::Refuse => {
                refused.push(format!("\n  {place}: verdict: {line}"));
                false
            }
            Grade::Unusable => {
                warnings.push(format!("{place} is left out: {line}"));
                false
            }
            Grade::Doubtful if study.doubtful == Doubtful::LeaveOut => {
                warnings.push(format!("{place} is left out: {line}"));
                false
            }
            grade => {
                if grade == Grade::Doubtful || verdict.overruled.is_some() {
                    warnings.push(format!("{place} is {line}"));
                }
                true
            }
        }
    };
    let is_admitted: Vec<bool> = verdicts.into_iter().map(&mut takes_part).collect();
    if refused.is_empty() {
        return Ok((is_admitted, warnings));
    }
    Err(BadInput::whole(
        &study.place,
        format!("{} unusable:{}", counted(refused.len(), "trial"), refused.concat()),
        "`plumb show TRIAL` says what can be done for each; or write unusable = \"leave_out\" to go on \
         without them",
    ))
}
