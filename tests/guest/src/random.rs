//! Numbers that look random, the same for the same seed.

use std::ops::Range;

/// Knuth's linear congruential generator, of which the high bits are good.
#[derive(Debug)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// One of these numbers, of which there are fewer than 2^32.
    pub fn in_range(&mut self, range: Range<u64>) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let high = self.0 >> 32;
        range.start + ((high * (range.end - range.start)) >> 32)
    }
}
