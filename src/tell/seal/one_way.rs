//! A line without a way back: a box that nobody answers says which start of it this is, and its
//! hosts compute the key of the stream from that and from the box's key.
//!
//! Nothing fresh comes from the host here, so whoever records the line could play it back later.
//! Each start of the box therefore has a number higher than all before, and a host takes no start
//! whose number it has seen. Unlike after a handshake, the box's key opens what was recorded
//! before it became known.

use super::aead::{CipherKey, is_mac, mac};
use super::key::{Key, KeyId};
use super::wire::{Kind, MAC_BYTES, Reader, SEALED_BYTES_MAX, Writer};
use crate::tell::packet::Start;

const SALT_BYTES: usize = 16;
const PURPOSE: &str = "plumbline one-way announcement";

/// What a box says of a start, authenticated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OneWay {
    /// Which key it has.
    pub key_id: KeyId,
    /// Which start this is.
    pub start: Start,
    /// How often the box has started: more than at each start before.
    pub start_count: u32,
    /// The messages that it knows.
    pub schema_hash: u32,
    /// Drawn at random at each start.
    pub salt: [u8; SALT_BYTES],
    /// The counter of the next packet of the stream.
    pub next: u64,
}

impl OneWay {
    /// Writes it as a packet.
    #[must_use]
    pub fn packet<'a>(&self, key: &Key, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        let mut writer = Writer::new(buffer, Kind::OneWay);
        writer.put(self.key_id.bytes());
        writer.put(self.start.get().to_le_bytes());
        writer.put(self.start_count.to_le_bytes());
        writer.put(self.schema_hash.to_le_bytes());
        writer.put(self.salt);
        writer.put(self.next.to_le_bytes());
        let mac = mac(key.bytes(), PURPOSE, &[writer.written()]);
        writer.put_slice(&mac[..MAC_BYTES]);
        writer.packet()
    }

    /// Which key the box has that sent this packet; to be believed only once it has been read with
    /// that key.
    #[must_use]
    pub fn key_id(packet: &[u8]) -> Option<KeyId> {
        let (Kind::OneWay, rest) = Kind::of(packet)? else { return None };
        KeyId::new(*rest.first_chunk()?)
    }

    /// Reads a packet; `None` if it is not authentic.
    #[must_use]
    pub fn read(key: &Key, packet: &[u8]) -> Option<Self> {
        let (Kind::OneWay, rest) = Kind::of(packet)? else { return None };
        let (covered, mac) = packet.split_last_chunk::<MAC_BYTES>()?;
        if !is_mac(mac, key.bytes(), PURPOSE, &[covered]) {
            return None;
        }
        let mut reader = Reader(rest);
        let read = Self {
            key_id: KeyId::new(reader.take()?)?,
            start: Start::new(u32::from_le_bytes(reader.take()?))?,
            start_count: u32::from_le_bytes(reader.take()?),
            schema_hash: u32::from_le_bytes(reader.take()?),
            salt: reader.take()?,
            next: u64::from_le_bytes(reader.take()?),
        };
        (reader.0.len() == MAC_BYTES).then_some(read)
    }

    /// The first key of this start's stream.
    pub(super) fn stream_key(&self, key: &Key) -> CipherKey {
        let start = self.start.get().to_le_bytes();
        let count = self.start_count.to_le_bytes();
        CipherKey::derived(key.bytes(), "plumbline one-way", &[&start, &count, &self.salt])
    }
}
