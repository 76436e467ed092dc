//! From one figure per trial to what a study can say about it.
//!
//! ```text
//! observations ─▶ within ─┬─▶ describe           means and errors, Cohen's d
//!                         ├─▶ paired             t tests, Bonferroni
//!                         ├─▶ anova              repeated measures, sphericity
//!                         └─▶ ranks              the same without normality
//! pairs of values ────────┬─▶ regression
//!                         └─▶ bland_altman       limits of agreement
//! any values ───────────────▶ shapiro_wilk
//! within ───────────────────▶ inference          all of it, of one response
//! ```
//!
//! Sums are taken after centring, so that a large offset costs no digits. A spread that is no
//! more than the rounding of the values themselves counts as none ([`Undefined::NoSpread`]): a
//! test on it would answer with an enormous statistic.

pub mod anova;
pub mod bland_altman;
pub mod describe;
pub mod distributions;
pub mod inference;
pub mod paired;
pub mod ranks;
pub mod regression;
pub mod shapiro_wilk;
#[cfg(test)]
mod testing;
pub mod within;

use std::fmt;

/// Eigenvalues of a covariance smaller than this share of the largest are rounding.
const SINGULAR: f64 = 1e-10;

/// Why a statistic is not defined for what was given.
#[derive(Debug, Clone, PartialEq)]
pub enum Undefined {
    /// It takes this many values, or subjects, at least.
    TooFew {
        /// How many there are.
        found: usize,
        /// How many it takes.
        needed: usize,
    },
    /// It is not defined beyond this many values.
    TooMany {
        /// How many there are.
        found: usize,
        /// How many it takes at most.
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
    /// This factor has one level: there is nothing to compare.
    OneLevel(String),
    /// More effective samples than samples, or too few.
    EffectiveSamples(f64),
}

impl fmt::Display for Undefined {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew { found, needed } => write!(formatter, "{found}, and it takes {needed}"),
            Self::TooMany { found, limit } => {
                write!(formatter, "{found}, and it is defined up to {limit}")
            }
            Self::Lengths(left, right) => write!(formatter, "{left} values against {right}"),
            Self::NotFinite(index) => write!(formatter, "value {index} is not a number"),
            Self::NoSpread => write!(formatter, "the values do not differ"),
            Self::EqualRanks => {
                write!(formatter, "the ranks of all subjects differ alike: there are too few")
            }
            Self::OneLevel(factor) => write!(formatter, "{factor} has one level only"),
            Self::EffectiveSamples(count) => {
                write!(formatter, "{count} effective samples: too few, or more than there are")
            }
        }
    }
}

impl std::error::Error for Undefined {}

/// Whether a value is a number, and one whose powers do not overflow.
fn is_number(value: f64) -> bool {
    value.abs() < 1e100
}

/// Checks that the values are finite, and at least this many.
fn checked(values: &[f64], needed: usize) -> Result<&[f64], Undefined> {
    if let Some(at) = values.iter().position(|&value| !is_number(value)) {
        return Err(Undefined::NotFinite(at));
    }
    if values.len() < needed {
        return Err(Undefined::TooFew { found: values.len(), needed });
    }
    Ok(values)
}

/// Two columns of one table, checked as [`checked`].
fn checked_pairs(x: &[f64], y: &[f64], needed: usize) -> Result<(), Undefined> {
    if x.len() != y.len() {
        return Err(Undefined::Lengths(x.len(), y.len()));
    }
    checked(x, needed)?;
    checked(y, needed)?;
    Ok(())
}

/// A table whose effects can be tested: two subjects or more, and two levels of each factor.
fn checked_factors(design: &within::WithinDesign) -> Result<(), Undefined> {
    if let Some(factor) = design.factors().iter().find(|factor| factor.levels.len() < 2) {
        return Err(Undefined::OneLevel(factor.name.clone()));
    }
    match design.subjects().len() {
        found @ ..2 => Err(Undefined::TooFew { found, needed: 2 }),
        _ => Ok(()),
    }
}

/// A difference up to which numbers computed from these few are equal: some units in the last
/// place of the largest.
fn rounding(values: impl IntoIterator<Item = f64>) -> f64 {
    8.0 * f64::EPSILON
        * values.into_iter().fold(0.0, |largest: f64, value| largest.max(value.abs()))
}

/// The mean, and the values less it. Centred twice: the second takes out the rounding that the
/// first has left.
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
