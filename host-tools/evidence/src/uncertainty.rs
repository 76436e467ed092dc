//! Values with their uncertainty, in the terms of the GUM (JCGM 100:2008).
//!
//! A Type A standard uncertainty is that of the mean of n values, s / sqrt(n). Here it is multiplied
//! by sqrt(v / (v - 2)) with v = n - 1 degrees of freedom, as in GUM Supplement 1 (JCGM 101:2008,
//! 6.4.9.4): the standard deviation of what is known about the mean after n values. The expanded
//! uncertainty U = 2 u then holds in 95 of 100 cases however few values there are, as Student's t
//! would, and standard uncertainties can be combined by their squares. For values that depend on
//! each other n is the effective sample size.

use plumbline_analysis::agreement::effective::effective_samples;
use plumbline_analysis::statistics::distributions::chi_squared_quantile;
use serde::{Serialize, Serializer};

/// The coverage factor of all expanded uncertainties.
pub const K: f64 = 2.0;

/// The fewest degrees of freedom for which the distribution of a mean has a standard deviation.
const FREEDOM_MIN: f64 = 3.0;

/// A value and its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The best estimate.
    pub value: f64,
    /// Its standard uncertainty u.
    pub standard: f64,
}

impl Estimate {
    /// A value with its standard uncertainty.
    #[must_use]
    pub const fn new(value: f64, standard: f64) -> Self {
        Self { value, standard }
    }

    /// What was read from a ruler, a caliper or a label, from the largest error that it may have: a
    /// rectangular distribution (JCGM 100:2008, 4.3.7).
    #[must_use]
    pub fn of_reading(value: f64, largest_error: f64) -> Self {
        Self::new(value, largest_error / 3_f64.sqrt())
    }

    /// The mean of values that follow each other in time, with its Type A uncertainty by their
    /// effective number.
    ///
    /// # Panics
    /// When there are fewer than two values: a caller's bug.
    #[must_use]
    pub fn mean(values: &[f64]) -> Self {
        let effective = effective_samples(&[values.to_vec()]);
        Self::mean_of_effective(values, effective)
    }

    /// The mean of values that are independent of each other.
    ///
    /// # Panics
    /// When there are fewer than two values: a caller's bug.
    #[must_use]
    pub fn mean_of_independent(values: &[f64]) -> Self {
        Self::mean_of_effective(values, values.len() as f64)
    }

    fn mean_of_effective(values: &[f64], effective: f64) -> Self {
        let sd = Spread::of(values).sd;
        let standard = sd * (few_values(effective - 1.0) / effective).sqrt();
        Self { value: mean(values), standard }
    }

    /// The expanded uncertainty U = 2 u.
    #[must_use]
    pub fn expanded(&self) -> f64 {
        K * self.standard
    }

    /// Whether a value lies within U.
    #[must_use]
    pub fn covers(&self, value: f64) -> bool {
        (self.value - value).abs() <= self.expanded()
    }

    /// Whether it differs from 0 by more than U.
    #[must_use]
    pub fn is_beyond_chance(&self) -> bool {
        !self.covers(0.0)
    }

    /// What it exceeds another one by; both are independent.
    #[must_use]
    pub fn minus(&self, other: Self) -> Self {
        Self::new(self.value - other.value, combined([self.standard, other.standard]))
    }

    /// In another unit.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self::new(factor * self.value, factor.abs() * self.standard)
    }
}

impl Serialize for Estimate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        /// As written to files.
        #[derive(Serialize)]
        struct Written {
            value: f64,
            standard_uncertainty: f64,
            expanded_uncertainty_k2: f64,
        }
        let written = Written {
            value: self.value,
            standard_uncertainty: self.standard,
            expanded_uncertainty_k2: self.expanded(),
        };
        written.serialize(serializer)
    }
}

/// The combined standard uncertainty of independent contributions: the root of the sum of their
/// squares.
#[must_use]
pub fn combined(contributions: impl IntoIterator<Item = f64>) -> f64 {
    contributions.into_iter().map(|it| it * it).sum::<f64>().sqrt()
}

/// The factor of the variance of a mean that accounts for few values, v / (v - 2).
pub(crate) fn few_values(freedom: f64) -> f64 {
    let freedom = freedom.max(FREEDOM_MIN);
    freedom / (freedom - 2.0)
}

/// A standard deviation, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The standard deviation.
    pub sd: f64,
    /// Its 95 % confidence interval, for normal values.
    pub interval_95: [f64; 2],
}

impl Spread {
    /// The standard deviation of independent values.
    ///
    /// # Panics
    /// When there are fewer than two values: a caller's bug.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        assert!(values.len() >= 2, "a spread needs two values");
        let mean = mean(values);
        let squares: f64 = values.iter().map(|it| (it - mean).powi(2)).sum();
        let freedom = (values.len() - 1) as f64;
        Self::with((squares / freedom).sqrt(), freedom)
    }

    /// The noise in values that follow each other in time, from their successive differences: a
    /// drift that is slow beside the time between two values does not count (von Neumann 1941).
    ///
    /// Each value is in two differences, so that the variance of the result is 3/2 of that of an
    /// ordinary one: 2/3 of the degrees of freedom.
    ///
    /// # Panics
    /// When there are fewer than two values: a caller's bug.
    #[must_use]
    pub fn of_successive(values: &[f64]) -> Self {
        let ones = vec![1.0; values.len()];
        Self::of_successive_in_units(values, &ones)
    }

    /// The same for values in units of their variances: 1 where the values vary from each to the
    /// next as these variances say.
    ///
    /// # Panics
    /// As [`of_successive`](Self::of_successive), and when the lengths differ.
    #[must_use]
    pub fn of_successive_in_units(values: &[f64], variances: &[f64]) -> Self {
        assert_eq!(values.len(), variances.len());
        assert!(values.len() >= 2, "a spread needs two values");
        let differences = values.windows(2).map(|pair| pair[1] - pair[0]);
        let of_both = variances.windows(2).map(|pair| pair[0] + pair[1]);
        let squares: f64 = differences.zip(of_both).map(|(it, variance)| it * it / variance).sum();
        let count = (values.len() - 1) as f64;
        Self::with((squares / count).sqrt(), 2.0 / 3.0 * count)
    }

    fn with(sd: f64, freedom: f64) -> Self {
        let bound = |p: f64| sd * (freedom / chi_squared_quantile(p, freedom)).sqrt();
        Self { sd, interval_95: [bound(0.975), bound(0.025)] }
    }

    /// Whether a standard deviation lies in the interval.
    #[must_use]
    pub fn covers(&self, sd: f64) -> bool {
        let [low, high] = self.interval_95;
        (low..=high).contains(&sd)
    }
}

/// Whether a measured error is within a limit, by the decision rule of ISO 14253-1: what is said
/// is true beyond the uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The error and U together are within the limit.
    Within,
    /// The error exceeds the limit by more than U.
    Exceeds,
    /// U is too large to say.
    Undecided,
}

impl Verdict {
    /// Of an error against a limit of its size.
    #[must_use]
    pub fn of(error: &Estimate, limit: f64) -> Self {
        if error.value.abs() + error.expanded() <= limit {
            Self::Within
        } else if error.value.abs() - error.expanded() > limit {
            Self::Exceeds
        } else {
            Self::Undecided
        }
    }
}

/// The mean of values.
pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{COVERED_OF_1000, Random};

    #[test]
    fn u_holds_in_95_of_100_cases_however_few_values_there_are() {
        for count in [4, 6, 12, 100] {
            let mut random = Random::new(count as u64);
            let covered = (0..1000).filter(|_| {
                let values: Vec<f64> = (0..count).map(|_| 7.0 + random.normal()).collect();
                Estimate::mean_of_independent(&values).covers(7.0)
            });
            let covered = covered.count();
            assert!(COVERED_OF_1000.contains(&covered), "{count} values: {covered}");
        }
    }

    /// s / sqrt(n) itself would hold in 86 % with four values, and in a third of the cases with
    /// values that depend on each other as these do.
    #[test]
    fn u_holds_for_values_that_depend_on_each_other() {
        let mut random = Random::new(1);
        let covered = (0..1000).filter(|_| Estimate::mean(&random.process(900, 0.8)).covers(0.0));
        let covered = covered.count();
        assert!(COVERED_OF_1000.contains(&covered), "{covered}");
    }

    #[test]
    fn intervals_of_a_spread_hold_in_95_of_100_cases() {
        let mut random = Random::new(2);
        let mut covered = [0, 0];
        for _ in 0..1000 {
            let values: Vec<f64> = (0..60).map(|_| 3.0 * random.normal()).collect();
            covered[0] += usize::from(Spread::of(&values).covers(3.0));
            covered[1] += usize::from(Spread::of_successive(&values).covers(3.0));
        }
        for covered in covered {
            assert!(COVERED_OF_1000.contains(&covered), "{covered}");
        }
    }

    #[test]
    fn successive_differences_leave_out_a_drift() {
        let mut random = Random::new(3);
        let values: Vec<f64> = (0..3000).map(|at| 0.01 * f64::from(at) + random.normal()).collect();
        // The drift alone spreads by 30 / sqrt(12).
        assert!(Spread::of(&values).sd > 8.0);
        // 3000 values give it to 1.6 %.
        assert!((Spread::of_successive(&values).sd - 1.0).abs() < 0.05);
        let in_units = Spread::of_successive_in_units(&values, &[4.0; 3000]);
        assert!((in_units.sd - 0.5).abs() < 0.025);
    }

    #[test]
    fn contributions_add_by_their_squares() {
        let difference = Estimate::new(10.0, 3.0).minus(Estimate::new(8.0, 4.0));
        assert_eq!(difference, Estimate::new(2.0, 5.0));
        assert_eq!((difference.expanded(), difference.covers(-8.0)), (10.0, true));
        assert_eq!(difference.times(-2.0), Estimate::new(-4.0, 10.0));
    }

    #[test]
    fn a_reading_that_may_be_off_by_a_millimetre_has_this_uncertainty() {
        let reading = Estimate::of_reading(109.0, 1.0);
        assert!(reading.value == 109.0 && (reading.standard - 0.577).abs() < 1e-3);
    }

    #[test]
    fn a_verdict_is_true_beyond_the_uncertainty() {
        let of = |value: f64| Verdict::of(&Estimate::new(value, 0.01), 0.1);
        assert_eq!([0.07, -0.09, 0.11, -0.13].map(of), {
            use Verdict::{Exceeds, Undecided, Within};
            [Within, Undecided, Undecided, Exceeds]
        });
    }
}
