//! From one figure per trial to the statistics of a study.
//!
//! ```text
//! observations ─▶ within ─┬─▶ describe           means and errors, Cohen's d
//!                         ├─▶ paired             t tests, Bonferroni
//!                         ├─▶ anova              repeated measures, sphericity
//!                         └─▶ ranks              the same without normality
//! pairs of values ────────┬─▶ regression
//!                         └─▶ bland_altman       limits of agreement
//! any values ─────────────┬─▶ shapiro_wilk
//!                         └─▶ quantiles          percentiles and how well they are known
//! within ───────────────────▶ inference          all of it, of one response
//! p values of many responses ▶ multiplicity      adjusted for their number
//! ```
//!
//! Sums are taken after centring, so that a large offset costs no precision. A spread no larger
//! than the rounding of the values counts as none ([`Undefined::NoSpread`]): a test on it would
//! report an enormous statistic.

pub mod anova;
pub mod bland_altman;
pub mod describe;
pub mod distributions;
pub mod inference;
pub mod multiplicity;
pub mod paired;
pub mod quantiles;
pub mod ranks;
pub mod regression;
pub mod shapiro_wilk;
#[cfg(test)]
mod testing;
pub mod within;

use std::fmt;

/// Eigenvalues of a covariance below this fraction of the largest are rounding.
const SINGULAR: f64 = 1e-10;

/// Why a statistic is not defined for its input.
#[derive(Debug, Clone, PartialEq)]
pub enum Undefined {
    /// There are fewer values, or subjects, than needed.
    TooFew {
        /// The number found.
        found: usize,
        /// The least number needed.
        needed: usize,
    },
    /// There are more values than the statistic is defined for.
    TooMany {
        /// The number found.
        found: usize,
        /// The largest number allowed.
        limit: usize,
    },
    /// Two columns that belong together have different lengths.
    Lengths(usize, usize),
    /// The value at this index is not a number, or beyond 1e100.
    NotFinite(usize),
    /// The values do not differ by more than their own rounding.
    NoSpread,
    /// The ranks of all subjects differ in the same way, which leaves nothing to judge chance by.
    EqualRanks,
    /// This factor has only one level: there is nothing to compare.
    OneLevel(String),
    /// The number of effective samples exceeds that of the samples, or is too small.
    EffectiveSamples(f64),
}

impl fmt::Display for Undefined {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew { found, needed } => {
                write!(formatter, "only {found}, but {needed} are needed")
            }
            Self::TooMany { found, limit } => {
                write!(formatter, "{found}, but at most {limit} are allowed")
            }
            Self::Lengths(left, right) => write!(formatter, "{left} values against {right}"),
            Self::NotFinite(index) => write!(formatter, "value {index} is not a number"),
            Self::NoSpread => write!(formatter, "the values do not differ"),
            Self::EqualRanks => {
                write!(
                    formatter,
                    "the ranks of all subjects differ in the same way: there are too few"
                )
            }
            Self::OneLevel(factor) => write!(formatter, "{factor} has only one level"),
            Self::EffectiveSamples(count) => {
                write!(
                    formatter,
                    "{count} effective samples: too few, or more than there are samples"
                )
            }
        }
    }
}

impl std::error::Error for Undefined {}

/// Whether a value is finite and small enough that its powers do not overflow.
fn is_number(value: f64) -> bool {
    value.abs() < 1e100
}

/// Checks that the values are finite, and that there are at least this many.
fn checked(values: &[f64], needed: usize) -> Result<&[f64], Undefined> {
    if let Some(at) = values.iter().position(|&value| !is_number(value)) {
        return Err(Undefined::NotFinite(at));
    }
    if values.len() < needed {
        return Err(Undefined::TooFew { found: values.len(), needed });
    }
    Ok(values)
}

/// Checks two columns of one table in the same way as [`checked`].
fn checked_pairs(x: &[f64], y: &[f64], needed: usize) -> Result<(), Undefined> {
    if x.len() != y.len() {
        return Err(Undefined::Lengths(x.len(), y.len()));
    }
    checked(x, needed)?;
    checked(y, needed)?;
    Ok(())
}

/// Checks that a table has effects to test: at least two subjects, and two levels of each factor.
fn checked_factors(design: &within::WithinDesign) -> Result<(), Undefined> {
    if let Some(factor) = design.factors().iter().find(|factor| factor.levels.len() < 2) {
        return Err(Undefined::OneLevel(factor.name.clone()));
    }
    match design.subjects().len() {
        found @ ..2 => Err(Undefined::TooFew { found, needed: 2 }),
        _ => Ok(()),
    }
}

/// The largest difference at which numbers computed from these few values count as equal: some
/// units in the last place of the largest.
fn rounding(values: impl IntoIterator<Item = f64>) -> f64 {
    8.0 * f64::EPSILON
        * values.into_iter().fold(0.0, |largest: f64, value| largest.max(value.abs()))
}

/// The mean, and the values minus the mean. Centres twice: the second pass removes the rounding
/// left by the first.
fn centred(values: &[f64]) -> (f64, Vec<f64>) {
    let count = values.len() as f64;
    let first = values.iter().sum::<f64>() / count;
    let rest = values.iter().map(|value| value - first).sum::<f64>() / count;
    let mean = first + rest;
    (mean, values.iter().map(|value| value - mean).collect())
}

/// The sum of the squares.
fn sum_of_squares(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}
