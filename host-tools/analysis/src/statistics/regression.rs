//! The least-squares line through pairs of values.

use serde::Serialize;

use super::{Undefined, centred, checked_pairs, distributions, rounding, sum_of_squares};

/// y = intercept + slope x, with the standard errors that follow from the residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Line {
    /// Number of pairs.
    pub n: usize,
    /// The number of independent pairs that would be as informative.
    pub effective_samples: f64,
    /// Change of y per unit of x.
    pub slope: f64,
    /// Its standard error.
    pub slope_se: f64,
    /// Its 95 % confidence interval.
    pub slope_ci95: [f64; 2],
    /// y at x = 0.
    pub intercept: f64,
    /// Its standard error.
    pub intercept_se: f64,
    /// Its 95 % confidence interval.
    pub intercept_ci95: [f64; 2],
    /// Standard deviation of the residuals, with n - 2.
    pub residual_sd: f64,
    /// Pearson's correlation and its p value; `None` where y does not vary.
    pub correlation: Option<Correlation>,
}

/// Pearson's correlation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Correlation {
    /// From -1 to 1.
    pub r: f64,
    /// The fraction of y's variance that the line explains.
    pub r_squared: f64,
    /// Two-sided p for no correlation, which is also that for a slope of 0.
    pub p: f64,
}

/// Fits a line to pairs of values.
///
/// Samples of a movement taken many times per second are not independent and carry less information
/// than their number suggests. With `effective_samples` independent ones, the variances of slope
/// and intercept are those of n pairs times n / effective_samples, and Student's t has
/// effective_samples - 2 degrees of freedom; with n it is the ordinary regression.
///
/// # Errors
/// With fewer than three pairs, values that are not finite, an x that does not vary, or unless 2 <
/// `effective_samples` <= n.
pub fn line(x: &[f64], y: &[f64], effective_samples: f64) -> Result<Line, Undefined> {
    checked_pairs(x, y, 3)?;
    let n = x.len() as f64;
    if !(effective_samples > 2.0 && effective_samples <= n) {
        return Err(Undefined::EffectiveSamples(effective_samples));
    }
    let ((x_mean, x_rest), (y_mean, y_rest)) = (centred(x), centred(y));
    let (xx, yy) = (sum_of_squares(&x_rest), sum_of_squares(&y_rest));
    let is_constant =
        |squares: f64, values: &[f64]| squares <= n * rounding(values.iter().copied()).powi(2);
    if is_constant(xx, x) {
        return Err(Undefined::NoSpread);
    }
    let xy: f64 = x_rest.iter().zip(&y_rest).map(|(x, y)| x * y).sum();
    let slope = xy / xx;
    let intercept = y_mean - slope * x_mean;
    let residuals: f64 = x_rest.iter().zip(&y_rest).map(|(x, y)| (y - slope * x).powi(2)).sum();
    let residual_sd = (residuals / (n - 2.0)).sqrt();

    let df = effective_samples - 2.0;
    let mean_se = residual_sd / effective_samples.sqrt();
    let slope_se = mean_se / (xx / n).sqrt();
    let intercept_se = mean_se.hypot(slope_se * x_mean);
    let reach = distributions::t_quantile(0.975, df);
    let around = |value: f64, se: f64| [value - reach * se, value + reach * se];
    let correlation = (!is_constant(yy, y)).then(|| {
        let r = (xy / (xx * yy).sqrt()).clamp(-1.0, 1.0);
        Correlation { r, r_squared: r * r, p: distributions::t_two_sided(slope / slope_se, df) }
    });
    Ok(Line {
        n: x.len(),
        effective_samples,
        slope,
        slope_se,
        slope_ci95: around(slope, slope_se),
        intercept,
        intercept_se,
        intercept_ci95: around(intercept, intercept_se),
        residual_sd,
        correlation,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: [f64; 4] = [1.0, 2.0, 3.0, 4.0];

    #[test]
    fn a_small_example_by_hand() {
        // Sxx 5, Sxy 4, Syy 5: slope 0.8, residual sum of squares 5 - 16/5 = 1.8 with 2 degrees of
        // freedom.
        let it = line(&X, &[1.0, 3.0, 2.0, 4.0], 4.0).unwrap();
        assert!((it.slope - 0.8).abs() < 1e-15 && (it.intercept - 0.5).abs() < 1e-15);
        assert!((it.residual_sd.powi(2) - 0.9).abs() < 1e-14);
        assert!((it.slope_se.powi(2) - 0.18).abs() < 1e-14);
        assert!((it.intercept_se.powi(2) - 0.9 * (0.25 + 6.25 / 5.0)).abs() < 1e-14);
        let correlation = it.correlation.unwrap();
        assert!((correlation.r - 0.8).abs() < 1e-15);
        // With two degrees of freedom the tail of Student's t has a closed form, and p = 1 - |r|.
        assert!((correlation.p - 0.2).abs() < 1e-14);
        // The t quantile for two degrees of freedom: q = 0.95 / sqrt(2 * 0.975 * 0.025).
        let q = 0.95 / (2.0_f64 * 0.975 * 0.025).sqrt();
        assert!(((it.slope_ci95[1] - it.slope) / (q * it.slope_se) - 1.0).abs() < 1e-13);
    }

    #[test]
    fn fewer_effective_samples_widen_the_intervals_alone() {
        let x: Vec<f64> = (0..200).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 * x + (x * 1.7).sin()).collect();
        let (all, quarter) = (line(&x, &y, 200.0).unwrap(), line(&x, &y, 50.0).unwrap());
        assert_eq!((all.slope, all.residual_sd), (quarter.slope, quarter.residual_sd));
        assert!((quarter.slope_se / all.slope_se - 2.0).abs() < 1e-14);
        assert!((quarter.intercept_se / all.intercept_se - 2.0).abs() < 1e-14);
        let q = distributions::t_quantile(0.975, 48.0);
        let reach = quarter.slope_ci95[1] - quarter.slope;
        assert!((reach / (q * quarter.slope_se) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_has_no_line_is_refused() {
        assert_eq!(line(&[0.1; 4], &X, 4.0), Err(Undefined::NoSpread));
        assert_eq!(line(&X, &X[1..], 3.0), Err(Undefined::Lengths(4, 3)));
        let few = Err(Undefined::TooFew { found: 2, needed: 3 });
        assert_eq!(line(&X[..2], &X[..2], 2.0), few);
        for count in [2.0, 4.1, f64::NAN] {
            assert!(matches!(line(&X, &X, count), Err(Undefined::EffectiveSamples(_))));
        }
    }

    #[test]
    fn a_level_line_has_no_correlation_and_a_perfect_one_is_certain() {
        let level = line(&X, &[0.1; 4], 4.0).unwrap();
        assert_eq!((level.slope, level.slope_se, level.correlation), (0.0, 0.0, None));
        let perfect = line(&X, &X.map(|x| 3.0 - 2.0 * x), 4.0).unwrap();
        let correlation = perfect.correlation.unwrap();
        assert_eq!((perfect.slope, correlation.r, correlation.p), (-2.0, -1.0, 0.0));
    }
}
