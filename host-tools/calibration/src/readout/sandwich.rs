//! The variance of a sum whose terms, one for each frame, may depend on each other.

/// Frames this far apart, or closer, may err together.
const CORRELATED: usize = 10;

/// The variance of the sum of `scores`, which add up to zero, estimated from themselves (Newey and
/// West 1987).
pub fn variance_of_sum(scores: &[f64]) -> f64 {
    let apart = |apart: usize| -> f64 {
        scores.iter().zip(scores.iter().skip(apart)).map(|(one, other)| one * other).sum()
    };
    // Bartlett's weights keep the estimate from being negative.
    let weight = |apart: usize| 1.0 - apart as f64 / (CORRELATED + 1) as f64;
    let covariances = (1..=CORRELATED).map(|lag| 2.0 * weight(lag) * apart(lag));
    apart(0) + covariances.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_neighbours_count_more_than_alternating_ones() {
        // Eleven equal frames, and eleven with the opposite sign, in turn: their covariance falls
        // from 1 to -1 over eleven frames, which makes 1 + 2 * 1.36.
        let slow: Vec<f64> =
            (0..220).map(|frame| if frame / 11 % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let fast: Vec<f64> =
            (0..220).map(|frame| if frame % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(variance_of_sum(&slow) > 3.0 * 220.0);
        let few = variance_of_sum(&fast);
        assert!((0.0..0.2 * 220.0).contains(&few), "{few}");
    }
}
