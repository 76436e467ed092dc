//! Packets that could not be used, by cause.

use plumbline::packet::PacketError;

/// How many packets were bad, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BadPackets {
    /// Bits changed on the way: checksum, COBS, length.
    pub corrupt: u64,
    /// Frames whose beginning was missed because listening began in the middle.
    pub fragments: u64,
    /// Intact, of another protocol version.
    pub other_version: u64,
    /// Intact, of this version, with another program's messages.
    pub other_schema: u64,
    /// Intact, of this schema, but not a message.
    pub malformed: u64,
    /// Messages with a number that no measurement in a room gives.
    pub numbers: u64,
    /// Not of the box's session: forged, damaged, repeated, or late from before.
    pub not_authentic: u64,
}

impl BadPackets {
    /// Counts one more; returns the new count of its kind.
    pub fn count(&mut self, error: PacketError) -> u64 {
        let counter = match error {
            PacketError::Fragment => &mut self.fragments,
            PacketError::Oversize
            | PacketError::Cobs
            | PacketError::Short
            | PacketError::Checksum => &mut self.corrupt,
            PacketError::OtherVersion { .. } => &mut self.other_version,
            PacketError::OtherSchema { .. } => &mut self.other_schema,
            PacketError::Body => &mut self.malformed,
            PacketError::Number => &mut self.numbers,
        };
        *counter += 1;
        *counter
    }
}
