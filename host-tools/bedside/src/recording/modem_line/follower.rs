//! Which changes of a modem line are marks, and when they were.

use std::time::{Duration, Instant};

use super::Line;

/// A program that waits for a change is woken within this time, on a computer that is not overloaded.
const WOKEN_WITHIN: Duration = Duration::from_millis(1);

/// A mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Seen {
    pub at: Instant,
    /// It was at most this much earlier or later.
    pub uncertain: Duration,
    /// Marks before it whose time is not known.
    pub missed: u64,
}

/// Follows a line.
#[derive(Debug)]
pub(super) struct Follower {
    line: Line,
    is_on: bool,
    changes: Option<u32>,
    /// When the line was looked at last.
    looked: Instant,
}

impl Follower {
    pub(super) fn new(line: Line, is_on: bool, now: Instant) -> Self {
        Self { line, is_on, changes: None, looked: now }
    }

    /// The driver has told of a change: how the line is now, and how often it has changed.
    pub(super) fn woken(&mut self, is_on: bool, changes: u32, now: Instant) -> Option<Seen> {
        // The change that woke this is one, where none was counted before.
        let before = self.changes.replace(changes).unwrap_or(changes.wrapping_sub(1));
        let looked = std::mem::replace(&mut self.looked, now);
        self.is_on = is_on;
        let changed = changes.wrapping_sub(before);
        let asserted = match self.line {
            // Drivers count the end of a ring only.
            Line::Ri => changed,
            _ => changed / 2 + (changed % 2) * u32::from(is_on),
        };
        if asserted == 0 {
            return None;
        }
        // With more than one change it is not known which was when.
        let uncertain = match changed {
            1 => WOKEN_WITHIN,
            _ => now.saturating_duration_since(looked).max(WOKEN_WITHIN),
        };
        Some(Seen { at: now, uncertain, missed: u64::from(asserted - 1) })
    }

    /// The driver has been asked how the line is.
    pub(super) fn asked(&mut self, is_on: bool, now: Instant) -> Option<Seen> {
        let was_on = std::mem::replace(&mut self.is_on, is_on);
        let looked = std::mem::replace(&mut self.looked, now);
        if was_on || !is_on {
            return None;
        }
        // It was in between.
        let half = now.saturating_duration_since(looked) / 2;
        Some(Seen { at: looked + half, uncertain: half, missed: 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_line_that_is_asserted_is_a_mark_and_its_release_is_none() {
        let begun = Instant::now();
        let mut follower = Follower::new(Line::Cts, false, begun);
        let mut woken = |is_on, changes, at_ms| follower.woken(is_on, changes, begun + at_ms * MS);
        let seen =
            |at_ms, uncertain, missed| Some(Seen { at: begun + at_ms * MS, uncertain, missed });
        assert_eq!(woken(true, 41, 100), seen(100, WOKEN_WITHIN, 0));
        assert_eq!(woken(false, 42, 150), None);
        assert_eq!(woken(true, 43, 300), seen(300, WOKEN_WITHIN, 0));
        // Released and asserted again before this was woken: one mark, at some time since.
        assert_eq!(woken(true, 45, 340), seen(340, 40 * MS, 0));
        // Asserted for a moment, three times.
        assert_eq!(woken(false, 46, 400), None);
        assert_eq!(woken(false, 52, 500), seen(500, 100 * MS, 2));
        // A signal, and nothing else.
        assert_eq!(woken(false, 52, 510), None);
    }

    #[test]
    fn the_count_begins_anew_after_the_largest_number() {
        let begun = Instant::now();
        let mut follower = Follower::new(Line::Dsr, true, begun);
        assert_eq!(follower.woken(false, u32::MAX, begun), None);
        assert!(follower.woken(true, 0, begun).is_some());
    }

    #[test]
    fn a_ring_is_seen_at_its_end() {
        let begun = Instant::now();
        let mut follower = Follower::new(Line::Ri, false, begun);
        assert!(follower.woken(false, 1, begun).is_some());
        assert!(follower.woken(false, 2, begun + MS).is_some());
    }

    #[test]
    fn where_the_driver_is_asked_a_mark_lies_between_two_questions() {
        let begun = Instant::now();
        let mut follower = Follower::new(Line::Dcd, true, begun);
        let mut asked = |is_on, at_ms| follower.asked(is_on, begun + at_ms * MS);
        // It was asserted before.
        assert_eq!(asked(true, 1), None);
        assert_eq!(asked(false, 2), None);
        let seen = Seen { at: begun + 4 * MS, uncertain: 2 * MS, missed: 0 };
        assert_eq!(asked(true, 6), Some(seen));
        assert_eq!(asked(true, 7), None);
    }
}
