//! The verdict on each trial, as the study honours it.

use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_trial::verdict::Grade;
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
    let (mut admitted, mut warnings, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    for (entry, verdict) in trials.iter().zip(verdicts) {
        let Some((place, verdict)) = verdict? else {
            admitted.push(entry);
            continue;
        };
        let line = verdict.line();
        match verdict.grade() {
            Grade::Unusable if study.unusable == Unusable::Refuse => {
                refused.push(format!("\n  {place}: verdict: {line}"));
            }
            Grade::Unusable => warnings.push(format!("{place} is left out: {line}")),
            Grade::Doubtful if study.doubtful == Doubtful::LeaveOut => {
                warnings.push(format!("{place} is left out: {line}"));
            }
            grade => {
                if grade == Grade::Doubtful || verdict.overruled.is_some() {
                    warnings.push(format!("{place} is {line}"));
                }
                admitted.push(entry);
            }
        }
    }
    if refused.is_empty() {
        return Ok((admitted, warnings));
    }
    Err(BadInput::whole(
        &study.place,
        format!("{} unusable:{}", counted(refused.len(), "trial"), refused.concat()),
        "`plumb show TRIAL` says what can be done for each; or write unusable = \"leave_out\" to go on \
         without them",
    ))
}
