//! Sends documents to listeners: in parts, as fast as the link accepts them. A host that misses
//! some parts asks for them again.

use std::ops::Range;

use plumbline::packet::{Document, Message, PART_BYTES_MAX, Part};
use plumbline::seal::{LISTENERS_MAX, ListenerId};

use crate::link::Links;

/// The number of parts passed to a link in one iteration of the loop: fewer than fit into a
/// socket's buffer at the host, and about 800 kB/s at 60 iterations a second.
const PARTS_PER_TURN: usize = 64;

/// A document on its way to a listener.
#[derive(Debug)]
struct Transfer {
    to: ListenerId,
    document: Document,
    /// The bytes that are still to be sent.
    bytes: Range<usize>,
}

/// What is being sent, by the places of the listeners.
#[derive(Debug, Default)]
pub struct Outgoing {
    transfers: [Option<Transfer>; LISTENERS_MAX],
}

impl Outgoing {
    /// Starts sending these bytes of a document to a listener, in place of any earlier transfer.
    pub fn start(&mut self, to: ListenerId, document: Document, bytes: Range<usize>) {
        if let Some(place) = self.transfers.get_mut(to.place) {
            *place = Some(Transfer { to, document, bytes });
        }
    }

    /// Whether something is being sent to a listener.
    pub fn is_busy(&self, listener: ListenerId) -> bool {
        self.receivers().any(|to| to == listener)
    }

    /// Those to whom something is being sent.
    pub fn receivers(&self) -> impl Iterator<Item = ListenerId> + '_ {
        self.transfers.iter().flatten().map(|transfer| transfer.to)
    }

    /// Continues the transfers to listeners that have not left; `file` gives the bytes of a
    /// document, as long as it exists.
    pub fn serve<'a>(&mut self, links: &mut Links, file: impl Fn(Document) -> Option<&'a [u8]>) {
        for transfer in &mut self.transfers {
            let is_over = transfer.as_mut().is_some_and(|it| it.serve(links, &file));
            if is_over {
                *transfer = None;
            }
        }
    }
}

impl Transfer {
    /// Sends as many parts as one iteration may; returns whether the transfer is over.
    fn serve<'a>(
        &mut self,
        links: &mut Links,
        file: &impl Fn(Document) -> Option<&'a [u8]>,
    ) -> bool {
        if !links.is_there(self.to) {
            return true;
        }
        for _ in 0..PARTS_PER_TURN {
            if !links.has_room(self.to) {
                return false;
            }
            let end = self.bytes.end.min(self.bytes.start + PART_BYTES_MAX);
            let bytes = file(self.document).and_then(|file| file.get(self.bytes.start..end));
            let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) else { return true };
            let part = Part {
                document: self.document,
                offset: self.bytes.start as u32,
                bytes: bytes.iter().copied().collect(),
            };
            links.send_to(self.to, &Message::Part(part));
            self.bytes.start = end;
        }
        false
    }
}
