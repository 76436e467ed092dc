//! Documents on their way out: what a host has asked for goes in parts, as fast as its link
//! takes them and no faster, and a host that lost some asks again.

use std::ops::Range;

use plumbline::packet::{Document, LINKS_MAX, Message, PART_BYTES_MAX, Part};

use crate::link::{Link, send};

/// Parts handed to a link at one turn of the loop: less than a socket's buffer at the host
/// takes, and some 800 kB/s at 60 turns a second.
const PARTS_PER_TURN: usize = 64;

/// What is being sent, per link.
#[derive(Debug, Default)]
pub struct Outgoing {
    transfers: [Option<(Document, Range<usize>)>; LINKS_MAX],
}

impl Outgoing {
    /// Sends these bytes of a document over a link, instead of what was being sent over it.
    pub fn start(&mut self, link: usize, document: Document, bytes: Range<usize>) {
        self.transfers[link] = Some((document, bytes));
    }

    /// Whether something is being sent over a link.
    pub fn is_busy(&self, link: usize) -> bool {
        self.transfers[link].is_some()
    }

    /// Goes on with the link of this index; `file` gives a document's bytes while it is there.
    pub fn serve<'a>(
        &mut self,
        index: usize,
        link: &mut Link,
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
            send([&mut *link], &Message::Part(part));
            range.start = end;
        }
    }
}
