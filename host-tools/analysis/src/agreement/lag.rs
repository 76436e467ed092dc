//! How much later one clock shows a movement than another: the lag that maximises the correlation
//! of two recordings.
//!
//! Both recordings are resampled at the measurement's rate. The correlation at a lag, over all axes
//! together, is the sum of the covariances divided by the square root of the product of the summed
//! variances, taken over the samples that overlap at that lag. Axes that move most therefore count
//! most. A parabola through the largest of these correlations and its two neighbours gives the
//! maximum between samples.
//!
//! Every sum over an overlap is a correlation of two columns that are 0 where a value is missing;
//! their spectra give it for all lags at once (Padfield 2012, IEEE Trans. Image Process. 21:2706).

use std::ops::RangeInclusive;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use serde::Serialize;

use super::pairs::{PairError, places};
use crate::series::{Axis, Series};

/// Recordings that overlap in less than this fraction of the shorter one are not compared: a few
/// samples correlate by chance.
const OVERLAP_MIN: f64 = 0.5;

/// The most samples a recording may have, ten hours at 200 Hz: the grid of a recording with a pause
/// of days would exhaust the memory.
const GRID_MAX: f64 = 7.2e6;

/// A recording whose movement in the overlap is below this fraction of its squares has no
/// correlation there. Above it, rounding in the spectra, about 1e-15 of the squares, is at most a
/// millionth of the movement.
const MOVEMENT_MIN: f64 = 1e-9;

/// The lag between two clocks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Lag {
    /// The time of a movement in the measurement minus its time in the reference, seconds.
    pub lag_s: f64,
    /// The correlation at this lag, -1 to 1.
    pub correlation: f64,
    /// Whether the lag is at the end of the search range: a larger correlation may lie beyond.
    pub is_at_bound: bool,
}

/// The lag of a measurement behind its reference, from -`lag_max_s` to `lag_max_s`. For n samples
/// in both together it costs O(n log n) operations and at most about 120 n bytes, however many lags
/// there are.
///
/// # Errors
/// When one of the two does not move, or they do not overlap at any of these lags.
pub fn lag(measured: &Series, reference: &Series, lag_max_s: f64) -> Result<Lag, PairError> {
    let shared: Vec<Axis> = Axis::ALL
        .into_iter()
        .filter(|axis| measured.along(*axis).is_some() && reference.along(*axis).is_some())
        .collect();
    if shared.is_empty() {
        return Err(PairError::NoAxis);
    }
    let period_s = measured.period_s();
    let ends = |series: &Series| {
        let time_s = series.time_s();
        [time_s[0], time_s[time_s.len() - 1]]
    };
    let spans = [ends(measured), ends(reference)];
    let no_overlap = PairError::Overlap { pairs: 0, measured_s: spans[0], reference_s: spans[1] };
    if spans.iter().any(|[start, end]| (end - start) / period_s > GRID_MAX) {
        return Err(no_overlap);
    }
    let a = Grid::new(measured, period_s, &shared, "measurement")?;
    let b = Grid::new(reference, period_s, &shared, "reference")?;
    let enough = OVERLAP_MIN * a.filled().min(b.filled()) as f64;
    // Pairing sample i of one with i - shift of the other means a lag of start_s + shift period_s.
    let start_s = spans[0][0] - spans[1][0];
    let shift_of = |lag_s: f64| (lag_s - start_s) / period_s;
    let first = shift_of(-lag_max_s).ceil().max(-(b.samples() as f64)) as i64;
    let last = shift_of(lag_max_s).floor().min(a.samples() as f64) as i64;
    let all = correlations(&a, &b, first..=last, enough);
    let best = (0..all.len())
        .filter(|&at| all[at].is_some())
        .max_by(|&x, &y| all[x].unwrap_or(-1.0).total_cmp(&all[y].unwrap_or(-1.0)))
        .ok_or(no_overlap)?;
    let correlation = all[best].unwrap_or_default();
    let neighbour = |at: Option<usize>| all.get(at?).copied().flatten();
    let around = neighbour(best.checked_sub(1)).zip(neighbour(best.checked_add(1)));
    let (top, correlation) = match around {
        Some((left, right)) => {
            let bend = left - 2.0 * correlation + right;
            let slope = 0.5 * (right - left);
            // Between equal neighbours the maximum may be anywhere.
            let top = if bend < 0.0 { -slope / bend } else { 0.0 };
            (top, (correlation + 0.5 * slope * top).min(1.0))
        }
        None => (0.0, correlation),
    };
    let lag_s = start_s + (first as f64 + best as f64 + top) * period_s;
    Ok(Lag { lag_s, correlation, is_at_bound: around.is_none() })
}

/// A recording that never deviates from its mean by this much does not move: smaller deviations are
/// the rounding of positions some metres from the origin.
const STILL_MM: f64 = 1e-9;

/// A recording at evenly spaced times: the deviations from its mean along each axis, and where it
/// has a value at all. The largest deviation is 1: a correlation has no scale, and squares of
/// this size neither overflow nor underflow.
struct Grid {
    is_there: Vec<bool>,
    axes: Vec<Vec<f64>>,
}

impl Grid {
    fn new(
        series: &Series,
        period_s: f64,
        axes: &[Axis],
        name: &'static str,
    ) -> Result<Self, PairError> {
        let time_s = series.time_s();
        let (first_s, last_s) = (time_s[0], time_s[time_s.len() - 1]);
        let count = ((last_s - first_s) / period_s) as usize + 1;
        let times: Vec<f64> = (0..count).map(|at| first_s + at as f64 * period_s).collect();
        let places = places(series, &times);
        let column = |axis: &Axis| -> Vec<f64> {
            let values = series.along(*axis).unwrap_or_default();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            places.iter().map(|place| place.map_or(0.0, |it| it.value(values) - mean)).collect()
        };
        let mut axes: Vec<Vec<f64>> = axes.iter().map(column).collect();
        let largest_mm = axes.iter().flatten().fold(0.0, |largest: f64, it| largest.max(it.abs()));
        if axes.iter().flatten().any(|it| !it.is_finite()) {
            return Err(PairError::TooLarge(name));
        }
        if largest_mm < STILL_MM {
            return Err(PairError::Constant(name));
        }
        axes.iter_mut().flatten().for_each(|it| *it /= largest_mm);
        Ok(Self { is_there: places.iter().map(Option::is_some).collect(), axes })
    }

    fn samples(&self) -> usize {
        self.is_there.len()
    }

    fn filled(&self) -> usize {
        self.is_there.iter().filter(|it| **it).count()
    }

    /// 1 where there is a value.
    fn mask(&self) -> impl Iterator<Item = f64> {
        self.is_there.iter().map(|it| f64::from(u8::from(*it)))
    }

    /// The squares, summed over the axes.
    fn squares(&self) -> impl Iterator<Item = f64> {
        (0..self.samples()).map(|at| self.axes.iter().map(|values| values[at] * values[at]).sum())
    }

    /// The smallest variance over an overlap that is more than rounding.
    fn movement_min(&self) -> f64 {
        MOVEMENT_MIN * self.squares().sum::<f64>()
    }
}

/// The correlation at each shift; `None` where fewer than `enough` samples overlap or one side does
/// not vary.
fn correlations(a: &Grid, b: &Grid, shifts: RangeInclusive<i64>, enough: f64) -> Vec<Option<f64>> {
    let overlaps = Overlaps::new(a.samples() + b.samples(), shifts);
    let sums = |a: &_, b: &_| overlaps.sums(a, b);
    let masks = [a, b].map(|it| overlaps.spectrum(it.mask()));
    // Counts, apart from rounding.
    let counts: Vec<f64> = sums(&masks[0], &masks[1]).iter().map(|it| it.round()).collect();
    let mut variances = [
        sums(&overlaps.spectrum(a.squares()), &masks[1]),
        sums(&masks[0], &overlaps.spectrum(b.squares())),
    ];
    let mut covariances = vec![0.0; counts.len()];
    for (a, b) in a.axes.iter().zip(&b.axes) {
        let [a, b] = [a, b].map(|it| overlaps.spectrum(it.iter().copied()));
        let (x, y, xy) = (sums(&a, &masks[1]), sums(&masks[0], &b), sums(&a, &b));
        for (at, count) in counts.iter().enumerate() {
            covariances[at] += xy[at] - x[at] * y[at] / count;
            variances[0][at] -= x[at] * x[at] / count;
            variances[1][at] -= y[at] * y[at] / count;
        }
    }
    let least = [a, b].map(Grid::movement_min);
    let correlation = |at: usize| {
        let [of_a, of_b] = [variances[0][at], variances[1][at]];
        let is_known = counts[at] >= enough.max(3.0) && of_a > least[0] && of_b > least[1];
        is_known.then(|| (covariances[at] / (of_a * of_b).sqrt()).clamp(-1.0, 1.0))
    };
    (0..counts.len()).map(correlation).collect()
}

/// Sums over the samples in which two columns overlap, for each shift of one against the other.
struct Overlaps {
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
    shifts: RangeInclusive<i64>,
}

impl Overlaps {
    /// For two columns with this many samples together. At any of the `shifts` that leave an
    /// overlap, the columns do not wrap around the end of the transform.
    fn new(samples: usize, shifts: RangeInclusive<i64>) -> Self {
        let (length, mut planner) = (samples.next_power_of_two(), RealFftPlanner::new());
        let (forward, inverse) =
            (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
        Self { forward, inverse, shifts }
    }

    fn spectrum(&self, values: impl Iterator<Item = f64>) -> Vec<Complex<f64>> {
        let (mut column, mut spectrum) =
            (self.forward.make_input_vec(), self.forward.make_output_vec());
        column.iter_mut().zip(values).for_each(|(to, value)| *to = value);
        self.forward.process(&mut column, &mut spectrum).expect("the plan's own lengths");
        spectrum
    }

    /// The sum over all i of sample i of `a` times sample i - shift of `b`, for each shift.
    fn sums(&self, a: &[Complex<f64>], b: &[Complex<f64>]) -> Vec<f64> {
        let mut products: Vec<_> = a.iter().zip(b).map(|(a, b)| a * b.conj()).collect();
        let mut sums = self.inverse.make_output_vec();
        // Both ends are real, being products of two real numbers.
        self.inverse.process(&mut products, &mut sums).expect("the plan's own lengths");
        let length = sums.len() as i64;
        let at = |shift: i64| sums[shift.rem_euclid(length) as usize] / length as f64;
        self.shifts.clone().map(at).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A person's sway, without a period: a sum of sines up to 1.3 Hz.
    fn sway(time_s: f64) -> [f64; 3] {
        let sum = |parts: [(f64, f64); 3]| {
            parts.iter().map(|(hz, mm)| mm * (std::f64::consts::TAU * hz * time_s).sin()).sum()
        };
        [
            sum([(0.11, 9.0), (0.37, 4.0), (1.30, 0.7)]),
            sum([(0.17, 5.0), (0.53, 2.0), (0.90, 0.5)]),
            sum([(0.23, 0.5), (0.71, 0.2), (1.10, 0.1)]),
        ]
    }

    fn grid(series: &Series) -> Grid {
        Grid::new(series, 1.0 / 60.0, &Axis::ALL, "recording").unwrap()
    }

    fn series(rate_hz: f64, span_s: std::ops::Range<f64>, delay_s: f64) -> Series {
        let count = ((span_s.end - span_s.start) * rate_hz) as usize;
        let time_s: Vec<f64> = (0..count).map(|at| span_s.start + at as f64 / rate_hz).collect();
        let along = |axis: usize| time_s.iter().map(|it| sway(it - delay_s)[axis]).collect();
        Series::new(time_s.clone(), [along(0), along(1), along(2)]).unwrap()
    }

    /// Linear interpolation and the parabola leave an error of about 1e-5 s; a sample lasts 17 ms.
    #[test]
    fn a_delay_is_found_between_samples() {
        for delay_s in [-4.1234, -0.0042, 0.0, 0.0098, 2.3456] {
            let measured = series(60.0, 3.0..43.0, delay_s);
            let reference = series(150.0, 0.0..41.0, 0.0);
            let found = lag(&measured, &reference, 5.0).unwrap();
            assert!((found.lag_s - delay_s).abs() < 2e-4, "{found:?} instead of {delay_s}");
            assert!(found.correlation > 0.999_99 && !found.is_at_bound, "{found:?}");
        }
    }

    #[test]
    fn gaps_of_both_do_not_move_it() {
        let cut = |series: &Series| series.only(&[0..500, 560..900, 1000..1500]).unwrap();
        let measured = cut(&series(60.0, 0.0..40.0, 0.321));
        let reference = cut(&series(100.0, 0.0..40.0, 0.0));
        let found = lag(&measured, &reference, 2.0).unwrap();
        assert!((found.lag_s - 0.321).abs() < 5e-4, "{found:?}");
    }

    #[test]
    fn a_lag_beyond_the_search_is_said_to_be_at_its_bound() {
        let (measured, reference) = (series(60.0, 0.0..30.0, 1.4), series(100.0, 0.0..30.0, 0.0));
        assert!(lag(&measured, &reference, 1.0).unwrap().is_at_bound);
    }

    /// The correlation at one shift, sample by sample.
    fn correlation(a: &Grid, b: &Grid, shift: i64, enough: f64) -> Option<f64> {
        let both: Vec<(usize, usize)> = (0..a.samples())
            .filter_map(|at| Some((at, usize::try_from(at as i64 - shift).ok()?)))
            .filter(|&(at, there)| a.is_there[at] && b.is_there.get(there) == Some(&true))
            .collect();
        let (mut covariance, mut variances) = (0.0, [0.0; 2]);
        for (a, b) in a.axes.iter().zip(&b.axes) {
            let mean =
                |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / both.len() as f64;
            let mean_a = mean(&mut both.iter().map(|&(at, _)| a[at]));
            let mean_b = mean(&mut both.iter().map(|&(_, at)| b[at]));
            for &(at, there) in &both {
                let (a, b) = (a[at] - mean_a, b[there] - mean_b);
                covariance += a * b;
                variances[0] += a * a;
                variances[1] += b * b;
            }
        }
        (both.len() as f64 >= enough).then(|| covariance / (variances[0] * variances[1]).sqrt())
    }

    /// Noise about steps, with lengths and gaps drawn at random: nothing is smooth, and
    /// neighbouring lags have nothing in common.
    #[test]
    fn all_correlations_are_those_of_the_direct_sums() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..20 {
            let mut series = || {
                let count = random.random_range(50..400);
                let time_s = (0..count).map(|at| f64::from(at) / 60.0).collect();
                let mut along = || -> Vec<f64> {
                    let step_mm = random.random_range(-50.0..50.0);
                    let of = |at| if at > count / 2 { step_mm } else { 1500.0 };
                    (0..count).map(|at| of(at) + random.random_range(-5.0..5.0)).collect()
                };
                let positions_mm = [along(), along(), along()];
                let gap = random.random_range(5..20)..random.random_range(22..45);
                let whole = Series::new(time_s, positions_mm).unwrap();
                whole.only(&[0..gap.start, gap.end..count as usize]).unwrap()
            };
            let [a, b] = [series(), series()].map(|it| grid(&it));
            let shifts = -(b.samples() as i64)..=a.samples() as i64;
            let found = correlations(&a, &b, shifts.clone(), 20.0);
            assert_eq!(found.len() as i64, shifts.end() - shifts.start() + 1);
            for (shift, found) in shifts.zip(found) {
                let wanted = correlation(&a, &b, shift, 20.0);
                assert_eq!(found.is_some(), wanted.is_some(), "at {shift}");
                // Rounding: about 1e-16 of squares that the step makes 1e5 times larger, and ten
                // times that where the samples that overlap are those of the noise alone.
                let differs = found.zip(wanted).map_or(0.0, |(a, b)| (a - b).abs());
                assert!(differs < 1e-9, "{differs} at {shift}");
            }
        }
    }

    /// During the last 20 s the measurement is still. At lags that pair only these samples with the
    /// reference, nothing but rounding is left, whose correlation could be anything.
    #[test]
    fn what_is_still_where_both_overlap_has_no_lag() {
        let moving = series(60.0, 0.0..30.0, 0.0);
        let until = |count: usize| {
            let mut held = Axis::ALL.map(|axis| moving.along(axis).unwrap().to_vec());
            held.iter_mut().for_each(|values| {
                let last = values[count];
                values[count..].fill(last);
            });
            moving.with_positions(held).unwrap()
        };
        let [a, b] = [&until(600), &moving].map(grid);
        let found = correlations(&a, &b, -1800..=1800, 900.0);
        // Shift 600 is the first to leave only samples from 600 on; at 900 the overlap becomes too
        // short.
        let known = |shift: i64| found[(shift + 1800) as usize].is_some();
        assert!((-900..590).all(known), "they move together");
        assert!(!(600..=1800).any(known), "one is still");
    }

    #[test]
    fn what_has_no_lag_is_refused() {
        let moving = series(60.0, 0.0..30.0, 0.0);
        let still = moving.with_positions([vec![3e3; 1800], vec![], vec![1.0; 1800]]).unwrap();
        assert_eq!(lag(&moving, &still, 5.0), Err(PairError::Constant("reference")));
        assert_eq!(lag(&still, &moving, 5.0), Err(PairError::Constant("measurement")));
        let far = series(60.0, 100.0..130.0, 0.0);
        assert!(matches!(lag(&far, &moving, 5.0), Err(PairError::Overlap { .. })));
        let ml = moving.with_positions([vec![], vec![1.0; 1800], vec![]]).unwrap();
        let ap = moving.with_positions([vec![1.0; 1800], vec![], vec![]]).unwrap();
        assert_eq!(lag(&ml, &ap, 5.0), Err(PairError::NoAxis));
    }
}
