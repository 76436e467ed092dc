//! Questions to a box and their numbers: an answer carries the number of its question.

use std::ops::RangeInclusive;

use plumbline::packet::{Action, Command, Message};

/// Numbers for the receiver, or for a
/// [`BoxLink`](crate::link::BoxLink), which is the only user of its link.
const OF_LINK: RangeInclusive<u16> = 1..=0x7FFF;

/// Numbers for a [`Tap`](crate::reception::Tap), which shares the link with the receiver.
const OF_TAP: RangeInclusive<u16> = 0x8000..=0xBFFF;

/// Numbers for whoever asks the box for its clock beside a tap that does so too.
const OF_CLOCK: RangeInclusive<u16> = 0xC000..=0xFFFF;

/// Gives each question a number. The users of one link draw from different numbers, so that none
/// takes another's answer for its own.
#[derive(Debug)]
pub struct Questions {
    numbers: RangeInclusive<u16>,
    next: u16,
    is_forced: bool,
}

impl Questions {
    /// Questions of the receiver, or of the only user of a link.
    #[must_use]
    pub fn of_link() -> Self {
        Self::numbered(OF_LINK)
    }

    /// Questions of what follows a reception beside the receiver.
    #[must_use]
    pub fn of_tap() -> Self {
        Self::numbered(OF_TAP)
    }

    /// Questions for the box's clock, beside the receiver and its tap.
    #[must_use]
    pub fn of_clock() -> Self {
        Self::numbered(OF_CLOCK)
    }

    /// Whether a question with this number is one of [`of_clock`](Self::of_clock).
    #[must_use]
    pub fn is_of_clock(id: u16) -> bool {
        OF_CLOCK.contains(&id)
    }

    fn numbered(numbers: RangeInclusive<u16>) -> Self {
        Self { next: *numbers.start(), numbers, is_forced: false }
    }

    /// From now on, commands that change the box are to be carried out even while somebody records a
    /// trial.
    pub fn force(&mut self) {
        self.is_forced = true;
    }

    /// A question and its number. After the last number the first one is used again.
    pub fn ask(&mut self, action: Action) -> (u16, Message) {
        let id = self.next;
        self.next = if id == *self.numbers.end() { *self.numbers.start() } else { id + 1 };
        let is_forced = self.is_forced && action.changes_box();
        (id, Message::Command(Command { id, action, is_forced }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_users_of_a_link_never_use_the_same_number() {
        let (mut link, mut tap) = (Questions::of_link(), Questions::of_tap());
        for _ in 0..0x1_0000 {
            let (id, message) = link.ask(Action::SendHello);
            assert!((1..0x8000).contains(&id), "{id}");
            assert_eq!(
                message,
                Message::Command(Command { id, action: Action::SendHello, is_forced: false })
            );
            assert!(tap.ask(Action::SendHealth).0 >= 0x8000);
        }
    }

    #[test]
    fn only_what_changes_a_box_is_forced_and_only_where_that_was_said() {
        let mut questions = Questions::of_link();
        let mut forced = |is_said: bool, action| {
            if is_said {
                questions.force();
            }
            match questions.ask(action).1 {
                Message::Command(command) => command.is_forced,
                other => panic!("{other:?}"),
            }
        };
        assert!(!forced(false, Action::Reboot));
        assert!(forced(true, Action::Reboot) && forced(true, Action::Aim { seconds: 10 }));
        assert!(!forced(true, Action::SendHello));
    }
}
