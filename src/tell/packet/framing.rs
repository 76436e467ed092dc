//! Packets and frames: checksum, versions, COBS, and resynchronisation in a stream that was cut or
//! garbled.

use serde::{Deserialize, Serialize};

use super::{Message, PROTOCOL_VERSION, Packet, SCHEMA_HASH, Start, UpdateReply, UpdateRequest};
use crate::common::checksum::{CRC_BYTES, CRC32, checked};

/// Version, schema hash and start.
const HEADER_BYTES: usize = 9;

/// Bytes of a clear packet besides its message.
pub(crate) const CLEAR_OVERHEAD_BYTES: usize = HEADER_BYTES + CRC_BYTES;

/// Longest packet, checksum included: the longest that COBS lengthens by one byte only.
pub const PACKET_BYTES_MAX: usize = 254;

/// Longest frame of a clear packet: one byte of COBS and the delimiter more.
pub const FRAME_BYTES_MAX: usize = PACKET_BYTES_MAX + 2;

/// The byte that ends every frame, and occurs nowhere else.
pub const DELIMITER: u8 = 0;

/// The message does not fit the buffer; no part of it was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EncodeError;

impl core::fmt::Display for EncodeError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("the message does not fit the buffer")
    }
}

impl core::error::Error for EncodeError {}

/// Why bytes are not a message. Each deserves a counter of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PacketError {
    /// The first frame after listening began, whose start was missed. Once per opened line this is
    /// not a fault.
    Fragment,
    /// More bytes than any frame has, without a delimiter.
    Oversize,
    /// Not a COBS frame.
    Cobs,
    /// Too few bytes for a packet.
    Short,
    /// The checksum does not agree: bits changed on the way.
    Checksum,
    /// An intact packet of another protocol version.
    OtherVersion {
        /// The sender's version.
        version: u8,
    },
    /// An intact packet of this version, but of another program's messages.
    OtherSchema {
        /// The sender's schema hash.
        hash: u32,
    },
    /// An intact packet of this schema whose body is not a message: the sender is broken.
    Body,
    /// A message with a number that no measurement in a room gives: the sender is broken.
    Number,
}

impl core::fmt::Display for PacketError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Fragment => formatter.write_str("the end of a frame whose start was missed"),
            Self::Oversize => write!(formatter, "a frame of more than {FRAME_BYTES_MAX} bytes"),
            Self::Cobs => formatter.write_str("not a COBS frame"),
            Self::Short => formatter.write_str("too short for a packet"),
            Self::Checksum => formatter.write_str("wrong checksum"),
            Self::OtherVersion { version } => write!(
                formatter,
                "protocol version {version}, this program speaks {PROTOCOL_VERSION}"
            ),
            Self::OtherSchema { hash } => {
                write!(formatter, "schema {hash:08x}, this program knows {SCHEMA_HASH:08x}")
            }
            Self::Body => formatter.write_str("an intact packet that holds no message"),
            Self::Number => formatter.write_str("a number that no measurement in a room gives"),
        }
    }
}

impl core::error::Error for PacketError {}

/// Writes a message as one packet, to be sent as one datagram. A box gives its start, a host
/// `None`. A buffer of [`PACKET_BYTES_MAX`] holds every message.
///
/// # Errors
/// [`EncodeError`] when the buffer is too small.
pub fn encode_datagram<'a>(
    start: Option<Start>,
    message: &Message,
    buffer: &'a mut [u8],
) -> Result<&'a [u8], EncodeError> {
    let (header, rest) = buffer.split_first_chunk_mut::<HEADER_BYTES>().ok_or(EncodeError)?;
    header[0] = PROTOCOL_VERSION;
    header[1..5].copy_from_slice(&SCHEMA_HASH.to_le_bytes());
    header[5..].copy_from_slice(&start.map_or(0, Start::get).to_le_bytes());
    let body_bytes = message.encode(rest)?;
    let covered = HEADER_BYTES + body_bytes;
    let packet = buffer.get_mut(..covered + CRC_BYTES).ok_or(EncodeError)?;
    let checksum = CRC32.checksum(&packet[..covered]);
    packet[covered..].copy_from_slice(&checksum.to_le_bytes());
    Ok(packet)
}

/// Writes a message as one frame of a serial line, delimiter included; see [`encode_datagram`].
/// A buffer of [`FRAME_BYTES_MAX`] holds every message.
///
/// # Errors
/// [`EncodeError`] when the buffer is too small.
pub fn encode_frame<'a>(
    start: Option<Start>,
    message: &Message,
    buffer: &'a mut [u8],
) -> Result<&'a [u8], EncodeError> {
    let mut packet = [0; PACKET_BYTES_MAX];
    frame_packet(encode_datagram(start, message, &mut packet)?, buffer)
}

/// Writes a packet, which must not be empty, as one frame of a serial line, delimiter included. COBS
/// adds one byte to each 254.
///
/// # Errors
/// [`EncodeError`] when the buffer is too small.
pub fn frame_packet<'a>(packet: &[u8], buffer: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    // The room is checked here, because the crate does not notice that a final zero needs a byte
    // more than there is.
    let room = packet.len() + packet.len().div_ceil(254);
    let stuffed = buffer.get_mut(..room).ok_or(EncodeError)?;
    let length = cobs::try_encode(packet, stuffed).map_err(|_| EncodeError)?;
    *buffer.get_mut(length).ok_or(EncodeError)? = DELIMITER;
    Ok(&buffer[..=length])
}

/// Reads one packet: a datagram, or a frame after COBS decoding.
///
/// # Errors
/// Any [`PacketError`] but those of the serial line.
pub fn decode_datagram(packet: &[u8]) -> Result<Packet, PacketError> {
    // The checksum comes first: a wrong version number in a damaged packet is
    // damage, not another version.
    let (covered, intact) = checked(packet).ok_or(PacketError::Short)?;
    let (header, body) = covered.split_first_chunk::<HEADER_BYTES>().ok_or(PacketError::Short)?;
    if !intact {
        return Err(PacketError::Checksum);
    }
    let [version, h0, h1, h2, h3, start @ ..] = *header;
    if version != PROTOCOL_VERSION {
        return Err(PacketError::OtherVersion { version });
    }
    let hash = u32::from_le_bytes([h0, h1, h2, h3]);
    if hash != SCHEMA_HASH {
        return Err(PacketError::OtherSchema { hash });
    }
    let start = Start::new(u32::from_le_bytes(start));
    let message = Message::decode(body)?;
    if is_sent_by(&message, start) { Ok(Packet { start, message }) } else { Err(PacketError::Body) }
}

/// What stands under a seal, or alone in a clear packet.
pub(crate) trait Body: Sized {
    /// Writes it; returns its length.
    fn encode(&self, buffer: &mut [u8]) -> Result<usize, EncodeError>;

    /// Reads it; nothing may follow.
    fn decode(body: &[u8]) -> Result<Self, PacketError>;
}

impl Body for Message {
    fn encode(&self, buffer: &mut [u8]) -> Result<usize, EncodeError> {
        to_postcard(self, buffer)
    }

    fn decode(body: &[u8]) -> Result<Self, PacketError> {
        let message: Self = from_postcard(body)?;
        if message.is_measurable() { Ok(message) } else { Err(PacketError::Number) }
    }
}

impl Body for UpdateRequest {
    fn encode(&self, buffer: &mut [u8]) -> Result<usize, EncodeError> {
        to_postcard(self, buffer)
    }

    fn decode(body: &[u8]) -> Result<Self, PacketError> {
        from_postcard(body)
    }
}

impl Body for UpdateReply {
    fn encode(&self, buffer: &mut [u8]) -> Result<usize, EncodeError> {
        to_postcard(self, buffer)
    }

    fn decode(body: &[u8]) -> Result<Self, PacketError> {
        from_postcard(body)
    }
}

fn to_postcard(body: &impl Serialize, buffer: &mut [u8]) -> Result<usize, EncodeError> {
    postcard::to_slice(body, buffer).map(|body| body.len()).map_err(|_| EncodeError)
}

fn from_postcard<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, PacketError> {
    match postcard::take_from_bytes(body) {
        Ok((body, [])) => Ok(body),
        _ => Err(PacketError::Body),
    }
}

/// Hosts send commands and parts, boxes everything but commands; a Hello names its own start.
pub(crate) fn is_sent_by(message: &Message, start: Option<Start>) -> bool {
    match message {
        Message::Command(_) => start.is_none(),
        Message::Part(_) => true,
        Message::Hello(hello) => start.is_some_and(|start| start.get() == hello.boot_id),
        _ => start.is_some(),
    }
}

/// Takes a serial line's bytes as they come and returns the packets in them.
///
/// `N` is the longest frame without its delimiter; [`FRAME_BYTES_MAX`] is enough for every frame of
/// this version. After damage it resumes at the next delimiter, so that only the damaged frames are
/// lost.
#[derive(Debug)]
pub struct Deframer<const N: usize = FRAME_BYTES_MAX> {
    frame: heapless::Vec<u8, N>,
    overflow: bool,
    synchronised: bool,
    /// The frame has been handed over, and the next byte begins another.
    is_handed_over: bool,
}

impl<const N: usize> Default for Deframer<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Deframer<N> {
    /// A deframer that starts to listen, perhaps in the middle of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            frame: heapless::Vec::new(),
            overflow: false,
            synchronised: false,
            is_handed_over: false,
        }
    }

    /// Discards an incomplete frame; for a line that has been reopened.
    pub fn restart(&mut self) {
        *self = Self::new();
    }

    /// Whether a delimiter has been seen, so that the next frame is known to be whole.
    #[must_use]
    pub const fn is_synchronised(&self) -> bool {
        self.synchronised
    }

    /// Takes one byte; returns an outcome when the byte ends a frame. Consecutive delimiters are an
    /// idle line, not frames.
    pub fn feed(&mut self, byte: u8) -> Option<Result<Packet, PacketError>> {
        let was_synchronised = self.synchronised;
        let outcome = self.frame(byte)?.and_then(decode_datagram);
        Some(match outcome {
            // The part that was missed may have held anything.
            Err(PacketError::Short | PacketError::Checksum) if !was_synchronised => {
                Err(PacketError::Fragment)
            }
            outcome => outcome,
        })
    }

    /// Takes one byte; returns the packet in a frame when the byte ends one, whatever kind of packet
    /// it is.
    pub fn frame(&mut self, byte: u8) -> Option<Result<&[u8], PacketError>> {
        if core::mem::take(&mut self.is_handed_over) {
            self.frame.clear();
        }
        if byte != DELIMITER {
            self.overflow |= self.frame.push(byte).is_err();
            return None;
        }
        let was_synchronised = core::mem::replace(&mut self.synchronised, true);
        let overflow = core::mem::take(&mut self.overflow);
        if self.frame.is_empty() && !overflow {
            return None;
        }
        self.is_handed_over = true;
        let fault = |error| if was_synchronised { error } else { PacketError::Fragment };
        if overflow {
            return Some(Err(fault(PacketError::Oversize)));
        }
        Some(match cobs::decode_in_place(&mut self.frame) {
            Ok(length) => Ok(&self.frame[..length]),
            Err(_) => Err(fault(PacketError::Cobs)),
        })
    }

    /// Takes many bytes and hands each outcome to `receive`.
    pub fn push(&mut self, bytes: &[u8], mut receive: impl FnMut(Result<Packet, PacketError>)) {
        for &byte in bytes {
            if let Some(outcome) = self.feed(byte) {
                receive(outcome);
            }
        }
    }
}
