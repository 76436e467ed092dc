//! One quantity over time, with its missing values.

use std::fmt;
use std::ops::Range;

use crate::series::{GAP_PERIODS, usual_period_s};

/// A step shorter than this fraction of a period is more than jitter: the samples are not evenly
/// spaced.
const UNEVEN_PERIODS: f64 = 0.25;

/// The relative tolerance of the bounds of a rate, for errors of the clock and rounded times.
const RATE_TOLERANCE: f64 = 0.01;

/// Values at increasing times, evenly spaced or not. NaN marks a missing value.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    time_s: Vec<f64>,
    values: Vec<f64>,
}

/// Why numbers do not form a signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SignalError {
    /// The number of times and the number of values.
    Lengths(usize, usize),
    /// This sample's time is not a number.
    Time(usize),
    /// This sample's time is not later than that of the sample before it.
    TimeNotIncreasing(usize),
    /// This sample's value is infinite, or beyond 1e100.
    Value(usize),
}

impl fmt::Display for SignalError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lengths(times, values) => write!(formatter, "{values} values at {times} times"),
            Self::Time(index) => write!(formatter, "the time of sample {index} is not a number"),
            Self::TimeNotIncreasing(index) => {
                write!(formatter, "the time of sample {index} is not later than the one before")
            }
            Self::Value(index) => write!(formatter, "the value of sample {index} is infinite"),
        }
    }
}

impl std::error::Error for SignalError {}

/// Why a signal is not sampled in the way a method requires.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SamplingError {
    /// Fewer than two samples, which have no rate.
    TooFew,
    /// The rate is not one that the method is made for: the times may be in milliseconds.
    Rate {
        /// The rate found.
        rate_hz: f64,
        /// The lowest rate allowed.
        min_hz: f64,
        /// The highest rate allowed.
        max_hz: f64,
    },
    /// This sample comes far too soon after the one before it.
    Uneven(usize),
}

impl fmt::Display for SamplingError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew => write!(formatter, "fewer than two samples"),
            Self::Rate { rate_hz, min_hz, max_hz } => write!(
                formatter,
                "{rate_hz:.1} samples per second instead of {min_hz} to {max_hz}: is the time \
                 in seconds?"
            ),
            Self::Uneven(index) => write!(
                formatter,
                "the samples are not evenly spaced: sample {index} comes too soon"
            ),
        }
    }
}

impl std::error::Error for SamplingError {}

impl Signal {
    /// A signal of values at these times, seconds.
    ///
    /// # Errors
    /// When times do not increase, a number is infinite, or the lengths differ.
    pub fn new(time_s: Vec<f64>, values: Vec<f64>) -> Result<Self, SignalError> {
        if time_s.len() != values.len() {
            return Err(SignalError::Lengths(time_s.len(), values.len()));
        }
        if let Some(at) = time_s.iter().position(|time| !time.is_finite()) {
            return Err(SignalError::Time(at));
        }
        if let Some(at) = time_s.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(SignalError::TimeNotIncreasing(at + 1));
        }
        if let Some(at) = values.iter().position(|value| value.abs() > 1e100) {
            return Err(SignalError::Value(at));
        }
        Ok(Self { time_s, values })
    }

    /// A signal of pairs (time, value) whose times are known to increase.
    pub(super) fn of(pairs: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let (time_s, values): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        debug_assert!(time_s.is_sorted_by(|a, b| a < b));
        Self { time_s, values }
    }

    /// The times of the samples, seconds.
    #[must_use]
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// The values; NaN where one is missing.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The samples that have a value.
    pub fn present(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let samples = self.time_s.iter().copied().zip(self.values.iter().copied());
        samples.filter(|(_, value)| !value.is_nan())
    }

    /// The number of samples per second outside gaps, if it lies between these bounds and the
    /// samples are evenly spaced.
    ///
    /// # Errors
    /// When it does not, or they are not.
    pub fn rate_hz(&self, min_hz: f64, max_hz: f64) -> Result<f64, SamplingError> {
        let period_s = usual_period_s(&self.time_s).ok_or(SamplingError::TooFew)?;
        let rate_hz = period_s.recip();
        let (slow, fast) = (1.0 - RATE_TOLERANCE, 1.0 + RATE_TOLERANCE);
        if !(slow * min_hz..=fast * max_hz).contains(&rate_hz) {
            return Err(SamplingError::Rate { rate_hz, min_hz, max_hz });
        }
        let too_soon = |pair: &[f64]| pair[1] - pair[0] < UNEVEN_PERIODS * period_s;
        match self.time_s.windows(2).position(too_soon) {
            Some(at) => Err(SamplingError::Uneven(at + 1)),
            None => Ok(rate_hz),
        }
    }

    /// The parts with neither a missing value nor a missing sample, in order.
    #[must_use]
    pub fn parts(&self) -> Vec<Range<usize>> {
        let Some(period_s) = usual_period_s(&self.time_s) else {
            return Vec::new();
        };
        let mut parts: Vec<Range<usize>> = Vec::new();
        for (at, value) in self.values.iter().enumerate() {
            let follows = |part: &Range<usize>| {
                part.end == at && self.time_s[at] - self.time_s[at - 1] <= GAP_PERIODS * period_s
            };
            match parts.last_mut().filter(|part| follows(part)) {
                _ if value.is_nan() => {}
                Some(part) => part.end = at + 1,
                None => parts.push(at..at + 1),
            }
        }
        parts
    }

    /// The indices of the samples from one time up to, but excluding, another.
    pub(super) fn within(&self, span_s: Range<f64>) -> Range<usize> {
        let start = self.time_s.partition_point(|time| *time < span_s.start);
        start..start + self.time_s[start..].partition_point(|time| *time < span_s.end)
    }

    /// The value at a time, interpolated linearly between the values before and after it; `None`
    /// where those are further apart than the bound, and outside them.
    #[must_use]
    pub fn at(&self, time_s: f64, gap_max_s: f64) -> Option<f64> {
        let after = self.time_s.partition_point(|time| *time < time_s);
        let sample = |at: usize| (self.time_s[at], self.values[at]);
        let near = |(time, _): &(f64, f64)| (time - time_s).abs() <= gap_max_s;
        let known = |(_, value): &(f64, f64)| !value.is_nan();
        let next = (after..self.time_s.len()).map(sample).take_while(near).find(known)?;
        if next.0 == time_s {
            return Some(next.1);
        }
        let last = (0..after).rev().map(sample).take_while(near).find(known)?;
        let step_s = next.0 - last.0;
        let part = (time_s - last.0) / step_s;
        (step_s <= gap_max_s).then_some(last.1 * (1.0 - part) + next.1 * part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NO: f64 = f64::NAN;

    fn signal(samples: &[(f64, f64)]) -> Signal {
        let (time_s, values) = samples.iter().copied().unzip();
        Signal::new(time_s, values).unwrap()
    }

    #[test]
    fn what_is_no_signal_is_named() {
        let of = |time_s: &[f64], values: &[f64]| Signal::new(time_s.to_vec(), values.to_vec());
        assert_eq!(of(&[0.0], &[]), Err(SignalError::Lengths(1, 0)));
        assert_eq!(of(&[0.0, NO], &[1.0, 1.0]), Err(SignalError::Time(1)));
        assert_eq!(of(&[0.0, 1.0, 1.0], &[1.0; 3]), Err(SignalError::TimeNotIncreasing(2)));
        assert_eq!(of(&[0.0, 2.0, 1.0], &[1.0; 3]), Err(SignalError::TimeNotIncreasing(2)));
        assert_eq!(of(&[0.0, 1.0], &[NO, f64::INFINITY]), Err(SignalError::Value(1)));
        assert!(of(&[], &[]).is_ok_and(|it| it.parts().is_empty() && it.at(0.0, 9.0).is_none()));
    }

    #[test]
    fn parts_end_at_missing_samples_and_at_missing_values() {
        let it = signal(&[
            (0.0, 1.0),
            (0.1, 1.0),
            (0.2, NO),
            (0.3, 1.0),
            (0.4, 1.0),
            (0.6, 1.0),
            (0.7, 1.0),
        ]);
        assert_eq!(it.parts(), [0..2, 3..5, 5..7]);
        assert!(signal(&[(0.0, NO), (0.1, NO)]).parts().is_empty());
        assert_eq!(it.within(0.1..0.6), 1..5);
        assert_eq!(it.within(0.6..0.1), 5..5);
    }

    #[test]
    fn a_rate_survives_rounded_times_and_gaps() {
        // 600 Hz rounded to milliseconds: steps of 1 and 2 ms; and one second is missing.
        let times = (0..600).chain(1200..1800).map(|at| (f64::from(at) / 0.6).round() / 1e3);
        let it = signal(&times.map(|time| (time, 0.0)).collect::<Vec<_>>());
        let rate_hz = it.rate_hz(100.0, 2000.0).unwrap();
        // Half a millisecond at each end of two seconds.
        assert!((rate_hz - 600.0).abs() < 0.5, "{rate_hz}");
        assert_eq!(it.parts(), [0..600, 600..1200]);
        let out_of_bounds = it.rate_hz(1000.0, 2000.0);
        assert_eq!(
            out_of_bounds,
            Err(SamplingError::Rate { rate_hz, min_hz: 1000.0, max_hz: 2000.0 })
        );
        let uneven = signal(&[(0.0, 0.0), (1.0, 0.0), (1.1, 0.0), (2.0, 0.0)]);
        assert_eq!(uneven.rate_hz(0.0, 9.0), Err(SamplingError::Uneven(2)));
        assert_eq!(signal(&[(0.0, 0.0)]).rate_hz(0.0, 9.0), Err(SamplingError::TooFew));
    }

    #[test]
    fn between_values_lies_a_line_and_beyond_them_nothing() {
        let it = signal(&[(0.0, 10.0), (1.0, NO), (2.0, 14.0), (6.0, 20.0)]);
        assert_eq!(it.at(0.5, 3.0), Some(11.0));
        assert_eq!((it.at(1.0, 2.0), it.at(1.0, 1.9)), (Some(12.0), None));
        assert_eq!(
            (it.at(2.0, 0.0), it.at(0.0, 0.0), it.at(6.0, 0.0)),
            (Some(14.0), Some(10.0), Some(20.0))
        );
        assert_eq!((it.at(4.0, 3.0), it.at(5.0, 4.0)), (None, Some(18.5)));
        assert_eq!((it.at(-0.1, 9.0), it.at(6.1, 9.0), it.at(NO, 9.0)), (None, None, None));
    }
}
