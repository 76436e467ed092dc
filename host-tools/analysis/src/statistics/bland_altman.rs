//! How far two methods of measurement disagree: bias and 95 % limits of agreement (Bland & Altman
//! 1986, 1999).

use serde::Serialize;

use super::regression::{Line, line};
use super::{Undefined, centred, checked_pairs, distributions, sum_of_squares};

/// The distance of the limits from the bias, in standard deviations.
const LIMIT_SDS: f64 = 1.96;

/// The agreement of a measurement with a reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BlandAltman {
    /// Number of pairs.
    pub n: usize,
    /// The number of independent pairs that would be as informative; the confidence intervals use
    /// it.
    pub effective_samples: f64,
    /// The mean of the differences, measured minus reference.
    pub bias: f64,
    /// Its 95 % confidence interval.
    pub bias_ci95: [f64; 2],
    /// Standard deviation of the differences, with n - 1.
    pub sd: f64,
    /// bias - 1.96 sd.
    pub lower_limit: Limit,
    /// bias + 1.96 sd.
    pub upper_limit: Limit,
    /// The proportional error: the regression line of the differences on the pairs' means. `None`
    /// where the means do not differ, or there are only two pairs.
    pub proportional: Option<Line>,
}

/// A limit of agreement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limit {
    /// The limit itself.
    pub value: f64,
    /// The usual 95 % confidence interval, value +- t sd sqrt(1 / n + 1.96^2 / (2 (n - 1))) (Bland
    /// & Altman 1999, without their approximation).
    pub ci95_approximate: [f64; 2],
    /// The exact interval, from the noncentral t distribution (Carkeet 2015): it reaches farther
    /// outwards than inwards.
    pub ci95_exact: [f64; 2],
}

/// Compares paired values of two methods.
///
/// Samples of a movement taken many times per second are not independent, and intervals that assume
/// independence are far too narrow: `effective_samples` is the number of independent ones. It does
/// not change the bias, sd and limits.
///
/// # Errors
/// With fewer than two pairs, values that are not finite, or unless 2 <= `effective_samples` <= n.
pub fn bland_altman(
    reference: &[f64],
    measured: &[f64],
    effective_samples: f64,
) -> Result<BlandAltman, Undefined> {
    checked_pairs(reference, measured, 2)?;
    let n = reference.len();
    if !(2.0..=n as f64).contains(&effective_samples) {
        return Err(Undefined::EffectiveSamples(effective_samples));
    }
    let pairs = || reference.iter().zip(measured);
    let differences: Vec<f64> = pairs().map(|(reference, measured)| measured - reference).collect();
    let means: Vec<f64> =
        pairs().map(|(reference, measured)| 0.5 * (measured + reference)).collect();
    let (bias, deviations) = centred(&differences);
    let sd = (sum_of_squares(&deviations) / (n - 1) as f64).sqrt();

    let df = effective_samples - 1.0;
    let t = distributions::t_quantile(0.975, df);
    let around = |value: f64, se: f64| [value - t * se, value + t * se];
    let bias_se = sd / effective_samples.sqrt();
    let limit_se = bias_se.hypot(LIMIT_SDS * sd / (2.0 * df).sqrt());
    let [inner, outer] = [0.025, 0.975].map(|p| limit_quantile(p, effective_samples) * sd);
    let limit = |value: f64, ci95_exact| Limit {
        value,
        ci95_approximate: around(value, limit_se),
        ci95_exact,
    };
    Ok(BlandAltman {
        n,
        effective_samples,
        bias,
        bias_ci95: around(bias, bias_se),
        sd,
        lower_limit: limit(bias - LIMIT_SDS * sd, [bias - outer, bias - inner]),
        upper_limit: limit(bias + LIMIT_SDS * sd, [bias + inner, bias + outer]),
        proportional: line(&means, &differences, effective_samples).ok(),
    })
}

/// The k for which the mean + k sd of n independent normal values exceeds their distribution's own
/// 1.96 sigma with probability `p`: the p quantile of the noncentral t distribution with n - 1
/// degrees of freedom and noncentrality 1.96 sqrt(n), divided by sqrt(n).
fn limit_quantile(p: f64, n: f64) -> f64 {
    let spread = SpreadDistribution::new(n - 1.0);
    let probability =
        |k: f64| spread.mean(|s| distributions::normal_upper(n.sqrt() * (LIMIT_SDS - k * s)));
    let (mut low, mut high) = (-LIMIT_SDS, 2.0 * LIMIT_SDS);
    while probability(high) < p {
        high *= 2.0;
    }
    // Bisects to the last bits.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *if probability(middle) < p { &mut low } else { &mut high } = middle;
    }
    0.5 * (low + high)
}

/// The distribution of sd / sigma in a normal sample, for averaging over it.
struct SpreadDistribution {
    /// Values and their probabilities.
    nodes: Vec<(f64, f64)>,
}

impl SpreadDistribution {
    /// In u = ln s the density is exp(df (u - e^2u / 2)) up to a factor. It and its derivatives
    /// vanish at both ends, so the trapezoidal rule converges faster than any power of its step.
    fn new(df: f64) -> Self {
        const NODES: usize = 400;
        // Beyond these ends the density is at most e^-45 of its maximum: on the right its logarithm
        // falls faster than -df u^2, on the left faster than the slower of that parabola and a
        // line.
        const DECAY: f64 = 45.0;
        let right = (DECAY / df).sqrt();
        let left = -right - DECAY / df;
        let node = |index: usize| {
            let u = left + (right - left) * index as f64 / NODES as f64;
            (u.exp(), (df * (u - 0.5 * (2.0 * u).exp_m1())).exp())
        };
        let mut nodes: Vec<(f64, f64)> = (0..=NODES).map(node).collect();
        let total: f64 = nodes.iter().map(|(_, weight)| weight).sum();
        nodes.iter_mut().for_each(|(_, weight)| *weight /= total);
        Self { nodes }
    }

    fn mean(&self, of: impl Fn(f64) -> f64) -> f64 {
        self.nodes.iter().map(|&(s, probability)| probability * of(s)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(n: usize) -> (Vec<f64>, Vec<f64>) {
        let reference: Vec<f64> = (0..n).map(|at| at as f64 * 0.1).collect();
        let measured = reference.iter().enumerate().map(|(at, it)| it + (at * at % 7) as f64);
        (reference.clone(), measured.collect())
    }

    #[test]
    fn fewer_effective_samples_widen_the_intervals_alone() {
        let (reference, measured) = pairs(400);
        let all = bland_altman(&reference, &measured, 400.0).unwrap();
        let few = bland_altman(&reference, &measured, 16.5).unwrap();
        assert_eq!((all.bias, all.sd), (few.bias, few.sd));
        assert_eq!(all.upper_limit.value, few.upper_limit.value);
        let width = |[low, high]: [f64; 2]| high - low;
        let t = |n: f64| distributions::t_quantile(0.975, n - 1.0) / n.sqrt();
        let ratio = width(few.bias_ci95) / width(all.bias_ci95);
        assert!((ratio / (t(16.5) / t(400.0)) - 1.0).abs() < 1e-13);
        // The exact and approximate intervals agree for many pairs; with few the exact one lies
        // outwards.
        let off = |it: Limit| (it.ci95_exact[0] - it.ci95_approximate[0]) / all.sd;
        assert!(off(all.upper_limit).abs() < 0.01 && off(few.upper_limit) > 0.1);
    }

    #[test]
    fn a_proportional_error_is_the_slope_over_the_means() {
        let (reference, _) = pairs(50);
        let measured: Vec<f64> = reference.iter().map(|it| 1.02 * it).collect();
        let line = bland_altman(&reference, &measured, 50.0).unwrap().proportional.unwrap();
        assert!((line.slope - 0.02 / 1.01).abs() < 1e-14 && line.intercept.abs() < 1e-14);
    }

    #[test]
    fn methods_that_agree_have_limits_at_their_bias() {
        let it = bland_altman(&[2.0; 5], &[3.0; 5], 5.0).unwrap();
        assert_eq!((it.bias, it.sd, it.proportional), (1.0, 0.0, None));
        assert_eq!((it.lower_limit.ci95_exact, it.upper_limit.value), ([1.0, 1.0], 1.0));
    }

    #[test]
    fn two_pairs_have_limits_and_no_line() {
        let it = bland_altman(&[1.0, 2.0], &[1.0, 4.0], 2.0).unwrap();
        assert!((it.sd - 2.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!((it.bias, it.proportional), (1.0, None));
        // With one degree of freedom almost nothing is known: sd / sigma may be 0.03.
        assert!(it.upper_limit.ci95_exact[1] > 50.0 * it.sd);
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let three = [1.0, 2.0, 3.0];
        assert_eq!(bland_altman(&three, &three[1..], 2.0), Err(Undefined::Lengths(3, 2)));
        for count in [1.9, 3.1, f64::NAN] {
            let refused = bland_altman(&three, &three, count);
            assert!(matches!(refused, Err(Undefined::EffectiveSamples(_))));
        }
        let error = bland_altman(&three, &[1.0, f64::NAN, 3.0], 3.0);
        assert_eq!(error, Err(Undefined::NotFinite(1)));
    }
}
