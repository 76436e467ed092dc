//! The verdict on a trial, at the top of its report.

use maud::{Markup, html};
use plumbline_trial::Verdict;

/// A coloured band: the grade, the reasons, and what can be done.
pub(crate) fn band(verdict: &Verdict) -> Markup {
    let class = format!("verdict {}", verdict.grade().word());
    html! {
        section class=(class) {
            h2 { "Verdict: " (verdict.grade().word()) }
            @if let Some(overruled) = verdict.overruled_words() {
                p { (overruled) ". By the criteria the trial is " (verdict.is.word()) "." }
            }
            @if !verdict.reasons.is_empty() {
                ul {
                    @for reason in &verdict.reasons {
                        li {
                            strong { (reason.is.word()) } ": " (reason.words)
                            span.remedy { (reason.remedy) }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline_trial::verdict::{Grade, Reason};

    use super::*;

    #[test]
    fn the_band_has_the_grade_that_counts_and_the_computed_one_beside_it() {
        let good = band(&Verdict::default()).into_string();
        assert!(good.contains("class=\"verdict good\"") && !good.contains("<ul>"), "{good}");
        let reason = Reason {
            key: "duration_s".to_owned(),
            is: Grade::Doubtful,
            found: Some(20.0),
            bound: Some(25.0),
            words: "20 s < 25 s".to_owned(),
            remedy: "record for longer".to_owned(),
        };
        let doubtful = Verdict { is: Grade::Doubtful, reasons: vec![reason], ..Verdict::default() };
        let text = band(&doubtful).into_string();
        for part in ["verdict doubtful", "20 s &lt; 25 s", "record for longer"] {
            assert!(text.contains(part), "no {part} in {text}");
        }
        let overruled = Verdict {
            overruled: Some(Grade::Good),
            by: Some("A. Smith".to_owned()),
            why: Some("stood down".to_owned()),
            ..doubtful
        };
        let text = band(&overruled).into_string();
        for part in ["class=\"verdict good\"", "A. Smith", "stood down", "the trial is doubtful"] {
            assert!(text.contains(part), "no {part} in {text}");
        }
    }
}
