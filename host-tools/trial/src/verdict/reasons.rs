//! Holds figures and signs of a trial against the bounds of the criteria, and puts into words what
//! misses them.

use super::{Criteria, Grade, Limits, Reason, Sign, Verdict};

/// The reasons so far.
pub struct Judge<'a> {
    criteria: &'a Criteria,
    reasons: Vec<Reason>,
}

/// One bound of a grade.
pub type Bound = fn(&Limits) -> Option<f64>;

/// A figure of the trial.
pub struct Figure<'a> {
    /// As the criteria name it.
    pub key: &'a str,
    /// For people.
    pub name: String,
    /// Its value.
    pub found: f64,
    /// Its unit, with a space before it.
    pub unit: &'a str,
    /// What can be done where it misses a bound.
    pub remedy: &'a str,
}

impl<'a> Judge<'a> {
    /// One that has not judged anything yet.
    pub fn new(criteria: &'a Criteria) -> Self {
        Self { criteria, reasons: Vec::new() }
    }

    /// The verdict by all reasons, the worst first; those of one grade stay in their order.
    pub fn verdict(self) -> Verdict {
        let mut reasons = self.reasons;
        reasons.sort_by_key(|reason| std::cmp::Reverse(reason.is));
        let is = reasons.first().map_or(Grade::Good, |worst| worst.is);
        Verdict { is, reasons, ..Verdict::default() }
    }

    /// A reason, unless the figure reaches the bound.
    pub fn at_least(&mut self, figure: Figure<'_>, bound: Bound) {
        self.bounded(figure, bound, "at least", |found, bound| found < bound);
    }

    /// A reason, if the figure exceeds the bound.
    pub fn at_most(&mut self, figure: Figure<'_>, bound: Bound) {
        self.bounded(figure, bound, "at most", |found, bound| found > bound);
    }

    fn bounded(
        &mut self,
        figure: Figure<'_>,
        bound: Bound,
        side: &str,
        misses: fn(f64, f64) -> bool,
    ) {
        let Figure { key, name, found, unit, remedy } = figure;
        let missed = self.criteria.graded().into_iter().find_map(|(grade, limits)| {
            // What is no number meets no bound.
            let is_missed = |bound: &f64| found.is_nan() || misses(found, *bound);
            bound(limits).filter(is_missed).map(|bound| (grade, bound))
        });
        if let Some((is, bound)) = missed {
            self.reasons.push(Reason {
                key: key.to_owned(),
                is,
                found: Some(found),
                bound: Some(bound),
                words: format!(
                    "{name}: {}{unit} ({side} {bound})",
                    digits(found, |shown| misses(shown, bound))
                ),
                remedy: remedy.to_owned(),
            });
        }
    }

    /// A reason, if it is so and a grade is given for it.
    pub fn sign(&mut self, is_so: bool, sign: Sign, words: &str, remedy: &str) {
        let graded = self.criteria.graded();
        let Some((is, _)) = graded.into_iter().find(|(_, limits)| limits.when.contains(&sign))
        else {
            return;
        };
        if is_so {
            self.reasons.push(Reason {
                key: sign.key().to_owned(),
                is,
                found: None,
                bound: None,
                words: words.to_owned(),
                remedy: remedy.to_owned(),
            });
        }
    }
}

/// Three digits, or all before the point; more, until the figure as it is shown misses the bound.
fn digits(value: f64, misses: impl Fn(f64) -> bool) -> String {
    let decimals = match value.abs() {
        0.0..9.995 => 2,
        0.0..99.95 => 1,
        _ => 0,
    };
    let mut rounded = (decimals..decimals + 6).map(|decimals| format!("{value:.decimals$}"));
    let missing = rounded.find(|text| text.parse().is_ok_and(&misses));
    let text = missing.unwrap_or_else(|| value.to_string());
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

impl Sign {
    /// Its name in files.
    fn key(self) -> &'static str {
        match self {
            Self::NoScene => "no_scene",
            Self::NoTarget => "no_target",
            Self::NoConfiguration => "no_configuration",
            Self::ConfigurationChanged => "configuration_changed",
            Self::NoMark => "no_mark",
            Self::NoOnset => "no_onset",
            Self::ClockUnrelated => "clock_unrelated",
            Self::Undervoltage => "undervoltage",
            Self::Throttled => "throttled",
            Self::CutOff => "cut_off",
        }
    }
}
