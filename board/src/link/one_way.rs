//! A serial line on which nothing comes back: the box says once a second which start this is, and
//! seals a stream of its own for the line.

use plumbline::packet::{EncodeError, Message, SCHEMA_HASH, Start};
use plumbline::seal::{Key, OneWay, SEALED_BYTES_MAX, StreamSealer};

use crate::random;

/// The box's end of such a line.
#[derive(Debug)]
pub(super) struct OneWayLine {
    key: Key,
    announcement: OneWay,
    stream: StreamSealer,
}

impl OneWayLine {
    /// The line of a start. No start before may have had this count.
    pub(super) fn new(key: &Key, start: Start, start_count: u32) -> Self {
        let announcement = OneWay {
            key_id: key.id(),
            start,
            start_count,
            schema_hash: SCHEMA_HASH,
            salt: random::bytes(),
            next: 0,
        };
        let stream = StreamSealer::one_way(key, &announcement);
        Self { key: key.clone(), announcement, stream }
    }

    /// The packet that says which start this is, and how far the stream is.
    pub(super) fn announcement<'a>(&self, buffer: &'a mut [u8; SEALED_BYTES_MAX]) -> &'a [u8] {
        OneWay { next: self.stream.next(), ..self.announcement }.packet(&self.key, buffer)
    }

    /// Seals a message.
    pub(super) fn seal<'a>(
        &mut self,
        message: &Message,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Result<&'a [u8], EncodeError> {
        self.stream.seal(message, buffer)
    }
}
