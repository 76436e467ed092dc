//! Centred running means, the filters of the detectors: they cause no delay.

/// The running mean over an odd number of samples; near the ends, over the samples that exist.
pub(super) fn mean(samples: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut sum = 0.0;
    let sums: Vec<f64> = [0.0]
        .into_iter()
        .chain(samples.iter().map(|sample| {
            sum += sample;
            sum
        }))
        .collect();
    let mean = |at: usize| {
        let (start, end) = (at.saturating_sub(half), samples.len().min(at + half + 1));
        (sums[end] - sums[start]) / (end - start) as f64
    };
    (0..samples.len()).map(mean).collect()
}

/// An odd number of samples of about this duration.
pub(super) fn window(duration_s: f64, rate_hz: f64) -> usize {
    (duration_s * rate_hz).round() as usize | 1
}

/// The extremum of the parabola through three samples, in samples from the middle one, which must
/// be at least as extreme as the other two.
pub(super) fn vertex([before, middle, after]: [f64; 3]) -> f64 {
    let curvature = before - 2.0 * middle + after;
    if curvature == 0.0 { 0.0 } else { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_running_mean_is_of_what_there_is() {
        assert_eq!(mean(&[1.0, 2.0, 6.0, 4.0], 3), [1.5, 3.0, 4.0, 5.0]);
        assert_eq!(mean(&[3.0, 5.0], 9), [4.0, 4.0]);
        assert!(mean(&[], 3).is_empty());
        assert_eq!((window(0.125, 1000.0), window(0.01, 100.0), window(0.1, 100.0)), (125, 1, 11));
    }

    #[test]
    fn a_parabolas_vertex_is_found() {
        let parabola = |x: f64| 3.0 - 2.0 * (x - 0.3).powi(2);
        assert!((vertex([-1.0, 0.0, 1.0].map(parabola)) - 0.3).abs() < 1e-15);
        assert_eq!(vertex([1.0; 3]), 0.0);
    }
}
