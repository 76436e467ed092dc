//! Links to the hosts: UDP and a serial line, sealed by the box's key, and a file.
//!
//! ```text
//! ports        where packets physically go: udp, serial, file
//! identity     who the box is, and what it says in clear     announcing   when it says so
//! pairing      how long it takes a key over the cable
//! receiving    what comes: junk, handshakes, messages        requests     what the link itself answers
//! resends      what listeners ask for once more              one_way      a line without a way back
//! ```
//!
//! Who listens, and what of it is authentic, is the core's [`BoxEnd`]. Nothing leaves a socket or a
//! line in clear but announcements, answers to greetings, and the answer to a key that came over the
//! cable. The file is the box's own and stays in clear.
//!
//! A link is opened once, when a fault can still be reported to a person as an error.
//! From then on it never waits and never fails: a packet that cannot be sent is
//! dropped whole and counted, and a host that misses it asks for it again.

mod announcing;
pub mod file;
mod identity;
mod one_way;
mod pairing;
mod ports;
mod receiving;
mod requests;
mod resends;
pub mod serial;
pub mod udp;

use std::time::{Duration, Instant};

use plumbline::packet::{
    EncodeError, FRAME_BYTES_MAX, LINKS_MAX, LinkKind, Message, Start, UpdateOutcome, UpdateReply,
    encode_frame,
};
use plumbline::seal::{BoxEnd, ListenerId, Peer, SEALED_BYTES_MAX, StreamRing};

use crate::key_store::KeyStore;
use crate::logger;
use crate::machine::clock;
use crate::random;
use announcing::Announcing;
pub use file::FileLink;
use identity::Description;
pub use identity::Identity;
use one_way::OneWayLine;
use pairing::PairingTime;
pub use ports::Ports;
pub use receiving::{Arrivals, MESSAGES_PER_TURN_MAX, Said};
pub use serial::SerialLink;
pub use udp::UdpLink;

/// A host that has missed something asks for it within this time: it pings the box every 0.4 s, and
/// learns from the answer how far the stream is.
const ASKS_WITHIN: Duration = Duration::from_millis(500);

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

/// The links in use, and who listens.
pub struct Links {
    start: Start,
    ports: Ports,
    end: BoxEnd,
    /// Without it, nothing is sent again.
    ring: Option<&'static mut StreamRing>,
    announcing: Announcing,
    one_way: Option<OneWayLine>,
    description: Description,
    pairing_time: PairingTime,
    store: Option<KeyStore>,
    is_refusing: bool,
}

impl std::fmt::Debug for Links {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Links").field("ports", &self.ports).finish_non_exhaustive()
    }
}

impl Links {
    /// The links of a box that has just started.
    #[must_use]
    pub fn new(ports: Ports, identity: Identity, ring: Option<&'static mut StreamRing>) -> Self {
        let description = Description::of(&identity);
        let Identity { start, key, store, reset_reason, start_count, refusal, .. } = identity;
        let key = key.ok().flatten();
        let one_way = match (&key, start_count) {
            (Some(key), Some(count)) if ports.is_one_way => {
                Some(OneWayLine::new(key, start, count))
            }
            (Some(_), None) if ports.is_one_way => {
                log::error!(
                    "nothing is sent on the serial line: nothing comes back on it, so hosts must \
                     tell a start from a repetition of an older one by its number, and this start \
                     is not counted (the program counts starts with --boot-count-file FILE)"
                );
                None
            }
            _ => None,
        };
        if key.is_none() && (ports.udp.is_some() || ports.serial.is_some()) {
            let remedy = if ports.hears_serial() {
                "put one beside the configuration, or pair the box over its serial line"
            } else {
                "put one beside the configuration"
            };
            log::warn!("without a key the box only announces that it is there: {remedy}");
        }
        let mut links = Self {
            start,
            ports,
            end: BoxEnd::new(key, start, &random::bytes()),
            ring,
            announcing: Announcing::default(),
            one_way,
            description,
            pairing_time: PairingTime::of_start(reset_reason, clock::monotonic_ns()),
            store,
            is_refusing: refusal.is_some(),
        };
        links.announce();
        links
    }

    /// The number of this start.
    #[must_use]
    pub fn start(&self) -> Start {
        self.start
    }

    /// Sends a message to all listeners, poses to those that take them, and to the file.
    pub fn send(&mut self, message: &Message) {
        self.send_unless(message, |_| false);
    }

    /// The same, but to no listener that is `spared`; it may ask for the message again later.
    pub fn send_unless(&mut self, message: &Message, spared: impl Fn(ListenerId) -> bool) {
        if let Some(file) = &mut self.ports.file {
            let mut frame = [0; FRAME_BYTES_MAX];
            file.send(whole(encode_frame(Some(self.start), message, &mut frame)));
        }
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(line) = &mut self.one_way {
            self.ports.send(Peer::Serial, whole(line.seal(message, &mut buffer)));
        }
        if self.end.key().is_none() {
            return;
        }
        let (counter, packet) = whole(self.end.seal_to_all(message, &mut buffer));
        if let Some(ring) = &mut self.ring {
            ring.push(counter, packet);
        }
        let is_pose = matches!(message, Message::Pose(_));
        for (listener, peer) in self.end.listeners() {
            let is_wanted = !is_pose || self.end.takes_pose(listener);
            if is_wanted && !spared(listener) {
                self.ports.send(peer, packet);
            }
        }
    }

    /// Sends a message to one listener, if it has not left.
    pub fn send_to(&mut self, listener: ListenerId, message: &Message) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(sealed) = self.end.seal_to(listener, message, &mut buffer) {
            let (peer, packet) = whole(sealed);
            self.ports.send(peer, packet);
        }
    }

    /// Answers the program that updates the box, if it has not left: what came of its request of this
    /// number.
    pub fn reply_to_updater(&mut self, id: u16, outcome: UpdateOutcome) {
        let version = logger::cut(crate::VERSION);
        let reply = UpdateReply { id, version, outcome };
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(sealed) = self.end.seal_to_updater(&reply, &mut buffer) {
            let (peer, packet) = whole(sealed);
            self.ports.send(peer, packet);
        }
    }

    /// Whether a listener has not left.
    #[must_use]
    pub fn is_there(&self, listener: ListenerId) -> bool {
        self.end.is_there(listener)
    }

    /// Whether a listener is at the other end of the serial line.
    #[must_use]
    pub fn is_on_serial(&self, listener: ListenerId) -> bool {
        self.peer_of(listener) == Some(Peer::Serial)
    }

    /// Whether a listener records a trial.
    #[must_use]
    pub fn is_recorded(&self) -> bool {
        self.end.recorder().is_some()
    }

    /// The name of the listener that records a trial.
    #[must_use]
    pub fn recorder(&self) -> Option<&str> {
        self.end.recorder().map(|caller| caller.name.as_str())
    }

    /// Whether one more packet to this listener leaves enough room for those that follow.
    #[must_use]
    pub fn has_room(&self, listener: ListenerId) -> bool {
        self.peer_of(listener).is_some_and(|peer| self.ports.has_room(peer))
    }

    /// Whether what is sent to all reaches anybody, or the file.
    #[must_use]
    pub fn has_audience(&self) -> bool {
        let is_heard = !self.end.listeners().is_empty();
        is_heard || self.one_way.is_some() || self.ports.file.is_some()
    }

    /// Announces the box when it is time to, sends again what was asked for, and sends waiting
    /// packets.
    pub fn service(&mut self) {
        self.end.pass(clock::monotonic_ns());
        self.announce();
        if let Some(ring) = &self.ring {
            resends::serve(&mut self.end, ring, &mut self.ports);
        }
        self.ports.service();
    }

    /// Sends waiting packets for at most `limit`; those that are left count as dropped. As long as
    /// listeners ask for what they have missed of the last packets, they get it.
    pub fn finish(&mut self, limit: Duration) {
        let end = Instant::now() + limit;
        let mut quiet_since = Instant::now();
        while !self.end.listeners().is_empty()
            && quiet_since.elapsed() < ASKS_WITHIN
            && Instant::now() < end
        {
            if self.receive(|_| {}).is_asked_again {
                quiet_since = Instant::now();
            }
            self.service();
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ports.finish(end.saturating_duration_since(Instant::now()));
    }

    /// Why packets are lost for good, if there is a reason that a person must put right. A host that
    /// is absent now is none: it may be there for the next packet.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        self.ports.file.as_ref().and_then(FileLink::fault)
    }

    /// What became of the packets of each link so far.
    #[must_use]
    pub fn counts(&self) -> heapless::Vec<(LinkKind, Counts), LINKS_MAX> {
        self.ports.counts()
    }

    /// The same with the names of the links, for people.
    #[must_use]
    pub fn summary(&self) -> heapless::Vec<(String, Counts), LINKS_MAX> {
        self.ports.summary()
    }

    fn peer_of(&self, listener: ListenerId) -> Option<Peer> {
        self.end.listeners().iter().find(|(id, _)| *id == listener).map(|(_, peer)| *peer)
    }

    /// Has the box say what it is now, in announcements and in answers to greetings.
    fn describe(&mut self, now_ns: u64) {
        // Where no key can come over a line, waiting for one would be in vain.
        let pairing_s = if self.ports.hears_serial() {
            self.pairing_time.left_s(self.end.key().is_some(), now_ns)
        } else {
            0
        };
        self.end.describe(self.description.state, pairing_s, &self.description.text);
    }

    fn announce(&mut self) {
        let now_ns = clock::monotonic_ns();
        self.describe(now_ns);
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(udp) = &self.ports.udp {
            let to = Peer::Udp(udp.destination());
            if self.announcing.is_due_on_udp(self.end.hears(to, now_ns), now_ns) {
                self.ports.send(to, self.end.announcement(&mut buffer));
            }
        }
        if self.ports.serial.is_none() || !self.announcing.is_due_on_serial(now_ns) {
            return;
        }
        if let Some(line) = &self.one_way {
            self.ports.send(Peer::Serial, line.announcement(&mut buffer));
        } else if !self.end.hears(Peer::Serial, now_ns)
            && (!self.ports.is_one_way || self.end.key().is_none())
        {
            self.ports.send(Peer::Serial, self.end.announcement(&mut buffer));
        }
    }
}

/// The buffers hold every message: the core computes them so.
fn whole<T>(encoded: Result<T, EncodeError>) -> T {
    match encoded {
        Ok(encoded) => encoded,
        Err(EncodeError) => unreachable!("a message larger than the largest"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `memory.md` has it.
    #[test]
    fn the_ring_is_as_large_as_it_is_said_to_be() {
        assert_eq!(size_of::<StreamRing>(), 12_000 * 192 + 12_288 * 4 + 24);
        let links = size_of::<Links>();
        assert!((8_000..=12_288).contains(&links), "{links}");
    }
}
