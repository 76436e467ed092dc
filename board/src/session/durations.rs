//! Median and worst of durations, in bounded memory however long the box runs.

use std::time::Duration;

use hdrhistogram::Histogram;

/// The range in which durations are resolved to 0.1 %: from 100 ns to a minute.
const NS: std::ops::RangeInclusive<u64> = 100..=60_000_000_000;

/// Durations seen since the start.
#[derive(Debug)]
pub struct Durations {
    histogram: Histogram<u64>,
    worst: Duration,
}

impl Default for Durations {
    fn default() -> Self {
        Self::new()
    }
}

impl Durations {
    /// No durations yet. Allocates all the memory that it will ever need.
    #[must_use]
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(*NS.start(), *NS.end(), 3)
            .expect("constant bounds, at least a factor of two apart");
        Self { histogram, worst: Duration::ZERO }
    }

    /// Adds one.
    pub fn record(&mut self, duration: Duration) {
        let ns = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        self.histogram.saturating_record(ns);
        self.worst = self.worst.max(duration);
    }

    /// The longest.
    #[must_use]
    pub fn worst(&self) -> Duration {
        self.worst
    }

    /// The median; never above [`Durations::worst`].
    #[must_use]
    pub fn median(&self) -> Duration {
        // The histogram answers with the upper end of a bucket.
        Duration::from_nanos(self.histogram.value_at_quantile(0.5)).min(self.worst)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_exact_to_a_thousandth_and_the_worst_is_exact() {
        let mut durations = Durations::new();
        for us in 1..=1001_u64 {
            durations.record(Duration::from_micros(us));
        }
        let median_us = durations.median().as_secs_f64() * 1e6;
        assert!((median_us - 501.0).abs() < 0.6, "{median_us}");
        assert_eq!(Durations::new().median(), Duration::ZERO);
        durations.record(Duration::from_secs(3600));
        assert_eq!(durations.worst(), Duration::from_secs(3600));
    }

    #[test]
    fn the_median_of_one_is_not_above_the_worst() {
        let mut durations = Durations::new();
        durations.record(Duration::from_nanos(53_585_123));
        assert_eq!(durations.median(), durations.worst());
    }
}
