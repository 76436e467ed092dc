//! The normality test of Shapiro and Wilk (1965), extended to 5000 values by Royston (1995,
//! algorithm AS R94).
//!
//! W is the squared correlation of the sorted values with weights close to the expected order
//! statistics of a normal sample; it is close to 1 for normal values. A transform of 1 - W is
//! nearly normal; its moments are the paper's polynomials in n or ln n, fitted to simulations, so p
//! is an approximation however many digits it has.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_3, FRAC_PI_6};

use serde::Serialize;

use super::{Undefined, centred, checked, distributions, rounding, sum_of_squares};

/// The polynomials were fitted up to this number of values.
const VALUES_MAX: usize = 5000;

// Royston (1995), tables of coefficients, constant term first. The two outermost weights, in powers
// of 1 / sqrt(n).
const OUTERMOST: [f64; 6] = [0.0, 0.221157, -0.147981, -2.07119, 4.434685, -2.706056];
const SECOND: [f64; 6] = [0.0, 0.042981, -0.293762, -1.752461, 5.682633, -3.582633];
// Up to 11 values: the bound, the mean, and ln of the standard deviation in powers of n.
const SMALL_BOUND: [f64; 2] = [-2.273, 0.459];
const SMALL_MEAN: [f64; 4] = [0.544, -0.39978, 0.025054, -6.714e-4];
const SMALL_LN_SD: [f64; 4] = [1.3822, -0.77857, 0.062767, -0.0020322];
const SMALL_MAX: usize = 11;
// From 12 values on: the same in powers of ln n.
const LARGE_MEAN: [f64; 4] = [-1.5861, -0.31082, -0.083751, 0.0038915];
const LARGE_LN_SD: [f64; 3] = [-0.4803, -0.082676, 0.0030302];

/// W and its p value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ShapiroWilk {
    /// Number of values.
    pub n: usize,
    /// From 0 to 1; 1 for values spaced like the expected order statistics of a normal sample.
    pub w: f64,
    /// The probability of a smaller W for normal values. 0 where, for 11 values or fewer, W is
    /// below everything the approximation can express.
    pub p: f64,
}

/// Tests whether values are a sample of a normal distribution.
///
/// # Errors
/// With fewer than 3 or more than 5000 values, or values that are not finite or do not differ.
pub fn shapiro_wilk(values: &[f64]) -> Result<ShapiroWilk, Undefined> {
    let n = checked(values, 3)?.len();
    if n > VALUES_MAX {
        return Err(Undefined::TooMany { found: n, limit: VALUES_MAX });
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let range = sorted[n - 1] - sorted[0];
    if range <= rounding(values.iter().copied()) {
        return Err(Undefined::NoSpread);
    }
    let (_, deviations) = centred(&sorted);
    let deviations: Vec<f64> = deviations.iter().map(|it| it / range).collect();

    let weights = weights(n);
    let upper = deviations.iter().rev().zip(deviations.iter());
    let along: f64 =
        weights.iter().zip(upper).map(|(weight, (high, low))| weight * (high - low)).sum();
    let total = (2.0 * sum_of_squares(&weights) * sum_of_squares(&deviations)).sqrt();
    // 1 - W, factorised: the difference of squares would cancel where W is close to 1.
    let rest = ((total - along) * (total + along) / (total * total)).max(0.0);
    Ok(ShapiroWilk { n, w: 1.0 - rest, p: p_value(n, rest) })
}

/// The weights of the largest value, the second largest, and so on; those of the smallest are their
/// negatives, and a median has none. Their squares sum to about one half.
fn weights(n: usize) -> Vec<f64> {
    if n == 3 {
        return vec![FRAC_1_SQRT_2];
    }
    // Blom's approximation of the expected order statistics of a normal sample.
    let expected =
        |rank: usize| -distributions::normal_quantile((rank as f64 - 0.375) / (n as f64 + 0.25));
    let scores: Vec<f64> = (1..=n / 2).map(expected).collect();
    let squares = 2.0 * sum_of_squares(&scores);
    let root = (n as f64).sqrt().recip();
    let fitted: &[[f64; 6]] = if n > 5 { &[OUTERMOST, SECOND] } else { &[OUTERMOST] };
    let mut weights: Vec<f64> = fitted
        .iter()
        .zip(&scores)
        .map(|(coefficients, score)| polynomial(coefficients, root) + score / squares.sqrt())
        .collect();
    let (outer, inner) = scores.split_at(fitted.len());
    // Scaled so that all squares sum to 1.
    let scale =
        ((squares - 2.0 * sum_of_squares(outer)) / (1.0 - 2.0 * sum_of_squares(&weights))).sqrt();
    weights.extend(inner.iter().map(|score| score / scale));
    weights
}

/// The probability that 1 - W is larger than `rest`.
fn p_value(n: usize, rest: f64) -> f64 {
    if n == 3 {
        // Exact (Shapiro & Wilk 1965, corollary 4): W is at least 3/4.
        return ((1.0 - rest).sqrt().asin() - FRAC_PI_3).max(0.0) / FRAC_PI_6;
    }
    let y = rest.ln();
    let (z, mean, ln_sd) = if n <= SMALL_MAX {
        let n = n as f64;
        let bound = polynomial(&SMALL_BOUND, n);
        if y >= bound {
            return 0.0;
        }
        (-(bound - y).ln(), polynomial(&SMALL_MEAN, n), polynomial(&SMALL_LN_SD, n))
    } else {
        let log_n = (n as f64).ln();
        (y, polynomial(&LARGE_MEAN, log_n), polynomial(&LARGE_LN_SD, log_n))
    };
    distributions::normal_upper((z - mean) / ln_sd.exp())
}

/// Evaluates a polynomial whose constant term comes first.
fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_values_have_the_exact_distribution() {
        // Three values in equal steps are as straight as possible: W = 1. With two equal ones, W =
        // 3/4.
        let straight = shapiro_wilk(&[1.0, 2.0, 3.0]).unwrap();
        assert!((straight.w - 1.0).abs() < 1e-15 && (straight.p - 1.0).abs() < 1e-7);
        let bent = shapiro_wilk(&[1.0, 1.0, 3.0]).unwrap();
        assert!((bent.w - 0.75).abs() < 1e-15 && bent.p < 1e-15);
    }

    #[test]
    fn neither_order_nor_unit_nor_offset_matters() {
        let values = [148.0, 154.0, 158.0, 160.0, 161.0, 162.0, 166.0, 170.0, 182.0, 195.0, 236.0];
        let it = shapiro_wilk(&values).unwrap();
        // Men's weights, the example of Shapiro & Wilk (1965): W = 0.79, p < 0.01.
        assert!((it.w - 0.79).abs() < 0.005 && it.p < 0.01, "{it:?}");
        let mut other = values.map(|it| 1e6 - 0.5 * it);
        other.swap(0, 7);
        let other = shapiro_wilk(&other).unwrap();
        assert!((other.w - it.w).abs() < 1e-14 && (other.p / it.p - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_tested_is_refused() {
        assert_eq!(shapiro_wilk(&[1.0, 2.0]), Err(Undefined::TooFew { found: 2, needed: 3 }));
        let many = vec![1.0; 5001];
        assert_eq!(shapiro_wilk(&many), Err(Undefined::TooMany { found: 5001, limit: 5000 }));
        assert_eq!(shapiro_wilk(&many[..9]), Err(Undefined::NoSpread));
        assert_eq!(shapiro_wilk(&[1e6, 1e6 + 1e-10, 1e6]), Err(Undefined::NoSpread));
        assert_eq!(shapiro_wilk(&[1.0, f64::INFINITY, 3.0]), Err(Undefined::NotFinite(1)));
    }

    #[test]
    fn one_value_that_differs_is_far_from_normal() {
        let mut values = [0.0; 11];
        values[4] = 1.0;
        let it = shapiro_wilk(&values).unwrap();
        assert!(it.w < 0.4 && it.p < 1e-6, "{it:?}");
    }
}
