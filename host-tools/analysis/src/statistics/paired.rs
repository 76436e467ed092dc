//! Student's t test for paired values, with Bonferroni's correction for several tests.

use serde::Serialize;

use super::describe::differences;
use super::{Undefined, distributions};

/// The tests that are made together, and for whose number p is corrected. It belongs in every
/// report: which tests form a family is a choice, and p is proportional to their number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Family {
    /// What is compared, such as "control against hypoventilation, at each time".
    pub name: String,
    /// The number of tests.
    pub tests: usize,
}

/// The result of a paired t test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairedT {
    /// Number of pairs.
    pub n: usize,
    /// Mean of the differences, second minus first.
    pub mean_difference: f64,
    /// Their standard deviation.
    pub sd_difference: f64,
    /// The 95 % confidence interval of the mean difference, not corrected for the family.
    pub difference_ci95: [f64; 2],
    /// Student's t.
    pub t: f64,
    /// Its degrees of freedom, n - 1.
    pub df: usize,
    /// The two-sided p of this test alone.
    pub p: f64,
    /// p times the number of tests in the family, at most 1 (Bonferroni).
    pub p_bonferroni: f64,
    /// The family.
    pub family: Family,
}

/// Tests whether `to` differs from `from`.
///
/// # Errors
/// With fewer than two pairs, values that are not finite, or differences that are all the same.
///
/// # Panics
/// When the family has no tests.
pub fn paired_t(from: &[f64], to: &[f64], family: &Family) -> Result<PairedT, Undefined> {
    assert!(family.tests > 0, "this test is in the family");
    let differences = differences(from, to)?;
    let df = differences.n - 1;
    let t = differences.mean / differences.sem;
    let p = distributions::t_two_sided(t, df as f64);
    Ok(PairedT {
        n: differences.n,
        mean_difference: differences.mean,
        sd_difference: differences.sd,
        difference_ci95: differences.mean_ci95,
        t,
        df,
        p,
        p_bonferroni: (p * family.tests as f64).min(1.0),
        family: family.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family(tests: usize) -> Family {
        Family { name: "times".to_owned(), tests }
    }

    #[test]
    fn two_pairs_have_the_t_of_cauchy() {
        // Differences 1 and 3: mean 2, sem 1, t = 2 with one degree of freedom.
        let it = paired_t(&[1.0, 5.0], &[2.0, 8.0], &family(3)).unwrap();
        assert_eq!((it.n, it.df, it.mean_difference), (2, 1, 2.0));
        assert!((it.t - 2.0).abs() < 1e-15);
        let p = 1.0 - 2.0 / std::f64::consts::PI * 2.0_f64.atan();
        assert!((it.p / p - 1.0).abs() < 1e-14, "{} {p}", it.p);
        assert!((it.p_bonferroni / (3.0 * p) - 1.0).abs() < 1e-14);
        assert_eq!(paired_t(&[1.0, 5.0], &[2.0, 8.0], &family(4)).unwrap().p_bonferroni, 1.0);
        let zero = paired_t(&[1.0, 5.0], &[2.0, 4.0], &family(1)).unwrap();
        assert_eq!((zero.t, zero.p), (0.0, 1.0));
    }

    #[test]
    fn differences_that_are_all_the_same_have_no_t() {
        let values = [0.1, 0.2, 0.3];
        assert_eq!(paired_t(&values, &values, &family(1)), Err(Undefined::NoSpread));
        let shifted = values.map(|it| it + 1e6);
        assert_eq!(paired_t(&values, &shifted, &family(1)), Err(Undefined::NoSpread));
        let one = paired_t(&[1.0], &[2.0], &family(1));
        assert_eq!(one, Err(Undefined::TooFew { found: 1, needed: 2 }));
    }
}
