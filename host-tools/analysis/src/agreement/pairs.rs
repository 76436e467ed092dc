//! Two recordings as pairs of values at the same instants.

use std::fmt;
use std::ops::Range;

use crate::series::{Axis, Series};

/// A trial with fewer pairs is rejected.
const PAIRS_MIN: usize = 10;

/// One trial: the values of both systems at the camera's times.
#[derive(Debug, Clone, PartialEq)]
pub struct Paired {
    series: Series,
    along: [Option<Pairs>; 3],
}

/// The values along one axis, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Pairs {
    /// The reference's values.
    pub reference_mm: Vec<f64>,
    /// The measurement's values.
    pub measured_mm: Vec<f64>,
    /// The offset subtracted from measured minus reference to align the origins.
    pub offset_mm: f64,
}

impl Pairs {
    /// Measured minus reference.
    #[must_use]
    pub fn differences(&self) -> Vec<f64> {
        self.measured_mm.iter().zip(&self.reference_mm).map(|(a, b)| a - b).collect()
    }
}

/// Why two recordings cannot be paired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairError {
    /// No axis was measured by both.
    NoAxis,
    /// There are no, or too few, times at which both have a value. The spans of the measurement and
    /// of the reference are on the same clock, in seconds.
    Overlap {
        /// The number of such times.
        pairs: usize,
        /// The first and last time of the measurement.
        measured_s: [f64; 2],
        /// The first and last time of the reference.
        reference_s: [f64; 2],
    },
    /// The measurement, or the reference, does not move: no lag can be found.
    Constant(&'static str),
    /// Positions of the measurement, or of the reference, are so large that their mean overflows.
    TooLarge(&'static str),
}

impl fmt::Display for PairError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAxis => write!(formatter, "no axis was measured by both"),
            Self::Overlap { pairs, measured_s: [a, b], reference_s: [c, d] } => write!(
                formatter,
                "both have a value at only {pairs} times: the measurement is from {a:.2} to \
                 {b:.2} s, the reference from {c:.2} to {d:.2} s"
            ),
            Self::Constant(which) => write!(formatter, "the {which} does not move"),
            Self::TooLarge(which) => write!(formatter, "positions of the {which} are too large"),
        }
    }
}

impl std::error::Error for PairError {}

impl Paired {
    /// Brings the reference to the measurement's times: its value at t is the reference at t -
    /// `lag_s`, interpolated linearly between neighbouring samples but not across gaps. With
    /// `align_origins`, both have their mean over the pairs subtracted.
    ///
    /// # Errors
    /// When too few pairs remain.
    pub fn new(
        measured: &Series,
        reference: &Series,
        lag_s: f64,
        align_origins: bool,
    ) -> Result<Self, PairError> {
        let is_shared =
            |axis: &Axis| measured.along(*axis).is_some() && reference.along(*axis).is_some();
        if !Axis::ALL.iter().any(is_shared) {
            return Err(PairError::NoAxis);
        }
        let times: Vec<f64> = measured.time_s().iter().map(|time_s| time_s - lag_s).collect();
        let places = places(reference, &times);
        let kept: Vec<usize> = (0..places.len()).filter(|&at| places[at].is_some()).collect();
        let ranges: Vec<Range<usize>> = kept.iter().map(|&at| at..at + 1).collect();
        let series = measured.only(&ranges).filter(|_| kept.len() >= PAIRS_MIN);
        let series = series.ok_or_else(|| {
            let ends =
                |time_s: &[f64], by_s: f64| [time_s[0] + by_s, time_s[time_s.len() - 1] + by_s];
            PairError::Overlap {
                pairs: kept.len(),
                measured_s: ends(measured.time_s(), 0.0),
                reference_s: ends(reference.time_s(), lag_s),
            }
        })?;
        let along = Axis::ALL.map(|axis| {
            let (measured_mm, from) = (series.along(axis)?, reference.along(axis)?);
            let reference_mm = places.iter().flatten().map(|place| place.value(from)).collect();
            Some(Pairs::aligned(reference_mm, measured_mm.to_vec(), align_origins))
        });
        Ok(Self { series, along })
    }

    /// The pairs along an axis, if both have it.
    #[must_use]
    pub fn along(&self, axis: Axis) -> Option<&Pairs> {
        self.along[axis as usize].as_ref()
    }

    /// The times of the pairs, on the measurement's clock.
    #[must_use]
    pub fn time_s(&self) -> &[f64] {
        self.series.time_s()
    }

    /// The parts without a gap.
    pub fn runs(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.series.segments()
    }
}

impl Pairs {
    fn aligned(mut reference_mm: Vec<f64>, mut measured_mm: Vec<f64>, align: bool) -> Self {
        let mut offset_mm = 0.0;
        if align {
            let mut centre = |values: &mut Vec<f64>, sign: f64| {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                values.iter_mut().for_each(|it| *it -= mean);
                offset_mm += sign * mean;
            };
            centre(&mut reference_mm, -1.0);
            centre(&mut measured_mm, 1.0);
        }
        Self { reference_mm, measured_mm, offset_mm }
    }
}

/// A position between two neighbouring samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    before: usize,
    /// The fraction of the way to the next sample, from 0 to 1.
    share: f64,
}

impl Place {
    /// The linearly interpolated value at this position.
    pub(super) fn value(self, values: &[f64]) -> f64 {
        let (a, b) = (values[self.before], values[(self.before + 1).min(values.len() - 1)]);
        a + self.share * (b - a)
    }
}

/// Where increasing times lie among a series' samples; `None` before, after, and in gaps.
pub(super) fn places(series: &Series, times_s: &[f64]) -> Vec<Option<Place>> {
    let at_s = series.time_s();
    let mut segments = series.segments().peekable();
    let mut before = 0;
    let place = |&time_s: &f64| {
        while segments.next_if(|segment| at_s[segment.end - 1] < time_s).is_some() {}
        let segment = segments.peek().filter(|segment| at_s[segment.start] <= time_s)?;
        before = segment.start.max(before);
        while before + 1 < segment.end && at_s[before + 1] <= time_s {
            before += 1;
        }
        let step_s = at_s.get(before + 1).map_or(1.0, |next_s| next_s - at_s[before]);
        Some(Place { before, share: (time_s - at_s[before]) / step_s })
    };
    times_s.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(time_s: Vec<f64>, value: impl Fn(f64) -> f64) -> Series {
        let values = time_s.iter().map(|it| value(*it)).collect();
        Series::new(time_s, [values, vec![], vec![]]).unwrap()
    }

    fn steps(from: usize, to: usize, period_s: f64) -> Vec<f64> {
        (from..to).map(|at| at as f64 * period_s).collect()
    }

    #[test]
    fn a_line_is_interpolated_exactly_and_not_over_gaps() {
        // The reference: 10 Hz, samples 1.0 to 1.4 missing, 0.25 s later, and ten times as large.
        let mut time_s = steps(0, 10, 0.1);
        time_s.extend(steps(15, 30, 0.1));
        let reference = series(time_s, |it| 10.0 * it);
        let measured = series(steps(0, 100, 0.03), |it| it);
        let paired = Paired::new(&measured, &reference, 0.25, false).unwrap();
        let pairs = paired.along(Axis::Ap).unwrap();
        for (at, &time_s) in paired.time_s().iter().enumerate() {
            assert!((pairs.reference_mm[at] - 10.0 * (time_s - 0.25)).abs() < 1e-12);
            assert_eq!(pairs.measured_mm[at], time_s);
            let reference_s = time_s - 0.25;
            assert!((0.0..=0.9).contains(&reference_s) || (1.5..=2.9).contains(&reference_s));
        }
        // 0.25 to 1.15 at 0.03: 9 to 38; 1.75 to 3.15: 59 to 99.
        assert_eq!(paired.time_s().len(), 30 + 41);
        assert_eq!(paired.runs().collect::<Vec<_>>(), [0..30, 30..71]);
        assert_eq!(paired.along(Axis::Ml), None);
    }

    #[test]
    fn a_sample_at_the_very_time_is_itself() {
        let reference = series(steps(0, 20, 0.1), |it| it * it);
        let paired = Paired::new(&reference, &reference, 0.0, false).unwrap();
        let pairs = paired.along(Axis::Ap).unwrap();
        assert_eq!((paired.time_s().len(), &pairs.reference_mm), (20, &pairs.measured_mm));
    }

    #[test]
    fn aligned_origins_have_no_bias_and_say_what_was_taken_off() {
        let reference = series(steps(0, 50, 0.1), |it| it.sin() + 1e3);
        let measured = series(steps(0, 50, 0.1), |it| it.sin() - 200.0);
        let paired = Paired::new(&measured, &reference, 0.0, true).unwrap();
        let pairs = paired.along(Axis::Ap).unwrap();
        assert!((pairs.offset_mm + 1200.0).abs() < 1e-9);
        assert!(pairs.differences().iter().all(|it| it.abs() < 1e-9));
    }

    #[test]
    fn recordings_that_do_not_meet_are_refused_with_their_times() {
        let reference = series(steps(0, 50, 0.1), |it| it);
        let measured = series(steps(100, 150, 0.1), |it| it);
        let error = Paired::new(&measured, &reference, 0.0, true).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("from 10.00 to 14.90 s") && text.contains("0.00 to 4.90 s"),
            "{text}"
        );
        let across = Series::new(steps(0, 50, 0.1), [vec![], vec![1.0; 50], vec![]]).unwrap();
        assert_eq!(Paired::new(&across, &reference, 0.0, true), Err(PairError::NoAxis));
    }
}
