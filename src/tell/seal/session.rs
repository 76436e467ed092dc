//! A host's sessions with its box: the one that it uses, and the one before.

use super::Peer;
use super::channel::{Channel, session_of};
use crate::tell::packet::Start;

/// A session in which nothing has come for this long is tried again from the beginning; a box
/// answers each ping, and sends something every second besides.
const SILENT_NS: u64 = 1_000_000_000;

/// So is one in which no ping has been answered for this long, whatever else has come: the box does
/// not know of it, and sends the stream because of another one, or of another program.
const UNANSWERED_NS: u64 = 2_000_000_000;

/// A ping is sent this often.
const PING_NS: u64 = 400_000_000;

/// New keys are agreed on after this time.
pub(super) const RENEW_NS: u64 = 3_600_000_000_000;

/// A session with one start of a box.
#[derive(Debug)]
pub(super) struct Session {
    pub(super) peer: Peer,
    pub(super) start: Start,
    pub(super) channel: Channel,
    pub(super) begun_ns: u64,
    pub(super) heard_ns: u64,
    /// When something last came that only this listener can have been sent.
    pub(super) answered_ns: Option<u64>,
    pinged_ns: Option<u64>,
}

impl Session {
    pub(super) fn new(peer: Peer, start: Start, channel: Channel, now_ns: u64) -> Self {
        Self {
            peer,
            start,
            channel,
            begun_ns: now_ns,
            heard_ns: now_ns,
            answered_ns: None,
            pinged_ns: None,
        }
    }

    /// Whether nothing is wrong with it, and its keys are not old.
    pub(super) fn is_settled(&self, now_ns: u64) -> bool {
        let since = |then_ns: u64| now_ns.saturating_sub(then_ns);
        since(self.heard_ns) < SILENT_NS
            && since(self.answered_ns.unwrap_or(self.begun_ns)) < UNANSWERED_NS
            && since(self.begun_ns) < RENEW_NS
    }

    /// Whether it is time for a ping, which is then sent.
    pub(super) fn takes_ping(&mut self, now_ns: u64) -> bool {
        let is_due = self.pinged_ns.is_none_or(|then| now_ns.saturating_sub(then) >= PING_NS);
        if is_due {
            self.pinged_ns = Some(now_ns);
        }
        is_due
    }
}

/// The sessions of a host.
#[derive(Debug, Default)]
pub(super) struct Sessions {
    pub(super) current: Option<Session>,
    /// The one before, whose last packets may still be under way.
    former: Option<Session>,
}

impl Sessions {
    /// Another one begins.
    pub(super) fn begin(&mut self, session: Session) {
        self.former = self.current.replace(session);
    }

    /// Whether there is one with this start of the box, and nothing wrong with it.
    pub(super) fn has_met(&self, start: Start, now_ns: u64) -> bool {
        self.current.as_ref().is_some_and(|it| it.start == start && it.is_settled(now_ns))
    }

    /// The one whose channel a packet is of.
    pub(super) fn of_channel(&mut self, from: Peer, packet: &[u8]) -> Option<&mut Session> {
        let number = session_of(packet)?;
        self.iter_mut().find(|it| it.peer == from && it.channel.session() == number)
    }

    /// Something of this start of the box has come from there.
    pub(super) fn heard(&mut self, from: Peer, start: Start, now_ns: u64) {
        for session in self.iter_mut().filter(|it| it.peer == from && it.start == start) {
            session.heard_ns = now_ns;
        }
    }

    /// Lets time pass.
    pub(super) fn pass(&mut self, now_ns: u64) {
        self.former.take_if(|it| now_ns.saturating_sub(it.heard_ns) >= SILENT_NS);
    }

    /// All of them, the one that is used first.
    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Session> {
        [self.current.as_mut(), self.former.as_mut()].into_iter().flatten()
    }
}
