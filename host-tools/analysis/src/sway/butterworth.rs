//! Butterworth's low-pass filter of fourth order, run forwards and backwards, so that nothing is
//! delayed.
//!
//! Two passes attenuate twice: by 6 dB at the cut-off, as an eighth order would beyond it. The
//! ends are those of scipy's `sosfiltfilt`: the signal is continued by 15 samples, turned about
//! its end points, and each pass starts as though its first sample had always been there.

/// Damping of the two second-order sections: `2 sin(pi/8)` and `2 sin(3 pi/8)`, which places the
/// four poles evenly on a half circle.
const DAMPING: [f64; 2] = [0.765_366_864_730_179_6, 1.847_759_065_022_573_5];

/// Samples by which each end is continued.
const CONTINUED: usize = 15;

/// Below the cut-off; `None` when that is not below half the rate, or there are too few samples
/// to continue.
pub(super) fn low_pass(samples: &[f64], cut_off_hz: f64, rate_hz: f64) -> Option<Vec<f64>> {
    let usable = cut_off_hz > 0.0 && 2.0 * cut_off_hz < rate_hz && samples.len() > CONTINUED;
    if !usable {
        return None;
    }
    // Warped so that the bilinear transform puts the cut-off where it was asked for.
    let warped = (core::f64::consts::PI * cut_off_hz / rate_hz).tan();
    let (first, last) = (samples[0], samples[samples.len() - 1]);
    let before = samples[1..=CONTINUED].iter().rev().map(|it| 2.0 * first - it);
    let end = &samples[samples.len() - 1 - CONTINUED..samples.len() - 1];
    let after = end.iter().rev().map(|it| 2.0 * last - it);
    let mut all: Vec<f64> = before.chain(samples.iter().copied()).chain(after).collect();
    for _direction in 0..2 {
        DAMPING.into_iter().for_each(|damping| section(&mut all, warped, damping));
        all.reverse();
    }
    Some(all[CONTINUED..CONTINUED + samples.len()].to_vec())
}

/// `H(s) = 1 / (s^2 + damping s + 1)` after the bilinear transform.
fn section(samples: &mut [f64], warped: f64, damping: f64) {
    let square = warped * warped;
    let scale = 1.0 / (1.0 + damping * warped + square);
    let b0 = square * scale;
    let (b1, b2) = (2.0 * b0, b0);
    let (a1, a2) = (2.0 * (square - 1.0) * scale, (1.0 - damping * warped + square) * scale);
    // The state after an endless run of the first sample, which passes unchanged.
    let first = samples[0];
    let (mut s1, mut s2) = ((1.0 - b0) * first, (b2 - a2) * first);
    for sample in samples {
        let input = *sample;
        let output = b0 * input + s1;
        s1 = b1 * input - a1 * output + s2;
        s2 = b2 * input - a2 * output;
        *sample = output;
    }
}
