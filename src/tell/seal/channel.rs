//! What a box and one listener say to each other.

use super::aead::{CipherKey, TAG_BYTES};
use super::window::Window;
use super::wire::{
    HEAD_BYTES, Purpose, Reader, SEALED_BYTES_MAX, SESSION_BYTES, Writer, put_counter, take_counter,
};
use crate::tell::packet::{Body, EncodeError, PacketError};

/// One end of the channel.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    purpose: Purpose,
    session: u16,
    seals: CipherKey,
    opens: CipherKey,
    /// The counter of the next packet.
    sent: u64,
    received: Window<16>,
}

impl Channel {
    /// A channel of a new session; its keys must be of this session alone.
    pub(super) fn new(purpose: Purpose, session: u16, seals: CipherKey, opens: CipherKey) -> Self {
        Self { purpose, session, seals, opens, sent: 0, received: Window::starting_at(0) }
    }

    pub(super) fn purpose(&self) -> Purpose {
        self.purpose
    }

    pub(super) fn session(&self) -> u16 {
        self.session
    }

    /// Seals a message.
    pub(super) fn seal<'a>(
        &mut self,
        message: &impl Body,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Result<&'a [u8], EncodeError> {
        let counter = self.sent;
        let mut writer = Writer::new(buffer, self.purpose.channel());
        writer.put(self.session.to_le_bytes());
        put_counter(&mut writer, counter);
        let packet = seal_body(writer, &self.seals, counter, message)?;
        self.sent += 1;
        Ok(packet)
    }

    /// Opens a packet of this session; `None` if it is not authentic, has come before, or holds no
    /// message, of which the first two change nothing.
    pub(super) fn open<B: Body>(&mut self, packet: &[u8]) -> Option<B> {
        let mut reader = Reader(packet.get(HEAD_BYTES + SESSION_BYTES..)?);
        let counter = take_counter(&mut reader)?;
        if !self.received.is_new(counter) {
            return None;
        }
        let message = open_body(packet, reader.0, &self.opens, counter)?;
        self.received.take(counter);
        message.ok()
    }

    /// Whether a packet that has not been opened is of this session all the same, and has come before
    /// or is too old.
    pub(super) fn is_repeated<B: Body>(&self, packet: &[u8]) -> bool {
        let mut reader = Reader(packet.get(HEAD_BYTES + SESSION_BYTES..).unwrap_or_default());
        take_counter(&mut reader).is_some_and(|counter| {
            !self.received.is_new(counter)
                && open_body::<B>(packet, reader.0, &self.opens, counter).is_some()
        })
    }
}

/// The session of a packet of a channel.
pub(super) fn session_of(packet: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(*packet.get(HEAD_BYTES..)?.first_chunk()?))
}

/// Seals a message behind the header that has been written.
pub(super) fn seal_body<'a>(
    mut writer: Writer<'a>,
    key: &CipherKey,
    counter: u64,
    message: &impl Body,
) -> Result<&'a [u8], EncodeError> {
    let header_bytes = writer.length();
    let body_bytes = message.encode(writer.room(TAG_BYTES))?;
    let packet = writer.packet_of(header_bytes + body_bytes + TAG_BYTES);
    key.seal(counter, packet, header_bytes);
    Ok(packet)
}

/// Opens what was sealed at the end of a packet: `None` if it is not authentic, `Some(Err)` if it
/// is, but holds no message.
pub(super) fn open_body<B: Body>(
    packet: &[u8],
    sealed: &[u8],
    key: &CipherKey,
    counter: u64,
) -> Option<Result<B, PacketError>> {
    let header = packet.get(..packet.len() - sealed.len())?;
    let mut body = [0; SEALED_BYTES_MAX];
    let body = key.open(counter, header, sealed, &mut body)?;
    Some(B::decode(body))
}
