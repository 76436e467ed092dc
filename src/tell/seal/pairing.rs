//! A key on its way to a box over a serial cable, and the box's answer.
//!
//! Neither is sealed: whoever holds the cable could as well change the card. A box takes a key only
//! while it says so ([`Announcement::pairing_s`](super::Announcement::pairing_s)), and over nothing
//! but its serial line.

use super::aead::KEY_BYTES;
use super::key::{Key, KeyId};
use super::wire::{HEAD_BYTES, Kind, Reader, SEALED_BYTES_MAX, Writer};
use crate::common::checksum::{CRC_BYTES, checked};

/// A host gives the box this key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pairing {
    /// The key.
    pub key: Key,
}

/// The box's answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Paired {
    /// The key that was sent.
    pub key_id: KeyId,
    /// Whether it is stored, and in use from now on.
    pub is_stored: bool,
}

impl Pairing {
    /// Writes it as a packet.
    #[must_use]
    pub fn packet<'a>(&self, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        let mut writer = Writer::new(buffer, Kind::Pairing);
        writer.put(*self.key.bytes());
        writer.with_checksum()
    }

    /// Reads a packet; `None` if it is none of these, or damaged.
    pub(super) fn read(packet: &[u8]) -> Option<Self> {
        let bytes: [u8; KEY_BYTES] = fixed(packet, Kind::Pairing)?;
        Some(Self { key: Key::new(bytes).ok()? })
    }
}

impl Paired {
    /// Writes it as a packet.
    #[must_use]
    pub fn packet<'a>(&self, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        let mut writer = Writer::new(buffer, Kind::Paired);
        writer.put(self.key_id.bytes());
        writer.put([u8::from(self.is_stored)]);
        writer.with_checksum()
    }

    /// Reads a packet; `None` if it is none of these, or damaged.
    #[must_use]
    pub fn read(packet: &[u8]) -> Option<Self> {
        let [id @ .., stored]: [u8; 9] = fixed(packet, Kind::Paired)?;
        Some(Self { key_id: KeyId::new(id)?, is_stored: stored == 1 })
    }
}

/// What a packet of this kind holds before its checksum, if it is intact.
fn fixed<const N: usize>(packet: &[u8], kind: Kind) -> Option<[u8; N]> {
    let (covered, true) = checked(packet)? else { return None };
    let (of, _) = Kind::of(packet)?;
    let mut reader = Reader(&covered[HEAD_BYTES..]);
    let bytes = reader.take()?;
    (of == kind && reader.0.is_empty() && packet.len() == covered.len() + CRC_BYTES)
        .then_some(bytes)
}
