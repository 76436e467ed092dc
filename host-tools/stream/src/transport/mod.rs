//! Where packets come from: datagrams, or a serial line that may vanish and come back; sealed, and
//! opened here.
//!
//! ```text
//! udp, serial: bytes ─▶ sealed: which box, sessions, what is missing ─▶ order ─▶ events
//! ```

mod order;
mod sealed;
mod serial;
mod udp;
mod words;

use std::net::SocketAddr;
use std::time::Duration;

use plumbline::packet::{Deframer, Message, Packet, PacketError, decode_datagram};
use plumbline::seal::{Announcement, Peer};
use plumbline_files::BadInput;

pub(crate) use sealed::{GREET_EVERY, caller, draw, token};
pub use sealed::{KnownBox, Link, Memory};
pub use serial::{Line, Opener, Serial};
pub use udp::{HeardElsewhere, Udp};
pub use words::words_of_other;

use crate::text;

/// The longest wait for bytes, so that Ctrl-C is noticed.
pub const WAIT: Duration = Duration::from_millis(100);

/// A packet as it is kept in a file: in clear.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Raw {
    /// As one datagram.
    Datagram(Vec<u8>),
    /// As a frame of a serial line, up to and with a delimiter; of a longer run than any frame, its
    /// beginning.
    Frame(Vec<u8>),
}

impl Raw {
    /// The packet in it. The deframer has to see all frames of the line, in their order.
    ///
    /// # Errors
    /// When there is none.
    pub fn decode(&self, deframer: &mut Deframer) -> Result<Packet, PacketError> {
        let outcome = match self {
            Self::Datagram(bytes) => decode_datagram(bytes),
            Self::Frame(bytes) => {
                let outcome = bytes.iter().filter_map(|byte| deframer.feed(*byte)).last();
                outcome.unwrap_or(Err(PacketError::Fragment))
            }
        };
        outcome.map(text::printable)
    }
}

/// What came in.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "it is handed over at once, and never kept")]
pub enum Event {
    /// The next packet, in clear, as it is to be kept.
    Raw(Raw),
    /// A packet of the box.
    Packet(Packet),
    /// Bytes that are no packet of the link, and why.
    Bad(PacketError),
    /// A packet that is not the box's: forged, damaged or of a session that is over. One that the
    /// network has carried twice is none of these, and is not told of.
    NotAuthentic,
    /// A box with which no session can be opened, or which was not chosen, says that it is there.
    Other {
        /// Where it is; `None` on a serial line.
        from: Option<SocketAddr>,
        /// The name that this computer has for it.
        name: Option<String>,
        /// What it says in clear.
        announcement: Announcement,
    },
    /// The serial line is lost, and is waited for.
    LineLost(String),
    /// The serial line is back.
    LineBack,
}

impl Event {
    /// The event for decoded bytes.
    #[must_use]
    pub fn of(outcome: Result<Packet, PacketError>) -> Self {
        match outcome {
            Ok(packet) => Self::Packet(packet),
            Err(error) => Self::Bad(error),
        }
    }
}

/// A source of packets.
pub trait Transport {
    /// Waits for at most [`WAIT`], and hands over what came.
    ///
    /// # Errors
    /// When the source cannot be used any more.
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput>;

    /// Sends a message to the box, if there is a session with it. One that does not get through is
    /// not worth an error: the box repeats what matters.
    fn send(&mut self, message: &Message);

    /// Whether packets of the box are missing that may still come.
    fn is_missing(&self) -> bool {
        false
    }

    /// Why nothing is heard of the box, in words, and what to do, if something is known of that.
    fn obstacle(&self) -> Option<(String, String)> {
        None
    }

    /// Datagrams that this computer's own system has dropped, as far as it tells.
    fn dropped_here(&self) -> Option<u64> {
        None
    }
}

/// What a [`Carrier`] brings.
pub enum Arrived<'a> {
    /// A packet, whatever it is.
    Packet {
        /// Where it comes from.
        from: Peer,
        /// Its bytes.
        bytes: &'a [u8],
    },
    /// Bytes of a serial line that are no packet.
    Bad(PacketError),
    /// The serial line is lost.
    LineLost(String),
    /// It is back.
    LineBack,
}

/// What carries packets, knowing nothing of what is in them.
pub trait Carrier {
    /// Waits for at most this long, and hands over what came: a bounded number of packets.
    ///
    /// # Errors
    /// When it cannot be used any more.
    fn poll(&mut self, wait: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput>;

    /// Sends a packet.
    fn send(&mut self, to: Peer, packet: &[u8]);

    /// Where a box is from the beginning, if there is only one place.
    fn only_peer(&self) -> Option<Peer>;

    /// Datagrams that this computer's own system has dropped, as far as it tells.
    fn dropped_here(&self) -> Option<u64>;
}

impl Carrier for Box<dyn Carrier> {
    fn poll(&mut self, wait: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        (**self).poll(wait, take)
    }

    fn send(&mut self, to: Peer, packet: &[u8]) {
        (**self).send(to, packet);
    }

    fn only_peer(&self) -> Option<Peer> {
        (**self).only_peer()
    }

    fn dropped_here(&self) -> Option<u64> {
        (**self).dropped_here()
    }
}
