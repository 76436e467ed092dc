//! Which of the latest counters have come: each is taken once, and what is missing is known.
//!
//! A bit per counter, in a ring (RFC 6479's idea, without its blocks). Only packets that have been
//! authenticated may be marked; everything else leaves the window as it is.

/// Bits of one word.
const WORD: u64 = u64::BITS as u64;

/// The counters from `first` to before `next`, with one bit each. All before `first` are decided:
/// they have come, or are given up. `WORDS` x 64 counters fit.
#[derive(Debug, Clone)]
pub struct Window<const WORDS: usize> {
    /// The lowest counter that is missing, or `next` if none is.
    first: u64,
    /// One above the highest counter that is known of.
    next: u64,
    /// Those outside of `first..next` are 0.
    bits: [u64; WORDS],
    /// Counters that were given up because they had fallen out of the window, or on demand.
    given_up: u64,
    /// Lower counters may come, and are not counted if they are given up.
    counted_from: u64,
}

impl<const WORDS: usize> Window<WORDS> {
    /// The number of counters that fit.
    pub const SPAN: u64 = WORDS as u64 * WORD;

    /// A window that expects this counter next.
    #[must_use]
    pub const fn starting_at(next: u64) -> Self {
        Self { first: next, next, bits: [0; WORDS], given_up: 0, counted_from: next }
    }

    /// A window that expects this counter next, and takes those from `first` on if they come, as far
    /// as they fit.
    #[must_use]
    pub fn with_past(first: u64, next: u64) -> Self {
        let first = first.max(next.saturating_sub(Self::SPAN)).min(next);
        Self { first, ..Self::starting_at(next) }
    }

    /// One above the highest counter that is known of.
    #[must_use]
    pub fn next(&self) -> u64 {
        self.next
    }

    /// The number of counters that were given up.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// Whether a counter has neither come nor been given up. 2^64 - 1, which no sender uses, is never
    /// new.
    #[must_use]
    pub fn is_new(&self, counter: u64) -> bool {
        let is_undecided = counter >= self.next || !self.bit(counter);
        counter >= self.first && is_undecided && counter < u64::MAX
    }

    /// Marks a counter as come; returns whether it was new.
    pub fn take(&mut self, counter: u64) -> bool {
        if !self.is_new(counter) {
            return false;
        }
        self.expect(counter + 1);
        if counter >= self.first {
            self.set(counter, true);
            self.skip_decided();
        }
        true
    }

    /// Takes note that all counters before this one have been sent.
    pub fn expect(&mut self, next: u64) {
        if next <= self.next {
            return;
        }
        self.next = next;
        let first = next.saturating_sub(Self::SPAN);
        if first > self.first {
            self.give_up_before(first);
        }
    }

    /// Gives up what is missing before this counter.
    pub fn give_up_before(&mut self, counter: u64) {
        let counter = counter.min(self.next);
        let known = counter.min(self.first.saturating_add(Self::SPAN));
        while self.first < known {
            if !self.bit(self.first) {
                self.count(self.first, self.first + 1);
            }
            self.set(self.first, false);
            self.first += 1;
        }
        // Those behind have no bits, for none of them has come.
        if self.first < counter {
            self.count(self.first, counter);
            self.first = counter;
        }
        self.skip_decided();
    }

    /// Counts counters that are given up.
    fn count(&mut self, first: u64, next: u64) {
        self.given_up += next.max(self.counted_from) - first.max(self.counted_from);
    }

    /// The number of counters that would be given up if all that are missing were.
    #[must_use]
    pub fn owed(&self) -> u64 {
        self.missing().filter(|&counter| counter >= self.counted_from).count() as u64
    }

    /// The counters that are missing, in order.
    pub fn missing(&self) -> impl Iterator<Item = u64> + '_ {
        (self.first..self.next).filter(|&counter| !self.bit(counter))
    }

    /// Moves `first` to the lowest counter that is missing.
    fn skip_decided(&mut self) {
        while self.first < self.next && self.bit(self.first) {
            self.set(self.first, false);
            self.first += 1;
        }
    }

    fn bit(&self, counter: u64) -> bool {
        let (word, mask) = Self::place(counter);
        self.bits[word] & mask != 0
    }

    fn set(&mut self, counter: u64, value: bool) {
        let (word, mask) = Self::place(counter);
        if value {
            self.bits[word] |= mask;
        } else {
            self.bits[word] &= !mask;
        }
    }

    fn place(counter: u64) -> (usize, u64) {
        let at = counter % Self::SPAN;
        ((at / WORD) as usize, 1 << (at % WORD))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::BTreeSet;
    use std::vec::Vec;

    use super::*;
    use crate::test_support::Random;

    /// The same in the obvious way.
    struct Plain {
        undecided: BTreeSet<u64>,
        next: u64,
        given_up: u64,
    }

    impl Plain {
        fn take(&mut self, counter: u64, span: u64) -> bool {
            let is_new = counter >= self.next || self.undecided.contains(&counter);
            if is_new {
                self.expect(counter + 1, span);
                self.undecided.remove(&counter);
            }
            is_new
        }

        fn expect(&mut self, next: u64, span: u64) {
            self.undecided.extend(self.next..next);
            self.next = self.next.max(next);
            self.give_up_before(self.next.saturating_sub(span));
        }

        fn give_up_before(&mut self, counter: u64) {
            let kept = self.undecided.split_off(&counter);
            self.given_up += self.undecided.len() as u64;
            self.undecided = kept;
        }
    }

    #[test]
    fn any_order_is_judged_as_by_a_set() {
        const WORDS: usize = 2;
        let span = Window::<WORDS>::SPAN;
        for seed in 0..20 {
            let mut random = Random::new(seed);
            let mut below = |bound: u64| random.bits() % bound;
            let start = below(500);
            let mut window = Window::<WORDS>::starting_at(start);
            let mut plain = Plain { undecided: BTreeSet::new(), next: start, given_up: 0 };
            for step in 0..3_000 {
                let reach = if below(50) == 0 { 1_000 } else { 12 };
                let counter = (window.next() + below(reach)).saturating_sub(below(2 * reach));
                match below(40) {
                    0 => {
                        window.expect(counter);
                        plain.expect(counter, span);
                    }
                    1 => {
                        window.give_up_before(counter);
                        plain.give_up_before(counter.min(plain.next));
                    }
                    _ => {
                        let is_new = plain.take(counter, span);
                        assert_eq!(window.take(counter), is_new, "seed {seed}, step {step}");
                    }
                }
                let missing: Vec<u64> = window.missing().collect();
                assert!(missing.iter().eq(plain.undecided.iter()), "seed {seed}, step {step}");
                assert_eq!((window.next(), window.given_up()), (plain.next, plain.given_up));
            }
        }
    }

    #[test]
    fn the_past_is_welcome_and_not_missed() {
        let mut window = Window::<2>::with_past(10, 50);
        assert_eq!((window.missing().count(), window.owed()), (40, 0));
        assert!(window.take(10) && window.take(49) && window.take(60));
        assert_eq!((window.missing().count(), window.owed()), (48, 10));
        window.give_up_before(52);
        assert_eq!((window.given_up(), window.owed()), (2, 8));
        assert!(!window.take(12) && window.take(52));
        // As far as it fits, and over a jump beyond it.
        let mut window = Window::<2>::with_past(0, 1_000);
        assert_eq!(window.missing().next(), Some(1_000 - Window::<2>::SPAN));
        assert!(window.take(5_000));
        window.give_up_before(5_001);
        assert_eq!(window.given_up(), 4_000);
    }

    #[test]
    fn nothing_is_taken_twice_however_far_the_counter_jumps() {
        let mut window = Window::<2>::starting_at(0);
        for counter in [0, 5, 1 << 40, u64::MAX - 1] {
            assert!(window.take(counter));
            assert!(!window.take(counter));
        }
        for counter in [0, 1, 5, 1 << 40, u64::MAX] {
            assert!(!window.is_new(counter) && !window.take(counter), "{counter}");
        }
        assert_eq!(window.next(), u64::MAX);
    }
}
