//! The messages between the box and the host, their versions, and their framing.
//!
//! # In clear
//!
//! So packets stand in files of one's own; between box and host they are sealed, as
//! [`seal`](crate::seal) has it.
//!
//! | bytes | what |
//! |---|---|
//! | 1 | [`PROTOCOL_VERSION`] |
//! | 4 | [`SCHEMA_HASH`], little endian |
//! | 4 | the [`Start`] of the box that sends this, little endian; 0 in what a host sends |
//! | n | the [`Message`], postcard |
//! | 4 | CRC-32 (ISO-HDLC) of all of the above, little endian |
//!
//! In a file it is a COBS frame that ends with a zero byte, one or two bytes more. The first byte
//! and the checksum keep their place in every version, so that a reader can
//! tell a newer box ([`PacketError::OtherVersion`],
//! [`PacketError::OtherSchema`]) from a damaged file ([`PacketError::Checksum`]).
//!
//! # Which start of which box
//!
//! A box draws a number at random at each start, and puts it into each of its packets. Sequence
//! numbers and capture times are comparable within one start only, and a receiver never has to
//! guess from them whether a box has restarted. The [`Hello`] of a start says which box it is of.
//!
//! # What the schema hash covers
//!
//! Every type, field name, variant name and their order below [`Message`], and the fixed-point
//! steps and capacities that the types alone do not show. It is computed by the compiler from the
//! types (`postcard-schema`), so that no change can be forgotten. What a field MEANS is not in it:
//! a change of meaning needs a new [`PROTOCOL_VERSION`]. What is said about an update
//! ([`UpdateRequest`], [`UpdateReply`]) is the same in all releases, and in neither.
//!
//! # Size
//!
//! A pose packet of two targets is at most 182 bytes as a frame, of three targets at most
//! 243; both hold for every value, and a test computes them. Its seal adds some ten bytes more than
//! this header and checksum have: at 60 Hz two targets fill the 11,520 bytes per second of 115,200
//! baud, and 230,400 baud leaves room for everything else. A third of it is the covariance.
//!
//! Decoding never panics, whatever bytes come from outside, and refuses numbers that no room can
//! hold ([`PacketError::Number`]): what has been decoded can be measured with.

mod document;
mod framing;
mod from_report;
mod message;
mod pose;
mod program;
mod update;
mod view;

use core::num::NonZeroU32;

use postcard_schema::Schema;
use postcard_schema::key::Key;
use serde::{Deserialize, Serialize};

pub use crate::model::config::Edge;
pub use document::{Document, PART_BYTES_MAX, Part, Picture, document_crc};
pub(crate) use framing::{Body, CLEAR_OVERHEAD_BYTES, is_sent_by};
pub use framing::{
    DELIMITER, Deframer, EncodeError, FRAME_BYTES_MAX, PACKET_BYTES_MAX, PacketError,
    decode_datagram, encode_datagram, encode_frame, frame_packet,
};
pub use message::{
    AIM_S_MAX, Action, CameraState, Command, Health, Hello, LINKS_MAX, LOG_TARGET_BYTES_MAX,
    LOG_TEXT_BYTES_MAX, LinkHealth, LinkKind, Log, LogLevel, REASON_BYTES_MAX, Refusal, Reply,
    ReplyOutcome, ResetReason, TargetInfo, Trigger, TriggerHealth, TriggerState,
};
pub use pose::{
    AnatomicalPoint, CORRELATIONS, MarkedInstant, MeasuredPose, POSITION_MM_MAX, PosePacket,
    RMS_STEP_PX, SD_STEP_MM, TargetPacket,
};
pub use program::ProgramVersion;
pub use update::{
    UPDATE_PART_BYTES_MAX, UPDATE_TEXT_BYTES_MAX, UPDATE_VERSION_BYTES_MAX, UpdateOutcome,
    UpdateRefusal, UpdateReply, UpdateRequest, UpdateState, UpdateStep,
};
pub use view::View;

use crate::limits::{DEVICE_TEXT_BYTES_MAX, NAME_BYTES_MAX, TARGETS_MAX};

/// Changes when a field's meaning changes, or the layout of the packet itself.
pub const PROTOCOL_VERSION: u8 = 4;

/// Changes automatically when the shape of any message changes.
pub const SCHEMA_HASH: u32 = schema_hash::<Message>(&[
    pose::SD_STEPS_PER_MM as u64,
    pose::SD_STEPS_PER_RAD as u64,
    pose::CORRELATION_STEPS as u64,
    pose::RMS_STEPS_PER_PX as u64,
    TARGETS_MAX as u64,
    NAME_BYTES_MAX as u64,
    DEVICE_TEXT_BYTES_MAX as u64,
    LINKS_MAX as u64,
    LOG_TARGET_BYTES_MAX as u64,
    LOG_TEXT_BYTES_MAX as u64,
    REASON_BYTES_MAX as u64,
    PART_BYTES_MAX as u64,
]);

/// One start of one box: a number drawn at random at each start.
pub type Start = NonZeroU32;

/// One message, and who sent it.
#[derive(Debug, Clone, PartialEq)]
pub struct Packet {
    /// The start of the box that sent it; `None` for a host.
    pub start: Option<Start>,
    /// What it says.
    pub message: Message,
}

/// One message, in either direction.
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the pose")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub enum Message {
    /// One frame's result.
    Pose(PosePacket),
    /// The sender's identity; sent at start, then from time to time, and on request.
    Hello(Hello),
    /// The condition of the box; sent from time to time, and on request.
    Health(Health),
    /// One log record.
    Log(Log),
    /// From the host to the box.
    Command(Command),
    /// The box's answer to a command.
    Reply(Reply),
    /// What the camera sees, in numbers; sent on request.
    View(View),
    /// Announces a picture that was taken in set-up mode.
    Picture(Picture),
    /// A piece of a document, in either direction.
    Part(Part),
    /// An edge at the box's trigger line; sent at once.
    Trigger(Trigger),
}

impl Message {
    /// Whether each number in it can be that of a measurement.
    fn is_measurable(&self) -> bool {
        match self {
            Self::Pose(packet) => packet.is_measurable(),
            Self::View(view) => view.is_finite(),
            Self::Command(Command { action: Action::Expose { gain: Some(gain), .. }, .. }) => {
                gain.is_finite()
            }
            _ => true,
        }
    }
}

/// FNV-1a (64 bits) over the schema of `T` and some numbers, folded to 32 bits.
const fn schema_hash<T: Schema>(numbers: &[u64]) -> u32 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut state = u64::from_le_bytes(Key::for_path::<T>("plumbline").to_bytes());
    let mut index = 0;
    while index < numbers.len() {
        let bytes = numbers[index].to_le_bytes();
        let mut byte = 0;
        while byte < bytes.len() {
            state = (state ^ bytes[byte] as u64).wrapping_mul(PRIME);
            byte += 1;
        }
        index += 1;
    }
    (state ^ (state >> 32)) as u32
}

#[cfg(test)]
mod tests;
