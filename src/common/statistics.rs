//! Means and medians.

use core::cmp::Ordering;

/// The middle value, or the upper one of the two in the middle; `None` if there are no values. The
/// median is reliable as long as fewer than half of the values are wrong.
///
/// Reorders the values. Takes time proportional to their number.
pub(crate) fn median<T: Copy>(
    values: &mut [T],
    order: impl FnMut(&T, &T) -> Ordering,
) -> Option<T> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, order).1)
}

/// The order of numbers that are neither negative nor -0.0: that of their bits, which are compared
/// faster than by [`f64::total_cmp`]. A NaN is larger than all of them.
pub(crate) fn order_of_positive(one: &f64, other: &f64) -> Ordering {
    one.to_bits().cmp(&other.to_bits())
}

/// A weighted mean.
#[derive(Default, Clone, Copy)]
pub(crate) struct Mean {
    sum: f64,
    weights: f64,
}

impl Mean {
    /// Adds a value with a weight that is not negative.
    pub(crate) fn add(&mut self, value: f64, weight: f64) {
        self.sum += weight * value;
        self.weights += weight;
    }

    /// True until a value with a positive weight has been added.
    pub(crate) fn is_empty(&self) -> bool {
        self.weights <= 0.0
    }

    /// The sum of the weights: where these are precisions, that of the mean.
    pub(crate) fn weight(&self) -> f64 {
        self.weights
    }

    /// The mean; 0 if there are no values.
    pub(crate) fn value(&self) -> f64 {
        if self.is_empty() { 0.0 } else { self.sum / self.weights }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_value_and_the_upper_one_of_two() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0], f64::total_cmp), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0], f32::total_cmp), Some(3.0));
        assert_eq!(median(&mut [], f32::total_cmp), None);
    }

    #[test]
    fn bits_order_what_is_not_negative() {
        let ascending = [0.0, 1e-310, 0.5, 1.0, 2.5, 1e300, f64::INFINITY, f64::NAN, -f64::NAN];
        assert!(ascending.is_sorted_by(|one, other| order_of_positive(one, other).is_lt()));
    }

    #[test]
    fn the_mean_weighs_its_values() {
        let mut mean = Mean::default();
        assert!(mean.is_empty());
        assert_eq!((mean.value(), mean.weight()), (0.0, 0.0));
        mean.add(1.0, 3.0);
        mean.add(5.0, 1.0);
        assert!(!mean.is_empty());
        assert_eq!((mean.value(), mean.weight()), (2.0, 4.0));
    }
}
