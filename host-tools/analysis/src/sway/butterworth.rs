//! Fourth-order Butterworth low-pass filter, run forwards and backwards, so that there is no delay.
//!
//! Two passes attenuate twice: by 6 dB at the cut-off, and beyond it like an eighth-order filter.
//! The ends are treated as in scipy's `sosfiltfilt`: the signal is extended by 15 samples, rotated
//! by half a turn about its end points, and each pass starts as if its first sample had lasted
//! forever.

/// Damping of the two second-order sections: `2 sin(pi/8)` and `2 sin(3 pi/8)`, which places the
/// four poles evenly on a half circle.
const DAMPING: [f64; 2] = [0.765_366_864_730_179_6, 1.847_759_065_022_573_5];

/// The number of samples by which each end is extended.
const CONTINUED: usize = 15;

/// Passes what lies below the cut-off; `None` when the cut-off is not below half the rate, or there
/// are too few samples to extend.
pub(super) fn low_pass(samples: &[f64], cut_off_hz: f64, rate_hz: f64) -> Option<Vec<f64>> {
    let usable = cut_off_hz > 0.0 && 2.0 * cut_off_hz < rate_hz && samples.len() > CONTINUED;
    if !usable {
        return None;
    }
    // Prewarped so that the bilinear transform puts the cut-off at the requested frequency.
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
    // The steady state for a constant input equal to the first sample, which passes unchanged.
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
