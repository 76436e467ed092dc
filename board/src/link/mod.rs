//! Links to the hosts: UDP, a serial line, a file, in any combination.
//!
//! A link is opened once, when a fault can still be reported to a person as an error.
//! From then on it never waits and never fails: a packet that cannot be sent is
//! dropped whole and counted, and the host sees the gap in the sequence numbers.

pub mod file;
pub mod serial;
pub mod udp;

use std::time::Duration;

use plumbline::packet::{
    FRAME_BYTES_MAX, LINKS_MAX, LinkKind, Message, PACKET_BYTES_MAX, Start, encode_datagram,
    encode_frame,
};

pub use file::FileLink;
pub use serial::SerialLink;
pub use udp::UdpLink;

/// The number of datagrams, or reads of a line, that are handled before the next frame.
pub(crate) const RECEIVED_PER_TURN_MAX: usize = 4;

/// What became of the packets given to a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Packets passed to the operating system whole.
    pub sent: u64,
    /// Packets dropped whole.
    pub dropped: u64,
    /// Packets waiting in the link's own buffer.
    pub waiting: u64,
}

/// One packet in both of its forms.
#[derive(Debug, Clone, Copy)]
struct Encoded<'a> {
    /// The content of one datagram.
    datagram: &'a [u8],
    /// The same between the delimiters of a byte stream; ends with its only zero byte.
    frame: &'a [u8],
}

/// The links in use, one of each kind at most.
pub type Links = heapless::Vec<Link, LINKS_MAX>;

/// Sends one message of this start over each of the links.
pub fn send<'a>(links: impl IntoIterator<Item = &'a mut Link>, start: Start, message: &Message) {
    let mut datagram = [0; PACKET_BYTES_MAX];
    let mut frame = [0; FRAME_BYTES_MAX];
    let encoded = (
        encode_datagram(Some(start), message, &mut datagram),
        encode_frame(Some(start), message, &mut frame),
    );
    let (Ok(datagram), Ok(frame)) = encoded else {
        // The buffers hold every message: the packet module computes them so.
        unreachable!("a message larger than the largest");
    };
    for link in links {
        link.send(Encoded { datagram, frame });
    }
}

/// A link of one of the three kinds.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there are three at most, and they never move")]
pub enum Link {
    /// One packet per datagram.
    Udp(UdpLink),
    /// Frames on a serial line.
    Serial(SerialLink),
    /// Frames appended to a file.
    File(FileLink),
}

impl Link {
    /// Sends one packet, or drops and counts it. Never waits.
    fn send(&mut self, packet: Encoded<'_>) {
        match self {
            Self::Udp(link) => link.send(packet.datagram),
            Self::Serial(link) => link.send(packet.frame),
            Self::File(link) => link.send(packet.frame),
        }
    }

    /// Whether one more packet leaves enough room for those that follow.
    #[must_use]
    pub fn has_room(&self) -> bool {
        match self {
            Self::Udp(_) => true,
            Self::Serial(link) => link.has_room(),
            // Nobody reads the other end.
            Self::File(_) => false,
        }
    }

    /// Sends waiting packets, as far as is possible without blocking.
    pub fn service(&mut self) {
        if let Self::Serial(link) = self {
            link.service();
        }
    }

    /// Sends waiting packets for at most `limit`; those that are left count as dropped.
    pub fn finish(&mut self, limit: Duration) {
        if let Self::Serial(link) = self {
            link.finish(limit);
        }
    }

    /// Passes on the messages from hosts received since the last call.
    pub fn receive(&mut self, take: impl FnMut(Message)) {
        match self {
            Self::Udp(link) => link.receive(take),
            Self::Serial(link) => link.receive(take),
            Self::File(_) => {}
        }
    }

    /// Why packets of this link are lost for good, if there is a reason that a person
    /// must put right.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        match self {
            Self::File(link) => link.fault(),
            // A host that is absent now may receive the next packet.
            Self::Udp(_) | Self::Serial(_) => None,
        }
    }

    /// Its kind.
    #[must_use]
    pub fn kind(&self) -> LinkKind {
        match self {
            Self::Udp(_) => LinkKind::Udp,
            Self::Serial(_) => LinkKind::Serial,
            Self::File(_) => LinkKind::File,
        }
    }

    /// What became of the packets so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        match self {
            Self::Udp(link) => link.counts(),
            Self::Serial(link) => link.counts(),
            Self::File(link) => link.counts(),
        }
    }
}

impl std::fmt::Display for Link {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Udp(link) => link.fmt(formatter),
            Self::Serial(link) => link.fmt(formatter),
            Self::File(link) => link.fmt(formatter),
        }
    }
}
