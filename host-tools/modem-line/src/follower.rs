//! Which changes of a modem line are assertions, and when they were.

use std::time::{Duration, Instant};

/// A program that waits for a change is woken within this time, on a computer that is not overloaded.
const WOKEN_WITHIN: Duration = Duration::from_millis(1);

/// An assertion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Seen {
    pub at: Instant,
    /// It was at most this much earlier or later.
    pub uncertain: Duration,
    /// Those before it whose time is not known.
    pub missed: u64,
}

/// Follows a line.
#[derive(Debug)]
pub(super) struct Follower {
    is_on: bool,
    /// The driver's count of its changes.
    changes: u32,
    /// When the line was looked at last.
    looked: Instant,
}

impl Follower {
    pub(super) fn new(is_on: bool, changes: u32, now: Instant) -> Self {
        Self { is_on, changes, looked: now }
    }

    /// The driver's count of changes when the line was looked at last.
    pub(super) fn changes(&self) -> u32 {
        self.changes
    }

    /// Whether a line that has changed so often is as it is said to be.
    pub(super) fn agrees(&self, is_on: bool, changes: u32) -> bool {
        let is_odd = changes.wrapping_sub(self.changes) % 2 == 1;
        is_odd == (self.is_on != is_on)
    }

    /// The driver has told of a change: how the line is now, and how often it has changed.
    ///
    /// Two changes in quick succession may count as one. Of "ring" many drivers count the end only.
    /// Either way the line is then not as the count has it, and one change more explains both.
    pub(super) fn woken(&mut self, is_on: bool, changes: u32, now: Instant) -> Option<Seen> {
        let counted = changes.wrapping_sub(self.changes);
        if counted == 0 {
            return None;
        }
        let changed = u64::from(counted) + u64::from(!self.agrees(is_on, changes));
        let was_on = std::mem::replace(&mut self.is_on, is_on);
        let looked = std::mem::replace(&mut self.looked, now);
        self.changes = changes;
        let asserted = (changed + u64::from(is_on) - u64::from(was_on)) / 2;
        // With more than one change it is not known which was when.
        let uncertain = match counted {
            1 => WOKEN_WITHIN,
            _ => now.saturating_duration_since(looked).max(WOKEN_WITHIN),
        };
        (asserted > 0).then(|| Seen { at: now, uncertain, missed: asserted - 1 })
    }

    /// The driver has been asked how the line is.
    pub(super) fn asked(&mut self, is_on: bool, now: Instant) -> Option<Seen> {
        let was_on = std::mem::replace(&mut self.is_on, is_on);
        let looked = std::mem::replace(&mut self.looked, now);
        // It was in between.
        let half = now.saturating_duration_since(looked) / 2;
        (is_on && !was_on).then(|| Seen { at: looked + half, uncertain: half, missed: 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_line_that_is_asserted_is_told_of_and_its_release_is_not() {
        let begun = Instant::now();
        let mut follower = Follower::new(false, 40, begun);
        let mut woken = |is_on, changes, at_ms| follower.woken(is_on, changes, begun + at_ms * MS);
        let seen =
            |at_ms, uncertain, missed| Some(Seen { at: begun + at_ms * MS, uncertain, missed });
        assert_eq!(woken(true, 41, 100), seen(100, WOKEN_WITHIN, 0));
        assert_eq!(woken(false, 42, 150), None);
        assert_eq!(woken(true, 43, 300), seen(300, WOKEN_WITHIN, 0));
        // Released and asserted again before this was woken: one, at some time since.
        assert_eq!(woken(true, 45, 340), seen(340, 40 * MS, 0));
        // Asserted for a moment, three times.
        assert_eq!(woken(false, 46, 400), None);
        assert_eq!(woken(false, 52, 500), seen(500, 100 * MS, 2));
        // A signal, and nothing else.
        assert_eq!(woken(false, 52, 510), None);
    }

    /// Both changes before the first look are counted, and so is a pulse of which the driver has seen
    /// one change.
    #[test]
    fn a_pulse_that_is_over_is_told_of() {
        let begun = Instant::now();
        let mut follower = Follower::new(false, 7, begun);
        let seen = |uncertain| Some(Seen { at: begun + 3 * MS, uncertain, missed: 0 });
        assert_eq!(follower.woken(false, 9, begun + 3 * MS), seen(3 * MS));
        assert!(!follower.agrees(false, 10) && follower.agrees(true, 10));
        assert_eq!(follower.woken(false, 10, begun + 3 * MS), seen(WOKEN_WITHIN));
        // Released for a moment, and seen as one change.
        let mut follower = Follower::new(true, 7, begun);
        assert_eq!(follower.woken(true, 8, begun + 3 * MS), seen(WOKEN_WITHIN));
        assert_eq!(follower.woken(false, 9, begun + 4 * MS), None);
    }

    #[test]
    fn the_count_begins_anew_after_the_largest_number() {
        let begun = Instant::now();
        let mut follower = Follower::new(true, u32::MAX - 1, begun);
        assert_eq!(follower.woken(false, u32::MAX, begun), None);
        assert!(follower.woken(true, 0, begun).is_some());
    }

    /// Some drivers count the end of a ring only, and others both.
    #[test]
    fn a_ring_is_told_of_once() {
        let begun = Instant::now();
        let mut ends = Follower::new(false, 0, begun);
        assert!(ends.woken(false, 1, begun).is_some());
        assert!(ends.woken(false, 2, begun + MS).is_some());
        let mut both = Follower::new(false, 0, begun);
        assert!(both.woken(true, 1, begun).is_some());
        assert_eq!(both.woken(false, 2, begun + MS), None);
    }

    #[test]
    fn where_the_driver_is_asked_an_assertion_lies_between_two_questions() {
        let begun = Instant::now();
        let mut follower = Follower::new(true, 0, begun);
        let mut asked = |is_on, at_ms| follower.asked(is_on, begun + at_ms * MS);
        // It was asserted before.
        assert_eq!(asked(true, 1), None);
        assert_eq!(asked(false, 2), None);
        let seen = Seen { at: begun + 4 * MS, uncertain: 2 * MS, missed: 0 };
        assert_eq!(asked(true, 6), Some(seen));
        assert_eq!(asked(true, 7), None);
    }
}
