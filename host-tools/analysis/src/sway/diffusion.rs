//! Stabilogram diffusion: how far a point moves within a given lag (Collins & De Luca 1993, Exp.
//! Brain Res. 95:308).
//!
//! The mean square displacement `<(x(t + lag) - x(t))^2>`, for lags up to 10 s, rises steeply at
//! short lags and more slowly at long ones. A line is fitted to each range. Half its slope is the
//! diffusion coefficient (as the authors define it for an axis; in the plane, where the
//! displacements of both axes are added, half the slope is used too), and the intersection of the
//! lines is the critical point. Half the slope of log displacement over log lag is the Hurst
//! exponent: 0.5 for a random walk, more where movement persists, less where it turns back.
//!
//! Where to split the ranges is not settled in the literature. Here the split minimises the squared
//! error of both lines together, between two bounds; a split at a bound was determined by that
//! bound and is flagged.
//!
//! All pairs within the parts without a gap count, but none across a gap.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use serde::Serialize;

use super::figure::{Absent, ByAxis, Figure, Figures};
use super::path::along;
use super::spectrum::{long_enough, longest_segment};
use crate::series::{Axis, Series};

/// The longest part without a gap must be this many times the longest lag: otherwise most
/// displacements at that lag would start from the same few seconds.
const LAGS_MIN: f64 = 2.0;

/// The fewest points that determine a line and leave one over to judge the fit.
const POINTS_MIN: usize = 3;

/// The longest lag, as in Collins & De Luca.
const LONGEST_LAG_S: f64 = 10.0;

/// The bounds between which the short range ends: the critical points that Collins & De Luca report
/// are near 1 s.
const SPLIT_MIN_S: f64 = 0.1;
const SPLIT_MAX_S: f64 = 2.5;

/// Along each axis and in the transverse plane.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diffusion {
    /// Along each axis.
    #[serde(flatten)]
    pub axes: ByAxis<Plot>,
    /// AP and ML together.
    pub transverse: Plot,
}

/// Figures of one diffusion plot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plot {
    /// Short-term diffusion coefficient, mm²/s.
    pub short_mm2_s: Figure,
    /// Long-term diffusion coefficient, mm²/s.
    pub long_mm2_s: Figure,
    /// Lag of the critical point, s.
    pub critical_s: Figure,
    /// Mean square displacement there, mm².
    pub critical_mm2: Figure,
    /// Short-term Hurst exponent.
    pub hurst_short: Figure,
    /// Long-term Hurst exponent.
    pub hurst_long: Figure,
    /// Last lag of the short range, s.
    pub split_s: Figure,
    /// Whether the split lies at a bound of its search, which then determined these figures.
    pub split_at_bound: bool,
}

impl Figures for Plot {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        let coefficients = [&mut self.short_mm2_s, &mut self.long_mm2_s];
        let critical = [&mut self.critical_s, &mut self.critical_mm2];
        let rest = [&mut self.hurst_short, &mut self.hurst_long, &mut self.split_s];
        coefficients.into_iter().chain(critical).chain(rest).for_each(visit);
    }
}

impl Figures for Diffusion {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.axes.each(visit);
        self.transverse.each(visit);
    }
}

pub(super) fn diffusion(series: &Series, planner: &mut RealFftPlanner<f64>) -> Diffusion {
    let displacements = ByAxis::of(|axis| displacements(series, axis, planner));
    let ByAxis { ap, ml, .. } = &displacements;
    let sum = |ap: &[f64], ml: &[f64]| ap.iter().zip(ml).map(|(ap, ml)| ap + ml).collect();
    let together = match (ap, ml) {
        (Ok(ap), Ok(ml)) => Ok(sum(ap, ml)),
        (Err(absent), _) | (_, Err(absent)) => Err(*absent),
    };
    let plot = |displacements| Plot::of(displacements, series);
    let transverse = plot(together);
    let ByAxis { ap, ml, si } = displacements;
    Diffusion { axes: ByAxis { ap: plot(ap), ml: plot(ml), si: plot(si) }, transverse }
}

impl Plot {
    fn of(displacements: Result<Vec<f64>, Absent>, series: &Series) -> Self {
        let period_s = series.period_s();
        let fitted = displacements.and_then(|it| Fitted::to(&it, period_s));
        let result = |of: fn(&Fitted) -> Result<f64, Absent>| match &fitted {
            Ok(fitted) => of(fitted).into(),
            Err(absent) => Err(*absent).into(),
        };
        Self {
            short_mm2_s: result(|it| Ok(it.short.slope / 2.0)),
            long_mm2_s: result(|it| Ok(it.long.slope / 2.0)),
            critical_s: result(Fitted::critical_s),
            critical_mm2: result(|it| Ok(it.short.intercept + it.short.slope * it.critical_s()?)),
            hurst_short: result(|it| it.hurst_short),
            hurst_long: result(|it| it.hurst_long),
            split_s: result(|it| Ok(it.split_s)),
            split_at_bound: fitted.as_ref().is_ok_and(|it| it.split_at_bound),
        }
    }
}

/// The two fitted lines.
struct Fitted {
    short: Line,
    long: Line,
    hurst_short: Result<f64, Absent>,
    hurst_long: Result<f64, Absent>,
    split_s: f64,
    split_at_bound: bool,
}

impl Fitted {
    /// Fits mean square displacements at 1, 2, 3 ... periods.
    fn to(displacements: &[f64], period_s: f64) -> Result<Self, Absent> {
        if displacements.iter().any(|it| !it.is_finite()) {
            return Err(Absent::Overflow);
        }
        let lags = displacements.len();
        let index = |time_s: f64| (time_s / period_s).round() as usize;
        let first = index(SPLIT_MIN_S).max(POINTS_MIN);
        let last = index(SPLIT_MAX_S).min(lags.saturating_sub(POINTS_MIN));
        if first > last {
            let needed_hz = 2.0 * POINTS_MIN as f64 / SPLIT_MAX_S;
            return Err(Absent::RateTooLow { rate_hz: period_s.recip(), needed_hz });
        }
        let points = || displacements.iter().zip(1..).map(|(mm2, lag)| (f64::from(lag), *mm2));
        let linear = Moments::running(points().map(|(lag, mm2)| (lag * period_s, mm2)));
        let error = |split: usize| {
            let (short, long) = (Line::of(linear[split]), Line::of(linear[lags] - linear[split]));
            short.squared_error + long.squared_error
        };
        let split = (first..=last).min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap_or(first);
        let logs = Moments::running(points().map(|(lag, mm2)| (lag.ln(), mm2.ln())));
        // Zero has no logarithm: then both slopes are NaN.
        let exponent = |points: Moments| {
            let hurst = Line::of(points).slope / 2.0;
            if hurst.is_finite() { Ok(hurst) } else { Err(Absent::Returns) }
        };
        Ok(Self {
            short: Line::of(linear[split]),
            long: Line::of(linear[lags] - linear[split]),
            hurst_short: exponent(logs[split]),
            hurst_long: exponent(logs[lags] - logs[split]),
            split_s: split as f64 * period_s,
            split_at_bound: split == first || split == last,
        })
    }

    /// The lag at which the lines cross.
    fn critical_s(&self) -> Result<f64, Absent> {
        let lag_s =
            (self.long.intercept - self.short.intercept) / (self.short.slope - self.long.slope);
        if lag_s > 0.0 && lag_s.is_finite() { Ok(lag_s) } else { Err(Absent::NoCrossing) }
    }
}

/// Sums over points: their number, x, y, x², xy, y².
#[derive(Debug, Clone, Copy, Default)]
struct Moments([f64; 6]);

impl Moments {
    /// The sums over the first 0, 1, 2 ... points.
    fn running(points: impl Iterator<Item = (f64, f64)>) -> Vec<Self> {
        let mut all = vec![Self::default()];
        let mut sums = Self::default();
        for (x, y) in points {
            for (sum, term) in sums.0.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                *sum += term;
            }
            all.push(sums);
        }
        all
    }
}

impl std::ops::Sub for Moments {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|at| self.0[at] - other.0[at]))
    }
}

/// The least-squares line through points.
struct Line {
    slope: f64,
    intercept: f64,
    squared_error: f64,
}

impl Line {
    fn of(Moments([count, x, y, xx, xy, yy]): Moments) -> Self {
        let (mean_x, mean_y) = (x / count, y / count);
        let slope = (xy - x * mean_y) / (xx - x * mean_x);
        Self {
            slope,
            intercept: mean_y - slope * mean_x,
            squared_error: yy - y * mean_y - slope * (xy - x * mean_y),
        }
    }
}

/// Mean square displacement at lags of 1, 2, 3 ... periods.
///
/// `sum (x(i + lag) - x(i))^2` is the sum of both squares minus twice the sum of the products,
/// which is a correlation: computed block by block with FFTs, for lags far shorter than the trial.
/// The mean of each block is subtracted, so that a slow drift does not cost precision.
fn displacements(
    series: &Series,
    axis: Axis,
    planner: &mut RealFftPlanner<f64>,
) -> Result<Vec<f64>, Absent> {
    let positions_mm = along(series, axis)?;
    if positions_mm.iter().all(|it| *it == positions_mm[0]) {
        return Err(Absent::NoMovement);
    }
    long_enough(longest_segment(series).len(), series, LAGS_MIN * LONGEST_LAG_S)?;
    let lags = (LONGEST_LAG_S / series.period_s()).round() as usize;
    let length = (4 * (lags + 1)).next_power_of_two();
    let block = length - lags;
    let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let mut spectrum = vec![Complex::default(); length / 2 + 1];
    let mut starts_spectrum = spectrum.clone();
    let (mut starts, mut ends) = (vec![0.0; length], vec![0.0; length]);
    let mut sums = vec![0.0; lags + 1];
    let mut pairs = vec![0_usize; lags + 1];
    for segment in series.segments() {
        let positions_mm = &positions_mm[segment];
        for start in (0..positions_mm.len()).step_by(block) {
            // Displacements start in the block and end in it or within the longest lag after it.
            let near = &positions_mm[start..positions_mm.len().min(start + length)];
            let in_block = near.len().min(block);
            let mean = near.iter().sum::<f64>() / near.len() as f64;
            starts.fill(0.0);
            ends.fill(0.0);
            near.iter().zip(&mut ends).for_each(|(from, to)| *to = from - mean);
            starts[..in_block].copy_from_slice(&ends[..in_block]);
            // The sums of the first 0, 1, 2 ... squares.
            let mut squares = Vec::with_capacity(near.len() + 1);
            squares.push(0.0);
            for value in &ends[..near.len()] {
                squares.push(squares[squares.len() - 1] + value * value);
            }
            // The lengths are those of the plans, and no other error is possible.
            let transformed = forward
                .process(&mut ends, &mut spectrum)
                .and_then(|()| forward.process(&mut starts, &mut starts_spectrum));
            if transformed.is_err() {
                return Err(Absent::Overflow);
            }
            spectrum.iter_mut().zip(&starts_spectrum).for_each(|(a, b)| *a *= b.conj());
            // Purely real in theory; any imaginary remainder is ignored.
            let _ = inverse.process(&mut spectrum, &mut ends);
            for lag in 1..=lags.min(near.len() - 1) {
                let count = in_block.min(near.len() - lag);
                let both = squares[count] + squares[count + lag] - squares[lag];
                sums[lag] += both - 2.0 * ends[lag] / length as f64;
                pairs[lag] += count;
            }
        }
    }
    // Rounding can make a zero sum negative. (`max` would turn NaN into zero.)
    let mean = |lag: usize| if sums[lag] < 0.0 { 0.0 } else { sums[lag] / pairs[lag] as f64 };
    Ok((1..=lags).map(mean).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_are_those_of_all_pairs_without_a_gap() {
        // 60 s and 25 s at 20 Hz with a gap between them; a drift of 1 m.
        let time_s: Vec<f64> =
            (0..1200).chain(1203..1703).map(|index| f64::from(index) / 20.0).collect();
        let ap: Vec<f64> = time_s
            .iter()
            .map(|time| 12.0 * time + 3.0 * (2.0 * time).sin() + (37.0 * time * time).cos())
            .collect();
        let series = Series::new(time_s, [ap.clone(), Vec::new(), Vec::new()]).unwrap();
        let mut planner = RealFftPlanner::new();
        let displacements = displacements(&series, Axis::Ap, &mut planner).unwrap();
        assert_eq!(displacements.len(), 200);
        for (value, lag) in displacements.iter().zip(1_usize..) {
            let squares = |part: &[f64]| -> Vec<f64> {
                part.windows(lag + 1).map(|it| (it[lag] - it[0]).powi(2)).collect()
            };
            let all = [squares(&ap[..1200]), squares(&ap[1200..])].concat();
            let expected = all.iter().sum::<f64>() / all.len() as f64;
            // Rounding of the squares over a block, (12 mm/s x 20 s)^2, compared with 1.5 mm².
            assert!((value / expected - 1.0).abs() < 1e-10, "{lag}: {value} {expected}");
        }
    }
}
