//! GOOD, LOOK or STOP: the trial would now be good, doubtful or unusable.
//!
//! In: the verdict by the trial's own criteria, as far as it goes, and how long no pose has come,
//! which no packet tells. Out: one word, and why. WAIT stands for a verdict that is not there yet.

use std::time::Duration;

use plumbline_trial::verdict::{Criteria, Grade, Verdict};

use crate::commands::receive::course::SETTLING;

/// What is to be read from two metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Word {
    Wait,
    Good,
    Look,
    Stop,
}

impl Word {
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::Wait => "WAIT",
            Self::Good => "GOOD",
            Self::Look => "LOOK",
            Self::Stop => "STOP",
        }
    }
}

/// A word and its reasons, the worst first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Judgement {
    /// Absent where nothing is recorded.
    pub(super) word: Option<Word>,
    pub(super) reasons: Vec<String>,
}

/// No pose has come for so long.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Silence {
    pub(super) lasts: Duration,
    /// Whether there was a pose before.
    pub(super) had_pose: bool,
    pub(super) words: String,
}

/// The judgement on a recording by these criteria; `verdict` is absent until there is one.
pub(super) fn of_recording(
    criteria: &Criteria,
    verdict: Option<&Verdict>,
    silence: Option<Silence>,
) -> Judgement {
    let mut reasons: Vec<(Grade, String)> = Vec::new();
    if let Some(silence) = silence {
        reasons.push((grade(criteria, &silence), silence.words));
    }
    let of_verdict = verdict.map(|verdict| &verdict.reasons).into_iter().flatten();
    reasons.extend(of_verdict.map(|reason| (reason.is, reason.words.clone())));
    // The order of equals stays.
    reasons.sort_by_key(|(grade, _)| std::cmp::Reverse(*grade));
    let word = match reasons.first().map_or(Grade::Good, |(worst, _)| *worst) {
        Grade::Unusable => Word::Stop,
        Grade::Doubtful => Word::Look,
        Grade::Good if verdict.is_some() => Word::Good,
        Grade::Good => Word::Wait,
    };
    if reasons.is_empty() && word == Word::Wait {
        reasons.push((
            Grade::Good,
            format!("the trial is judged {} s after its first frame", SETTLING.as_secs()),
        ));
    }
    Judgement { word: Some(word), reasons: reasons.into_iter().map(|(_, words)| words).collect() }
}

/// What a pause until now is worth. A box that falls silent is worth a look by any criteria; one
/// that has not sent yet gets the time to search.
fn grade(criteria: &Criteria, silence: &Silence) -> Grade {
    let lasts_s = silence.lasts.as_secs_f64();
    if criteria.unusable.gap_s_max.is_some_and(|max_s| lasts_s > max_s) {
        Grade::Unusable
    } else if silence.had_pose || silence.lasts > SETTLING {
        Grade::Doubtful
    } else {
        Grade::Good
    }
}

/// Where nothing is recorded there is nothing to judge.
pub(super) fn of_nothing(silence: Option<Silence>) -> Judgement {
    let mut reasons = vec!["not recorded: `--out FOLDER` records".to_owned()];
    reasons.extend(silence.map(|silence| silence.words));
    Judgement { word: None, reasons }
}

#[cfg(test)]
mod tests {
    use plumbline_trial::verdict::Reason;

    use super::*;

    fn silence(lasts_s: f64, had_pose: bool) -> Option<Silence> {
        let lasts = Duration::from_secs_f64(lasts_s);
        Some(Silence { lasts, had_pose, words: "no pose".to_owned() })
    }

    fn word(verdict: Option<&Verdict>, silence: Option<Silence>) -> Word {
        of_recording(&Criteria::default(), verdict, silence).word.unwrap()
    }

    fn verdict(is: Grade) -> Verdict {
        let reason = Reason {
            key: "gap_s".to_owned(),
            is,
            found: None,
            bound: None,
            words: "a gap".to_owned(),
            remedy: String::new(),
        };
        let reasons = if is == Grade::Good { Vec::new() } else { vec![reason] };
        Verdict { is, reasons, ..Verdict::default() }
    }

    #[test]
    fn each_grade_has_its_word() {
        for (is, wanted) in [
            (Grade::Good, Word::Good),
            (Grade::Doubtful, Word::Look),
            (Grade::Unusable, Word::Stop),
        ] {
            assert_eq!(word(Some(&verdict(is)), None), wanted);
        }
    }

    #[test]
    fn the_box_has_time_to_find_its_targets_and_a_silence_is_seen_at_once() {
        assert_eq!(word(None, None), Word::Wait);
        for (lasts_s, had_pose, wanted) in [
            (2.9, false, Word::Wait),
            (3.1, false, Word::Look),
            (1.6, true, Word::Look),
            // Longer than the longest gap of a trial that can be used.
            (9.9, true, Word::Look),
            (10.1, true, Word::Stop),
            (10.1, false, Word::Stop),
        ] {
            assert_eq!(word(None, silence(lasts_s, had_pose)), wanted, "{lasts_s}");
        }
        // What is good so far is not good any more.
        assert_eq!(word(Some(&verdict(Grade::Good)), silence(2.0, true)), Word::Look);
        // Whatever a laboratory leaves out.
        let criteria = Criteria::parse("[doubtful]\n[unusable]\n", "").unwrap();
        let judged = of_recording(&criteria, Some(&verdict(Grade::Good)), silence(99.0, true));
        assert_eq!(judged.word, Some(Word::Look));
    }

    #[test]
    fn the_worst_comes_first() {
        let judged =
            of_recording(&Criteria::default(), Some(&verdict(Grade::Unusable)), silence(2.0, true));
        assert_eq!(judged.reasons, ["a gap", "no pose"]);
    }

    #[test]
    fn what_is_not_recorded_is_not_called_good() {
        let judged = of_nothing(None);
        assert_eq!(judged.word, None);
        assert!(judged.reasons[0].contains("--out FOLDER"));
    }
}
