//! Packets of the stream in their order, as far as that does not make everything wait.
//!
//! What follows a gap is held back for a moment, in which the missing packets mostly come: they are
//! asked for at once. After that it is handed on, and what comes later is late.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The longest that a packet is held back.
const HOLD: Duration = Duration::from_millis(300);

/// The packets that are held back, and the counter of the next one.
#[derive(Debug)]
pub(super) struct Order<T> {
    next: u64,
    held: BTreeMap<u64, (Instant, T)>,
}

impl<T> Order<T> {
    /// From this counter on.
    pub(super) fn starting_at(next: u64) -> Self {
        Self { next, held: BTreeMap::new() }
    }

    /// Takes a packet that has not come before; hands over what is next now.
    pub(super) fn take(&mut self, counter: u64, packet: T, now: Instant, hand: &mut dyn FnMut(T)) {
        if counter < self.next {
            hand(packet);
            return;
        }
        self.held.insert(counter, (now, packet));
        self.release(hand);
    }

    /// Lets time pass. Nothing before `first_missing` comes any more.
    pub(super) fn pass(&mut self, now: Instant, first_missing: u64, hand: &mut dyn FnMut(T)) {
        // One that has waited for long enough takes those before it along, though they came later.
        let is_overdue = |came: Instant| now.saturating_duration_since(came) >= HOLD;
        let mut held = self.held.iter();
        let overdue = held.rfind(|(_, (came, _))| is_overdue(*came)).map(|(counter, _)| *counter);
        while let Some((&first, _)) = self.held.first_key_value() {
            if first > first_missing && overdue.is_none_or(|it| first > it) {
                return;
            }
            self.next = first;
            self.release(hand);
        }
    }

    /// Hands over what is held back, gaps or not.
    pub(super) fn flush(&mut self, hand: &mut dyn FnMut(T)) {
        for (_, (_, packet)) in std::mem::take(&mut self.held) {
            hand(packet);
        }
    }

    /// Whether something is held back.
    pub(super) fn holds(&self) -> bool {
        !self.held.is_empty()
    }

    fn release(&mut self, hand: &mut dyn FnMut(T)) {
        while let Some((_, packet)) = self.held.remove(&self.next) {
            self.next += 1;
            hand(packet);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn a_gap_is_waited_for_and_then_no_longer() {
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut order = Order::starting_at(5);
        let mut handed = Vec::new();
        for (counter, ms) in [(5, 0), (7, 10), (8, 20)] {
            order.take(counter, counter, at(ms), &mut |it| handed.push(it));
        }
        assert_eq!(handed, [5]);
        order.take(6, 6, at(30), &mut |it| handed.push(it));
        assert_eq!(handed, [5, 6, 7, 8]);
        // 9 does not come in time, 11 neither.
        order.take(10, 10, at(100), &mut |it| handed.push(it));
        order.take(12, 12, at(200), &mut |it| handed.push(it));
        order.pass(at(399), 9, &mut |it| handed.push(it));
        assert_eq!(handed, [5, 6, 7, 8]);
        order.pass(at(400), 9, &mut |it| handed.push(it));
        assert_eq!(handed, [5, 6, 7, 8, 10]);
        order.take(9, 9, at(410), &mut |it| handed.push(it));
        assert_eq!(handed, [5, 6, 7, 8, 10, 9]);
        // 11 is lost for good.
        order.pass(at(411), 13, &mut |it| handed.push(it));
        assert_eq!(handed, [5, 6, 7, 8, 10, 9, 12]);
        assert!(!order.holds());
    }

    #[test]
    fn what_is_held_back_at_the_end_is_handed_over() {
        let now = Instant::now();
        let mut order = Order::starting_at(0);
        let mut handed = Vec::new();
        for counter in [3, 2, 5] {
            order.take(counter, counter, now, &mut |it| handed.push(it));
        }
        order.flush(&mut |it| handed.push(it));
        assert_eq!(handed, [2, 3, 5]);
    }

    /// Counters that come displaced by up to so many places, some of them never, over some seconds.
    #[test]
    fn each_is_handed_over_once_and_in_order_unless_it_was_waited_for_in_vain() {
        for seed in 0..300 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let (begin, first) = (Instant::now(), random.random_range(0..1000_u64));
            let reach = random.random_range(1..20_u64);
            let mut coming = Vec::new();
            for counter in first..first + 60 {
                if random.random_bool(0.9) {
                    coming.push((counter + random.random_range(0..reach), counter));
                }
            }
            coming.sort_unstable();
            let mut order = Order::starting_at(first);
            let (mut handed, mut came) = (Vec::<u64>::new(), BTreeMap::new());
            let mut now = begin;
            for (_, counter) in coming {
                now += Duration::from_millis(random.random_range(0..80));
                came.insert(counter, now);
                let is_late = handed.iter().any(|it| *it > counter);
                let before = handed.len();
                order.take(counter, counter, now, &mut |it| handed.push(it));
                // What is late is handed over at once, and nothing with it.
                assert!(!is_late || handed[before..] == [counter], "seed {seed}");
                assert!(is_late || handed[before..].is_sorted(), "seed {seed}");
                let newest = handed[..before].iter().max();
                assert!(
                    is_late || handed[before..].iter().all(|it| Some(it) > newest),
                    "seed {seed}"
                );
                let missing = (first..).find(|it| !came.contains_key(it)).expect("one of them");
                let before = handed.len();
                order.pass(now, missing, &mut |it| handed.push(it));
                assert!(handed[before..].is_sorted(), "seed {seed}");
                // What is still held back has not waited for long.
                let held = came.iter().filter(|it| !handed.contains(it.0));
                assert!(held.clone().all(|(_, came)| now - *came < HOLD), "seed {seed}");
                assert_eq!(order.holds(), held.count() > 0, "seed {seed}");
            }
            order.flush(&mut |it| handed.push(it));
            handed.sort_unstable();
            assert!(handed.iter().eq(came.keys()), "seed {seed}: {handed:?}");
        }
    }
}
