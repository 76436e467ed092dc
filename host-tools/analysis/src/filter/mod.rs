//! Low-pass filters for positions over time, none of which delays.
//!
//! ```text
//! Design ── at a rate ─▶ Filter ── on a series ─▶ Filtered
//! ```
//!
//! - [`SavitzkyGolay`], second order, half a second: the paper's, and the default.
//! - [`Butterworth`], forwards and backwards: the usual one in posturography.
//! - None: positions as they were measured.
//!
//! Samples are taken to be evenly spaced. Each filter says how it treats the ends.
//!
//! # Gaps
//! A filter that runs over a gap would invent positions, so each part without a gap is filtered
//! separately, with ends of its own. A part that is too short for the filter is left out, and its
//! samples are counted.

use std::fmt;
use std::ops::{AddAssign, Mul, Range};
use std::str::FromStr;

use serde::Serialize;

use crate::series::{Axis, Series};

pub mod butterworth;
pub mod savitzky_golay;

pub use butterworth::Butterworth;
pub use savitzky_golay::SavitzkyGolay;

/// A filter, whatever the rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Design {
    /// Positions stay as they were measured.
    None,
    /// Parabolas over a window: [`savitzky_golay`].
    SavitzkyGolay {
        /// The window, seconds.
        window_s: f64,
    },
    /// Two passes of a Butterworth filter: [`butterworth`].
    Butterworth {
        /// The cutoff frequency of each pass, Hz: both together halve the amplitude there.
        cutoff_hz: f64,
        /// The order of each pass; both together attenuate like a filter of twice this order.
        order: usize,
    },
}

impl Design {
    /// The paper's filter.
    pub const PAPER: Self = Self::SavitzkyGolay { window_s: 0.5 };

    /// The filter for series of this rate.
    ///
    /// # Errors
    /// When the design does not suit the rate.
    pub fn at(self, rate_hz: f64) -> Result<Filter, Unsuitable> {
        match self {
            Self::None => Ok(Filter::None),
            Self::SavitzkyGolay { window_s } => SavitzkyGolay::lasting(window_s, rate_hz)
                .map(Filter::SavitzkyGolay)
                .ok_or(Unsuitable::Window { window_s, rate_hz }),
            Self::Butterworth { cutoff_hz, order } => Butterworth::new(cutoff_hz, order, rate_hz)
                .map(Filter::Butterworth)
                .ok_or(Unsuitable::Butterworth { cutoff_hz, order, rate_hz }),
        }
    }
}

impl Default for Design {
    fn default() -> Self {
        Self::PAPER
    }
}

impl fmt::Display for Design {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(formatter, "none"),
            Self::SavitzkyGolay { window_s } => {
                write!(formatter, "Savitzky-Golay, second order, {window_s} s")
            }
            Self::Butterworth { cutoff_hz, order } => {
                write!(
                    formatter,
                    "Butterworth, {cutoff_hz} Hz, order {order} in each of two passes"
                )
            }
        }
    }
}

/// The order of each pass of a Butterworth filter unless another is given; of both together it is the
/// usual four.
const ORDER: usize = 2;

impl FromStr for Design {
    type Err = String;

    /// A filter by its name and its numbers, as in `paper:0.5`, `butterworth:10:2` or `none`; the
    /// error says what to give instead.
    fn from_str(text: &str) -> Result<Self, String> {
        let positive =
            |text: &str| text.parse::<f64>().ok().filter(|it| *it > 0.0 && it.is_finite());
        let parts: Vec<&str> = text.split(':').map(str::trim).collect();
        let design = match parts[..] {
            ["none"] => Some(Self::None),
            ["paper"] => Some(Self::PAPER),
            ["paper", window_s] => {
                positive(window_s).map(|window_s| Self::SavitzkyGolay { window_s })
            }
            ["butterworth", cutoff_hz] => {
                positive(cutoff_hz).map(|cutoff_hz| Self::Butterworth { cutoff_hz, order: ORDER })
            }
            ["butterworth", cutoff_hz, order] => positive(cutoff_hz)
                .zip(order.parse().ok())
                .map(|(cutoff_hz, order)| Self::Butterworth { cutoff_hz, order }),
            _ => None,
        };
        design.ok_or_else(|| {
            format!(
                "{text:?} is not a filter: give paper, paper:SECONDS, butterworth:HZ, \
                 butterworth:HZ:ORDER, or none, such as paper:0.5 or butterworth:10"
            )
        })
    }
}

/// Why a design does not suit the rate of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unsuitable {
    /// The window would have less than 5 samples, or more than 2001.
    Window {
        /// The window.
        window_s: f64,
        /// The series' rate.
        rate_hz: f64,
    },
    /// The order, or the cutoff at this rate, is out of bounds.
    Butterworth {
        /// The cutoff of each pass.
        cutoff_hz: f64,
        /// The order of each pass.
        order: usize,
        /// The series' rate.
        rate_hz: f64,
    },
}

impl fmt::Display for Unsuitable {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Window { window_s, rate_hz } => write!(
                formatter,
                "a filter of {window_s} s has fewer than {} or more than {} samples at \
                 {rate_hz:.1} Hz",
                savitzky_golay::WINDOW_MIN,
                savitzky_golay::WINDOW_MAX
            ),
            Self::Butterworth { cutoff_hz, order, rate_hz } => write!(
                formatter,
                "a Butterworth filter of order {order} at {cutoff_hz} Hz does not suit a rate of \
                 {rate_hz:.1} Hz: the order must be 1 to {}, and the frequency above {:.3} Hz and \
                 below {:.1} Hz",
                butterworth::ORDER_MAX,
                rate_hz / butterworth::RATE_PER_CUTOFF_MAX,
                rate_hz / 2.0
            ),
        }
    }
}

impl std::error::Error for Unsuitable {}

/// A filter for one rate.
#[derive(Debug, Clone, PartialEq)]
pub enum Filter {
    /// It changes nothing.
    None,
    /// Parabolas over a window.
    SavitzkyGolay(SavitzkyGolay),
    /// Two passes of a Butterworth filter.
    Butterworth(Butterworth),
}

/// The result of filtering a series.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// The filtered positions.
    pub series: Series,
    /// The parts of the original that were kept, each without a gap.
    pub kept: Vec<Range<usize>>,
    /// The number of samples in parts that are too short for the filter.
    pub left_out_samples: usize,
}

/// The variance of an error, or the covariance matrix of several.
pub trait Variance: Copy + Default + AddAssign + Mul<f64, Output = Self> {}

impl<V: Copy + Default + AddAssign + Mul<f64, Output = V>> Variance for V {}

impl Filter {
    /// The number of samples without a gap that it needs.
    #[must_use]
    pub fn samples_min(&self) -> usize {
        match self {
            Self::None => 1,
            Self::SavitzkyGolay(filter) => filter.window(),
            Self::Butterworth(filter) => filter.samples_min(),
        }
    }

    /// Smooths evenly spaced samples; `None` when there are too few.
    #[must_use]
    pub fn smooth(&self, samples: &[f64]) -> Option<Vec<f64>> {
        match self {
            Self::None => Some(samples.to_vec()),
            Self::SavitzkyGolay(filter) => filter.smooth(samples),
            Self::Butterworth(filter) => filter.smooth(samples),
        }
    }

    /// Smooths each part without a gap; `None` when every part is too short.
    #[must_use]
    pub fn apply(&self, series: &Series) -> Option<Filtered> {
        let kept: Vec<Range<usize>> =
            series.segments().filter(|segment| segment.len() >= self.samples_min()).collect();
        let whole = series.only(&kept)?;
        let smooth = |axis: Axis| {
            let positions_mm = whole.along(axis).unwrap_or_default();
            let mut parts = whole.segments().filter_map(|part| positions_mm.get(part));
            parts.try_fold(Vec::new(), |mut all, part| {
                all.append(&mut self.smooth(part)?);
                Some(all)
            })
        };
        let [ap, ml, si] = Axis::ALL.map(smooth);
        Some(Filtered {
            series: whole.with_positions([ap?, ml?, si?]).ok()?,
            left_out_samples: series.samples() - whole.samples(),
            kept,
        })
    }

    /// The variances of the steps between neighbouring smoothed samples, for independent errors
    /// with these variances in the original samples. `None` when there are too few samples.
    ///
    /// A filter is linear, so a step, too, is a weighted sum of samples, and its variance is the
    /// sum of their variances times the squared weights. The same holds for covariance matrices.
    #[must_use]
    pub fn step_variances<V: Variance>(&self, variances: &[V]) -> Option<Vec<V>> {
        let sum = |pair: &[V]| {
            let mut sum = pair[0];
            sum += pair[1];
            sum
        };
        match self {
            Self::None => Some(variances.windows(2).map(sum).collect()),
            Self::SavitzkyGolay(filter) => filter.step_variances(variances),
            Self::Butterworth(filter) => filter.step_variances(variances),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_filter() -> [Filter; 4] {
        [
            Filter::None,
            Design::SavitzkyGolay { window_s: 0.7 }.at(10.0).unwrap(),
            Design::Butterworth { cutoff_hz: 1.0, order: 3 }.at(10.0).unwrap(),
            Design::Butterworth { cutoff_hz: 4.0, order: 2 }.at(10.0).unwrap(),
        ]
    }

    #[test]
    fn parts_are_smoothed_alone_and_short_ones_left_out() {
        // Gaps of one sample: parts of 20, 3 and 16 samples.
        let indices: Vec<usize> = (0..41).filter(|index| ![20, 24].contains(index)).collect();
        let time_s: Vec<f64> = indices.iter().map(|index| *index as f64 / 10.0).collect();
        let ap: Vec<f64> = indices.iter().map(|index| (index * index % 11) as f64).collect();
        let series = Series::new(time_s, [ap.clone(), Vec::new(), ap.clone()]).unwrap();
        for filter in &every_filter()[1..] {
            let filtered = filter.apply(&series).unwrap();
            assert_eq!((filtered.left_out_samples, &filtered.kept[..]), (3, &[0..20, 23..39][..]));
            let parts = [&ap[..20], &ap[23..]];
            let expected: Vec<f64> =
                parts.iter().flat_map(|part| filter.smooth(part).unwrap()).collect();
            assert_eq!(filtered.series.along(Axis::Si), Some(&expected[..]));
            assert_eq!(filtered.series.along(Axis::Ml), None);
            assert_eq!(filtered.series.segments().collect::<Vec<_>>(), [0..20, 20..36]);
        }
        let unchanged = Filter::None.apply(&series).unwrap();
        assert_eq!((&unchanged.series, unchanged.left_out_samples), (&series, 0));
        let longer = Design::SavitzkyGolay { window_s: 2.1 }.at(10.0).unwrap();
        assert_eq!(longer.apply(&series), None);
    }

    /// The response to an error in each single sample, squared: the definition, whatever the
    /// filter.
    fn by_definition(filter: &Filter, variances: &[f64]) -> Vec<f64> {
        let mut steps = vec![0.0; variances.len() - 1];
        for (sample, variance) in variances.iter().enumerate() {
            let mut impulse = vec![0.0; variances.len()];
            impulse[sample] = 1.0;
            let response = filter.smooth(&impulse).unwrap();
            for (sum, pair) in steps.iter_mut().zip(response.windows(2)) {
                *sum += (pair[1] - pair[0]).powi(2) * variance;
            }
        }
        steps
    }

    #[test]
    fn a_steps_variance_is_that_of_its_response_to_every_sample() {
        // Shorter than what the ends of a filter reach, and so long that its middle is a shifted
        // copy of one response.
        for (filter, samples) in every_filter().iter().flat_map(|it| [(it, 18), (it, 600)]) {
            let variances: Vec<f64> = (0..samples).map(|i| 0.5 + f64::from(i % 5)).collect();
            let steps = filter.step_variances(&variances).unwrap();
            let expected = by_definition(filter, &variances);
            assert_eq!(steps.len(), expected.len());
            for (at, (value, expected)) in steps.iter().zip(&expected).enumerate() {
                // Responses are taken to end at a millionth of their size.
                assert!((value / expected - 1.0).abs() < 1e-9, "{at}: {value} {expected}");
            }
        }
    }

    #[test]
    fn a_design_that_does_not_suit_the_rate_says_what_would() {
        let refused = |design: Design| design.at(60.0).unwrap_err().to_string();
        let butterworth = |cutoff_hz, order| refused(Design::Butterworth { cutoff_hz, order });
        for (said, part) in [
            (refused(Design::SavitzkyGolay { window_s: 0.05 }), "fewer than 5 or more than 2001"),
            (butterworth(30.0, 2), "above 0.060 Hz and below 30.0 Hz"),
            (butterworth(0.06, 2), "above 0.060 Hz"),
            (butterworth(10.0, 0), "the order must be 1 to 8"),
            (butterworth(10.0, 9), "the order must be 1 to 8"),
            (butterworth(f64::NAN, 2), "below 30.0 Hz"),
        ] {
            assert!(said.contains(part) && said.contains("60.0 Hz"), "{said}");
        }
    }
}
