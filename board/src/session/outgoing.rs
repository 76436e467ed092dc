//! Sends documents to hosts: in parts, as fast as the link accepts them. A host that misses
//! some parts asks for them again.

use std::ops::Range;

use plumbline::packet::{Document, LINKS_MAX, Message, PART_BYTES_MAX, Part, Start};

use crate::link::{Link, send};

/// The number of parts passed to a link in one iteration of the loop: fewer than fit into a
/// socket's buffer at the host, and about 800 kB/s at 60 iterations a second.
const PARTS_PER_TURN: usize = 64;

/// What is being sent, per link.
#[derive(Debug, Default)]
pub struct Outgoing {
    transfers: [Option<(Document, Range<usize>)>; LINKS_MAX],
}

impl Outgoing {
    /// Starts sending these bytes of a document over a link, in place of any earlier transfer.
    pub fn start(&mut self, link: usize, document: Document, bytes: Range<usize>) {
        self.transfers[link] = Some((document, bytes));
    }

    /// Whether something is being sent over a link.
    pub fn is_busy(&self, link: usize) -> bool {
        self.transfers[link].is_some()
    }

    /// Continues the transfer over the link with this index; `file` gives the bytes of a document,
    /// as long as it exists.
    pub fn serve<'a>(
        &mut self,
        index: usize,
        link: &mut Link,
        start: Start,
        file: impl Fn(Document) -> Option<&'a [u8]>,
    ) {
        let Some((document, range)) = &mut self.transfers[index] else { return };
        for _ in 0..PARTS_PER_TURN {
            if !link.has_room() {
                return;
            }
            let end = range.end.min(range.start + PART_BYTES_MAX);
            let bytes = file(*document).and_then(|file| file.get(range.start..end));
            let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) else {
                self.transfers[index] = None;
                return;
            };
            let part = Part {
                document: *document,
                offset: range.start as u32,
                bytes: bytes.iter().copied().collect(),
            };
            send([&mut *link], start, &Message::Part(part));
            range.start = end;
        }
    }
}
