//! The positions of one point of the body over time, with their gaps.

use std::fmt;
use std::ops::Range;

/// A step longer than this many periods is a gap: a sample is missing, as the jitter of the times
/// is far smaller.
pub const GAP_PERIODS: f64 = 1.5;

/// The usual step between increasing times: the mean of the steps that are not gaps. `None` for
/// fewer than two times.
///
/// It is not the median: for times in whole milliseconds that is a whole number of milliseconds,
/// such as 17 ms at 60 Hz, which would mean 58.8 Hz. The error of the mean comes only from the
/// rounding of the two ends of each part without a gap.
#[must_use]
pub fn usual_period_s(time_s: &[f64]) -> Option<f64> {
    let mut steps_s: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps_s.is_empty() {
        return None;
    }
    let middle = steps_s.len() / 2;
    let median_s = *steps_s.select_nth_unstable_by(middle, f64::total_cmp).1;
    // From the median to the mean in two steps: at 400 Hz the steps are 2 and 3 ms, and a step of 3
    // ms is 1.5 medians up to rounding, but less than 1.5 means of the steps counted.
    Some((0..2).fold(median_s, |period_s, _| {
        let within = |step_s: &&f64| **step_s <= GAP_PERIODS * period_s;
        let (sum_s, count) = steps_s
            .iter()
            .filter(within)
            .fold((0.0, 0_usize), |(sum_s, count), step_s| (sum_s + step_s, count + 1));
        sum_s / count as f64
    }))
}

/// A body axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Axis {
    /// Anterior-posterior, forward.
    Ap,
    /// Medial-lateral, to the person's right.
    Ml,
    /// Superior-inferior, up.
    Si,
}

impl Axis {
    /// All axes, in the order in which they are reported.
    pub const ALL: [Self; 3] = [Self::Ap, Self::Ml, Self::Si];

    /// Its usual abbreviation.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Ap => "AP",
            Self::Ml => "ML",
            Self::Si => "SI",
        }
    }
}

/// A plane of the body, given by the two axes that span it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Plane {
    /// AP and ML: seen from above.
    Transverse,
    /// AP and SI: seen from the side.
    Sagittal,
    /// ML and SI: seen from behind.
    Coronal,
}

impl Plane {
    /// All planes, in the order in which they are reported.
    pub const ALL: [Self; 3] = [Self::Transverse, Self::Sagittal, Self::Coronal];

    /// The two axes that span it.
    #[must_use]
    pub fn axes(self) -> [Axis; 2] {
        match self {
            Self::Transverse => [Axis::Ap, Axis::Ml],
            Self::Sagittal => [Axis::Ap, Axis::Si],
            Self::Coronal => [Axis::Ml, Axis::Si],
        }
    }

    /// Its name.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Transverse => "transverse",
            Self::Sagittal => "sagittal",
            Self::Coronal => "coronal",
        }
    }
}

/// Positions over time. Samples without a position are left out: the step over them is a gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    time_s: Vec<f64>,
    /// By [`Axis`]; empty for an axis that was not measured.
    position_mm: [Vec<f64>; 3],
    period_s: f64,
}

/// Why samples do not form a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SeriesError {
    /// Fewer than two samples.
    TooFew,
    /// The number of samples of an axis differs from the number of times.
    Lengths(Axis),
    /// The time or a position of this sample is not a number.
    NotFinite(usize),
    /// This sample's time is not later than that of the sample before it.
    TimeNotIncreasing(usize),
    /// The time from the first sample to the last is not a finite number.
    TooLong,
}

impl fmt::Display for SeriesError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew => write!(formatter, "fewer than two samples"),
            Self::Lengths(axis) => {
                write!(formatter, "{} and time differ in their number of samples", axis.word())
            }
            Self::NotFinite(index) => write!(formatter, "sample {index} is not a number"),
            Self::TimeNotIncreasing(index) => {
                write!(formatter, "the time of sample {index} is not later than the one before")
            }
            Self::TooLong => write!(formatter, "the times are too far apart"),
        }
    }
}

impl std::error::Error for SeriesError {}

impl Series {
    /// A series of positions in the order AP, ML, SI; an axis that was not measured is empty.
    ///
    /// # Errors
    /// When times do not increase, a number or the duration is not finite, or the lengths differ.
    pub fn new(time_s: Vec<f64>, position_mm: [Vec<f64>; 3]) -> Result<Self, SeriesError> {
        lengths(&time_s, &position_mm)?;
        let all = [&time_s].into_iter().chain(&position_mm);
        if let Some(at) = all.filter_map(|it| it.iter().position(|it| !it.is_finite())).min() {
            return Err(SeriesError::NotFinite(at));
        }
        if let Some(at) = time_s.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(SeriesError::TimeNotIncreasing(at + 1));
        }
        let period_s = usual_period_s(&time_s).ok_or(SeriesError::TooFew)?;
        // Every difference of two times is then finite, too.
        if !(time_s[time_s.len() - 1] - time_s[0]).is_finite() {
            return Err(SeriesError::TooLong);
        }
        Ok(Self { time_s, position_mm, period_s })
    }

    /// The times of the samples, seconds.
    #[must_use]
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// The positions along an axis, mm; `None` if it was not measured.
    #[must_use]
    pub fn along(&self, axis: Axis) -> Option<&[f64]> {
        Some(&self.position_mm[axis as usize][..]).filter(|values| !values.is_empty())
    }

    /// The number of samples.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.time_s.len()
    }

    /// The [usual step](usual_period_s).
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// The number of samples per second, where none is missing.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.period_s.recip()
    }

    /// The parts without a gap, in order; together they contain all samples.
    pub fn segments(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let is_gap =
            |at: &usize| self.time_s[*at] - self.time_s[*at - 1] > GAP_PERIODS * self.period_s;
        let gaps: Vec<usize> = (1..self.samples()).filter(is_gap).collect();
        let starts = [0].into_iter().chain(gaps.clone());
        let ends = gaps.into_iter().chain([self.samples()]);
        starts.zip(ends).map(|(start, end)| start..end)
    }

    /// The gaps, each from the last sample before it to the first after it, seconds.
    pub fn gaps_s(&self) -> impl Iterator<Item = Range<f64>> + '_ {
        let starts = self.segments().skip(1).map(|segment| segment.start);
        starts.map(|start| self.time_s[start - 1]..self.time_s[start])
    }

    /// The samples from one time up to, but excluding, another; `None` if there are fewer than two.
    /// The period remains that of the whole series.
    #[must_use]
    pub fn between(&self, span_s: Range<f64>) -> Option<Self> {
        let start = self.time_s.partition_point(|time| *time < span_s.start);
        let end = self.time_s.partition_point(|time| *time < span_s.end);
        (end >= start + 2).then(|| Self {
            time_s: self.time_s[start..end].to_vec(),
            position_mm: self
                .position_mm
                .each_ref()
                .map(|values| values.get(start..end).map(<[f64]>::to_vec).unwrap_or_default()),
            period_s: self.period_s,
        })
    }

    /// The samples in these increasing ranges of indices; `None` if there are fewer than two. The
    /// period remains that of the whole series.
    #[must_use]
    pub fn only(&self, kept: &[Range<usize>]) -> Option<Self> {
        let pick = |values: &[f64]| -> Vec<f64> {
            let ranges = kept.iter().filter_map(|range| values.get(range.clone()));
            ranges.flatten().copied().collect()
        };
        let time_s = pick(&self.time_s);
        (time_s.len() >= 2).then(|| Self {
            time_s,
            position_mm: self.position_mm.each_ref().map(|values| pick(values)),
            period_s: self.period_s,
        })
    }

    /// The same positions at other times.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn at_times(self, time_s: Vec<f64>) -> Result<Self, SeriesError> {
        Self::new(time_s, self.position_mm)
    }

    /// The same times with other positions, such as filtered ones.
    ///
    /// # Errors
    /// When a position is not finite, or the lengths differ.
    pub fn with_positions(&self, position_mm: [Vec<f64>; 3]) -> Result<Self, SeriesError> {
        lengths(&self.time_s, &position_mm)?;
        let not_finite = |values: &Vec<f64>| values.iter().position(|it| !it.is_finite());
        match position_mm.iter().filter_map(not_finite).min() {
            Some(at) => Err(SeriesError::NotFinite(at)),
            None => Ok(Self { time_s: self.time_s.clone(), position_mm, period_s: self.period_s }),
        }
    }
}

/// Checks that each axis that was measured has a position at each time.
fn lengths(time_s: &[f64], position_mm: &[Vec<f64>; 3]) -> Result<(), SeriesError> {
    let differs = |values: &Vec<f64>| !values.is_empty() && values.len() != time_s.len();
    match Axis::ALL.into_iter().zip(position_mm).find(|(_, values)| differs(values)) {
        Some((axis, _)) => Err(SeriesError::Lengths(axis)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(time_s: &[f64]) -> Result<Series, SeriesError> {
        Series::new(time_s.to_vec(), [time_s.to_vec(), Vec::new(), time_s.to_vec()])
    }

    #[test]
    fn a_missing_sample_is_a_gap_and_jitter_is_none() {
        let series = series(&[0.0, 0.1, 0.21, 0.30, 0.5, 0.6]).unwrap();
        assert_eq!(series.segments().collect::<Vec<_>>(), [0..4, 4..6]);
        assert_eq!(series.gaps_s().collect::<Vec<_>>(), [0.30..0.5]);
        assert!((series.rate_hz() - 10.0).abs() < 1e-9);
        assert_eq!(series.along(Axis::Ml), None);
        let part = series.between(0.1..0.5).unwrap();
        assert_eq!(
            (part.time_s(), part.along(Axis::Si)),
            (&[0.1, 0.21, 0.30][..], Some(&[0.1, 0.21, 0.30][..]))
        );
        assert_eq!(series.between(0.3..0.5), None);
        let ends = series.only(&[0..2, 5..6]).unwrap();
        assert_eq!((ends.time_s(), ends.along(Axis::Ml)), (&[0.0, 0.1, 0.6][..], None));
        assert_eq!((ends.segments().count(), series.only(&[0..0, 3..4])), (2, None));
    }

    #[test]
    fn a_rate_survives_times_in_whole_milliseconds_and_gaps() {
        for rate_hz in [60.0, 120.0, 150.0, 400.0] {
            // Half a minute, and another half a minute after one missing second.
            let half = (30.0 * rate_hz) as u32;
            let second = half + rate_hz as u32;
            let frames = (0..half).chain(second..second + half);
            let time_s: Vec<f64> =
                frames.map(|frame| (f64::from(frame) / rate_hz * 1e3).round() / 1e3).collect();
            let series = series(&time_s).unwrap();
            // Four ends, each off by at most half a millisecond, over a minute less two steps.
            let bound = 4.0 * 0.5e-3 / (60.0 - 2.0 / rate_hz);
            assert!((series.period_s() * rate_hz - 1.0).abs() < bound, "{}", series.rate_hz());
            assert_eq!(series.segments().count(), 2, "{rate_hz}");
        }
    }

    #[test]
    fn what_is_no_series_is_named() {
        assert_eq!(series(&[0.0]), Err(SeriesError::TooFew));
        assert_eq!(series(&[0.0, 0.2, 0.1]), Err(SeriesError::TimeNotIncreasing(2)));
        assert_eq!(series(&[0.0, 0.2, 0.2]), Err(SeriesError::TimeNotIncreasing(2)));
        assert_eq!(series(&[0.0, f64::NAN, 0.2]), Err(SeriesError::NotFinite(1)));
        assert_eq!(series(&[f64::MIN, f64::MAX]), Err(SeriesError::TooLong));
        let short = Series::new(vec![0.0, 0.1], [vec![1.0, 2.0], vec![1.0], vec![]]);
        assert_eq!(short, Err(SeriesError::Lengths(Axis::Ml)));
    }
}
