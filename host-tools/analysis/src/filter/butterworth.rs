//! The Butterworth low-pass filter, run forwards and backwards, so that there is no delay.
//!
//! The filter equals scipy's `sosfiltfilt(butter(order, cutoff_hz, fs=rate_hz, output="sos"), x)`.
//!
//! # Order and cutoff
//! Both are those of each pass, as in scipy and in MATLAB's `filtfilt`, and the cutoff is not
//! corrected for the second pass. Two passes attenuate twice: they halve the amplitude at the cutoff
//! (-6 dB), and beyond it they attenuate like a filter of twice the order. What is often called a
//! "fourth-order zero-phase Butterworth filter" is order 2 here. Authors who correct the cutoff
//! (Winter, Biomechanics and Motor Control of Human Movement) state the frequency at which both
//! passes together are at -3 dB: [`half_power_hz`](Butterworth::half_power_hz).
//!
//! # The ends
//! As in scipy, the signal is extended at each end by `3 (order + 1)` samples, rotated by half a
//! turn about its end point, and each pass starts as if its first sample had lasted forever. Within
//! about one period of the cutoff from an end, the result still depends on that guess.

use core::f64::consts::PI;

use super::Variance;

/// The highest order: beyond it, rounding and ringing grow, and nobody uses them.
pub const ORDER_MAX: usize = 8;

/// The rate may be this many times the cutoff. Below such a cutoff, rounding grows, and the
/// response is thousands of samples long.
pub const RATE_PER_CUTOFF_MAX: f64 = 1000.0;

/// A response is taken to have ended where it has fallen to this fraction.
const RESPONSE_END: f64 = 1e-6;

/// The filter for one rate.
#[derive(Debug, Clone, PartialEq)]
pub struct Butterworth {
    cutoff_hz: f64,
    order: usize,
    rate_hz: f64,
    /// One for each pair of poles and, if the order is odd, one for the real pole.
    sections: Vec<Section>,
}

/// `(b0 + b1 / z + b2 / z^2) / (1 + a1 / z + a2 / z^2)`, which passes a constant unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl Section {
    /// `1 / (s^2 + damping s + 1)` after the bilinear transform.
    fn of_pair(warped: f64, damping: f64) -> Self {
        let square = warped * warped;
        let scale = 1.0 / (1.0 + damping * warped + square);
        let b0 = square * scale;
        let a = [2.0 * (square - 1.0) * scale, (1.0 - damping * warped + square) * scale];
        Self { b: [b0, 2.0 * b0, b0], a }
    }

    /// `1 / (s + 1)` after the bilinear transform.
    fn of_real_pole(warped: f64) -> Self {
        let b0 = warped / (1.0 + warped);
        Self { b: [b0, b0, 0.0], a: [(warped - 1.0) / (1.0 + warped), 0.0] }
    }

    fn run(&self, samples: &mut [f64]) {
        let Self { b: [b0, b1, b2], a: [a1, a2] } = *self;
        // The steady state for a constant input equal to the first sample.
        let first = samples.first().copied().unwrap_or_default();
        let (mut s1, mut s2) = ((1.0 - b0) * first, (b2 - a2) * first);
        for sample in samples {
            let input = *sample;
            let output = b0 * input + s1;
            s1 = b1 * input - a1 * output + s2;
            s2 = b2 * input - a2 * output;
            *sample = output;
        }
    }
}

impl Butterworth {
    /// A filter with the cutoff and order of each pass; `None` when the order is not 1 to 8, or the
    /// cutoff is not between a thousandth and half of the rate.
    #[must_use]
    pub fn new(cutoff_hz: f64, order: usize, rate_hz: f64) -> Option<Self> {
        let is_usable = rate_hz.is_finite()
            && rate_hz < RATE_PER_CUTOFF_MAX * cutoff_hz
            && 2.0 * cutoff_hz < rate_hz
            && (1..=ORDER_MAX).contains(&order);
        if !is_usable {
            return None;
        }
        // Prewarped so that the bilinear transform puts the cutoff at the requested frequency.
        let warped = (PI * cutoff_hz / rate_hz).tan();
        // The poles lie evenly on a half circle.
        let damping = |pair: usize| 2.0 * pole_angle(pair, order).sin();
        let pairs = (0..order / 2).map(|pair| Section::of_pair(warped, damping(pair)));
        let real = (order % 2 == 1).then(|| Section::of_real_pole(warped));
        Some(Self { cutoff_hz, order, rate_hz, sections: pairs.chain(real).collect() })
    }

    /// The frequency at which both passes together halve the power (-3 dB), Hz.
    #[must_use]
    pub fn half_power_hz(&self) -> f64 {
        // One pass has the gain `1 / sqrt(1 + r^(2 n))` with `r = tan(pi f / rate) / warped`.
        let ratio = (2.0_f64.sqrt() - 1.0).powf(0.5 / self.order as f64);
        let warped = (PI * self.cutoff_hz / self.rate_hz).tan();
        (ratio * warped).atan() * self.rate_hz / PI
    }

    /// The number of samples by which each end is extended.
    fn extension(&self) -> usize {
        3 * (self.order + 1)
    }

    /// The number of samples that it needs: one more than the extension mirrors.
    #[must_use]
    pub fn samples_min(&self) -> usize {
        self.extension() + 1
    }

    /// Smooths evenly spaced samples; `None` when there are too few.
    #[must_use]
    pub fn smooth(&self, samples: &[f64]) -> Option<Vec<f64>> {
        let extension = self.extension();
        if samples.len() < self.samples_min() {
            return None;
        }
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let before = samples[1..=extension].iter().rev().map(|it| 2.0 * first - it);
        let end = &samples[samples.len() - 1 - extension..samples.len() - 1];
        let after = end.iter().rev().map(|it| 2.0 * last - it);
        let mut all: Vec<f64> = before.chain(samples.iter().copied()).chain(after).collect();
        for _direction in 0..2 {
            self.sections.iter().for_each(|section| section.run(&mut all));
            all.reverse();
        }
        Some(all[extension..extension + samples.len()].to_vec())
    }

    /// As [`Filter::step_variances`](super::Filter::step_variances).
    ///
    /// The weights are the responses to an error in a single sample. Away from the ends all
    /// responses are shifted copies of one, so it costs the length of a response times the number of
    /// samples, and the square of that length for the ends.
    #[must_use]
    pub fn step_variances<V: Variance>(&self, variances: &[V]) -> Option<Vec<V>> {
        let samples = variances.len();
        if samples < self.samples_min() {
            return None;
        }
        let edge = self.reach() + self.extension();
        // Each end of the shorter signal is like that of the whole, and its middle like the middle.
        let shorter = samples.min(3 * edge);
        let squared_steps = |sample: usize| -> Option<Vec<f64>> {
            let mut impulse = vec![0.0; shorter];
            impulse[sample] = 1.0;
            let response = self.smooth(&impulse)?;
            Some(response.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).collect())
        };
        let mut steps = vec![V::default(); samples - 1];
        let mut add = |squares: &[f64], first_step: usize, variance: V| {
            for (step, square) in steps[first_step..].iter_mut().zip(squares) {
                *step += variance * *square;
            }
        };
        if samples == shorter {
            for (sample, variance) in variances.iter().enumerate() {
                add(&squared_steps(sample)?, 0, *variance);
            }
            return Some(steps);
        }
        let shift = samples - shorter;
        for at in 0..edge {
            add(&squared_steps(at)?, 0, variances[at]);
            let from_end = shorter - 1 - at;
            add(&squared_steps(from_end)?, shift, variances[shift + from_end]);
        }
        let middle = squared_steps(edge)?;
        for (first_step, variance) in variances[edge..samples - edge].iter().enumerate() {
            add(&middle[..2 * edge], first_step, *variance);
        }
        Some(steps)
    }

    /// The number of samples after which a response has ended, in either direction.
    fn reach(&self) -> usize {
        // The slowest pole is the one with the least damping; for order 1 it is the real one.
        let warped = (PI * self.cutoff_hz / self.rate_hz).tan();
        let angle = pole_angle(0, self.order);
        let (real, imaginary) = (-warped * angle.sin(), warped * angle.cos());
        let radius = (1.0 + real).hypot(imaginary) / (1.0 - real).hypot(imaginary);
        if radius <= f64::EPSILON {
            return 1;
        }
        (RESPONSE_END.ln() / radius.ln()).ceil() as usize
    }
}

/// The angle between a pole and the imaginary axis, from the least damped pair onwards.
fn pole_angle(pair: usize, order: usize) -> f64 {
    (2 * pair + 1) as f64 * PI / (2 * order) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The amplitude ratio for a sine of this frequency, away from the ends.
    fn gain(filter: &Butterworth, hz: f64) -> f64 {
        // Thirty seconds before and after a whole number of periods.
        let rate_hz = filter.rate_hz;
        let count = (100.0 * rate_hz) as u32;
        let wave = |at: u32| (2.0 * PI * hz * f64::from(at) / rate_hz).cos();
        let samples: Vec<f64> = (0..count).map(wave).collect();
        let smooth = filter.smooth(&samples).unwrap();
        let middle = (30.0 * rate_hz) as usize..(70.0 * rate_hz) as usize;
        // Its part in phase with the sine; there is no other where there is no delay.
        let product: f64 = middle.clone().map(|at| smooth[at] * samples[at]).sum();
        product / middle.map(|at| samples[at] * samples[at]).sum::<f64>()
    }

    #[test]
    fn two_passes_halve_the_amplitude_at_the_cutoff_and_the_power_where_stated() {
        for order in 1..=ORDER_MAX {
            let filter = Butterworth::new(5.0, order, 60.0).unwrap();
            assert!((gain(&filter, 5.0) - 0.5).abs() < 1e-9, "{order}: {}", gain(&filter, 5.0));
            let half_power = gain(&filter, filter.half_power_hz());
            // The frequency is not a whole number of periods in the window: 1 / 500 periods.
            assert!((half_power - 0.5_f64.sqrt()).abs() < 1e-3, "{order}: {half_power}");
        }
        // Winter's factor for a second-order filter and two passes.
        let slow = Butterworth::new(5.0, 2, 4000.0).unwrap();
        assert!((slow.half_power_hz() / 5.0 - 0.802).abs() < 5e-4, "{}", slow.half_power_hz());
    }

    #[test]
    fn a_constant_passes_unchanged_and_a_line_nearly() {
        for order in 1..=ORDER_MAX {
            let filter = Butterworth::new(5.0, order, 60.0).unwrap();
            let level = filter.smooth(&[7.0; 40]).unwrap();
            assert!(level.iter().all(|it| (it - 7.0).abs() < 1e-12), "{order}");
            // The extension goes on with the line, and only before it a constant is assumed.
            let line: Vec<f64> = (0..80).map(|at| 0.25 * f64::from(at)).collect();
            let smooth = filter.smooth(&line).unwrap();
            let errors = smooth.iter().zip(&line).map(|(after, before)| (after - before).abs());
            let errors: Vec<f64> = errors.collect();
            // A tenth of a step at the ends, and a thousandth in the middle.
            assert!(errors.iter().all(|it| *it < 0.025), "{order}: {errors:?}");
            assert!(errors[40] < 0.25e-3, "{order}: {}", errors[40]);
        }
    }
}
