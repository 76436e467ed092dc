//! Anything longer than a packet is sent in parts: a configuration to the box or back, a picture
//! from a box in set-up mode.
//!
//! The sender never retransmits unasked. The receiver knows the length, and asks again for
//! what is missing ([`Action::SendParts`](super::Action::SendParts)) or tells
//! the sender ([`Refusal::Incomplete`](super::Refusal::Incomplete)).

use crate::common::checksum::CRC32;
use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Most bytes of a document in one packet.
pub const PART_BYTES_MAX: usize = 224;

/// Something longer than a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Document {
    /// A configuration: the blob of [`Config::encode`](crate::model::config::Config::encode).
    Config,
    /// The file of the [`Picture`] with this number.
    Picture(u16),
}

/// A piece of a document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Part {
    /// The document that it is a piece of.
    pub document: Document,
    /// Where in it the bytes begin.
    pub offset: u32,
    /// The bytes.
    pub bytes: Vec<u8, PART_BYTES_MAX>,
}

/// A picture that was taken, and can be requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Picture {
    /// Its number: there is only one picture at a time, the last one.
    pub number: u16,
    /// The frame that it was made from, as in its pose packet.
    pub sequence: u32,
    /// How many pixels of the frame, in either direction, are averaged into one of the picture.
    pub reduction: u8,
    /// Length of its file: PNG for a whole frame, with every bit that the camera gave; JPEG for a
    /// reduced one.
    pub bytes: u32,
    /// [`document_crc`] of its file.
    pub crc: u32,
}

/// The checksum of a document's bytes.
#[must_use]
pub fn document_crc(bytes: &[u8]) -> u32 {
    CRC32.checksum(bytes)
}
