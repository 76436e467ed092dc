//! Quantiles of a sample and how well they are known.
//!
//! The estimate is that of Harrell and Davis (1982, Biometrika 69:635): the mean of all values, each
//! weighted by the probability that the quantile lies at its place in the order. It is smooth, and
//! for few values more precise than a single value or two.
//!
//! The interval is that between two values in their order, such that the quantile lies below the lower
//! one with a probability of at most 5 %, and above the higher one likewise, whatever the distribution
//! (Conover 1999, Practical Nonparametric Statistics, 3.2; the same that CLSI EP28-A3c asks of
//! reference limits). Where there are too few values for such a bound, there is none: the 5th and the
//! 95th percentile need 59 values for both.

use statrs::function::beta::beta_reg;

/// The probability that the quantile lies between both bounds, at least.
pub const CONFIDENCE: f64 = 0.9;

/// A quantile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantile {
    /// The estimate.
    pub value: f64,
    /// The lower bound, if there are values enough for one.
    pub low: Option<f64>,
    /// The upper bound, likewise.
    pub high: Option<f64>,
}

/// The quantile at `p`, between 0 and 1 (exclusive), of values in increasing order. `None` where there
/// are none.
#[must_use]
pub fn quantile(sorted: &[f64], p: f64) -> Option<Quantile> {
    let n = sorted.len() as f64;
    let (a, b) = ((n + 1.0) * p, (n + 1.0) * (1.0 - p));
    let (last, first) = (sorted.last()?, sorted.first()?);
    let mut value = 0.0;
    let mut below = 0.0;
    for (at, it) in sorted.iter().enumerate() {
        let up_to = if at + 1 == sorted.len() { 1.0 } else { beta_reg(a, b, (at + 1) as f64 / n) };
        // About the middle, so that a large offset costs no precision.
        value += (up_to - below) * (it - first);
        below = up_to;
    }
    let value = (first + value).clamp(*first, *last);
    let tail = (1.0 - CONFIDENCE) / 2.0;
    // The number of values below the quantile is binomial.
    let places = 0..sorted.len();
    let low = places.clone().rev().find(|at| at_most(*at, sorted.len(), p) <= tail);
    let high = places.clone().find(|at| 1.0 - at_most(*at, sorted.len(), p) <= tail);
    Some(Quantile { value, low: low.map(|at| sorted[at]), high: high.map(|at| sorted[at]) })
}

/// The probability that at most `count` of `n` values are below the quantile at `p`.
fn at_most(count: usize, n: usize, p: f64) -> f64 {
    if count >= n {
        return 1.0;
    }
    beta_reg((n - count) as f64, count as f64 + 1.0, 1.0 - p)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    fn close(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() < within, "{found} {expected}");
    }

    #[test]
    fn few_values_have_the_quantiles_that_can_be_worked_out_by_hand() {
        assert_eq!(quantile(&[], 0.5), None);
        let one = Quantile { value: 3.0, low: None, high: None };
        assert_eq!(quantile(&[3.0], 0.05), Some(one));
        // For two values and the median the beta distribution is symmetric.
        close(quantile(&[1.0, 4.0], 0.5).unwrap().value, 2.5, 1e-14);
        // For three and the median it is 6 x (1 - x): of the thirds 7/27, 13/27 and 7/27.
        let median = quantile(&[0.0, 27.0, 270.0], 0.5).unwrap().value;
        close(median, 13.0 + 70.0, 1e-12);
        // For three and the first quartile it is 3 (1 - x)^2: 19/27, 7/27 and 1/27.
        let quartile = quantile(&[0.0, 27.0, 270.0], 0.25).unwrap().value;
        close(quartile, 7.0 + 10.0, 1e-12);
        // An offset costs nothing.
        let far = quantile(&[1e9, 1e9 + 27.0, 1e9 + 270.0], 0.25).unwrap().value;
        close(far - 1e9, 17.0, 1e-6);
    }

    /// `scipy.stats.mstats.hdquantiles`, version 1.17.
    #[test]
    fn estimates_are_scipys() {
        let mut values: Vec<f64> =
            (1..=40).map(|at| f64::from(at * at % 97) + f64::from(at) / 7.0).collect();
        values.sort_by(f64::total_cmp);
        for (p, expected) in [
            (0.05, 3.998_170_089_338_175),
            (0.25, 23.742_939_568_450_385),
            (0.5, 49.451_923_871_679_62),
            (0.75, 73.862_516_072_877_8),
            (0.95, 97.191_895_964_766_83),
        ] {
            close(quantile(&values, p).unwrap().value, expected, 1e-10);
        }
    }

    #[test]
    fn bounds_are_those_of_the_binomial_distribution_and_absent_where_there_are_too_few_values() {
        let values: Vec<f64> = (1..=59).map(f64::from).collect();
        let of = |n: usize, p: f64| {
            let it = quantile(&values[..n], p).unwrap();
            (it.low, it.high)
        };
        // 0.95^59 = 0.0485, and 0.95^58 = 0.0510.
        assert_eq!(of(58, 0.05).0, None);
        assert_eq!(of(59, 0.05).0, Some(1.0));
        assert_eq!((of(58, 0.95).1, of(59, 0.95).1), (None, Some(59.0)));
        // Of 10, at most 1 is below the median with a probability of 11/1024, at most 2 of 56/1024.
        assert_eq!(of(10, 0.5), (Some(2.0), Some(9.0)));
    }

    #[test]
    fn the_interval_holds_the_quantile_as_often_as_it_says() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        // Of the normal distribution.
        let quantiles =
            [(0.05, -1.644_853_626_951_472), (0.5, 0.0), (0.75, 0.674_489_750_196_081_7)];
        let (mut held, mut estimates) = ([0; 3], [0.0; 3]);
        for _ in 0..2000 {
            let mut values: Vec<f64> =
                (0..80).map(|_| StandardNormal.sample(&mut random)).collect();
            values.sort_by(f64::total_cmp);
            for (at, (p, truth)) in quantiles.into_iter().enumerate() {
                let it = quantile(&values, p).unwrap();
                held[at] += u32::from(it.low.unwrap() <= truth && truth <= it.high.unwrap());
                estimates[at] += it.value / 2000.0;
            }
        }
        for (at, (_, truth)) in quantiles.into_iter().enumerate() {
            let share = f64::from(held[at]) / 2000.0;
            // Discrete: at least 0.9, and with 80 values not much more.
            assert!((0.885..0.965).contains(&share), "{share}");
            close(estimates[at], truth, 0.05);
        }
    }
}
