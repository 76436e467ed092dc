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
}

impl Span {
    /// The whole of a series.
    pub fn whole(series: &Series) -> Self {
        let (first, last) = (series.time_s()[0], series.time_s()[series.samples() - 1]);
        Self::of(series, first..last, 0..series.samples())
    }

    /// The span between two times.
    pub fn between(series: &Series, time_s: &Range<f64>) -> Self {
        let index = |time: f64| series.time_s().partition_point(|at| *at < time);
        Self::of(series, time_s.clone(), index(time_s.start)..index(time_s.end))
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
        let covered = covered_s / (time_s.end - time_s.start);
        Self { time_s, samples, steps, covered }
    }
}

/// The positions along an axis.
pub(super) fn along(series: &Series, axis: Axis) -> Result<&[f64], Absent> {
    series.along(axis).ok_or(Absent::NotMeasured(axis))
}

/// The steps of a span along an axis and, if given, a second one.
pub(super) fn steps(
    series: &Series,
    span: &Span,
    first: Axis,
    second: Option<Axis>,
) -> Result<Vec<[f64; 2]>, Absent> {
    let first = along(series, first)?;
    let second = second.map(|second| along(series, second)).transpose()?;
    if span.steps.is_empty() {
        return Err(Absent::NothingMeasured);
    }
    let step = |positions_mm: &[f64], at: usize| positions_mm[at + 1] - positions_mm[at];
    let both = |at: &usize| [step(first, *at), second.map_or(0.0, |second| step(second, *at))];
    Ok(span.steps.iter().map(both).collect())
}

/// The sum of the lengths of the steps.
pub(super) fn length(steps: &[[f64; 2]]) -> f64 {
    steps.iter().map(|[first, second]| (first * first + second * second).sqrt()).sum()
}

pub(super) fn path(series: &Series, span: &Span) -> Path {
    let length_mm = ByDirection::of(|first, second| {
        steps(series, span, first, second).map(|steps| length(&steps)).into()
    });
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
