//! What the noise of the positions does to the figures.
//!
//! The noise is given by the covariance of each position's error along AP, ML and SI, as the
//! poses have it. It is taken to be normal, and independent from frame to frame; errors that
//! last, such as those of a calibration, are not in it.
//!
//! - **The path of noise alone** is what a point at rest would seem to move. A step has the
//!   covariance that [the filter makes of it](crate::filter::SavitzkyGolay::step_variances); with
//!   standard deviations `a >= b` along its principal axes, its mean length is
//!   `a sqrt(2/pi) E(1 - b^2/a^2)`, `E` the complete elliptic integral of the second kind by its
//!   parameter m (`E(1) = 1` for one axis). Exact.
//! - **The inflation** is what noise adds to the path of a point that moves. The true steps are
//!   taken to be the measured ones, shortened by one common factor, such that the mean length of
//!   `true step + noise` adds up to the measured path. Shortening matters: with the measured
//!   steps themselves, noise would be counted twice. It is right both for noise alone (all of the
//!   path is inflation) and for steps far beyond the noise, in between to the extent that true
//!   steps are distributed as the measured ones. The means over the noise are a seeded Monte
//!   Carlo in pairs of opposite noise.
//! - **The standard uncertainty** of every figure is the standard deviation of that figure over
//!   copies of the trial with noise added once more, through the same filter: a seeded Monte
//!   Carlo too. With n copies it is known to a part in `sqrt(2 (n - 1))`. It is the spread that
//!   noise causes and not the bias, which for a path is the inflation.
//!
//! The copies take ten to forty times as long as the figures themselves, forty for a minute at
//! 60 Hz and ten for an hour.

use std::fmt;
use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::figure::{ByDirection, Figure, Figures};
use super::path::{Span, length, steps};
use crate::filter::SavitzkyGolay;
use crate::series::{Axis, Series};

/// The same trial always gives the same figures.
const SEED: u64 = 1;

/// Copies of the trial: enough for this many samples together, within these limits. Ten tell
/// the uncertainty to a quarter, forty to a ninth.
const COPIED_SAMPLES: usize = 400_000;
const COPIES_MIN: usize = 10;
const COPIES_MAX: usize = 40;

/// Pairs of opposite noises for each step: enough for this many together, within these limits.
const PAIRED_STEPS: usize = 100_000;
const PAIRS_MAX: usize = 256;

/// A covariance may be negative by so much of its trace: rounding of 32-bit poses.
const ROUNDING: f64 = 1e-6;

/// The errors of a series' positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Lower triangular factors of the covariances of the samples, mm.
    factors: Vec<Matrix3<f64>>,
}

/// Why covariances cannot be used as noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseError {
    /// Another number than there are samples.
    Length,
    /// The covariance of this sample is not finite, not symmetric or has a negative variance in
    /// some direction.
    NoCovariance(usize),
}

impl fmt::Display for NoiseError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length => write!(formatter, "there are not as many covariances as samples"),
            Self::NoCovariance(index) => {
                write!(formatter, "what is given for sample {index} is not a covariance")
            }
        }
    }
}

impl std::error::Error for NoiseError {}

impl Noise {
    /// Of each sample of `series`: covariance along AP, ML and SI, mm². What it says of an axis that
    /// was not measured does not matter.
    ///
    /// # Errors
    /// When there are not as many as samples, or one is not a covariance.
    pub fn per_sample(
        series: &Series,
        covariance_mm2: &[Matrix3<f64>],
    ) -> Result<Self, NoiseError> {
        if covariance_mm2.len() != series.samples() {
            return Err(NoiseError::Length);
        }
        let all = covariance_mm2.iter().enumerate();
        let factors: Result<_, _> =
            all.map(|(at, it)| factor(it).ok_or(NoiseError::NoCovariance(at))).collect();
        Ok(Self { factors: factors? })
    }

    /// Checks that it is for this many samples.
    pub(super) fn fits(&self, samples: usize) -> bool {
        self.factors.len() == samples
    }

    /// Of the samples in these parts.
    pub(super) fn only(&self, kept: &[Range<usize>]) -> Self {
        let parts = kept.iter().filter_map(|part| self.factors.get(part.clone()));
        Self { factors: parts.flatten().copied().collect() }
    }
}

/// `L` of `L L^T`, also where the covariance is singular.
fn factor(covariance: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let tolerance = ROUNDING * covariance.trace();
    let asymmetric = (covariance - covariance.transpose()).abs().max() > tolerance;
    if !covariance.iter().all(|it| it.is_finite()) || asymmetric {
        return None;
    }
    let mut factor = Matrix3::zeros();
    for row in 0..3 {
        for column in 0..=row {
            let known: f64 = (0..column).map(|it| factor[(row, it)] * factor[(column, it)]).sum();
            let left: f64 = covariance[(row, column)] - known;
            factor[(row, column)] = if row == column {
                if left < -tolerance {
                    return None;
                }
                left.max(0.0).sqrt()
            } else if factor[(column, column)] > tolerance.sqrt() {
                left / factor[(column, column)]
            } else if left.abs() > tolerance.max(0.0).sqrt() * covariance[(row, row)].abs().sqrt() {
                // Correlated with what does not vary.
                return None;
            } else {
                0.0
            };
        }
    }
    Some(factor)
}

/// What noise does to the path within one span.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathNoise {
    /// The path that noise alone would give, mm.
    pub alone_mm: ByDirection<Figure>,
    /// How much of the measured path noise added, mm.
    pub inflation_mm: ByDirection<Figure>,
}

/// The covariance of the steps of a filtered series, mm²: lower triangular factors by the step's
/// first sample. Steps over gaps have none (zero).
pub(super) fn step_factors(
    noise: &Noise,
    series: &Series,
    filter: Option<&SavitzkyGolay>,
) -> Vec<Matrix3<f64>> {
    let mut factors = vec![Matrix3::zeros(); series.samples()];
    let through = |variances: &[f64]| match filter {
        Some(filter) => filter.step_variances(variances).unwrap_or_default(),
        None => variances.windows(2).map(|pair| pair[0] + pair[1]).collect(),
    };
    for segment in series.segments() {
        let covariances = noise.factors[segment.clone()].iter().map(|it| it * it.transpose());
        let covariances: Vec<Matrix3<f64>> = covariances.collect();
        let mut steps = vec![Matrix3::zeros(); segment.len() - 1];
        for (row, column) in [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)] {
            let of_samples: Vec<f64> = covariances.iter().map(|it| it[(row, column)]).collect();
            for (step, covariance) in steps.iter_mut().zip(through(&of_samples)) {
                (step[(row, column)], step[(column, row)]) = (covariance, covariance);
            }
        }
        for (to, covariance) in factors[segment.start..].iter_mut().zip(&steps) {
            // A sum of covariances is one, up to rounding that the factor forgives.
            *to = factor(covariance).unwrap_or_default();
        }
    }
    factors
}

/// What noise does to the path within a span of a filtered series.
pub(super) fn path_noise(series: &Series, span: &Span, step_factors: &[Matrix3<f64>]) -> PathNoise {
    let draws = Draws::of(span, step_factors);
    PathNoise {
        alone_mm: ByDirection::of(|first, second| {
            let mean = |at: &usize| mean_length(&step_factors[*at], first, second);
            let measured = steps(series, span, first, second);
            measured.map(|_| span.steps.iter().map(mean).sum()).into()
        }),
        inflation_mm: ByDirection::of(|first, second| {
            let measured = steps(series, span, first, second);
            measured.map(|measured| draws.inflation(&measured, first, second)).into()
        }),
    }
}

/// The mean length of a vector along one or two axes of which `factor` is the factor of the
/// covariance.
fn mean_length(factor: &Matrix3<f64>, first: Axis, second: Option<Axis>) -> f64 {
    let covariance = |a: Axis, b: Axis| factor.row(a as usize).dot(&factor.row(b as usize));
    let (greater, lesser) = match second {
        None => (covariance(first, first), 0.0),
        Some(second) => {
            let (a, b) = (covariance(first, first), covariance(second, second));
            let spread = ((a - b) / 2.0).hypot(covariance(first, second));
            (f64::midpoint(a, b) + spread, (f64::midpoint(a, b) - spread).max(0.0))
        }
    };
    if greater <= 0.0 {
        return 0.0;
    }
    (greater * core::f64::consts::FRAC_2_PI).sqrt() * elliptic_e(1.0 - lesser / greater)
}

/// The complete elliptic integral of the second kind of parameter `m`, 0 to 1, by the
/// arithmetic-geometric mean (Abramowitz & Stegun 17.6).
fn elliptic_e(m: f64) -> f64 {
    if m >= 1.0 {
        return 1.0;
    }
    let (mut a, mut b) = (1.0, (1.0 - m).sqrt());
    let (mut power, mut sum) = (0.5, m / 2.0);
    // Digits double each time: from the worst m below 1, eight suffice.
    for _doubling in 0..8 {
        let c: f64 = (a - b) / 2.0;
        (a, b) = (f64::midpoint(a, b), (a * b).sqrt());
        power *= 2.0;
        sum += power * c * c;
    }
    core::f64::consts::FRAC_PI_2 / a * (1.0 - sum)
}

/// Noises of a span's steps: several for each step, each of which stands for its opposite too.
struct Draws {
    noises_mm: Vec<Vector3<f64>>,
    pairs: usize,
}

impl Draws {
    fn of(span: &Span, step_factors: &[Matrix3<f64>]) -> Self {
        let pairs = (PAIRED_STEPS / span.steps.len().max(1)).clamp(1, PAIRS_MAX);
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let steps = span.steps.iter().flat_map(|at| std::iter::repeat_n(*at, pairs));
        let noises_mm = steps.map(|at| step_factors[at] * normal(&mut random)).collect();
        Self { noises_mm, pairs }
    }

    /// The path of the measured steps, less that of the shortened ones.
    fn inflation(&self, measured: &[[f64; 2]], first: Axis, second: Option<Axis>) -> f64 {
        let measured_mm = length(measured);
        // The mean path of the steps times `factor` with noise, and its derivative by the factor.
        let path = |factor: f64| -> (f64, f64) {
            let (mut sum, mut slope) = (0.0, 0.0);
            for (step, noises_mm) in measured.iter().zip(self.noises_mm.chunks(self.pairs)) {
                for noise in noises_mm {
                    let noise = [
                        noise[first as usize],
                        second.map_or(0.0, |second| noise[second as usize]),
                    ];
                    for sign in [1.0, -1.0] {
                        let [x, y] = [0, 1].map(|it| factor * step[it] + sign * noise[it]);
                        let distance = (x * x + y * y).sqrt();
                        sum += distance;
                        if distance > 0.0 {
                            slope += (x * step[0] + y * step[1]) / distance;
                        }
                    }
                }
            }
            let count = 2.0 * self.pairs as f64;
            (sum / count, slope / count)
        };
        // The path grows with the factor, and ever faster, from that of noise alone; at 1 it is
        // no shorter than what was measured. So Newton's method from 1 comes down to the root and
        // does not pass it, or to 0, where the measured path is no longer than that of noise.
        let mut factor = 1.0;
        for _step in 0..NEWTON_STEPS {
            let (mm, slope) = path(factor);
            let next: f64 = if slope > 0.0 { factor - (mm - measured_mm) / slope } else { 0.0 };
            let next = next.clamp(0.0, 1.0);
            let done = (factor - next).abs() < FACTOR_TOLERANCE;
            factor = next;
            if done {
                break;
            }
        }
        (1.0 - factor) * measured_mm
    }
}

/// Far more than Newton's method takes.
const NEWTON_STEPS: usize = 30;

/// Of the factor: of the path, a millionth.
const FACTOR_TOLERANCE: f64 = 1e-6;

fn normal(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(random))
}

/// Sets the standard uncertainty of all figures: `measure` gives them anew for positions with
/// more noise. The number of copies of the trial that it took.
pub(super) fn uncertainties<T: Figures>(
    figures: &mut T,
    noise: &Noise,
    series: &Series,
    filter: Option<&SavitzkyGolay>,
    measure: impl Fn(&Series) -> Option<T>,
) -> usize {
    let copies = (COPIED_SAMPLES / series.samples()).clamp(COPIES_MIN, COPIES_MAX);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    // Running mean and sum of squares (Welford 1962); a figure that a copy does not have is not
    // a number in either.
    let mut spreads: Vec<(f64, f64)> = Vec::new();
    for copy in 1..=copies {
        let noisy = noisy(noise, series, filter, &mut random);
        let Some(mut noisy) = noisy.and_then(|noisy| measure(&noisy)) else { return 0 };
        let mut index = 0;
        noisy.each(&mut |figure| {
            if copy == 1 {
                spreads.push((0.0, 0.0));
            }
            if let Some((mean, squares)) = spreads.get_mut(index) {
                let value = figure.value().unwrap_or(f64::NAN);
                let change = value - *mean;
                *mean += change / copy as f64;
                *squares += change * (value - *mean);
            }
            index += 1;
        });
    }
    let mut spreads = spreads.into_iter();
    figures.each(&mut |figure| {
        let sd = spreads.next().map(|(_, squares)| (squares / (copies - 1) as f64).sqrt());
        if let Figure::Known { noise_sd, .. } = figure {
            *noise_sd = sd.filter(|sd| sd.is_finite());
        }
    });
    copies
}

/// The filtered series with filtered noise added.
fn noisy(
    noise: &Noise,
    series: &Series,
    filter: Option<&SavitzkyGolay>,
    random: &mut ChaCha8Rng,
) -> Option<Series> {
    let noises_mm: Vec<Vector3<f64>> =
        noise.factors.iter().map(|factor| factor * normal(random)).collect();
    let positions = |axis: Axis| -> Option<Vec<f64>> {
        let Some(positions_mm) = series.along(axis) else { return Some(Vec::new()) };
        let mut noisy_mm = Vec::with_capacity(positions_mm.len());
        for segment in series.segments() {
            let part = noises_mm[segment.clone()].iter().map(|it| it[axis as usize]);
            let part: Vec<f64> = part.collect();
            let part: Vec<f64> = match filter {
                Some(filter) => filter.smooth(&part)?,
                None => part,
            };
            noisy_mm.extend(positions_mm[segment].iter().zip(part).map(|(a, b)| a + b));
        }
        Some(noisy_mm)
    };
    let [ap, ml, si] = Axis::ALL.map(positions);
    series.with_positions([ap?, ml?, si?]).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elliptic_integral_is_the_tables() {
        // Abramowitz & Stegun, table 17.1, by m.
        for (m, expected) in [
            (0.0, core::f64::consts::FRAC_PI_2),
            (0.25, 1.467_462_209_339_427),
            (0.5, 1.350_643_881_047_675),
            (0.99, 1.015_993_545_025_224),
            (1.0, 1.0),
        ] {
            assert!((elliptic_e(m) - expected).abs() < 1e-14, "{m}: {}", elliptic_e(m));
        }
        // Near 1 it is 1 + (1 - m) (ln(16 / (1 - m)) - 1) / 4.
        let near: f64 = 1e-9;
        let expected = 1.0 + near * ((16.0 / near).ln() - 1.0) / 4.0;
        assert!((elliptic_e(1.0 - near) - expected).abs() < 1e-12, "{}", elliptic_e(1.0 - near));
    }
}
