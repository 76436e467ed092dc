//! The `[choose]` section of `study.toml`: which trials of a cohort take part.

use plumbline_files::BadInput;
use serde::Deserialize;

/// What a trial must have; what is empty or absent is not asked for.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Choose {
    /// One of these participants.
    pub participants: Vec<String>,
    /// One of these sessions.
    pub sessions: Vec<String>,
    /// One of these runs.
    pub runs: Vec<u32>,
    /// An age from the first up to, but excluding, the second, years.
    pub age_years: Option<[f64; 2]>,
    /// One of these sexes: `F`, `M`, `O`.
    pub sex: Vec<String>,
}

/// What a cohort knows of a trial that can be chosen by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known<'a> {
    /// The participant.
    pub participant: &'a str,
    /// The session.
    pub session: &'a str,
    /// The run.
    pub run: u32,
    /// The participant's age, years.
    pub age_years: Option<f64>,
    /// The participant's sex.
    pub sex: Option<&'a str>,
}

impl Choose {
    /// Checks the section.
    ///
    /// # Errors
    /// When something in it cannot be meant.
    pub fn check(&self, place: &str) -> Result<(), BadInput> {
        let wrong = |field: &str, found: String, remedy: &str| {
            Err(BadInput::new(place, format!("choose.{field}"), found, remedy))
        };
        if let Some([from, to]) = self.age_years
            && !(from < to && from >= 0.0 && to.is_finite())
        {
            let remedy = "give two ages in years, [18, 40]: from 18 up to, but excluding, 40";
            return wrong("age_years", format!("[{from}, {to}]"), remedy);
        }
        match self.sex.iter().find(|it| !["F", "M", "O"].contains(&it.as_str())) {
            Some(other) => wrong("sex", format!("{other:?}"), "write \"F\", \"M\" or \"O\""),
            None => Ok(()),
        }
    }

    /// Whether a trial is chosen. One whose age or sex is not known is not, if that is asked for.
    #[must_use]
    pub fn takes(&self, known: &Known<'_>) -> bool {
        fn is_of<T: PartialEq<U>, U>(wanted: &[T], it: &U) -> bool {
            wanted.is_empty() || wanted.iter().any(|wanted| wanted == it)
        }
        let of_age =
            |[from, to]: [f64; 2]| known.age_years.is_some_and(|it| (from..to).contains(&it));
        is_of(&self.participants, &known.participant)
            && is_of(&self.sessions, &known.session)
            && is_of(&self.runs, &known.run)
            && self.age_years.is_none_or(of_age)
            && (self.sex.is_empty()
                || known.sex.is_some_and(|it| self.sex.iter().any(|sex| sex == it)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: Known<'_> =
        Known { participant: "P01", session: "1", run: 2, age_years: Some(40.0), sex: Some("F") };

    fn choose(text: &str) -> Choose {
        let choose: Choose = toml::from_str(text).unwrap();
        choose.check("study.toml").unwrap();
        choose
    }

    #[test]
    fn all_that_is_asked_for_must_hold() {
        for (text, takes) in [
            ("", true),
            ("participants = [\"P02\", \"P01\"]", true),
            ("participants = [\"P02\"]", false),
            ("sessions = [\"2\"]", false),
            ("runs = [1]", false),
            ("runs = [1, 2]\nsessions = [\"1\"]", true),
            ("age_years = [40, 60]", true),
            ("age_years = [18, 40]", false),
            ("sex = [\"M\", \"O\"]", false),
            ("sex = [\"F\"]", true),
        ] {
            assert_eq!(choose(text).takes(&KNOWN), takes, "{text}");
        }
        let unknown = Known { age_years: None, sex: None, ..KNOWN };
        assert!(choose("").takes(&unknown));
        assert!(!choose("age_years = [0, 120]").takes(&unknown));
        assert!(!choose("sex = [\"F\"]").takes(&unknown));
    }

    #[test]
    fn what_cannot_be_meant_is_named() {
        for (text, part) in [
            ("age_years = [40, 18]", "choose.age_years: [40, 18]"),
            ("age_years = [18, inf]", "choose.age_years"),
            ("sex = [\"female\"]", "choose.sex: \"female\"; write"),
        ] {
            let choose: Choose = toml::from_str(text).unwrap();
            let error = choose.check("study.toml").unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
