//! Questions to a box and their numbers: an answer carries the number of its question.

use std::ops::RangeInclusive;

use plumbline::packet::{Action, Command, Message};

/// Numbers for the receiver, or for a
/// [`BoxLink`](crate::link::BoxLink), which is the only user of its link.
const OF_LINK: RangeInclusive<u16> = 1..=0x7FFF;

/// Numbers for a [`Tap`](crate::reception::Tap), which shares the link with the receiver.
const OF_TAP: RangeInclusive<u16> = 0x8000..=0xFFFF;

/// Gives each question a number. The two users of one link draw from different numbers, so
/// that neither takes the other's answer for its own.
#[derive(Debug)]
pub struct Questions {
    numbers: RangeInclusive<u16>,
    next: u16,
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

    fn numbered(numbers: RangeInclusive<u16>) -> Self {
        Self { next: *numbers.start(), numbers }
    }

    /// A question and its number. After the last number the first one is used again.
    pub fn ask(&mut self, action: Action) -> (u16, Message) {
        let id = self.next;
        self.next = if id == *self.numbers.end() { *self.numbers.start() } else { id + 1 };
        (id, Message::Command(Command { id, action }))
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
            assert_eq!(message, Message::Command(Command { id, action: Action::SendHello }));
            assert!(tap.ask(Action::SendHealth).0 >= 0x8000);
        }
    }
}
