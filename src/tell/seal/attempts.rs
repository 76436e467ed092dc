//! A host's handshakes that are not through: with whom, and how far they are.
//!
//! An announcement is not authentic, so that anybody can have a host greet any address. The address
//! at which the box is known to have been has a place of its own here. At all others a greeting has
//! little time to be answered once more addresses announce themselves than there is room for. What
//! has been answered is of the box, and stays.

use heapless::Vec;
use zeroize::Zeroizing;

use super::Peer;
use super::aead::KEY_BYTES;
use super::channel::Channel;
use super::handshake::Handshake;
use super::key::Key;
use super::listeners::Caller;
use super::wire::{
    ACCEPTED_BYTES, ADMISSION_BYTES, Answer, CALLER_BYTES, Purpose, SEALED_BYTES_MAX,
    SESSION_BYTES, TOKEN_BYTES, Terms, Writer, greeting,
};
use crate::tell::packet::Start;

/// Addresses at which a session is tried at the same time.
const ATTEMPTS_MAX: usize = 8;

/// A message of a handshake is sent again after this time.
const REPEAT_NS: u64 = 200_000_000;

/// A greeting that has not been answered after this time, or an opening that has not been accepted, is
/// given up, and the handshake begun anew.
const ATTEMPT_NS: u64 = 1_000_000_000;

/// A greeting that has not been answered for this long, and up to twice as long, by chance, gives its
/// place to another address if there is no other. Boxes of a local network answer within a few
/// milliseconds; by chance, so that nobody can know when there is room.
const CROWDED_NS: u64 = 50_000_000;

struct Attempt {
    peer: Peer,
    /// Whether the box is known to have been there.
    is_known: bool,
    token: [u8; TOKEN_BYTES],
    began_ns: u64,
    crowded_ns: u64,
    sent_ns: Option<u64>,
    stage: Stage,
}

#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put it")]
enum Stage {
    /// Greetings are sent.
    Greets,
    /// A box of this key has answered.
    Opens(Opening),
    /// It has, and there is nothing to open.
    Over,
}

/// The first message of a handshake, and what is needed to read the second.
pub(super) struct Opening {
    purpose: Purpose,
    handshake: Handshake,
    packet: Vec<u8, SEALED_BYTES_MAX>,
    start: Start,
}

impl Opening {
    /// Begins a handshake with the box that has given this answer, with a secret key for this one
    /// alone.
    pub(super) fn new(
        purpose: Purpose,
        host_versions: [u8; 2],
        key: &Key,
        Answer { cookie, announcement, .. }: &Answer,
        caller: &Caller,
        ephemeral: &[u8; KEY_BYTES],
    ) -> Option<Self> {
        let terms = Terms {
            key_id: key.id(),
            host_versions,
            box_versions: announcement.versions,
            start: announcement.start,
        };
        let prologue = terms.prologue(purpose, cookie);
        let mut handshake = Handshake::of_host(key.bytes(), &prologue, ephemeral)?;
        let mut payload = [0; CALLER_BYTES];
        postcard::to_slice(caller, &mut payload).ok()?;
        let mut buffer = [0; SEALED_BYTES_MAX];
        let mut writer = Writer::new(&mut buffer, purpose.opening());
        writer.put(*cookie);
        writer.put(terms.bytes());
        let header_bytes = writer.length();
        let bytes = handshake.write(&payload, writer.room(0))?;
        let packet = Vec::from_slice(writer.packet_of(header_bytes + bytes)).ok()?;
        Some(Self { purpose, handshake, packet, start: terms.start })
    }
}

/// What a box has accepted a host with.
pub(super) struct Acceptance {
    pub(super) start: Start,
    pub(super) channel: Channel,
    /// What a listener is let into the stream with; of an update, zeros.
    pub(super) admission: Zeroizing<[u8; ADMISSION_BYTES]>,
}

/// Handshakes that are not through.
#[derive(Default)]
pub(super) struct Attempts {
    all: Vec<Attempt, ATTEMPTS_MAX>,
}

/// How far each is.
impl core::fmt::Debug for Attempts {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut list = formatter.debug_list();
        for Attempt { peer, is_known, token, began_ns, sent_ns, stage, .. } in &self.all {
            let stage = match stage {
                Stage::Greets => None,
                Stage::Opens(opening) => Some(&opening.packet[..]),
                Stage::Over => Some(&[][..]),
            };
            list.entry(&(peer, is_known, token, began_ns, sent_ns, stage));
        }
        list.finish()
    }
}

impl Attempts {
    /// Begins a handshake at an address, unless one is under way there or there is no room.
    pub(super) fn begin(
        &mut self,
        peer: Peer,
        is_known: bool,
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
    ) {
        let age_ns = |it: &Attempt| now_ns.saturating_sub(it.began_ns);
        self.all.retain(|it| age_ns(it) < ATTEMPT_NS);
        if let Some(attempt) = self.all.iter_mut().find(|it| it.peer == peer) {
            attempt.is_known |= is_known;
            return;
        }
        if self.all.is_full() {
            // One of them is of nobody who is known.
            let others =
                self.all.iter().filter(|it| !it.is_known && !matches!(it.stage, Stage::Opens(_)));
            let oldest = others.map(|it| (it.crowded_ns, it.peer)).min_by_key(|it| it.0);
            let Some((_, given_up)) = oldest.filter(|it| is_known || now_ns >= it.0) else {
                return;
            };
            self.all.retain(|it| it.peer != given_up);
        }
        let drawn = draw();
        let (token, rest) = drawn.split_at(TOKEN_BYTES);
        let attempt = Attempt {
            peer,
            is_known,
            token: core::array::from_fn(|index| token[index]),
            began_ns: now_ns,
            crowded_ns: now_ns + CROWDED_NS + CROWDED_NS * u64::from(rest[0]) / 256,
            sent_ns: None,
            stage: Stage::Greets,
        };
        let _ = self.all.push(attempt);
    }

    /// Writes the next message that is due; returns where to, and its length.
    pub(super) fn due(
        &mut self,
        now_ns: u64,
        buffer: &mut [u8; SEALED_BYTES_MAX],
    ) -> Option<(Peer, usize)> {
        let since = |then_ns: u64| now_ns.saturating_sub(then_ns);
        let is_due = |it: &&mut Attempt| {
            since(it.began_ns) < ATTEMPT_NS
                && it.sent_ns.is_none_or(|then| since(then) >= REPEAT_NS)
                && !matches!(it.stage, Stage::Over)
        };
        let attempt = self.all.iter_mut().find(is_due)?;
        attempt.sent_ns = Some(now_ns);
        let packet = match &attempt.stage {
            Stage::Opens(opening) => &opening.packet[..],
            _ => return Some((attempt.peer, greeting(attempt.token, buffer).len())),
        };
        buffer[..packet.len()].copy_from_slice(packet);
        Some((attempt.peer, packet.len()))
    }

    /// The answer in a packet, if a greeting to there waits for it and the box has this key.
    pub(super) fn answer(&self, from: Peer, packet: &[u8], key: &Key) -> Option<Answer> {
        let answer = Answer::read(packet)?;
        let waits = |it: &Attempt| it.token == answer.token && matches!(it.stage, Stage::Greets);
        let is_expected = self.all.iter().any(|it| it.peer == from && waits(it));
        (is_expected && Answer::is_authentic(key, packet)).then_some(answer)
    }

    /// Sends nothing more to an address, and does not begin again there so soon.
    pub(super) fn end(&mut self, peer: Peer) {
        self.all.iter_mut().filter(|it| it.peer == peer).for_each(|it| it.stage = Stage::Over);
    }

    /// The opening that follows an answer from an address.
    pub(super) fn open<'a>(
        &mut self,
        peer: Peer,
        opening: Opening,
        now_ns: u64,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let attempt = self.all.iter_mut().find(|it| it.peer == peer)?;
        let packet = buffer.get_mut(..opening.packet.len())?;
        packet.copy_from_slice(&opening.packet);
        (attempt.stage, attempt.sent_ns) = (Stage::Opens(opening), Some(now_ns));
        attempt.began_ns = now_ns;
        Some(packet)
    }

    /// What an acceptance of one of the openings says; all others end with it.
    pub(super) fn accepted(&mut self, from: Peer, rest: &[u8]) -> Option<Acceptance> {
        let attempt = self.all.iter().find(|it| it.peer == from)?;
        let Stage::Opens(opening) = &attempt.stage else { return None };
        let bytes = match opening.purpose {
            Purpose::Listening => ACCEPTED_BYTES,
            Purpose::Updating => SESSION_BYTES,
        };
        let mut accepted = Zeroizing::new([0; ACCEPTED_BYTES]);
        // A forged acceptance must not spoil the handshake: it is read from a copy.
        let mut handshake = opening.handshake.clone();
        if handshake.read(rest, &mut accepted[..])? != bytes {
            return None;
        }
        let (session, rest) = accepted.split_first_chunk::<SESSION_BYTES>()?;
        let session = u16::from_le_bytes(*session);
        let admission = Zeroizing::new(*rest.first_chunk()?);
        let (start, keys) = (opening.start, handshake.keys()?);
        let channel = Channel::new(opening.purpose, session, keys.to_box, keys.to_host);
        self.all.clear();
        Some(Acceptance { start, channel, admission })
    }
}
