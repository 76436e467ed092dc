//! What each packet of the link looks like before anything in it is opened.
//!
//! Announcement, greeting and answer look like this in all versions of the protocol: by them a box and
//! a host of different releases learn that they are. So do the packets of an update, by which one of
//! them becomes of the same release as the other.

use heapless::{String, Vec};

use super::aead::{KEY_BYTES, TAG_BYTES, is_mac, mac};
use super::handshake::NOISE_BYTES;
use super::key::{Key, KeyId};
use super::listeners::CALLER_NAME_BYTES_MAX;
use crate::common::checksum::{CRC_BYTES, CRC32, checked};
use crate::tell::packet::{
    CLEAR_OVERHEAD_BYTES, PACKET_BYTES_MAX, PROTOCOL_VERSION, SCHEMA_HASH, Start,
};

/// The version and the kind.
pub(super) const HEAD_BYTES: usize = 2;

/// Longest counter: 64 bits, 7 in a byte.
const COUNTER_BYTES_MAX: usize = 10;

/// The number of a session.
pub(super) const SESSION_BYTES: usize = 2;

/// Longest packet of the link: the longest message, on the channel of one listener.
pub const SEALED_BYTES_MAX: usize = PACKET_BYTES_MAX - CLEAR_OVERHEAD_BYTES
    + HEAD_BYTES
    + SESSION_BYTES
    + COUNTER_BYTES_MAX
    + TAG_BYTES;

/// Longest frame of the link on a serial line: COBS adds a byte to each 254, and the delimiter comes
/// last.
pub const SEALED_FRAME_BYTES_MAX: usize = SEALED_BYTES_MAX + SEALED_BYTES_MAX.div_ceil(254) + 1;

/// Longest explanation of a box that waits.
pub const WAITING_TEXT_BYTES_MAX: usize = 160;

/// A greeting is as long as the longest answer to it, so that nobody gains by having a box answer
/// somebody else.
pub(super) const GREETING_BYTES: usize = HEAD_BYTES + ANSWER_BYTES + ANNOUNCEMENT_BYTES_MAX;

/// Bytes of a greeting's token.
pub const TOKEN_BYTES: usize = 8;
pub(super) const COOKIE_BYTES: usize = 16;
/// Bytes of a MAC, of which the first half is enough.
pub(super) const MAC_BYTES: usize = 16;
/// Token, cookie and MAC.
const ANSWER_BYTES: usize = TOKEN_BYTES + COOKIE_BYTES + MAC_BYTES;
/// Key id, start, schema hash, versions, state, pairing time, length of the text.
const FIXED_BYTES: usize = 8 + 4 + 4 + 2 + 1 + 1 + 1;
const ANNOUNCEMENT_BYTES_MAX: usize = FIXED_BYTES + WAITING_TEXT_BYTES_MAX + CRC_BYTES;

/// Stream counter, epoch and key: what a box gives to a listener.
pub(super) const ADMISSION_BYTES: usize = 8 + 8 + KEY_BYTES;

/// What an acceptance says to a listener: the session, and the admission. It is sealed, so that nobody
/// changes it on its way.
pub(super) const ACCEPTED_BYTES: usize = SESSION_BYTES + ADMISSION_BYTES;

pub(super) const ACCEPTANCE_BYTES: usize = HEAD_BYTES + NOISE_BYTES + ACCEPTED_BYTES;

/// Bytes of a [`Caller`](super::Caller) in an opening, zeros behind it: whatever its name, an opening
/// is longer than the acceptance.
pub(super) const CALLER_BYTES: usize = 5 + 1 + CALLER_NAME_BYTES_MAX;

const OPENING_BYTES: usize = HEAD_BYTES + COOKIE_BYTES + TERMS_BYTES + NOISE_BYTES + CALLER_BYTES;

const _: () = assert!(ACCEPTANCE_BYTES <= OPENING_BYTES && OPENING_BYTES <= SEALED_BYTES_MAX);

/// The lowest and the highest version of the protocol that this program speaks.
pub(super) const VERSIONS: [u8; 2] = [PROTOCOL_VERSION, PROTOCOL_VERSION];

/// The first byte of the packets of an update: the version of the protocol that had them first. They
/// are the same in all later ones.
const UPDATE_VERSION: u8 = 4;

/// What a packet is: its second byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    /// A box says that it is there.
    Announcement = 1,
    /// A host asks who is there.
    Greeting = 2,
    /// A box's answer to that: an announcement, and a cookie.
    Answer = 3,
    /// The first message of a handshake, from a host.
    Opening = 4,
    /// The second one, from a box.
    Acceptance = 5,
    /// A message between a box and one listener.
    Channel = 6,
    /// A message of a box to all listeners.
    Stream = 7,
    /// A box on a line without a way back says which start of it this is.
    OneWay = 8,
    /// A key, over a cable.
    Pairing = 9,
    /// A box's answer to that.
    Paired = 10,
    /// An opening of a session in which the box is updated.
    UpdateOpening = 11,
    /// The acceptance of such a session.
    UpdateAcceptance = 12,
    /// What host and box say in it.
    UpdateChannel = 13,
}

impl Kind {
    /// The kind of a packet that this version can read, and what follows: one that is the same in all
    /// versions, or of this one.
    pub(super) fn of(packet: &[u8]) -> Option<(Self, &[u8])> {
        let [version, kind, rest @ ..] = packet else { return None };
        let kind = match kind {
            1 => Self::Announcement,
            2 => Self::Greeting,
            3 => Self::Answer,
            4 => Self::Opening,
            5 => Self::Acceptance,
            6 => Self::Channel,
            7 => Self::Stream,
            8 => Self::OneWay,
            9 => Self::Pairing,
            10 => Self::Paired,
            11 => Self::UpdateOpening,
            12 => Self::UpdateAcceptance,
            13 => Self::UpdateChannel,
            _ => return None,
        };
        (kind.is_of_all_versions() || *version == PROTOCOL_VERSION).then_some((kind, rest))
    }

    /// Whether it is one of the packets by which a box and a host learn what the other speaks, or of an
    /// update. Their layout is the same in all versions, and their first byte is not checked: whether
    /// there can be a session of this version is decided by the versions in an answer that is authentic.
    fn is_of_all_versions(self) -> bool {
        matches!(self, Self::Announcement | Self::Greeting | Self::Answer) || self.is_of_update()
    }

    fn is_of_update(self) -> bool {
        matches!(self, Self::UpdateOpening | Self::UpdateAcceptance | Self::UpdateChannel)
    }
}

/// What a session is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// The host listens to the box, with the messages of this version.
    Listening,
    /// The host updates the box, with messages that are the same in all versions.
    Updating,
}

impl Purpose {
    pub(super) fn opening(self) -> Kind {
        match self {
            Self::Listening => Kind::Opening,
            Self::Updating => Kind::UpdateOpening,
        }
    }

    pub(super) fn acceptance(self) -> Kind {
        match self {
            Self::Listening => Kind::Acceptance,
            Self::Updating => Kind::UpdateAcceptance,
        }
    }

    pub(super) fn channel(self) -> Kind {
        match self {
            Self::Listening => Kind::Channel,
            Self::Updating => Kind::UpdateChannel,
        }
    }
}

/// Whether a box that announces itself can be opened a session with, or why not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum BoxState {
    /// It tracks.
    Ready = 0,
    /// It has a key, and no configuration that it can use.
    Refusing = 1,
    /// It has no key.
    Unpaired = 2,
    /// It has a key that it cannot read.
    KeyUnreadable = 3,
    /// Something that this version does not know, and a later one does.
    Later = 255,
}

impl BoxState {
    fn of(byte: u8) -> Self {
        let known = [Self::Ready, Self::Refusing, Self::Unpaired, Self::KeyUnreadable];
        known.into_iter().find(|state| *state as u8 == byte).unwrap_or(Self::Later)
    }
}

/// What a box says of itself in clear: nothing, once it has a key, but which key that is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Announcement {
    /// Which key it has, if any.
    pub key_id: Option<KeyId>,
    /// Which start of it this is.
    pub start: Start,
    /// The messages that it knows: [`SCHEMA_HASH`] of its program.
    pub schema_hash: u32,
    /// The lowest and the highest version of the protocol that it speaks.
    pub versions: [u8; 2],
    /// Whether it tracks.
    pub state: BoxState,
    /// The seconds for which it takes a key over its serial line; 255: until it has one.
    pub pairing_s: u8,
    /// Without a usable key: who it is, and why it waits.
    pub text: String<WAITING_TEXT_BYTES_MAX>,
}

impl Announcement {
    /// The announcement in a packet; `None` if there is none.
    #[must_use]
    pub fn parse(packet: &[u8]) -> Option<Self> {
        match Kind::of(packet)? {
            (Kind::Announcement, _) => match checked(packet)? {
                (covered, true) => Self::read(covered.get(HEAD_BYTES..)?),
                _ => None,
            },
            (Kind::Answer, _) => Some(Answer::read(packet)?.announcement),
            _ => None,
        }
    }

    /// Writes it as a packet.
    pub(super) fn packet<'a>(&self, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        let mut writer = Writer::beginning(buffer, self.versions[1], Kind::Announcement);
        self.write(&mut writer);
        writer.with_checksum()
    }

    fn write(&self, writer: &mut Writer<'_>) {
        writer.put(self.key_id.map_or([0; 8], |id| id.bytes()));
        writer.put(self.start.get().to_le_bytes());
        writer.put(self.schema_hash.to_le_bytes());
        writer.put(self.versions);
        writer.put([self.state as u8, self.pairing_s, self.text.len() as u8]);
        writer.put_slice(self.text.as_bytes());
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader(bytes);
        let key_id = KeyId::new(reader.take()?);
        let start = Start::new(u32::from_le_bytes(reader.take()?))?;
        let schema_hash = u32::from_le_bytes(reader.take()?);
        let versions = reader.take()?;
        let [state, pairing_s, length] = reader.take()?;
        // What a later version says behind the text is left out.
        let text = core::str::from_utf8(reader.0.get(..usize::from(length))?).ok()?;
        let (state, text) = (BoxState::of(state), text.try_into().ok()?);
        Some(Self { key_id, start, schema_hash, versions, state, pairing_s, text })
    }
}

/// A box's answer to a greeting, which a host believes only from a box that has its key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Answer {
    pub(super) token: [u8; TOKEN_BYTES],
    pub(super) cookie: [u8; COOKIE_BYTES],
    pub(super) announcement: Announcement,
}

/// What the MAC of an answer is for.
const ANSWER: &str = "plumbline answer";

impl Answer {
    /// Writes it as a packet; without a key its MAC is zero.
    pub(super) fn packet<'a>(
        &self,
        key: Option<&Key>,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> &'a [u8] {
        let version = self.announcement.versions[1];
        let mut writer = Writer::beginning(buffer, version, Kind::Answer);
        writer.put(self.token);
        writer.put(self.cookie);
        self.announcement.write(&mut writer);
        let code = key.map(|key| mac(key.bytes(), ANSWER, &[writer.written()]));
        writer.put_slice(&code.unwrap_or_default()[..MAC_BYTES]);
        writer.with_checksum()
    }

    /// Reads a packet, whoever made it.
    pub(super) fn read(packet: &[u8]) -> Option<Self> {
        let (covered, true) = checked(packet)? else { return None };
        let (said, _) = covered.split_last_chunk::<MAC_BYTES>()?;
        let mut reader = Reader(said.get(HEAD_BYTES..)?);
        let (token, cookie) = (reader.take()?, reader.take()?);
        Some(Self { token, cookie, announcement: Announcement::read(reader.0)? })
    }

    /// Whether the packet of an answer was made by a box with this key.
    pub(super) fn is_authentic(key: &Key, packet: &[u8]) -> bool {
        let mac_and_before = checked(packet).and_then(|it| it.0.split_last_chunk::<MAC_BYTES>());
        mac_and_before.is_some_and(|(said, mac)| is_mac(mac, key.bytes(), ANSWER, &[said]))
    }
}

/// A host's greeting: its token, which the answer repeats, and zeros. A program that does not know
/// which box is there learns it from the answer: see [`Announcement::parse`].
pub fn greeting(token: [u8; TOKEN_BYTES], buffer: &mut [u8; SEALED_BYTES_MAX]) -> &[u8] {
    let mut writer = Writer::beginning(buffer, VERSIONS[1], Kind::Greeting);
    writer.put(token);
    while writer.length < GREETING_BYTES {
        writer.put([0]);
    }
    writer.packet()
}

/// The token of a greeting.
pub(super) fn greeting_token(packet: &[u8]) -> Option<[u8; TOKEN_BYTES]> {
    let is_whole = packet.len() == GREETING_BYTES;
    packet.get(HEAD_BYTES..)?.first_chunk().copied().filter(|_| is_whole)
}

/// What host and box agree on before the handshake, and the handshake then proves to have been the
/// same for both: a change of it on the way spoils the handshake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Terms {
    pub(super) key_id: KeyId,
    pub(super) host_versions: [u8; 2],
    pub(super) box_versions: [u8; 2],
    pub(super) start: Start,
}

/// Bytes of the [`Terms`].
pub(super) const TERMS_BYTES: usize = 8 + 2 + 2 + 4;

impl Terms {
    pub(super) fn bytes(&self) -> [u8; TERMS_BYTES] {
        let mut bytes = [0; TERMS_BYTES];
        bytes[..8].copy_from_slice(&self.key_id.bytes());
        bytes[8..10].copy_from_slice(&self.host_versions);
        bytes[10..12].copy_from_slice(&self.box_versions);
        bytes[12..].copy_from_slice(&self.start.get().to_le_bytes());
        bytes
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            key_id: KeyId::new(reader.take()?)?,
            host_versions: reader.take()?,
            box_versions: reader.take()?,
            start: Start::new(u32::from_le_bytes(reader.take()?))?,
        })
    }

    /// The prologue of the handshake: the version that both chose and the messages that both know,
    /// unless it is for an update, the terms, and the cookie, without which an opening could be played
    /// again from elsewhere.
    pub(super) fn prologue(
        &self,
        purpose: Purpose,
        cookie: &[u8; COOKIE_BYTES],
    ) -> Vec<u8, PROLOGUE_BYTES_MAX> {
        let schema_hash = SCHEMA_HASH.to_le_bytes();
        let agreed: [&[u8]; 3] = match purpose {
            Purpose::Listening => [b"plumbline link", &[PROTOCOL_VERSION], &schema_hash],
            Purpose::Updating => [b"plumbline update", &[], &[]],
        };
        let terms = self.bytes();
        let parts = agreed.into_iter().chain([&terms[..], &cookie[..]]);
        // There is room for the longer one.
        parts.flatten().copied().collect()
    }
}

/// Longest prologue: label, version and schema hash, terms, cookie.
const PROLOGUE_BYTES_MAX: usize = 14 + 1 + 4 + TERMS_BYTES + COOKIE_BYTES;

/// Writes a counter, 7 bits in a byte, the lowest first; all but the last have their highest bit set.
pub(super) fn put_counter(writer: &mut Writer<'_>, mut counter: u64) {
    while counter > 0x7F {
        writer.put([counter as u8 | 0x80]);
        counter >>= 7;
    }
    writer.put([counter as u8]);
}

/// Reads a counter in its shortest form, the only one.
pub(super) fn take_counter(reader: &mut Reader<'_>) -> Option<u64> {
    let mut counter = 0_u64;
    for shift in (0..u64::BITS).step_by(7) {
        let [byte] = reader.take()?;
        let bits = u64::from(byte & 0x7F);
        let shifted = bits << shift;
        if shifted >> shift != bits || (byte == 0 && shift > 0) {
            return None;
        }
        counter |= shifted;
        if byte & 0x80 == 0 {
            return Some(counter);
        }
    }
    None
}

/// Writes one packet, which always fits.
#[derive(Debug)]
pub(super) struct Writer<'a> {
    buffer: &'a mut [u8; SEALED_BYTES_MAX],
    length: usize,
}

impl<'a> Writer<'a> {
    /// A packet of this version, or of an update.
    pub(super) fn new(buffer: &'a mut [u8; SEALED_BYTES_MAX], kind: Kind) -> Self {
        let version = if kind.is_of_update() { UPDATE_VERSION } else { PROTOCOL_VERSION };
        Self::beginning(buffer, version, kind)
    }

    /// A packet that begins with this version: of meeting, the highest that the sender speaks.
    fn beginning(buffer: &'a mut [u8; SEALED_BYTES_MAX], version: u8, kind: Kind) -> Self {
        let mut writer = Self { buffer, length: 0 };
        writer.put([version, kind as u8]);
        writer
    }

    pub(super) fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        self.put_slice(&bytes);
    }

    pub(super) fn put_slice(&mut self, bytes: &[u8]) {
        self.buffer[self.length..][..bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
    }

    pub(super) fn length(&self) -> usize {
        self.length
    }

    pub(super) fn written(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    /// The room that is left, without `behind` bytes at its end.
    pub(super) fn room(&mut self, behind: usize) -> &mut [u8] {
        let end = SEALED_BYTES_MAX - behind;
        &mut self.buffer[self.length..end]
    }

    /// The buffer, of which that many bytes are the packet.
    pub(super) fn packet_of(self, bytes: usize) -> &'a mut [u8] {
        &mut self.buffer[..bytes]
    }

    pub(super) fn packet(self) -> &'a [u8] {
        &self.buffer[..self.length]
    }

    pub(super) fn with_checksum(mut self) -> &'a [u8] {
        let checksum = CRC32.checksum(&self.buffer[..self.length]);
        self.put(checksum.to_le_bytes());
        self.packet()
    }
}

/// Reads one packet.
#[derive(Debug)]
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl Reader<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*taken)
    }
}
