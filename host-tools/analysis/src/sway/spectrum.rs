//! How fast a point sways: figures of the power spectrum along each axis.
//!
//! The spectrum is the periodogram about the mean, which needs no choice of a length and whose
//! total power is the variance. (The detrending and the length of the parts change the median by up
//! to a factor of two: Vieira et al. 2009, J. Neurosci. Methods.) It runs from 0 to half the rate
//! and uses only the longest part without a gap: a gap that is bridged or closed is a jump, which
//! adds power at all frequencies.

use std::ops::Range;

use realfft::RealFftPlanner;
use serde::Serialize;

use super::figure::{Absent, ByAxis, Figure, Figures};
use crate::series::{Axis, Series};

/// Sway has much of its power at a few tenths of a hertz: in a shorter time it cannot be told from
/// a drift.
const SHORTEST_S: f64 = 10.0;

/// A part with fewer samples has no useful spectrum.
const PART_MIN: usize = 8;

/// The relative remainder when a constant, or a line, is subtracted from itself.
const ROUNDING: f64 = 1e-12;

/// What is subtracted from each transformed part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Detrend {
    /// Its mean.
    Mean,
    /// Its least-squares line.
    Line,
}

/// Figures of the spectra.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spectrum {
    /// The start of the part without a gap that was used, seconds.
    pub from_s: f64,
    /// The end of that part, seconds.
    pub to_s: f64,
    /// The figures along each axis.
    #[serde(flatten)]
    pub axes: ByAxis<Frequencies>,
}

/// Figures of one spectrum `P(f)`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Frequencies {
    /// Mean frequency `sum(f P) / sum(P)`, Hz. (Not the "mean frequency" of Prieto et al. 1996,
    /// which is a mean velocity divided by a mean radius.)
    pub mean_hz: Figure,
    /// Centroidal frequency `sqrt(sum(f^2 P) / sum(P))`, Hz.
    pub centroidal_hz: Figure,
    /// Median frequency F50: half of the power lies below it, Hz. Like F95 it is interpolated on
    /// the cumulative integral of `P` (trapezoids), so that it is not tied to the frequency grid.
    pub median_hz: Figure,
    /// F95: 95 % of the power lies below it, Hz.
    pub f95_hz: Figure,
}

impl Figures for Frequencies {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        let all =
            [&mut self.mean_hz, &mut self.centroidal_hz, &mut self.median_hz, &mut self.f95_hz];
        all.into_iter().for_each(visit);
    }
}

impl Figures for Spectrum {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.axes.each(visit);
    }
}

/// The longest part without a gap.
pub(super) fn longest_segment(series: &Series) -> Range<usize> {
    // The first of several equally long ones.
    series.segments().fold(0..0, |a, b| if b.len() > a.len() { b } else { a })
}

/// Checks that this many samples without a gap last long enough. Each stands for one period;
/// depending on its phase, a span of exactly the required length may hold one sample fewer than
/// periods.
pub(super) fn long_enough(samples: usize, series: &Series, needed_s: f64) -> Result<(), Absent> {
    let longest_s = samples as f64 * series.period_s();
    if longest_s + series.period_s() < needed_s {
        return Err(Absent::TooShort { longest_s, needed_s });
    }
    Ok(())
}

pub(super) fn spectrum(series: &Series, planner: &mut RealFftPlanner<f64>) -> Spectrum {
    let segment = longest_segment(series);
    let mut frequencies = |samples: Option<&[f64]>, absent| -> Result<[f64; 4], Absent> {
        let samples = &samples.ok_or(absent)?[segment.clone()];
        long_enough(samples.len(), series, SHORTEST_S)?;
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if largest(&detrended(samples, Detrend::Mean)) <= ROUNDING * largest(samples) {
            return Err(Absent::NoMovement);
        }
        let count = samples.len();
        if count < PART_MIN {
            return Err(Absent::TooFewSamples { samples: count, needed: PART_MIN });
        }
        let density = density(planner, samples, count, false, Detrend::Mean);
        figures(&density, series.rate_hz() / count as f64)
    };
    let axes = ByAxis::of(|axis| {
        let all = frequencies(series.along(axis), Absent::NotMeasured(axis));
        let figure = |index: usize| all.map(|all| all[index]).into();
        Frequencies {
            mean_hz: figure(0),
            centroidal_hz: figure(1),
            median_hz: figure(2),
            f95_hz: figure(3),
        }
    });
    let time_s = series.time_s();
    Spectrum { from_s: time_s[segment.start], to_s: time_s[segment.end - 1], axes }
}

/// The one-sided power spectral density along an axis, for plotting: pairs of a frequency in Hz and
/// a density in mm²/Hz, without the one at 0 Hz. Welch's method (1967): half-overlapping parts of
/// `part_s`, each linearly detrended, from the longest part without a gap.
///
/// `None` when that part is shorter than `part_s`, or the axis was not measured.
#[must_use]
pub fn power_density(series: &Series, axis: Axis, part_s: f64) -> Option<Vec<(f64, f64)>> {
    let samples = &series.along(axis)?[longest_segment(series)];
    let part = (part_s * series.rate_hz()).round() as usize;
    if part < PART_MIN || part > samples.len() {
        return None;
    }
    let sums = density(&mut RealFftPlanner::new(), samples, part, true, Detrend::Line);
    let parts = (samples.len() - part) / (part - part / 2) + 1;
    // The sum of squares of the periodic Hann window.
    let scale = series.rate_hz() * 0.375 * part as f64 * parts as f64;
    let resolution_hz = series.rate_hz() / part as f64;
    let at = |(index, sum): (usize, f64)| (index as f64 * resolution_hz, sum / scale);
    Some(sums.into_iter().enumerate().skip(1).map(at).collect())
}

/// The one-sided density at multiples of the rate divided by `part`, up to a factor on which none
/// of the figures depends.
fn density(
    planner: &mut RealFftPlanner<f64>,
    samples: &[f64],
    part: usize,
    hann: bool,
    detrend: Detrend,
) -> Vec<f64> {
    let transform = planner.plan_fft_forward(part);
    let (mut transformed, mut scratch) =
        (transform.make_output_vec(), transform.make_scratch_vec());
    let mut density = vec![0.0; transformed.len()];
    let weight = |index: usize| {
        // Periodic: the sample after the last would equal the first.
        let angle = core::f64::consts::TAU * index as f64 / part as f64;
        if hann { 0.5 - 0.5 * angle.cos() } else { 1.0 }
    };
    let weights: Vec<f64> = (0..part).map(weight).collect();
    for start in (0..=samples.len() - part).step_by((part - part / 2).max(1)) {
        let mut values = detrended(&samples[start..start + part], detrend);
        values.iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight);
        // The lengths are those of the plan, and no other error is possible.
        if transform.process_with_scratch(&mut values, &mut transformed, &mut scratch).is_err() {
            return Vec::new();
        }
        density.iter_mut().zip(&transformed).for_each(|(sum, value)| *sum += value.norm_sqr());
    }
    // Frequencies above 0 and below half the rate also stand for their negatives.
    let inner = 1..part.div_ceil(2);
    density[inner].iter_mut().for_each(|value| *value *= 2.0);
    density
}

fn detrended(samples: &[f64], detrend: Detrend) -> Vec<f64> {
    let count = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / count;
    let middle = (count - 1.0) / 2.0;
    let slope = match detrend {
        Detrend::Mean => 0.0,
        Detrend::Line => {
            let moment: f64 =
                samples.iter().enumerate().map(|(at, it)| (at as f64 - middle) * (it - mean)).sum();
            // The sum of squared distances from the middle.
            moment / (count * (count * count - 1.0) / 12.0)
        }
    };
    let line = |at: usize| mean + slope * (at as f64 - middle);
    samples.iter().enumerate().map(|(at, it)| it - line(at)).collect()
}

/// Mean frequency, centroidal frequency, median frequency and F95.
fn figures(density: &[f64], resolution_hz: f64) -> Result<[f64; 4], Absent> {
    let moment = |power: i32| -> f64 {
        density.iter().enumerate().map(|(at, it)| (at as f64).powi(power) * it).sum()
    };
    let power = moment(0);
    if power <= 0.0 {
        return Err(Absent::NoMovement);
    }
    let trapezoids = density.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0);
    let integral: f64 = trapezoids.clone().sum();
    let below = |share: f64| {
        let mut left = share * integral;
        for (at, trapezoid) in trapezoids.clone().enumerate() {
            if left <= trapezoid {
                return at as f64 + if trapezoid > 0.0 { left / trapezoid } else { 0.0 };
            }
            left -= trapezoid;
        }
        (density.len() - 1) as f64
    };
    let centroidal = (moment(2) / power).sqrt();
    Ok([moment(1) / power, centroidal, below(0.5), below(0.95)].map(|it| it * resolution_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with scipy: see `generate.py` there.
    #[test]
    fn figures_are_those_of_scipys_spectra() {
        let text = include_str!("../../tests/sway_oracles/signal.csv");
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let ap: Vec<f64> =
            reader.deserialize::<(f64, f64)>().map(|position_mm| position_mm.unwrap().0).collect();
        let text = include_str!("../../tests/sway_oracles/oracles.json");
        let oracles: serde_json::Value = serde_json::from_str(text).unwrap();
        for (name, part, hann, detrend) in [
            ("periodogram_mean", ap.len(), false, Detrend::Mean),
            ("periodogram_line", ap.len(), false, Detrend::Line),
            ("welch_mean", 600, true, Detrend::Mean),
            // Parts with an odd number of samples.
            ("welch_line", 421, true, Detrend::Line),
        ] {
            let density = density(&mut RealFftPlanner::new(), &ap, part, hann, detrend);
            let found = figures(&density, 60.0 / part as f64).unwrap();
            let expected = oracles["spectra"][name].as_array().unwrap();
            assert_eq!(expected.len(), found.len());
            for (found, expected) in found.into_iter().zip(expected) {
                let error = found / expected.as_f64().unwrap() - 1.0;
                // The rounding of transforms of 2400 samples.
                assert!(error.abs() < 1e-12, "{name}: {error:e}");
            }
        }
    }

    #[test]
    fn a_span_that_is_long_enough_is_so_wherever_its_samples_lie() {
        // 10 s are 599.4 periods at 59.94 Hz: 599 or 600 samples, depending on where the first one
        // lies.
        let time_s: Vec<f64> = (0..1200).map(|frame| f64::from(frame) / 59.94).collect();
        let series = Series::new(time_s, [Vec::new(), Vec::new(), Vec::new()]).unwrap();
        let part = |from_s: f64| series.between(from_s..from_s + 10.0).unwrap();
        assert_eq!((part(0.001).samples(), part(0.016).samples()), (599, 600));
        for from_s in [0.001, 0.016] {
            assert_eq!(long_enough(part(from_s).samples(), &series, 10.0), Ok(()));
        }
        assert!(long_enough(598, &series, 10.0).is_err());
    }
}
