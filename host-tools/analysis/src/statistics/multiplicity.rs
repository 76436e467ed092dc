//! p values of tests that are made together, adjusted for their number.
//!
//! [`holm`] bounds the probability that any of the true null hypotheses is rejected, under any
//! dependence of the tests; [`benjamini_hochberg`] the expected share of false rejections among
//! all, for tests that are independent or positively dependent. An adjusted p is compared with the
//! level as a single one is.
//!
//! A test that could not be made has no p and is not counted: what was not asked of the data cannot
//! be answered wrongly.

/// Holm's step-down procedure (1979): in ascending order, each p times the number of tests that
/// remain, and no smaller than the one before.
#[must_use]
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut adjusted = p.to_vec();
    let mut largest: f64 = 0.0;
    for (at, index) in ascending(p).into_iter().enumerate() {
        largest = largest.max(p[index] * (p.len() - at) as f64).min(1.0);
        adjusted[index] = largest;
    }
    adjusted
}

/// Benjamini and Hochberg's step-up procedure (1995): each p times the number of tests over its
/// place in ascending order, and no larger than the one after.
#[must_use]
pub fn benjamini_hochberg(p: &[f64]) -> Vec<f64> {
    let mut adjusted = p.to_vec();
    let mut smallest: f64 = 1.0;
    for (at, index) in ascending(p).into_iter().enumerate().rev() {
        smallest = smallest.min(p[index] * p.len() as f64 / (at + 1) as f64);
        adjusted[index] = smallest;
    }
    adjusted
}

/// The indices of the values from the smallest to the largest.
fn ascending(p: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|left, right| p[*left].total_cmp(&p[*right]));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In no order, with a tie, and with values that one step up and one step down makes equal.
    const P: [f64; 8] = [0.0105, 0.0007, 0.04, 0.041, 0.5, 0.0007, 0.2, 0.03];

    #[track_caller]
    fn assert_near(found: &[f64], expected: [f64; 8]) {
        for (found, expected) in found.iter().zip(expected) {
            // A product and a quotient.
            assert!((found / expected - 1.0).abs() < 1e-15, "{found} {expected}");
        }
    }

    #[test]
    fn adjusted_values_are_those_of_statsmodels() {
        // multipletests of statsmodels 0.15, methods "holm" and "fdr_bh".
        assert_near(&holm(&P), [0.063, 0.0056, 0.16, 0.16, 0.5, 0.0056, 0.4, 0.15]);
        let third = 0.041 * 4.0 / 3.0;
        let expected = [0.028, 0.0028, third, third, 0.5, 0.0028, 0.8 / 3.5, third];
        assert_near(&benjamini_hochberg(&P), expected);
    }

    #[test]
    fn one_test_is_not_adjusted_and_none_is_none() {
        assert_eq!((holm(&[0.03]), benjamini_hochberg(&[0.03])), (vec![0.03], vec![0.03]));
        assert_eq!((holm(&[]), benjamini_hochberg(&[])), (vec![], vec![]));
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
    }
}
