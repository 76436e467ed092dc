//! Why a host and a box that are heard open no session.

use heapless::String;

use super::wire::Announcement;
use crate::tell::packet::{PROTOCOL_VERSION, REASON_BYTES_MAX, SCHEMA_HASH};

/// Why a box that is heard opens no session.
#[derive(Debug, Clone, PartialEq, Eq)]
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the words")]
pub enum Obstacle {
    /// It speaks other versions of the protocol.
    OtherVersions {
        /// The lowest and the highest.
        versions: [u8; 2],
    },
    /// It knows other messages.
    OtherSchema {
        /// The schema hash of its program.
        hash: u32,
    },
    /// As many programs listen as it has room for: these.
    Busy {
        /// In words.
        reason: String<REASON_BYTES_MAX>,
    },
}

impl Obstacle {
    /// What a box says of itself that keeps this program from understanding it; to be believed only
    /// of an authentic answer.
    #[must_use]
    pub fn of(announcement: &Announcement) -> Option<Self> {
        let Announcement { versions, schema_hash: hash, .. } = *announcement;
        if !(versions[0]..=versions[1]).contains(&PROTOCOL_VERSION) {
            Some(Self::OtherVersions { versions })
        } else if hash != SCHEMA_HASH {
            Some(Self::OtherSchema { hash })
        } else {
            None
        }
    }
}
