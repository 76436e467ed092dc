//! The triggers of a box in a trial: those that came, and how many did not.

use plumbline::packet::Trigger;
use plumbline_files::counting::counted;

/// The largest number of triggers of a trial: two a second for more than an hour. A line that
/// changes faster is not one that marks events.
const TRIGGERS_MAX: usize = 10_000;

/// The triggers that have come.
#[derive(Debug, Default)]
pub(crate) struct Triggers {
    /// With the number of the box's session.
    all: Vec<(u32, Trigger)>,
    /// The session and the number of the newest.
    newest: Option<(u32, u32)>,
    left_out: u64,
    /// Those that are missing between others of the same session.
    missing: u64,
}

impl Triggers {
    /// Takes one of the session that is under way.
    pub(crate) fn take(&mut self, session: u32, trigger: Trigger) {
        match self.newest {
            Some((number, newest)) if number == session && trigger.sequence <= newest => {
                let is_repeated = |it: &(u32, Trigger)| *it == (session, trigger);
                if self.all.iter().rev().any(is_repeated) {
                    return;
                }
                // It was asked for again.
                self.missing = self.missing.saturating_sub(1);
            }
            Some((number, newest)) if number == session => {
                self.missing += u64::from(trigger.sequence - newest - 1);
                self.newest = Some((session, trigger.sequence));
            }
            _ => self.newest = Some((session, trigger.sequence)),
        }
        if self.all.len() < TRIGGERS_MAX {
            self.all.push((session, trigger));
        } else {
            self.left_out += 1;
        }
    }

    /// Those that have come.
    pub(crate) fn all(&self) -> &[(u32, Trigger)] {
        &self.all
    }

    /// What a user should know of them.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.missing > 0 {
            let triggers = counted(self.missing, "trigger");
            warnings.push(format!("{triggers} of the box never came"));
        }
        if self.left_out > 0 {
            warnings.push(format!(
                "left out: {} after the first {TRIGGERS_MAX}; check what drives the box's line",
                counted(self.left_out, "trigger")
            ));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::Edge;

    use super::*;

    fn trigger(sequence: u32) -> Trigger {
        let time_ns = 1_000_000 * u64::from(sequence);
        Trigger { sequence, time_ns, uncertain_ns: 100_000, edge: Edge::Rising }
    }

    #[test]
    fn triggers_that_never_came_are_counted_and_those_that_came_again_are_not() {
        let mut triggers = Triggers::default();
        // The first of a recording may have any number; 12, 13 and 15 are missing, and 13 comes late.
        for sequence in [10, 11, 14, 14, 16, 13, 11] {
            triggers.take(1, trigger(sequence));
        }
        // After a restart.
        triggers.take(2, trigger(0));
        let sequences: Vec<u32> = triggers.all().iter().map(|(_, it)| it.sequence).collect();
        assert_eq!(sequences, [10, 11, 14, 16, 13, 0]);
        assert_eq!(triggers.warnings(), ["2 triggers of the box never came"]);
    }

    #[test]
    fn a_line_that_never_rests_fills_no_memory() {
        let mut triggers = Triggers::default();
        for sequence in 0..TRIGGERS_MAX as u32 + 7 {
            triggers.take(1, trigger(sequence));
        }
        assert_eq!(triggers.all().len(), TRIGGERS_MAX);
        let warnings = triggers.warnings();
        assert!(warnings[0].starts_with("left out: 7 triggers after the first"), "{warnings:?}");
        assert_eq!(warnings.len(), 1);
    }
}
