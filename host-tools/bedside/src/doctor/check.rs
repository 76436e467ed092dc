//! A check of the box: its subject, its verdict, and what to do.

/// The verdict of a check, the worst last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// There is nothing to look at.
    Skipped,
    /// As it should be.
    Good,
    /// It measures, and could measure better or more safely.
    Warn,
    /// It does not measure, or what it measures is not to be used.
    Fail,
}

/// One line of the doctor's report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What was looked at.
    pub subject: String,
    /// The verdict.
    pub verdict: Verdict,
    /// What was seen, with figure and bound.
    pub seen: String,
    /// What to do; empty where there is nothing to do.
    pub remedy: String,
}

impl Check {
    /// As it should be.
    pub fn good(subject: impl Into<String>, seen: impl Into<String>) -> Self {
        Self::new(Verdict::Good, subject, seen, "")
    }

    /// A warning.
    pub fn warn(
        subject: impl Into<String>,
        seen: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::new(Verdict::Warn, subject, seen, remedy)
    }

    /// A failure.
    pub fn fail(
        subject: impl Into<String>,
        seen: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::new(Verdict::Fail, subject, seen, remedy)
    }

    /// Nothing to look at.
    pub fn skipped(subject: impl Into<String>, why: impl Into<String>) -> Self {
        Self::new(Verdict::Skipped, subject, why, "")
    }

    /// With this verdict; where it is good the remedy is left out.
    pub fn new(
        verdict: Verdict,
        subject: impl Into<String>,
        seen: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let remedy = if verdict == Verdict::Good { String::new() } else { remedy.into() };
        Self { subject: subject.into(), verdict, seen: seen.into(), remedy }
    }
}

impl Verdict {
    /// A warning if something is amiss, otherwise good.
    #[must_use]
    pub fn warn_if(amiss: bool) -> Self {
        if amiss { Self::Warn } else { Self::Good }
    }

    /// The verdict on a figure that should not be above `warn`, and must not be above `fail`.
    #[must_use]
    pub fn at_most(figure: f64, warn: f64, fail: f64) -> Self {
        if figure > fail {
            Self::Fail
        } else if figure > warn {
            Self::Warn
        } else {
            Self::Good
        }
    }

    /// The verdict on a figure that should not be below `warn`, and must not be below `fail`.
    #[must_use]
    pub fn at_least(figure: f64, warn: f64, fail: f64) -> Self {
        Self::at_most(-figure, -warn, -fail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_judged_by_its_bounds() {
        let at_most = |figure| Verdict::at_most(figure, 1.0, 2.0);
        assert_eq!([1.0, 1.5, 2.1].map(at_most), [Verdict::Good, Verdict::Warn, Verdict::Fail]);
        let at_least = |figure| Verdict::at_least(figure, 2.0, 1.0);
        assert_eq!([2.0, 1.5, 0.9].map(at_least), [Verdict::Good, Verdict::Warn, Verdict::Fail]);
    }
}
