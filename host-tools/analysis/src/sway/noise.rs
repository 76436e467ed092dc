//! The effect of position noise on the figures.
//!
//! The noise is given as the covariance of each position's error along AP, ML and SI, as it comes
//! with the poses. It is taken to be normal and independent from frame to frame; lasting errors,
//! such as those of a calibration, are not included.
//!
//! - **The path of noise alone** is how far a point at rest would seem to move. A step has the
//!   covariance that [the filter makes of it](crate::filter::Filter::step_variances); with
//!   standard deviations `a >= b` along its principal axes, its mean length is
//!   `a sqrt(2/pi) E(1 - b^2/a^2)`, where `E` is the complete elliptic integral of the second kind
//!   as a function of the parameter m (`E(1) = 1` for one axis). Exact.
//! - **The inflation** is what noise adds to the path of a moving point. The true steps are taken
//!   to be the measured ones, shortened by one common factor chosen so that the mean lengths of
//!   `true step + noise` add up to the measured path. Without the shortening, noise would be
//!   counted twice. The result is correct for noise alone (the whole path is inflation) and for
//!   steps far larger than the noise; in between, to the extent that true steps are distributed
//!   like the measured ones. The means over the noise are a seeded Monte Carlo estimate with pairs
//!   of opposite noise.
//! - **The standard uncertainty** of every figure is its standard deviation over copies of the
//!   trial, each with noise added once more and passed through the same filter: also a seeded Monte
//!   Carlo estimate. With n copies its relative error is `1 / sqrt(2 (n - 1))`. It covers the
//!   spread that noise causes but not the bias, which for a path is the inflation.
//!
//! The copies take ten to forty times as long as the figures themselves: forty times for a minute
//! at 60 Hz and ten times for an hour.

use std::fmt;
use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::figure::{ByDirection, Figure, Figures};
use super::path::{Span, length, steps};
use crate::filter::Filter;
use crate::series::{Axis, Plane, Series};

/// Fixed, so that the same trial always gives the same figures.
const SEED: u64 = 1;

/// The number of copies of the trial: enough for this many samples in total, within these limits.
/// Ten copies give the uncertainty to within a quarter, forty to within a ninth.
const COPIED_SAMPLES: usize = 400_000;
const COPIES_MIN: usize = 10;
const COPIES_MAX: usize = 40;

/// The number of pairs of opposite noise per step: enough for this many in total, within these
/// limits.
const PAIRED_STEPS: usize = 100_000;
const PAIRS_MAX: usize = 256;

/// A variance may be negative by this fraction of the trace: rounding of 32-bit poses.
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
    /// The number of covariances differs from the number of samples.
    Length,
    /// The covariance of this sample is not finite, not symmetric or has a negative variance in
    /// some direction.
    NoCovariance(usize),
}

impl fmt::Display for NoiseError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length => {
                write!(formatter, "the number of covariances differs from that of samples")
            }
            Self::NoCovariance(index) => {
                write!(formatter, "the matrix given for sample {index} is not a covariance")
            }
        }
    }
}

impl std::error::Error for NoiseError {}

impl Noise {
    /// The noise of each sample of `series`: the covariance along AP, ML and SI, mm². Its entries
    /// for an axis that was not measured do not matter.
    ///
    /// # Errors
    /// When the numbers of covariances and samples differ, or one is not a covariance.
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

    /// Whether it is for this many samples.
    pub(super) fn fits(&self, samples: usize) -> bool {
        self.factors.len() == samples
    }

    /// The noise of the samples in these parts.
    pub(super) fn only(&self, kept: &[Range<usize>]) -> Self {
        let parts = kept.iter().filter_map(|part| self.factors.get(part.clone()));
        Self { factors: parts.flatten().copied().collect() }
    }
}

/// The factor `L` of `L L^T`, also for a singular covariance.
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
                // Correlated with an axis that does not vary.
                return None;
            } else {
                0.0
            };
        }
    }
    Some(factor)
}

/// The effect of noise on the path within one span.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathNoise {
    /// The path length that noise alone would give, mm.
    pub alone_mm: ByDirection<Figure>,
    /// The part of the measured path length that noise added, mm.
    pub inflation_mm: ByDirection<Figure>,
}

/// The covariances of the steps of a filtered series, mm²: lower triangular factors, indexed by the
/// step's first sample. Steps over gaps have none (zero).
pub(super) fn step_factors(noise: &Noise, series: &Series, filter: &Filter) -> Vec<Matrix3<f64>> {
    let mut factors = vec![Matrix3::zeros(); series.samples()];
    for segment in series.segments() {
        let covariances = noise.factors[segment.clone()].iter().map(|it| it * it.transpose());
        let covariances: Vec<Matrix3<f64>> = covariances.collect();
        let steps = filter.step_variances(&covariances).unwrap_or_default();
        for (to, covariance) in factors[segment.start..].iter_mut().zip(&steps) {
            // A sum of covariances is a covariance, up to rounding that `factor` tolerates.
            *to = factor(covariance).unwrap_or_default();
        }
    }
    factors
}

/// The effect of noise on the path within a span of a filtered series.
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
            measured.map(|it| draws.inflation(&it.collect::<Vec<_>>(), first, second)).into()
        }),
    }
}

/// How long a step in this plane is on average that noise alone makes, mm, for the covariance of the
/// step along AP, ML and SI, mm²; 0 for what is not a covariance.
#[must_use]
pub fn mean_step_mm(covariance_mm2: &Matrix3<f64>, plane: Plane) -> f64 {
    let [first, second] = plane.axes();
    mean_length(&factor(covariance_mm2).unwrap_or_default(), first, Some(second))
}

/// The mean length along one or two axes of a normal vector, where `factor` is the lower triangular
/// factor of its covariance.
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

/// The complete elliptic integral of the second kind with parameter `m`, 0 to 1, by the
/// arithmetic-geometric mean (Abramowitz & Stegun 17.6).
fn elliptic_e(m: f64) -> f64 {
    if m >= 1.0 {
        return 1.0;
    }
    let (mut a, mut b) = (1.0, (1.0 - m).sqrt());
    let (mut power, mut sum) = (0.5, m / 2.0);
    // The number of correct digits doubles each time: even for the worst m below 1, eight suffice.
    for _doubling in 0..8 {
        let c: f64 = (a - b) / 2.0;
        (a, b) = (f64::midpoint(a, b), (a * b).sqrt());
        power *= 2.0;
        sum += power * c * c;
    }
    core::f64::consts::FRAC_PI_2 / a * (1.0 - sum)
}

/// Noise for the steps of a span: several draws for each step, each of which also stands for its
/// opposite.
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

    /// The path of the measured steps minus that of the shortened ones.
    fn inflation(&self, measured: &[[f64; 2]], first: Axis, second: Option<Axis>) -> f64 {
        let measured_mm = length(measured.iter().copied());
        // The mean path of the steps times `factor` with noise, and its derivative with respect to
        // `factor`.
        let path = |factor: f64| -> (f64, f64) {
            let (mut sum, mut slope) = (0.0, 0.0);
            for (step, noises_mm) in measured.iter().zip(self.noises_mm.chunks(self.pairs)) {
                for noise in noises_mm {
                    let noise_x = noise[first as usize];
                    let noise_y = second.map_or(0.0, |second| noise[second as usize]);
                    for sign in [1.0, -1.0] {
                        let x = factor * step[0] + sign * noise_x;
                        let y = factor * step[1] + sign * noise_y;
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
        // The path length is an increasing, convex function of the factor, starting from that of
        // noise alone; at 1 it is no shorter than the measured one. Newton's method from 1
        // therefore descends to the root without passing it, or to 0 where the measured path is no
        // longer than that of noise.
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

/// Far more than Newton's method needs.
const NEWTON_STEPS: usize = 30;

/// The tolerance of the factor: a millionth of the path.
const FACTOR_TOLERANCE: f64 = 1e-6;

fn normal(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(random))
}

/// Sets the standard uncertainty of all figures: `measure` computes them again for positions with
/// more noise. Returns the number of copies of the trial that were used.
pub(super) fn uncertainties<T: Figures>(
    figures: &mut T,
    noise: &Noise,
    series: &Series,
    filter: &Filter,
    mut measure: impl FnMut(&Series) -> Option<T>,
) -> usize {
    let copies = (COPIED_SAMPLES / series.samples()).clamp(COPIES_MIN, COPIES_MAX);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    // Running mean and sum of squares (Welford 1962); for a figure that a copy lacks, both become
    // NaN.
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

/// The filtered series plus filtered noise.
fn noisy(
    noise: &Noise,
    series: &Series,
    filter: &Filter,
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
            let part = filter.smooth(&part)?;
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
