//! Total path length: how far a point moved in total.
//!
//! `L = sum of |step|` over the steps from each sample to the next, along one axis (the absolute
//! difference) or in a plane (the distance), as the paper's `L_A(T)`. A step belongs to the time in
//! which it starts, so the lengths of adjacent bins add up to the length of both together. There is
//! no step across a gap: movement there is not included, and [`covered`](Path::covered) says what
//! fraction of the time is. The length is not scaled up to make up for it.
//!
//! A path length depends largely on the noise and on the filter: see [the noise](super::noise).

use std::ops::Range;

use serde::Serialize;

use super::figure::{Absent, ByDirection, Figure, Figures};
use crate::series::{Axis, Series};

/// A bin of which less than this fraction was measured has no path: its path is not scaled up for
/// what is missing, so it would fall short by more than about a tenth, as much as the effects that
/// studies look for. A trial that starts or ends a second early, or loses that much, still counts.
pub const COVERED_MIN: f64 = 0.9;

/// Rounding of times and of their sum, as a fraction of a span.
const ROUNDING: f64 = 1e-9;

/// The path within one span of time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Path {
    /// Start, seconds.
    pub from_s: f64,
    /// End, seconds; it belongs to the next span.
    pub to_s: f64,
    /// The number of samples in it.
    pub samples: usize,
    /// The fraction of the time between start and end that lies between consecutive samples, 0 to
    /// 1.
    pub covered: f64,
    /// Total path length, mm.
    pub length_mm: ByDirection<Figure>,
    /// Mean velocity, mm/s: the length divided by the duration of the samples in the span, each of
    /// which counts as one period (Duarte's convention, that of the data set BDS). A trial of N
    /// samples has N - 1 steps, so this is lower by 1/N than the mean velocity of the steps.
    pub mean_velocity_mm_s: ByDirection<Figure>,
}

impl Path {
    /// Why it does not represent its time, if less than this fraction of that was measured.
    #[must_use]
    pub fn too_little(&self, covered_min: f64) -> Option<Absent> {
        too_little(&(self.from_s..self.to_s), self.covered, covered_min)
    }
}

impl Figures for Path {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.length_mm.each(visit);
        self.mean_velocity_mm_s.each(visit);
    }
}

/// A span of a series' time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Span {
    time_s: Range<f64>,
    samples: Range<usize>,
    /// The first samples of the steps that start in it.
    pub steps: Vec<usize>,
    covered: f64,
    /// Why its path does not count.
    lacking: Option<Absent>,
}

impl Span {
    /// The whole of a series.
    pub fn whole(series: &Series) -> Self {
        let (first, last) = (series.time_s()[0], series.time_s()[series.samples() - 1]);
        Self::of(series, first..last, 0..series.samples())
    }

    /// The span between two times; an infinite end is that of the series.
    pub fn between(series: &Series, time_s: &Range<f64>) -> Self {
        let index = |time: f64| series.time_s().partition_point(|at| *at < time);
        let samples = index(time_s.start)..index(time_s.end);
        let last_s = series.time_s()[series.samples() - 1];
        let end_s = if time_s.end.is_finite() { time_s.end } else { last_s };
        Self::of(series, time_s.start..end_s, samples)
    }

    /// A bin, whose path counts if at least this fraction of it was measured.
    pub fn bin(series: &Series, time_s: &Range<f64>, covered_min: f64) -> Self {
        let mut span = Self::between(series, time_s);
        span.lacking = too_little(&span.time_s, span.covered, covered_min);
        span
    }

    /// Its start and its end, seconds.
    pub fn time_s(&self) -> &Range<f64> {
        &self.time_s
    }

    /// The time between consecutive samples in it, seconds.
    pub fn measured_s(&self) -> f64 {
        self.covered * (self.time_s.end - self.time_s.start)
    }

    fn of(series: &Series, time_s: Range<f64>, samples: Range<usize>) -> Self {
        let times_s = series.time_s();
        let mut steps = Vec::new();
        let mut covered_s = 0.0;
        for segment in series.segments() {
            let last = segment.end - 1;
            steps.extend(segment.start.max(samples.start)..last.min(samples.end));
            let start = times_s[segment.start].max(time_s.start);
            covered_s += (times_s[last].min(time_s.end) - start).max(0.0);
        }
        // A span of no length, which ends where the series does, has nothing in it.
        let length_s = time_s.end - time_s.start;
        let covered = if length_s > 0.0 { covered_s / length_s } else { 0.0 };
        Self { time_s, samples, steps, covered, lacking: None }
    }
}

/// Why figures of this time have no value, if less than the needed fraction of it was measured.
fn too_little(time_s: &Range<f64>, covered: f64, needed: f64) -> Option<Absent> {
    let (from_s, to_s) = (time_s.start, time_s.end);
    (covered + ROUNDING < needed).then_some(Absent::TooLittleMeasured {
        from_s,
        to_s,
        covered,
        needed,
    })
}

/// The positions along an axis.
pub(super) fn along(series: &Series, axis: Axis) -> Result<&[f64], Absent> {
    series.along(axis).ok_or(Absent::NotMeasured(axis))
}

/// The steps of a span along an axis and, if given, a second one.
pub(super) fn steps<'a>(
    series: &'a Series,
    span: &'a Span,
    first: Axis,
    second: Option<Axis>,
) -> Result<impl Iterator<Item = [f64; 2]> + 'a, Absent> {
    let first = along(series, first)?;
    let second = second.map(|second| along(series, second)).transpose()?;
    if let Some(absent) = span.lacking {
        return Err(absent);
    }
    if span.steps.is_empty() {
        return Err(Absent::NothingMeasured);
    }
    let step = |positions_mm: &[f64], at: usize| positions_mm[at + 1] - positions_mm[at];
    Ok(span
        .steps
        .iter()
        .map(move |at| [step(first, *at), second.map_or(0.0, |second| step(second, *at))]))
}

/// The sum of the lengths of the steps.
pub(super) fn length(steps: impl IntoIterator<Item = [f64; 2]>) -> f64 {
    let lengths = steps.into_iter().map(|[first, second]| (first * first + second * second).sqrt());
    lengths.sum()
}

/// How far the steps of a series fall short of the smooth curve through its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Shortfall {
    /// The estimate, mm.
    pub length_mm: ByDirection<Figure>,
    /// Its standard uncertainty, mm.
    pub u_mm: ByDirection<Figure>,
}

/// Estimates the shortfall from the path of every other sample.
///
/// A chord is shorter than its arc by a part that grows with the square of the time between its
/// ends. So the path of every other sample falls short by four times as much, and a third of the
/// difference of the two paths is the shortfall (Richardson's extrapolation). Each pair of
/// consecutive steps `a, b` contributes `(|a| + |b| - |a + b|) / 2` to that difference, since each
/// step is in two pairs.
///
/// Along one axis only the pairs at turning points contribute, and each tells little of what is
/// lost at its turn, which depends on how far from the nearest sample that is. The uncertainty
/// therefore takes each pair's part as uncertain by its whole size, and independent: it is small
/// where many pairs share the shortfall, as on a curve in a plane.
pub(super) fn shortfall(series: &Series) -> Shortfall {
    let whole = Span::whole(series);
    let parts_mm = |first: Axis, second: Option<Axis>| -> Result<Vec<f64>, Absent> {
        let steps: Vec<[f64; 2]> = steps(series, &whole, first, second)?.collect();
        let pairs = steps.windows(2).zip(whole.steps.windows(2));
        // Steps on both sides of a gap are no pair.
        let pairs = pairs.filter(|(_, at)| at[1] == at[0] + 1).map(|(pair, _)| pair);
        let part_mm = |pair: &[[f64; 2]]| {
            let [a, b] = [pair[0], pair[1]];
            (length([a, b]) - length([[a[0] + b[0], a[1] + b[1]]])) / 6.0
        };
        Ok(pairs.map(part_mm).collect())
    };
    let root = |parts_mm: Vec<f64>| parts_mm.iter().map(|it| it * it).sum::<f64>().sqrt();
    Shortfall {
        length_mm: ByDirection::of(|first, second| {
            parts_mm(first, second).map(|it| it.iter().sum()).into()
        }),
        u_mm: ByDirection::of(|first, second| parts_mm(first, second).map(root).into()),
    }
}

pub(super) fn path(series: &Series, span: &Span) -> Path {
    let length_mm =
        ByDirection::of(|first, second| steps(series, span, first, second).map(length).into());
    let duration_s = span.samples.len() as f64 * series.period_s();
    let mut mean_velocity_mm_s = length_mm.clone();
    mean_velocity_mm_s.each(&mut |figure| {
        if let Some(mm) = figure.value() {
            *figure = Ok(mm / duration_s).into();
        }
    });
    Path {
        from_s: span.time_s.start,
        to_s: span.time_s.end,
        samples: span.samples.len(),
        covered: span.covered,
        length_mm,
        mean_velocity_mm_s,
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn the_steps_around_a_circle_fall_short_of_it() {
        // Ten turns of radius 10 mm with 100 samples each, one of which is missing.
        let (radius_mm, angle_rad) = (10.0, TAU / 100.0);
        let samples: Vec<f64> = (0..1001).filter(|at| *at != 500).map(f64::from).collect();
        let along = |of: fn(f64) -> f64| {
            samples.iter().map(|at| radius_mm * of(at * angle_rad)).collect::<Vec<f64>>()
        };
        let time_s = samples.iter().map(|at| at / 60.0).collect();
        let series = Series::new(time_s, [along(f64::cos), along(f64::sin), Vec::new()]).unwrap();
        let found = shortfall(&series);
        // Each chord is shorter than its arc; there are 998 of them.
        let chord_mm = 2.0 * radius_mm * (angle_rad / 2.0).sin();
        let expected_mm = 998.0 * (radius_mm * angle_rad - chord_mm);
        // Each of the two parts has one pair of steps fewer than steps, and the next order is
        // angle^2 / 16.
        let found_mm = found.length_mm.planes.transverse.value().unwrap();
        let share = found_mm / expected_mm - 1.0;
        assert!(share.abs() < 2.0 / 998.0 + angle_rad * angle_rad / 16.0, "{share}");
        // All of the 996 pairs contribute alike.
        let u_mm = found.u_mm.planes.transverse.value().unwrap();
        assert!((u_mm * 996_f64.sqrt() / found_mm - 1.0).abs() < 1e-9, "{u_mm}");
        assert_eq!(found.length_mm.axes.si.value(), None);
    }

    #[test]
    fn the_steps_along_a_line_fall_short_of_nothing() {
        let line: Vec<f64> = (0..100).map(f64::from).collect();
        let series = Series::new(line.clone(), [line.clone(), line.clone(), line]).unwrap();
        let found = shortfall(&series);
        assert_eq!(found.length_mm.axes.ap.value(), Some(0.0));
        // Square roots of 8 and of 2 are rounded.
        assert!(found.length_mm.planes.transverse.value().is_some_and(|mm| mm.abs() < 1e-12));
    }
}
