//! The smoothing filter of Savitzky and Golay (1964), second order, as the
//! paper uses it on sway.

use nalgebra::{Matrix3, Vector3};

/// Each sample replaced by the value there of the parabola that fits the
/// `window` samples around it best. Near the ends, where there are not enough
/// on one side, the parabola of the first or last whole window is used.
///
/// `None` when the window is even or shorter than 5, or there are fewer samples
/// than it takes.
#[must_use]
pub fn smooth(samples: &[f64], window: usize) -> Option<Vec<f64>> {
    if window.is_multiple_of(2) || window < 5 || samples.len() < window {
        return None;
    }
    let half = window / 2;
    let powers = |index: usize| {
        // -1 to 1, so that the normal equations are well conditioned.
        let x = (index as f64 - half as f64) / half as f64;
        Vector3::new(1.0, x, x * x)
    };
    let normal: Matrix3<f64> =
        (0..window).map(|index| powers(index) * powers(index).transpose()).sum();
    let inverse = normal.try_inverse()?;
    let smoothed = (0..samples.len()).map(|index| {
        let start = index.saturating_sub(half).min(samples.len() - window);
        let around = &samples[start..start + window];
        let moments: Vector3<f64> =
            around.iter().enumerate().map(|(index, sample)| powers(index) * *sample).sum();
        powers(index - start).dot(&(inverse * moments))
    });
    Some(smoothed.collect())
}

/// The odd number of samples that comes closest to `window_s` at `rate_hz`.
#[must_use]
pub fn window(window_s: f64, rate_hz: f64) -> usize {
    2 * (window_s * rate_hz / 2.0).round().max(2.0) as usize + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabolas_pass_unchanged_to_their_very_ends() {
        let samples: Vec<f64> =
            (0..40).map(f64::from).map(|t| 3.0 - 2.0 * t + 0.25 * t * t).collect();
        let smoothed = smooth(&samples, 31).unwrap();
        for (after, before) in smoothed.iter().zip(&samples) {
            assert!((after - before).abs() < 1e-9, "{after} {before}");
        }
    }

    #[test]
    fn the_weights_are_those_of_the_published_table() {
        // Savitzky and Golay, table I, five points: (-3, 12, 17, 12, -3) / 35.
        let mut impulse = [0.0; 11];
        impulse[5] = 35.0;
        let smoothed = smooth(&impulse, 5).unwrap();
        for (value, expected) in smoothed[3..8].iter().zip([-3.0, 12.0, 17.0, 12.0, -3.0]) {
            assert!((value - expected).abs() < 1e-12, "{value} {expected}");
        }
    }

    #[test]
    fn what_cannot_be_smoothed_is_refused() {
        assert_eq!(smooth(&[1.0; 30], 31), None);
        assert_eq!(smooth(&[1.0; 30], 6), None);
        assert_eq!((window(0.5, 60.0), window(0.5, 30.0), window(0.01, 30.0)), (31, 17, 5));
    }
}
