//! The box's end of the link: who listens, and what of it is authentic.
//!
//! It sends and receives nothing itself: it is given each packet that came and the time, and says
//! what to send back.
//!
//! ```text
//! Greeting ─▶ Answer, with a cookie: nothing is remembered
//! Opening ──▶ right cookie, right key? ─▶ pending, Acceptance ─┐
//! Channel ──▶ of a pending session, authentic? ─▶ a listener ◀─┘
//!         └─▶ of a listener, authentic, new? ─▶ a message, or its goodbye
//! ```
//!
//! UpdateOpening and UpdateChannel go the same way, to one program that updates the box, of whatever
//! release it is.
//!
//! Whatever is not authentic changes nothing: the box remembers neither its sender nor that it
//! came, and nothing is answered but a greeting, with as many bytes at most.

use heapless::{String, Vec};
use zeroize::Zeroizing;

use super::aead::{CipherKey, KEY_BYTES};
use super::channel::{Channel, session_of};
use super::cookie::Cookies;
use super::handshake::{Handshake, NOISE_BYTES};
use super::key::Key;
use super::listeners::{Caller, LISTENERS_MAX, Listener, ListenerId, Listeners};
use super::pending::{Handshakes, PENDING_MAX, Pending, SEEN_BYTES};
use super::resends::Again;
use super::ring::Ring;
use super::stream::StreamSealer;
use super::updater::{Updater, UpdaterId};
use super::wire::{
    ACCEPTED_BYTES, ADMISSION_BYTES, Announcement, Answer, BoxState, CALLER_BYTES, Kind, Purpose,
    Reader, SEALED_BYTES_MAX, SESSION_BYTES, Terms, VERSIONS, Writer, greeting_token,
};
use super::{Pairing, Peer};
use crate::tell::packet::{
    Action, Command, EncodeError, Message, PROTOCOL_VERSION, REASON_BYTES_MAX, Refusal, Reply,
    ReplyOutcome, SCHEMA_HASH, Start, UPDATE_TEXT_BYTES_MAX, UpdateOutcome, UpdateRefusal,
    UpdateReply, UpdateRequest, UpdateStep, is_sent_by,
};

/// What to do with a packet.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the message")]
pub enum Heard<'a> {
    /// Nothing.
    Nothing,
    /// Send this to where it came from.
    Answer(&'a [u8]),
    /// A listener says this.
    Message {
        /// Who.
        listener: ListenerId,
        /// Whether it joins with this, for the first time or after another handshake.
        has_joined: bool,
        /// What.
        message: Message,
    },
    /// A listener has left: its place is free.
    Left,
    /// The program that updates the box asks this.
    Update {
        /// Who.
        updater: UpdaterId,
        /// What.
        request: UpdateRequest,
    },
    /// Over the serial line, while the box may be paired, comes this key.
    Pairing(Key),
}

/// The box's end of the link.
#[derive(Debug)]
pub struct BoxEnd {
    key: Option<Key>,
    pub(super) announcement: Announcement,
    cookies: Cookies,
    pub(super) stream: StreamSealer,
    listeners: Listeners,
    updater: Option<Updater>,
    handshakes: Handshakes,
    /// The number of the next session.
    pub(super) sessions: u16,
}

impl BoxEnd {
    /// The end of a box that has just started. The secret must have been drawn at random for this
    /// start; a box without a key takes no listener.
    #[must_use]
    pub fn new(key: Option<Key>, start: Start, secret: &[u8; KEY_BYTES]) -> Self {
        let announcement = Announcement {
            key_id: key.as_ref().map(Key::id),
            start,
            schema_hash: SCHEMA_HASH,
            versions: VERSIONS,
            state: if key.is_some() { BoxState::Ready } else { BoxState::Unpaired },
            pairing_s: 0,
            text: String::new(),
        };
        Self {
            key,
            announcement,
            cookies: Cookies::new(secret),
            stream: StreamSealer::new(CipherKey::derived(secret, "plumbline first stream", &[])),
            listeners: Listeners::new(),
            updater: None,
            handshakes: Handshakes::new(),
            sessions: 0,
        }
    }

    /// What the box says of itself in clear. What a box with a key has to say in words, it says to
    /// its listeners alone.
    pub fn describe(&mut self, state: BoxState, pairing_s: u8, text: &str) {
        let announcement = &mut self.announcement;
        (announcement.state, announcement.pairing_s) = (state, pairing_s);
        announcement.text.clear();
        if self.key.is_none() {
            for letter in text.chars() {
                if announcement.text.push(letter).is_err() {
                    break;
                }
            }
        }
    }

    /// The packet that announces the box.
    #[must_use]
    pub fn announcement<'a>(&self, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        self.announcement.packet(buffer)
    }

    /// The box's key.
    #[must_use]
    pub fn key(&self) -> Option<&Key> {
        self.key.as_ref()
    }

    /// Takes a packet. `draw` gives 32 bytes from the operating system's random generator.
    pub fn receive<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        draw: impl FnOnce() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Heard<'a> {
        let heard = match Kind::of(packet) {
            Some((Kind::Greeting, _)) => {
                self.greeted(from, packet, now_ns, buffer).map(Heard::Answer)
            }
            Some((Kind::Opening, rest)) => {
                self.opened(Purpose::Listening, from, rest, now_ns, draw, buffer).map(Heard::Answer)
            }
            Some((Kind::UpdateOpening, rest)) => {
                self.opened(Purpose::Updating, from, rest, now_ns, draw, buffer).map(Heard::Answer)
            }
            Some((Kind::Channel, _)) => self.said(from, packet, now_ns, buffer),
            Some((Kind::UpdateChannel, _)) => self.requested(from, packet, now_ns, buffer),
            Some((Kind::Pairing, _)) if from == Peer::Serial => {
                let pairing = Pairing::read(packet);
                pairing.map(|it| it.key).filter(|key| self.may_come(key)).map(Heard::Pairing)
            }
            _ => None,
        };
        heard.unwrap_or(Heard::Nothing)
    }

    /// Whether a key may come over the cable: while the box says so, and the key that it has at any time,
    /// because the host may have missed the answer.
    fn may_come(&self, key: &Key) -> bool {
        self.announcement.pairing_s > 0 || self.key.as_ref().map(Key::id) == Some(key.id())
    }

    /// Lets time pass: handshakes that nobody finishes, and listeners that have left, are forgotten.
    pub fn pass(&mut self, now_ns: u64) {
        self.handshakes.pass(now_ns);
        self.listeners.pass(now_ns);
    }

    /// Seals a message for all listeners; returns it with its counter in the stream.
    ///
    /// # Errors
    /// [`EncodeError`] for a message larger than the largest.
    pub fn seal_to_all<'a>(
        &mut self,
        message: &Message,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Result<(u64, &'a [u8]), EncodeError> {
        let counter = self.stream.next();
        Ok((counter, self.stream.seal(message, buffer)?))
    }

    /// The counter of the next packet of the stream.
    #[must_use]
    pub fn stream_next(&self) -> u64 {
        self.stream.next()
    }

    /// Seals a message for one listener; `None` if it has left.
    ///
    /// # Errors
    /// [`EncodeError`] for a message larger than the largest.
    pub fn seal_to<'a>(
        &mut self,
        listener: ListenerId,
        message: &Message,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Result<(Peer, &'a [u8]), EncodeError>> {
        let listener = self.listeners.get_mut(listener)?;
        let packet = listener.channel.seal(message, buffer);
        Some(packet.map(|packet| (listener.peer, packet)))
    }

    /// Seals a reply for the program that updates the box; `None` if there is none.
    ///
    /// # Errors
    /// [`EncodeError`] for a reply larger than the largest.
    pub fn seal_to_updater<'a>(
        &mut self,
        reply: &UpdateReply,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Result<(Peer, &'a [u8]), EncodeError>> {
        let updater = self.updater.as_mut()?;
        let packet = updater.channel.seal(reply, buffer);
        Some(packet.map(|packet| (updater.peer, packet)))
    }

    /// The listeners, and where they are.
    #[must_use]
    pub fn listeners(&self) -> Vec<(ListenerId, Peer), LISTENERS_MAX> {
        self.listeners.ids()
    }

    /// Whether a listener has not left.
    #[must_use]
    pub fn is_there(&self, listener: ListenerId) -> bool {
        self.listeners().iter().any(|(id, _)| *id == listener)
    }

    /// Whether somebody at this address has been heard in the last seconds.
    #[must_use]
    pub fn hears(&self, peer: Peer, now_ns: u64) -> bool {
        self.listeners.hears(peer, now_ns)
    }

    /// Sends a listener every such pose only.
    pub fn send_poses(&mut self, listener: ListenerId, every: u16) {
        if let Some(listener) = self.listeners.get_mut(listener) {
            listener.send_poses(every);
        }
    }

    /// Whether the next pose is for this listener; counts it.
    pub fn takes_pose(&mut self, listener: ListenerId) -> bool {
        self.listeners.get_mut(listener).is_some_and(Listener::takes_pose)
    }

    /// A listener has asked for packets of the stream once more, with the command of this number: see
    /// [`Action::Resend`](crate::tell::packet::Action::Resend).
    pub fn resend(&mut self, listener: ListenerId, id: u16, first: u64, mask: u64) {
        if let Some(listener) = self.listeners.get_mut(listener) {
            listener.resends.ask(id, first, mask);
        }
    }

    /// The next packet that a listener is to get once more, or the reply that some are gone; to be
    /// asked as often as its line can take another packet.
    pub fn next_resend<'a, const BYTES: usize, const PACKETS: usize>(
        &mut self,
        listener: ListenerId,
        ring: &Ring<BYTES, PACKETS>,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<(Peer, &'a [u8])> {
        let listener = self.listeners.get_mut(listener)?;
        let packet = match listener.resends.next(ring.kept())? {
            Again::Packet(counter) => {
                let packet = ring.get(counter)?;
                let place = buffer.get_mut(..packet.len())?;
                place.copy_from_slice(packet);
                place
            }
            Again::Gone(id) => {
                let outcome = ReplyOutcome::Gone { first: ring.kept().start };
                listener.channel.seal(&Message::Reply(Reply { id, outcome }), buffer).ok()?
            }
        };
        Some((listener.peer, packet))
    }

    /// A listener records a trial from now on, or no longer.
    pub fn record(&mut self, listener: ListenerId, on: bool) {
        if let Some(listener) = self.listeners.get_mut(listener) {
            listener.records = on;
        }
    }

    /// Who records a trial.
    #[must_use]
    pub fn recorder(&self) -> Option<&Caller> {
        self.listeners.iter().find(|it| it.records).map(|it| &it.caller)
    }

    /// The answer to a greeting.
    fn greeted<'a>(
        &self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let token = greeting_token(packet)?;
        let cookie = self.cookies.cookie(from, now_ns)?;
        let announcement = self.announcement.clone();
        Some(Answer { token, cookie, announcement }.packet(self.key.as_ref(), buffer))
    }

    /// The answer to the first message of a handshake, if it is authentic.
    fn opened<'a>(
        &mut self,
        purpose: Purpose,
        from: Peer,
        rest: &[u8],
        now_ns: u64,
        draw: impl FnOnce() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let mut reader = Reader(rest);
        let cookie = reader.take()?;
        let terms = Terms::read(&mut reader)?;
        let message: &[u8; NOISE_BYTES + CALLER_BYTES] = reader.0.try_into().ok()?;
        if !self.cookies.is_valid(&cookie, from, now_ns) || !self.agrees(purpose, &terms) {
            return None;
        }
        let key = self.key.as_ref()?;
        let prologue = terms.prologue(purpose, &cookie);
        let mut caller = [0; CALLER_BYTES];
        // Without a key pair of its own first, which costs more than all that is done before.
        Handshake::check(key.bytes(), &prologue, message, &mut caller)?;
        let seen: [u8; SEEN_BYTES] = *message.first_chunk()?;
        if let Some(pending) = self.handshakes.iter().find(|it| it.seen == seen) {
            let place = buffer.get_mut(..pending.acceptance.len())?;
            place.copy_from_slice(&pending.acceptance);
            return Some(place);
        }
        if self.handshakes.has_seen(&seen) {
            return None;
        }
        let secret = Zeroizing::new(draw());
        let mut handshake = Handshake::of_box(key.bytes(), &prologue, &secret)?;
        handshake.read(message, &mut caller)?;
        self.handshakes.see(seen);
        let caller = postcard::from_bytes::<Caller>(&caller).ok()?;
        let session = self.free_session();
        let mut accepted = Zeroizing::new([0; ACCEPTED_BYTES]);
        accepted[..SESSION_BYTES].copy_from_slice(&session.to_le_bytes());
        accepted[SESSION_BYTES..].copy_from_slice(&self.admission()[..]);
        let payload = match purpose {
            Purpose::Listening => &accepted[..],
            // Who updates the box has no part in its stream.
            Purpose::Updating => &accepted[..SESSION_BYTES],
        };
        let mut writer = Writer::new(buffer, purpose.acceptance());
        let header_bytes = writer.length();
        let bytes = handshake.write(payload, writer.room(0))?;
        let packet = writer.packet_of(header_bytes + bytes);
        let keys = handshake.keys()?;
        self.handshakes.add(Pending {
            peer: from,
            caller,
            channel: Channel::new(purpose, session, keys.to_host, keys.to_box),
            seen,
            acceptance: Vec::from_slice(packet).ok()?,
            begun_ns: now_ns,
        });
        Some(packet)
    }

    /// What a listener is let into the stream with.
    fn admission(&mut self) -> Zeroizing<[u8; ADMISSION_BYTES]> {
        let next = self.stream.next();
        let stream = self.stream.key();
        let mut admission = Zeroizing::new([0; ADMISSION_BYTES]);
        admission[..8].copy_from_slice(&next.to_le_bytes());
        admission[8..16].copy_from_slice(&stream.epoch().to_le_bytes());
        admission[16..].copy_from_slice(stream.bytes());
        admission
    }

    /// A number for a session that no other has.
    fn free_session(&mut self) -> u16 {
        let listeners = self.listeners.iter().map(|it| it.channel.session());
        let updater = self.updater.iter().map(|it| it.channel.session());
        let pending = self.handshakes.iter().map(|it| it.channel.session());
        let used: Vec<u16, { LISTENERS_MAX + 1 + PENDING_MAX }> =
            listeners.chain(updater).chain(pending).collect();
        while used.contains(&self.sessions) {
            self.sessions = self.sessions.wrapping_add(1);
        }
        let session = self.sessions;
        self.sessions = session.wrapping_add(1);
        session
    }

    /// A message on the channel of a listener, or of one that joins with it.
    fn said<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Heard<'a>> {
        let session = session_of(packet)?;
        if let Some((id, listener)) = self.listeners.of_channel(from, session) {
            let message: Message = listener.channel.open(packet)?;
            listener.heard_ns = now_ns;
            if is_goodbye(&message) {
                let process = listener.caller.process;
                self.listeners.leave(process);
                return Some(Heard::Left);
            }
            return is_sent_by(&message, None).then_some(Heard::Message {
                listener: id,
                has_joined: false,
                message,
            });
        }
        let is_of_host = |message: &Message| is_sent_by(message, None);
        let (Pending { caller, mut channel, .. }, message) =
            self.handshakes.begin(Purpose::Listening, from, packet, is_of_host)?;
        if is_goodbye(&message) {
            // What the program has said before in this session is lost, or comes later. It may have
            // its place from the session before.
            self.listeners.leave(caller.process);
            return Some(Heard::Left);
        }
        if let Some(listener) = self.listeners.join(from, &caller, &channel, now_ns) {
            return Some(Heard::Message { listener, has_joined: true, message });
        }
        let id = if let Message::Command(command) = &message { command.id } else { 0 };
        let outcome = ReplyOutcome::Refused { refusal: Refusal::Busy, reason: self.names() };
        let reply = Message::Reply(Reply { id, outcome });
        channel.seal(&reply, buffer).ok().map(Heard::Answer)
    }

    /// A request on the channel of the program that updates the box, or of one that begins to.
    fn requested<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Heard<'a>> {
        let session = session_of(packet)?;
        let is_it = |it: &&mut Updater| it.peer == from && it.channel.session() == session;
        let request: UpdateRequest = if let Some(updater) = self.updater.as_mut().filter(is_it) {
            let request = updater.channel.open(packet)?;
            updater.heard_ns = now_ns;
            request
        } else {
            let (pending, request) =
                self.handshakes.begin(Purpose::Updating, from, packet, |_: &UpdateRequest| true)?;
            let Pending { peer, caller, mut channel, .. } = pending;
            if let Some(other) = &self.updater
                && !other.yields_to(&caller, now_ns)
            {
                let mut text = String::<UPDATE_TEXT_BYTES_MAX>::new();
                // There is room for all of it.
                let _ = text.push_str("it is being updated by ");
                let _ = text.push_str(&other.caller.name);
                let outcome = UpdateOutcome::Refused { refusal: UpdateRefusal::Busy, text };
                let reply = UpdateReply { id: request.id, version: String::new(), outcome };
                return channel.seal(&reply, buffer).ok().map(Heard::Answer);
            }
            self.updater = Some(Updater { peer, caller, channel, heard_ns: now_ns });
            request
        };
        if request.step == UpdateStep::Leave {
            self.updater = None;
            return Some(Heard::Left);
        }
        let updater = self.updater.as_ref()?.id();
        Some(Heard::Update { updater, request })
    }

    /// Who listens, in words.
    fn names(&self) -> String<REASON_BYTES_MAX> {
        let mut names = String::new();
        // There is room for all of them.
        let _ = names.push_str("as many programs listen as it has room for: ");
        for (index, listener) in self.listeners.iter().enumerate() {
            let _ = names.push_str(if index > 0 { ", " } else { "" });
            let _ = names.push_str(&listener.caller.name);
        }
        names
    }

    fn agrees(&self, purpose: Purpose, terms: &Terms) -> bool {
        let [lowest, highest] = terms.host_versions;
        Some(terms.key_id) == self.announcement.key_id
            && terms.start == self.announcement.start
            && terms.box_versions == self.announcement.versions
            && match purpose {
                Purpose::Listening => (lowest..=highest).contains(&PROTOCOL_VERSION),
                Purpose::Updating => true,
            }
    }
}

/// Whether a listener says that it leaves. It says so of its session alone: of one that another has
/// replaced it is no longer understood.
fn is_goodbye(message: &Message) -> bool {
    matches!(message, Message::Command(Command { action: Action::Leave, .. }))
}

/// What tests want to know.
#[cfg(test)]
impl BoxEnd {
    /// The programs that listen.
    pub(super) fn listening(&self) -> impl Iterator<Item = &Caller> {
        self.listeners.iter().map(|it| &it.caller)
    }

    /// Forgets the handshakes that wait, as if they were old.
    pub(super) fn forget_pending(&mut self) {
        self.handshakes.pass(u64::MAX);
    }

    /// The handshakes that wait for the host's first message.
    pub(super) fn pending(&self) -> impl Iterator<Item = &Pending> {
        self.handshakes.iter()
    }
}
