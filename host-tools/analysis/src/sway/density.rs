//! Sway density: how long a point stays close to where it is (Baratto et al. 2002, Motor Control
//! 6:246; Jacono et al. 2004).
//!
//! For each sample, the number of consecutive samples around it that lie within a radius of it in
//! the transverse plane, divided by the rate: a curve of times, in seconds. The curve is smoothed
//! (Butterworth, 2.5 Hz, no delay), and its peaks are the times at which the point is held.
//!
//! It is computed from the longest part without a gap, whose start and end [the
//! spectrum](super::spectrum) reports. The radius must suit what is measured: 3 mm (or 2.5 mm) is
//! used for the centre of pressure, and nothing is published for the trunk.

use serde::Serialize;

use super::figure::{Absent, Figure, Figures};
use super::path::along;
use super::spectrum::{long_enough, longest_segment};
use crate::filter::Butterworth;
use crate::series::{Axis, Series};

/// The cut-off frequency and the order of each pass of the smoothing, as in the literature.
const CUT_OFF_HZ: f64 = 2.5;
const ORDER: usize = 4;

/// The rate must be above twice the cut-off.
const RATE_MIN_HZ: f64 = 2.0 * CUT_OFF_HZ;

/// A point that stays within the radius for longer than this to one side is not swaying between
/// positions that it holds. The limit also bounds the computing time.
const LIMIT_S: f64 = 60.0;

/// The number of samples examined together.
const BLOCK: usize = 16;

/// Enough for several peaks, of which there are one or two per second.
const SHORTEST_S: f64 = 10.0;

/// The settings of the sway density.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// The radius, mm.
    pub radius_mm: f64,
}

impl Default for Settings {
    /// The radius commonly used for the centre of pressure.
    fn default() -> Self {
        Self { radius_mm: 3.0 }
    }
}

/// Means over the peaks of the curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Density {
    /// The settings used.
    pub settings: Settings,
    /// Mean height of a peak (MP), s.
    pub peak_s: Figure,
    /// Mean time from one peak to the next (MT), s.
    pub interval_s: Figure,
    /// Mean distance between the positions at one peak and at the next (MD), mm.
    pub distance_mm: Figure,
}

impl Figures for Density {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        let all = [&mut self.peak_s, &mut self.interval_s, &mut self.distance_mm];
        all.into_iter().for_each(visit);
    }
}

pub(super) fn density(series: &Series, settings: Settings) -> Density {
    let means = means(series, settings);
    let figure = |index: usize| means.map(|means| means[index]).into();
    Density { settings, peak_s: figure(0), interval_s: figure(1), distance_mm: figure(2) }
}

fn means(series: &Series, Settings { radius_mm }: Settings) -> Result<[f64; 3], Absent> {
    let rate_hz = series.rate_hz();
    let segment = longest_segment(series);
    let positions_mm = [along(series, Axis::Ap)?, along(series, Axis::Ml)?];
    let positions_mm = positions_mm.map(|axis| &axis[segment.clone()]);
    long_enough(segment.len(), series, SHORTEST_S)?;
    let times_s = times(positions_mm, radius_mm, rate_hz)?;
    let curve_s = Butterworth::new(CUT_OFF_HZ, ORDER, rate_hz)
        .and_then(|filter| filter.smooth(&times_s))
        .ok_or(Absent::RateTooLow { rate_hz, needed_hz: RATE_MIN_HZ })?;
    let peaks = peaks(&curve_s);
    let [first, .., last] = peaks[..] else { return Err(Absent::TooFewPeaks(peaks.len())) };
    let distance_mm = |pair: &[usize]| {
        let along = |axis: &[f64]| axis[pair[1]] - axis[pair[0]];
        along(positions_mm[0]).hypot(along(positions_mm[1]))
    };
    let steps = (peaks.len() - 1) as f64;
    Ok([
        peaks.iter().map(|at| curve_s[*at]).sum::<f64>() / peaks.len() as f64,
        (last - first) as f64 / steps / rate_hz,
        peaks.windows(2).map(distance_mm).sum::<f64>() / steps,
    ])
}

/// For each sample, how long the consecutive samples around it stay within the radius.
fn times(positions_mm: [&[f64]; 2], radius_mm: f64, rate_hz: f64) -> Result<Vec<f64>, Absent> {
    let limit = (LIMIT_S * rate_hz) as usize;
    let reversed = positions_mm.map(|axis| axis.iter().rev().copied().collect::<Vec<f64>>());
    let after = stays(positions_mm, radius_mm, limit);
    let before = stays([&reversed[0], &reversed[1]], radius_mm, limit);
    let (Some(after), Some(before)) = (after, before) else {
        return Err(Absent::StaysWithin { radius_mm, limit_s: LIMIT_S });
    };
    let samples = after.iter().zip(before.iter().rev()).map(|(after, before)| before + 1 + after);
    Ok(samples.map(|samples| samples as f64 / rate_hz).collect())
}

/// For each sample, the number of samples after it that stay within the radius; `None` if one
/// exceeds the limit.
fn stays([x_mm, y_mm]: [&[f64]; 2], radius_mm: f64, limit: usize) -> Option<Vec<usize>> {
    // A block whose bounding box lies within the radius need not be examined.
    let span = |block: &[f64]| {
        let least = block.iter().copied().fold(f64::INFINITY, f64::min);
        (least, block.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let blocks: Vec<_> = x_mm.chunks(BLOCK).map(span).zip(y_mm.chunks(BLOCK).map(span)).collect();
    let samples = x_mm.len();
    let within = |x: f64, y: f64| x * x + y * y <= radius_mm * radius_mm;
    let stays = |at: usize| {
        let (x, y) = (x_mm[at], y_mm[at]);
        let farthest =
            |(least, greatest): (f64, f64), from: f64| (from - least).max(greatest - from);
        let mut next = at + 1;
        while next < samples && next - at <= limit + BLOCK {
            let (x_span, y_span) = blocks[next / BLOCK];
            if next.is_multiple_of(BLOCK) && within(farthest(x_span, x), farthest(y_span, y)) {
                next = samples.min(next + BLOCK);
            } else if within(x_mm[next] - x, y_mm[next] - y) {
                next += 1;
            } else {
                break;
            }
        }
        let stays = next - at - 1;
        (stays <= limit).then_some(stays)
    };
    (0..samples).map(stays).collect()
}

/// The samples above both neighbours; of several equal ones the middle.
fn peaks(curve: &[f64]) -> Vec<usize> {
    let mut peaks = Vec::new();
    let mut rose_at = None;
    for at in 1..curve.len() {
        if curve[at] > curve[at - 1] {
            rose_at = Some(at);
        } else if curve[at] < curve[at - 1] {
            peaks.extend(rose_at.take().map(|rose: usize| usize::midpoint(rose, at - 1)));
        }
    }
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipping_gives_what_looking_at_every_sample_gives() {
        let wander = |speed: f64| -> Vec<f64> {
            (0..600).map(|i| 4.0 * (speed * f64::from(i)).sin() + f64::from(i * i % 13)).collect()
        };
        let (x, y) = (wander(0.05), wander(0.033));
        let near = |a: usize, b: usize| {
            let (dx, dy): (f64, f64) = (x[a] - x[b], y[a] - y[b]);
            dx * dx + dy * dy <= 81.0
        };
        let expected: Vec<f64> = (0..600)
            .map(|at| {
                let before = (0..at).rev().take_while(|other| near(at, *other)).count();
                let after = (at + 1..600).take_while(|other| near(at, *other)).count();
                (before + 1 + after) as f64 / 50.0
            })
            .collect();
        assert_eq!(times([&x, &y], 9.0, 50.0), Ok(expected));
    }

    #[test]
    fn a_point_that_stays_has_no_density_and_costs_nothing() {
        let still = [0.0; 20_000];
        let absent = Absent::StaysWithin { radius_mm: 3.0, limit_s: LIMIT_S };
        assert_eq!(times([&still, &still], 3.0, 60.0), Err(absent));
    }

    #[test]
    fn peaks_are_inner_and_a_flat_one_counts_once() {
        assert_eq!(peaks(&[5.0, 1.0, 2.0, 2.0, 2.0, 1.0, 3.0, 0.0, 4.0]), [3, 6]);
        assert!(peaks(&[1.0, 1.0, 1.0]).is_empty());
    }
}
