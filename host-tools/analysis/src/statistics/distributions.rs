//! Upper tails of the normal, t, F and chi-squared distributions, and quantiles of the normal, t
//! and chi-squared distributions.
//!
//! Tails keep their relative precision far out, where the cumulative function is 1: 1e-11 for F and
//! t with up to thousands of degrees of freedom, 5e-13 for the others, down to 1e-300
//! (`tests/oracles.rs`). The normal tail is libm's, because that of statrs has only ten digits. For
//! quantiles, the result of statrs is only a starting value, since its search stops early (at
//! 1.6e-7 for t with 50,000 degrees of freedom); Newton's method refines it.

use std::f64::consts::SQRT_2;

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};
use statrs::function::beta::beta_reg;
use statrs::function::gamma::gamma_ur;

/// P(Z > z) of the standard normal distribution.
#[must_use]
pub fn normal_upper(z: f64) -> f64 {
    0.5 * libm::erfc(z / SQRT_2)
}

/// P(T > t) of Student's t distribution.
///
/// # Panics
/// When `df` is not positive or `t` is not a number.
#[must_use]
pub fn t_upper(t: f64, df: f64) -> f64 {
    assert!(df > 0.0 && !t.is_nan());
    let half = 0.5 * t_two_sided(t, df);
    if t > 0.0 { half } else { 1.0 - half }
}

/// P(|T| > |t|): the two-sided p value.
///
/// # Panics
/// As [`t_upper`].
#[must_use]
pub fn t_two_sided(t: f64, df: f64) -> f64 {
    f_upper(t * t, 1.0, df)
}

/// P(F > f) of Fisher's F distribution. For infinite `df2` it is `chi_squared_upper(f * df1, df1)`.
///
/// # Panics
/// When a number of degrees of freedom is not positive and finite, or `f` is not a number.
#[must_use]
pub fn f_upper(f: f64, df1: f64, df2: f64) -> f64 {
    assert!(df1 > 0.0 && df2 > 0.0 && df1.is_finite() && df2.is_finite() && !f.is_nan());
    if f <= 0.0 {
        return 1.0;
    }
    beta_reg(0.5 * df2, 0.5 * df1, df2 / (df2 + df1 * f))
}

/// P(X > x) of the chi-squared distribution.
///
/// # Panics
/// When `df` is not positive and finite, or `x` is not a number.
#[must_use]
pub fn chi_squared_upper(x: f64, df: f64) -> f64 {
    assert!(df > 0.0 && df.is_finite() && !x.is_nan());
    if x <= 0.0 {
        return 1.0;
    }
    if x == f64::INFINITY {
        return 0.0;
    }
    gamma_ur(0.5 * df, 0.5 * x)
}

/// The p quantile of the standard normal distribution.
///
/// # Panics
/// When `p` is not between 0 and 1.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    symmetric_quantile(p, |tail| {
        let start = -Normal::standard().inverse_cdf(tail);
        polished(start, tail, normal_upper)
    })
}

/// The p quantile of Student's t distribution.
///
/// # Panics
/// When `p` is not between 0 and 1, or `df` is not positive and finite.
#[must_use]
pub fn t_quantile(p: f64, df: f64) -> f64 {
    let distribution = StudentsT::new(0.0, 1.0, df).expect("positive degrees of freedom");
    symmetric_quantile(p, |tail| {
        let start = -distribution.inverse_cdf(tail);
        polished(start, tail, |t| t_upper(t, df))
    })
}

/// The p quantile of the chi-squared distribution.
///
/// # Panics
/// When `p` is not between 0 and 1, or `df` is not positive and finite.
#[must_use]
pub fn chi_squared_quantile(p: f64, df: f64) -> f64 {
    assert!(p > 0.0 && p < 1.0);
    let distribution = ChiSquared::new(df).expect("positive degrees of freedom");
    polished(distribution.inverse_cdf(p), 1.0 - p, |x| chi_squared_upper(x, df))
}

/// A quantile of a distribution symmetric about 0, from the quantile by upper tails of at most one
/// half.
fn symmetric_quantile(p: f64, upper_quantile: impl Fn(f64) -> f64) -> f64 {
    assert!(p > 0.0 && p < 1.0);
    if p < 0.5 {
        -upper_quantile(p)
    } else if p > 0.5 {
        upper_quantile(1.0 - p)
    } else {
        0.0
    }
}

/// The point at which the upper tail is `tail`: two Newton steps from a start with six or more
/// digits. The slope is a difference of tails, within 1e-8 of the density.
fn polished(start: f64, tail: f64, upper: impl Fn(f64) -> f64) -> f64 {
    (0..2).fold(start, |x, _| {
        let step = 1e-4 * x;
        let density = (upper(x - step) - upper(x + step)) / (2.0 * step);
        x + (upper(x) - tail) / density
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_are_exact() {
        assert_eq!((normal_upper(0.0), t_upper(0.0, 7.0)), (0.5, 0.5));
        assert_eq!((f_upper(0.0, 2.0, 7.0), chi_squared_upper(-1.0, 3.0)), (1.0, 1.0));
        let far = f64::INFINITY;
        assert_eq!((f_upper(far, 2.0, 7.0), chi_squared_upper(far, 3.0)), (0.0, 0.0));
        assert_eq!((t_upper(far, 7.0), t_upper(-far, 7.0), normal_upper(far)), (0.0, 1.0, 0.0));
        assert_eq!((normal_quantile(0.5), t_quantile(0.5, 3.0)), (0.0, 0.0));
    }

    #[test]
    fn quantiles_of_chi_squared_are_where_its_tail_says() {
        for df in [1.0, 2.0, 9.0, 66.7, 5000.0] {
            for p in [0.025, 0.5, 0.975] {
                let tail = chi_squared_upper(chi_squared_quantile(p, df), df);
                // Ten digits of the tail.
                assert!((tail - (1.0 - p)).abs() < 1e-10, "{df}, {p}: {tail}");
            }
        }
        // With two degrees of freedom it is -2 ln(1 - p).
        assert!((chi_squared_quantile(0.975, 2.0) + 2.0 * 0.025_f64.ln()).abs() < 1e-9);
    }

    #[test]
    fn both_sides_are_alike() {
        assert_eq!(t_upper(-1.3, 5.0), 1.0 - t_upper(1.3, 5.0));
        assert_eq!(t_quantile(0.25, 5.0), -t_quantile(0.75, 5.0));
        assert_eq!(t_two_sided(-1.3, 5.0), 2.0 * t_upper(1.3, 5.0));
    }

    #[test]
    fn two_degrees_of_freedom_have_closed_forms() {
        // exp(-x / 2), and (1 + 2 f / m)^(-m / 2).
        assert!((chi_squared_upper(9.0, 2.0) / (-4.5_f64).exp() - 1.0).abs() < 1e-13);
        let (f, m) = (3.0, 5998.0);
        // The precision of the tail.
        assert!((f_upper(f, 2.0, m) / (1.0 + 2.0 * f / m).powf(-m / 2.0) - 1.0).abs() < 1e-11);
    }
}
