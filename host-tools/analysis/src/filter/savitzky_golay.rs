//! The smoothing filter of Savitzky and Golay (1964, Anal. Chem. 36:1627), second order, as the
//! paper uses it on sway.
//!
//! Each sample is replaced by the value, at that sample, of the parabola that best fits the samples
//! around it. Near the ends, where one side has too few samples, the parabola of the first or last
//! whole window is used (scipy's `mode="interp"`). Samples are taken to be evenly spaced.
//!
//! # The window
//! The window is given in seconds and converted to samples: seconds times rate, rounded to a whole
//! number, plus one if that is even. The paper's half second is 15 samples at 30 Hz, 31 at 60 Hz
//! and 51 at 100 Hz. (The paper does not say how it counts: a window that *spans* half a second
//! would be 17 samples at 30 Hz.) Rounding first gives the same window at 59.99 and 60.01 Hz.

use nalgebra::{Matrix3, Vector3};

use super::Variance;

/// A shorter window does not smooth: a parabola passes through any three points, so callers whose
/// duration and rate give three samples would get their samples back unchanged.
pub const WINDOW_MIN: usize = 5;

/// Keeps a mistaken duration from taking hours: filtering costs samples times window.
pub const WINDOW_MAX: usize = 2001;

/// The number of outputs computed together, chosen so that they stay in the L1 cache.
const BLOCK: usize = 1024;

/// The filter for one window.
#[derive(Debug, Clone, PartialEq)]
pub struct SavitzkyGolay {
    /// The weight of each sample of a window in the value at its centre.
    weights: Vec<f64>,
    /// From a window's moments to the coefficients `c` of its parabola `c0 + c1 x + c2 x^2`, with
    /// `x` from -1 to 1.
    parabola_from_moments: Matrix3<f64>,
}

impl SavitzkyGolay {
    /// A filter with a window of this many samples; `None` when that is even, below 5 or above
    /// 2001.
    #[must_use]
    pub fn new(window: usize) -> Option<Self> {
        if window.is_multiple_of(2) || !(WINDOW_MIN..=WINDOW_MAX).contains(&window) {
            return None;
        }
        let normal: Matrix3<f64> = (0..window)
            .map(|index| powers(index, window) * powers(index, window).transpose())
            .sum();
        let parabola_from_moments = normal.try_inverse()?;
        let centre = powers(window / 2, window).transpose() * parabola_from_moments;
        let weights = (0..window).map(|index| (centre * powers(index, window)).x).collect();
        Some(Self { weights, parabola_from_moments })
    }

    /// A filter with a window of this many seconds: see [the window](self#the-window).
    #[must_use]
    pub fn lasting(window_s: f64, rate_hz: f64) -> Option<Self> {
        // NaN and negative values become 0 and are refused like other windows that are too short.
        let samples = (window_s * rate_hz).round() as usize;
        Self::new(samples | 1)
    }

    /// The number of samples in the window.
    #[must_use]
    pub fn window(&self) -> usize {
        self.weights.len()
    }

    /// Smooths evenly spaced samples; `None` when there are fewer than the window holds.
    #[must_use]
    pub fn smooth(&self, samples: &[f64]) -> Option<Vec<f64>> {
        let (window, half) = (self.window(), self.window() / 2);
        let last = samples.len().checked_sub(window)?;
        let mut smoothed = Vec::with_capacity(samples.len());
        let start = self.parabola(&samples[..window]);
        smoothed.extend((0..half).map(|index| powers(index, window).dot(&start)));
        smoothed.extend(weighted_sums(samples, &self.weights));
        let end = self.parabola(&samples[last..]);
        smoothed.extend((half + 1..window).map(|index| powers(index, window).dot(&end)));
        Some(smoothed)
    }

    /// As [`Filter::step_variances`](super::Filter::step_variances). For equal variances the factor
    /// is the filter's noise gain for a step: 2 without a filter, 0.0753^2 with 31 samples.
    #[must_use]
    pub fn step_variances<V: Variance>(&self, variances: &[V]) -> Option<Vec<V>> {
        let (window, half) = (self.window(), self.window() / 2);
        let last = variances.len().checked_sub(window)?;
        // Between two values of the same window's parabola.
        let in_window = |variances: &[V], index: usize| -> V {
            let step = (powers(index + 1, window) - powers(index, window)).transpose()
                * self.parabola_from_moments;
            let mut sum = V::default();
            for (sample, variance) in variances.iter().enumerate() {
                let weight = (step * powers(sample, window)).x;
                sum += *variance * (weight * weight);
            }
            sum
        };
        // Between the centres of neighbouring windows.
        let before = [0.0].iter().chain(&self.weights);
        let after = self.weights.iter().chain(&[0.0]);
        let squares: Vec<f64> = before.zip(after).map(|(b, a)| (b - a) * (b - a)).collect();
        let mut steps = Vec::with_capacity(variances.len() - 1);
        steps.extend((0..half).map(|index| in_window(&variances[..window], index)));
        steps.extend(weighted_sums(variances, &squares));
        steps.extend((half..window - 1).map(|index| in_window(&variances[last..], index)));
        Some(steps)
    }

    fn parabola(&self, window: &[f64]) -> Vector3<f64> {
        let terms = window.iter().enumerate();
        self.parabola_from_moments
            * terms
                .map(|(index, sample)| powers(index, window.len()) * *sample)
                .sum::<Vector3<f64>>()
    }
}

/// 1, x and x^2 at a sample of a window, where x runs from -1 to 1, so that the normal equations
/// are well conditioned.
fn powers(index: usize, window: usize) -> Vector3<f64> {
    let half = (window / 2) as f64;
    let x = (index as f64 - half) / half;
    Vector3::new(1.0, x, x * x)
}

/// The weighted sum at each position where all weights have a sample. It is computed weight by
/// weight over a block, which fills whole vector registers; sum by sum would use scalars.
fn weighted_sums<V: Variance>(samples: &[V], weights: &[f64]) -> Vec<V> {
    let mut sums = vec![V::default(); (samples.len() + 1).saturating_sub(weights.len())];
    for (block, sums) in sums.chunks_mut(BLOCK).enumerate() {
        for (offset, weight) in weights.iter().enumerate() {
            let samples = &samples[block * BLOCK + offset..];
            for (sum, sample) in sums.iter_mut().zip(samples) {
                *sum += *sample * *weight;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, sample by sample: the parabola of the nearest whole window.
    fn plainly(filter: &SavitzkyGolay, samples: &[f64]) -> Vec<f64> {
        let window = filter.window();
        let smoothed = (0..samples.len()).map(|index| {
            let start = index.saturating_sub(window / 2).min(samples.len() - window);
            let parabola = filter.parabola(&samples[start..start + window]);
            powers(index - start, window).dot(&parabola)
        });
        smoothed.collect()
    }

    fn close(value: f64, expected: f64, relative: f64) {
        assert!((value - expected).abs() <= relative * expected.abs(), "{value} {expected}");
    }

    #[test]
    fn parabolas_pass_unchanged_to_their_very_ends() {
        let samples: Vec<f64> =
            (0..40).map(f64::from).map(|t| 3.0 - 2.0 * t + 0.25 * t * t).collect();
        let smoothed = SavitzkyGolay::new(31).unwrap().smooth(&samples).unwrap();
        for (after, before) in smoothed.iter().zip(&samples) {
            assert!((after - before).abs() < 1e-9, "{after} {before}");
        }
    }

    #[test]
    fn the_weights_are_those_of_the_published_table() {
        // Savitzky and Golay, table I, five points: (-3, 12, 17, 12, -3) / 35.
        let filter = SavitzkyGolay::new(5).unwrap();
        for (value, expected) in filter.weights.iter().zip([-3.0, 12.0, 17.0, 12.0, -3.0]) {
            close(*value, expected / 35.0, 1e-13);
        }
    }

    #[test]
    fn blocks_give_what_the_definition_gives() {
        // Shorter than a block, one sample on either side of the end of a block, and longer.
        for samples in [31, 32, 1053, 1054, 1055, 2500] {
            let filter = SavitzkyGolay::new(31).unwrap();
            let samples: Vec<f64> =
                (0..samples).map(|i| (f64::from(i) * 0.37).sin() + f64::from(i % 7)).collect();
            let smoothed = filter.smooth(&samples).unwrap();
            assert_eq!(smoothed.len(), samples.len());
            for (value, expected) in smoothed.iter().zip(plainly(&filter, &samples)) {
                // About ten roundings of numbers up to 7.
                assert!((value - expected).abs() < 1e-13, "{value} {expected}");
            }
        }
    }

    #[test]
    fn a_step_has_the_published_noise_gain() {
        // In the interior: 2 x (3/35)^2 + 2 x (15/35)^2 + 2 x (5/35)^2 for five
        // points.
        let gains = SavitzkyGolay::new(5).unwrap().step_variances(&[1.0; 11]).unwrap();
        close(gains[5], 2.0 * (9.0 + 225.0 + 25.0) / 1225.0, 1e-13);
    }

    #[test]
    fn a_window_is_counted_in_samples() {
        let window =
            |window_s, rate_hz| SavitzkyGolay::lasting(window_s, rate_hz).map(|it| it.window());
        for rate_hz in [59.94, 60.0, 60.02] {
            assert_eq!(window(0.5, rate_hz), Some(31));
        }
        assert_eq!((window(0.5, 30.0), window(0.5, 100.0)), (Some(15), Some(51)));
        // Three samples; not a number; infinite.
        assert_eq!(
            (window(0.1, 30.0), window(f64::NAN, 30.0), window(-1.0, 30.0)),
            (None, None, None)
        );
        assert_eq!(window(f64::INFINITY, 30.0), None);
        assert_eq!((SavitzkyGolay::new(6), SavitzkyGolay::new(3)), (None, None));
        assert_eq!(SavitzkyGolay::new(31).unwrap().smooth(&[1.0; 30]), None);
        assert_eq!(SavitzkyGolay::new(31).unwrap().step_variances(&[1.0; 30]), None);
    }
}
