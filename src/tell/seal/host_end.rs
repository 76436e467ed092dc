//! A host's end of the link to one box: it opens sessions, keeps them alive, and asks for what was
//! lost.
//!
//! It sends and receives nothing itself: it is given each packet that came and the time, and says
//! what to send.
//!
//! ```text
//!                        Announcement ─┐
//! no session, or silent, or old ───────┴▶ Greeting ─▶ Answer ─▶ Opening ─▶ Acceptance ─▶ session
//! session: a Ping twice a second; the reply says how far the stream is
//! stream: what is missing is asked for, until it comes or is gone
//! at the end: Leave, which frees the place at the box
//! ```

use heapless::String;

use super::Peer;
use super::aead::{CipherKey, KEY_BYTES};
use super::approach::Approach;
use super::attempts::Acceptance;
use super::key::Key;
use super::listeners::Caller;
use super::obstacle::Obstacle;
use super::reception::Reception;
use super::session::{Session, Sessions};
use super::stream::{Opened, StreamKey};
use super::wire::{Kind, Purpose, SEALED_BYTES_MAX};
use crate::tell::packet::{
    Action, Command, EncodeError, Message, REASON_BYTES_MAX, Refusal, Reply, ReplyOutcome, Start,
    is_sent_by,
};

/// The number of the commands that this end sends by itself; a program numbers its own from 1.
pub const OWN_COMMAND: u16 = 0;

/// A box that has no room is asked again after this time.
const BUSY_NS: u64 = 5_000_000_000;

/// What a packet has turned out to be.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the message")]
pub enum Told<'a> {
    /// Not authentic.
    Nothing,
    /// Authentic, and come before, or too old: it changes nothing.
    Repeated,
    /// Part of a handshake: send this to where it came from, if there is something to send.
    Handshake(Option<&'a [u8]>),
    /// The box says this.
    Message {
        /// The start of the box.
        start: Start,
        /// Its place in the stream, unless it is for this listener alone.
        counter: Option<u64>,
        /// What it says.
        message: Message,
    },
    /// An answer to what this end has asked by itself.
    Kept,
}

/// A host's end of the link.
#[derive(Debug)]
pub struct HostEnd {
    approach: Approach,
    sessions: Sessions,
    reception: Reception,
    /// Whether other poses than all have ever been wanted; the box is then told after each ping,
    /// because what it was told before may have been lost, or come late.
    chooses: bool,
    has_chosen: bool,
    obstacle: Option<Obstacle>,
    /// When the box had no room.
    refused_ns: Option<u64>,
}

impl HostEnd {
    /// The end of a program that wants to hear the box with this key, and may know where it is.
    #[must_use]
    pub fn new(key: Key, caller: Caller, known: Option<Peer>) -> Self {
        Self {
            approach: Approach::new(Purpose::Listening, key, caller, known),
            sessions: Sessions::default(),
            reception: Reception::new(),
            chooses: false,
            has_chosen: true,
            obstacle: None,
            refused_ns: None,
        }
    }

    /// Wants what the box has kept of the time before as well, as far as this listener is given the
    /// key of it: see [`EPOCH_PACKETS`](super::EPOCH_PACKETS). What of that is gone is not lost.
    pub fn want_past(&mut self) {
        self.reception.want_past();
    }

    /// The box's key.
    #[must_use]
    pub fn key(&self) -> &Key {
        self.approach.key()
    }

    /// Where the box is that has taken this end as a listener.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.listening().map(|it| it.peer)
    }

    /// The start of the box that has taken this end as a listener.
    #[must_use]
    pub fn start(&self) -> Option<Start> {
        self.listening().map(|it| it.start)
    }

    /// The session in which the box has taken this end as a listener.
    fn listening(&self) -> Option<&Session> {
        self.sessions.current.as_ref().filter(|_| self.reception.listens)
    }

    /// Why there is no session with a box that is heard.
    #[must_use]
    pub fn obstacle(&self) -> Option<&Obstacle> {
        self.obstacle.as_ref()
    }

    /// The number of packets of the stream that are lost for good.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.reception.lost()
    }

    /// Whether packets of the stream are missing that may still come.
    #[must_use]
    pub fn is_missing(&self) -> bool {
        self.reception.is_missing()
    }

    /// The lowest counter of the stream that may still come.
    #[must_use]
    pub fn first_missing(&self) -> Option<u64> {
        self.reception.first_missing()
    }

    /// Wants every such pose only, and none for 0; what is left out is then not asked for, and not
    /// lost.
    pub fn want_poses(&mut self, every: u16) {
        self.reception.want_poses(every);
        (self.chooses, self.has_chosen) = (true, false);
    }

    /// Tries the box at this address, at which it is perhaps.
    pub fn try_at(&mut self, peer: Peer, now_ns: u64, mut draw: impl FnMut() -> [u8; KEY_BYTES]) {
        self.approach.try_at(peer, now_ns, &mut draw);
    }

    /// The next packet that is due, and where to; to be asked until there is none.
    pub fn due<'a>(
        &mut self,
        now_ns: u64,
        mut draw: impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<(Peer, &'a [u8])> {
        let current = self.sessions.current.as_ref();
        let is_settled = current.is_some_and(|it| it.is_settled(now_ns));
        if !is_settled && !self.is_refused(now_ns) {
            self.approach.try_known(now_ns, &mut draw);
        }
        self.sessions.pass(now_ns);
        if let Some((peer, bytes)) = self.approach.due(now_ns, buffer) {
            return Some((peer, &buffer[..bytes]));
        }
        let session = self.sessions.current.as_mut()?;
        let action = if session.takes_ping(now_ns) {
            self.has_chosen = !self.chooses;
            Action::Ping { host_sent_ns: now_ns }
        } else if !self.has_chosen {
            self.has_chosen = true;
            Action::SendPoses { every: self.reception.every() }
        } else {
            let (first, mask) = self.reception.next_request(now_ns)?;
            Action::Resend { first, mask }
        };
        let command = Command { id: OWN_COMMAND, action, is_forced: false };
        let packet = session.channel.seal(&Message::Command(command), buffer).ok()?;
        Some((session.peer, packet))
    }

    /// Seals a message for the box; `None` without a session.
    ///
    /// # Errors
    /// [`EncodeError`] for a message larger than the largest.
    pub fn seal<'a>(
        &mut self,
        message: &Message,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Result<(Peer, &'a [u8]), EncodeError>> {
        let session = self.sessions.current.as_mut()?;
        let packet = session.channel.seal(message, buffer);
        Some(packet.map(|packet| (session.peer, packet)))
    }

    /// The end of this end: gives `send` the goodbyes that free its place at the box, and where to.
    ///
    /// The box may know the session before alone, so that it is left as well. Whoever wants to be
    /// heard over a line that loses packets sends each more than once: only the first counts.
    pub fn leave(mut self, mut send: impl FnMut(Peer, &[u8])) {
        let command = Command { id: OWN_COMMAND, action: Action::Leave, is_forced: false };
        let mut buffer = [0; SEALED_BYTES_MAX];
        for session in self.sessions.iter_mut() {
            if let Ok(packet) = session.channel.seal(&Message::Command(command), &mut buffer) {
                send(session.peer, packet);
            }
        }
    }

    /// Takes a packet.
    pub fn receive<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        mut draw: impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Told<'a> {
        let Some((kind, rest)) = Kind::of(packet) else { return Told::Nothing };
        let told = match kind {
            Kind::Announcement => {
                self.announced(from, packet, now_ns, &mut draw).map(|()| Told::Handshake(None))
            }
            Kind::Answer => self
                .answered(from, packet, now_ns, &mut draw, buffer)
                .map(|packet| Told::Handshake(Some(packet))),
            Kind::Acceptance => self.accepted(from, rest, now_ns).map(|()| Told::Handshake(None)),
            Kind::Channel => self.said(from, packet, now_ns),
            Kind::Stream => self.told(from, packet, now_ns),
            Kind::Greeting | Kind::Opening | Kind::OneWay | Kind::Pairing | Kind::Paired => None,
            Kind::UpdateOpening | Kind::UpdateAcceptance | Kind::UpdateChannel => None,
        };
        told.unwrap_or(Told::Nothing)
    }

    /// Takes note of an announcement of this box: another start of it is met at once.
    fn announced(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
    ) -> Option<()> {
        let start = self.approach.announced(packet)?;
        if !self.sessions.has_met(start, now_ns) && !self.is_refused(now_ns) {
            self.approach.try_at(from, now_ns, draw);
        }
        Some(())
    }

    fn is_refused(&self, now_ns: u64) -> bool {
        self.refused_ns.is_some_and(|then| now_ns.saturating_sub(then) < BUSY_NS)
    }

    /// The opening that follows an answer to a greeting of this end.
    fn answered<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let answer = self.approach.answered(from, packet)?;
        if let Some(obstacle) = Obstacle::of(&answer.announcement) {
            self.obstacle = Some(obstacle);
            self.approach.end(from);
            return None;
        }
        if self.sessions.has_met(answer.announcement.start, now_ns) {
            // What made this end greet it was not true.
            self.approach.end(from);
            return None;
        }
        self.approach.open(from, &answer, now_ns, draw, buffer)
    }

    /// The session that follows an acceptance of an opening of this end.
    fn accepted(&mut self, from: Peer, rest: &[u8], now_ns: u64) -> Option<()> {
        let Acceptance { start, channel, admission } = self.approach.accepted(from, rest)?;
        let (next, rest) = admission.split_first_chunk::<8>()?;
        let (epoch, key) = rest.split_first_chunk::<8>()?;
        let next = u64::from_le_bytes(*next);
        let key = CipherKey::new(*key.first_chunk()?);
        let stream_key = StreamKey::of_epoch(u64::from_le_bytes(*epoch), key);
        self.reception.join(start, next, stream_key);
        self.sessions.begin(Session::new(from, start, channel, now_ns));
        self.has_chosen = !self.chooses;
        Some(())
    }

    /// A message for this listener alone.
    fn said(&mut self, from: Peer, packet: &[u8], now_ns: u64) -> Option<Told<'static>> {
        let session = self.sessions.of_channel(from, packet)?;
        let Some(message) = session.channel.open::<Message>(packet) else {
            return session.channel.is_repeated::<Message>(packet).then_some(Told::Repeated);
        };
        session.heard_ns = now_ns;
        let start = session.start;
        if !is_sent_by(&message, Some(start)) {
            return None;
        }
        if let Message::Reply(Reply { id: OWN_COMMAND, outcome }) = &message
            && let ReplyOutcome::Refused { refusal: Refusal::Busy, reason } = outcome
            && session.answered_ns.is_none()
        {
            self.refused(reason.clone(), now_ns);
            return Some(Told::Kept);
        }
        session.answered_ns = Some(now_ns);
        (self.obstacle, self.refused_ns) = (None, None);
        self.reception.listens = true;
        let Message::Reply(Reply { id: OWN_COMMAND, outcome }) = message else {
            return Some(Told::Message { start, counter: None, message });
        };
        match outcome {
            ReplyOutcome::Pong { stream_next, .. } => self.reception.expect(start, stream_next),
            ReplyOutcome::Gone { first } => self.reception.give_up_before(start, first),
            _ => {}
        }
        Some(Told::Kept)
    }

    /// The box has no room for this listener.
    fn refused(&mut self, reason: String<REASON_BYTES_MAX>, now_ns: u64) {
        (self.obstacle, self.refused_ns) = (Some(Obstacle::Busy { reason }), Some(now_ns));
        self.sessions.current = None;
        if !self.reception.listens {
            self.reception.end();
        }
    }

    /// A message for all listeners.
    fn told(&mut self, from: Peer, packet: &[u8], now_ns: u64) -> Option<Told<'static>> {
        let (start, opened) = self.reception.open(packet, now_ns)?;
        let Some(Opened { counter, message }) = opened else { return Some(Told::Repeated) };
        self.sessions.heard(from, start, now_ns);
        is_sent_by(&message, Some(start)).then_some(Told::Message {
            start,
            counter: Some(counter),
            message,
        })
    }
}

/// What tests want to know, or to be otherwise.
#[cfg(test)]
impl HostEnd {
    pub(super) fn session_number(&self) -> Option<u16> {
        self.sessions.current.as_ref().map(|it| it.channel.session())
    }

    pub(super) fn session_start(&self) -> Option<Start> {
        self.sessions.current.as_ref().map(|it| it.start)
    }

    /// The session is older by this.
    pub(super) fn age(&mut self, by_ns: u64) {
        self.sessions.current.iter_mut().for_each(|it| it.begun_ns -= by_ns);
    }

    /// Gives itself out for a program with another key.
    pub(super) fn pretend(&mut self, key_id: super::KeyId) {
        self.approach.pretend(key_id);
    }
}
