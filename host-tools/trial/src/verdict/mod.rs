//! What a trial is worth: good, doubtful or unusable, each reason with its figure, its bound and a
//! remedy.
//!
//! [`judge`] is a function of a trial and the [`Criteria`] alone: whoever reads the trial finds the
//! same verdict. It stands in `trial.toml`, where a person may overrule it:
//!
//! ```toml
//! [verdict]
//! is = "doubtful"
//! overruled = "good"
//! by = "A. Smith"
//! why = "the person was asked to step down after 20 s"
//! ```

mod criteria;
mod judge;
mod reasons;
#[cfg(test)]
mod tests;

use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};

pub use criteria::{Criteria, EXAMPLE, Limits, Sign};
pub use judge::judge;

/// What a trial is worth.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// It meets every criterion.
    #[default]
    Good,
    /// Its figures may be wrong in the way that a reason names.
    Doubtful,
    /// It measures no sway.
    Unusable,
}

impl Grade {
    /// Its name in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Doubtful => "doubtful",
            Self::Unusable => "unusable",
        }
    }
}

/// The verdict on a trial.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// What the criteria say.
    pub is: Grade,
    /// What a person says instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overruled: Option<Grade>,
    /// Who.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Why it is not good, the worst first.
    #[serde(default, rename = "reason", skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<Reason>,
}

/// One criterion that is not met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reason {
    /// The criterion, as the criteria name it, without `_min` and `_max`.
    pub key: String,
    /// The grade that it earns.
    pub is: Grade,
    /// What was found; absent where something is so or is not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<f64>,
    /// The bound that it misses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bound: Option<f64>,
    /// The same in words.
    pub words: String,
    /// What can be done.
    pub remedy: String,
}

impl Verdict {
    /// The grade that counts: a person's, where there is one.
    #[must_use]
    pub fn grade(&self) -> Grade {
        self.overruled.unwrap_or(self.is)
    }

    /// The same without what the rest of a recording can still mend: that it is short, that
    /// nobody has stood up and, while `awaits_mark`, that there is no mark.
    #[must_use]
    pub fn so_far(mut self, awaits_mark: bool) -> Self {
        self.reasons.retain(|reason| match &*reason.key {
            "duration_s" | "no_onset" => false,
            "no_mark" => !awaits_mark,
            _ => true,
        });
        self.is = self.reasons.first().map_or(Grade::Good, |worst| worst.is);
        self
    }

    /// What people and files are told in one line.
    #[must_use]
    pub fn line(&self) -> String {
        let reasons: Vec<&str> = self.reasons.iter().map(|reason| &*reason.words).collect();
        let reasons = reasons.join("; ");
        let computed = match self.is {
            Grade::Good => Grade::Good.word().to_owned(),
            grade => format!("{}: {reasons}", grade.word()),
        };
        match self.overruled_words() {
            Some(overruled) => format!("{overruled} (by the criteria {computed})"),
            None => computed,
        }
    }

    /// The same in several lines, with the remedies.
    #[must_use]
    pub fn lines(&self) -> String {
        let computed = self.is.word();
        let mut text = match self.overruled_words() {
            Some(overruled) => format!("verdict: {overruled} (by the criteria {computed})"),
            None => format!("verdict: {computed}"),
        };
        for Reason { is, words, remedy, .. } in &self.reasons {
            text += &format!("\n  {}: {words}\n    {remedy}", is.word());
        }
        text
    }

    /// A person's verdict in words.
    #[must_use]
    pub fn overruled_words(&self) -> Option<String> {
        let of = |text: &Option<String>| text.clone().unwrap_or_default();
        let grade = self.overruled?.word();
        Some(format!("{grade}, overruled by {}: {}", of(&self.by), of(&self.why)))
    }

    /// Checks that a person who overrules the criteria says who and why.
    ///
    /// # Errors
    /// When one of the two is absent.
    pub fn check(&self, place: &str) -> Result<(), BadInput> {
        let is_empty = |text: &Option<String>| text.as_ref().is_none_or(|it| it.trim().is_empty());
        for (field, text) in [("verdict.by", &self.by), ("verdict.why", &self.why)] {
            if self.overruled.is_some() && is_empty(text) {
                return Err(BadInput::new(
                    place,
                    field,
                    "absent, although the verdict is overruled",
                    "write who overrules it and why, or remove verdict.overruled",
                ));
            }
        }
        Ok(())
    }
}
