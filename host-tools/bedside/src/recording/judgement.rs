//! GOOD, LOOK or STOP: the trial would now be good, doubtful or unusable.
//!
//! In: the verdict by the trial's own criteria, as far as it goes, and how long no pose has come,
//! which no packet tells. Out: one word, and why. WAIT stands for a verdict that is not there yet.

use std::time::Duration;

use plumbline_trial::verdict::{Criteria, Grade, Verdict};

use super::course::SETTLING;

/// What is to be read from two metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// There is no verdict yet.
    Wait,
    /// The trial would now be good.
    Good,
    /// It would be doubtful.
    Look,
    /// It would be unusable.
    Stop,
}

impl Word {
    /// As it is shown.
    #[must_use]
    pub fn text(self) -> &'static str {
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
pub struct Judgement {
    /// Absent where nothing is recorded.
    pub word: Option<Word>,
    /// Why.
    pub reasons: Vec<Why>,
}

/// A reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Why {
    /// What is amiss.
    pub words: String,
    /// What can be done; empty where the reason says it.
    pub remedy: String,
}

impl Why {
    /// A reason, and what can be done.
    pub fn new(words: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { words: words.into(), remedy: remedy.into() }
    }
}

/// No pose has come for so long.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Silence {
    pub lasts: Duration,
    /// Whether there was a pose before.
    pub had_pose: bool,
    pub words: String,
}

/// The judgement on a recording by these criteria; `verdict` is absent until there is one.
pub(crate) fn of_recording(
    criteria: &Criteria,
    verdict: Option<&Verdict>,
    silence: Option<Silence>,
) -> Judgement {
    let mut reasons: Vec<(Grade, Why)> = Vec::new();
    if let Some(silence) = silence {
        reasons.push((grade(criteria, &silence), Why::new(silence.words, "")));
    }
    let of_verdict = verdict.map(|verdict| &verdict.reasons).into_iter().flatten();
    reasons.extend(of_verdict.map(|it| (it.is, Why::new(it.words.clone(), it.remedy.clone()))));
    // The order of equals stays.
    reasons.sort_by_key(|(grade, _)| std::cmp::Reverse(*grade));
    let word = match reasons.first().map_or(Grade::Good, |(worst, _)| *worst) {
        Grade::Unusable => Word::Stop,
        Grade::Doubtful => Word::Look,
        Grade::Good if verdict.is_some() => Word::Good,
        Grade::Good => Word::Wait,
    };
    let mut reasons: Vec<Why> = reasons.into_iter().map(|(_, why)| why).collect();
    if reasons.is_empty() && word == Word::Wait {
        let words = format!("the trial is judged {} s after its first frame", SETTLING.as_secs());
        reasons.push(Why::new(words, ""));
    }
    Judgement { word: Some(word), reasons }
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
pub(crate) fn of_nothing(silence: Option<Silence>) -> Judgement {
    let mut reasons = vec![Why::new("not recorded: `--out FOLDER` records", "")];
    reasons.extend(silence.map(|silence| Why::new(silence.words, "")));
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
            remedy: "record again".to_owned(),
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
        let words: Vec<&str> = judged.reasons.iter().map(|it| &*it.words).collect();
        assert_eq!(words, ["a gap", "no pose"]);
        assert_eq!(judged.reasons[0].remedy, "record again");
    }

    #[test]
    fn what_is_not_recorded_is_not_called_good() {
        let judged = of_nothing(None);
        assert_eq!(judged.word, None);
        assert!(judged.reasons[0].words.contains("--out FOLDER"));
    }
}
