//! The one checksum of the project: CRC-32 as in Ethernet, zip and PNG
//! (ISO-HDLC), so that any tool can recompute it.

use crc::{CRC_32_ISO_HDLC, Crc};

/// Detects every burst of up to 32 wrong bits, and any three wrong bits in a packet or a blob of
/// the sizes used here.
pub(crate) static CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes of a checksum on a wire or in a blob, little endian.
pub(crate) const CRC_BYTES: usize = 4;

/// Returns the bytes that the checksum covers, and whether it agrees; `None` when there are too few
/// bytes to hold one.
pub(crate) fn checked(bytes: &[u8]) -> Option<(&[u8], bool)> {
    let (covered, stored) = bytes.split_last_chunk::<CRC_BYTES>()?;
    Some((covered, CRC32.checksum(covered) == u32::from_le_bytes(*stored)))
}
