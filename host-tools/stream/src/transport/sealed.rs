//! The sealed link to one box, over datagrams or a serial line.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Message, PACKET_BYTES_MAX, PROTOCOL_VERSION, Packet, PacketError, SCHEMA_HASH, Start,
    encode_datagram,
};
use plumbline::seal::{
    Announcement, CALLER_NAME_BYTES_MAX, Caller, HostEnd, Key, KeyId, Obstacle, OneWay, Peer,
    SEALED_BYTES_MAX, StreamOpener, TOKEN_BYTES, Told, greeting,
};
use plumbline_files::BadInput;
use plumbline_files::text::shown;

use super::order::Order;
use super::words::{words_of, words_of_other};
use super::{Arrived, Carrier, Event, Raw, Transport, WAIT};
use crate::text;

/// The wait for bytes while a session is being opened or something is missing.
const SHORT_WAIT: Duration = Duration::from_millis(20);

/// A box that cannot be known from its announcements is greeted this often.
pub(crate) const GREET_EVERY: Duration = Duration::from_millis(500);

/// A goodbye is sent this often, without a wait between: nothing answers it, and a packet alone is
/// lost now and then.
const GOODBYES: usize = 3;

/// A box of which this computer has the key.
#[derive(Debug, Clone)]
pub struct KnownBox {
    /// Its name, for people.
    pub name: String,
    /// Its key.
    pub key: Key,
    /// Where it was heard last.
    pub address: Option<SocketAddr>,
}

/// What is remembered of boxes from one run of a program to the next.
pub trait Memory {
    /// There is a session with a box at this address.
    fn met_at(&mut self, key_id: KeyId, address: SocketAddr);

    /// On a line without a way back a box says that this is its start of this number: whether that is
    /// higher than all before, which is noted. Otherwise it may be a recording of that start.
    fn take_start(&mut self, key_id: KeyId, start_count: u32) -> bool;
}

/// Nothing is remembered: the latest start of a box is taken once in this run of the program.
impl Memory for BTreeMap<KeyId, u32> {
    fn met_at(&mut self, _: KeyId, _: SocketAddr) {}

    fn take_start(&mut self, key_id: KeyId, start_count: u32) -> bool {
        let is_new = self.get(&key_id).is_none_or(|highest| start_count > *highest);
        if is_new {
            self.insert(key_id, start_count);
        }
        is_new
    }
}

/// The box that was chosen.
enum Chosen {
    None,
    /// With sessions.
    Box(Box<HostEnd>),
    /// Over a line without a way back.
    OneWay {
        start_count: u32,
        stream: Box<StreamOpener>,
    },
}

/// The link to one box: the first that is heard of those that are known, unless there is only one
/// that it can be. When it is dropped the box is told, so that its place is free at once.
pub struct Link<C: Carrier> {
    carrier: C,
    boxes: Vec<KnownBox>,
    caller: Caller,
    begun: Instant,
    chosen: Chosen,
    /// The start whose packets come, and their order.
    order: Option<(Start, Order<Packet>)>,
    greeted: Option<Instant>,
    /// The latest announcement of a box with which there is no session.
    waiting: Option<(Option<String>, Announcement)>,
    memory: Box<dyn Memory>,
    wants_past: bool,
    /// Where the box was remembered to be.
    remembered: Option<SocketAddr>,
}

impl<C: Carrier> Link<C> {
    /// A link over a carrier to one of these boxes, for a program of this name.
    #[must_use]
    pub fn new(carrier: C, boxes: Vec<KnownBox>, program: &str) -> Self {
        let mut link = Self {
            carrier,
            boxes,
            caller: caller(program),
            begun: Instant::now(),
            chosen: Chosen::None,
            order: None,
            greeted: None,
            waiting: None,
            memory: Box::new(BTreeMap::new()),
            wants_past: false,
            remembered: None,
        };
        if let [known] = &link.boxes[..]
            && let Some(address) = known.address
        {
            // It may be there still, and perhaps announces itself to somebody else.
            let key = known.key.clone();
            link.choose(key, Some(Peer::Udp(address)));
        }
        link
    }

    /// With a memory beyond this run of the program.
    #[must_use]
    pub fn remembering(mut self, memory: Box<dyn Memory>) -> Self {
        self.memory = memory;
        self
    }

    /// Takes also what the box has kept of the time before: its last minute.
    #[must_use]
    pub fn with_past(mut self) -> Self {
        self.wants_past = true;
        if let Chosen::Box(end) = &mut self.chosen {
            end.want_past();
        }
        self
    }

    /// What carries its packets.
    pub fn carrier(&self) -> &C {
        &self.carrier
    }

    fn choose(&mut self, key: Key, known: Option<Peer>) {
        let mut end = HostEnd::new(key, self.caller.clone(), known);
        if self.wants_past {
            end.want_past();
        }
        self.chosen = Chosen::Box(Box::new(end));
    }

    fn now_ns(&self) -> u64 {
        self.begun.elapsed().as_nanos() as u64
    }

    /// Sends what is due.
    fn send_due(&mut self) {
        let now_ns = self.now_ns();
        let mut buffer = [0; SEALED_BYTES_MAX];
        match &mut self.chosen {
            Chosen::Box(end) => {
                while let Some((peer, packet)) = end.due(now_ns, draw, &mut buffer) {
                    self.carrier.send(peer, packet);
                }
            }
            Chosen::None => {
                let is_due = self.greeted.is_none_or(|then| then.elapsed() >= GREET_EVERY);
                if let Some(peer) = self.carrier.only_peer().filter(|_| is_due) {
                    self.greeted = Some(Instant::now());
                    self.carrier.send(peer, greeting(token(), &mut buffer));
                }
            }
            Chosen::OneWay { .. } => {}
        }
    }

    /// Takes one packet.
    fn packet(&mut self, from: Peer, bytes: &[u8], take: &mut dyn FnMut(Event)) {
        let announcement = Announcement::parse(bytes);
        if let Some(announcement) = &announcement {
            self.announced(from, announcement, take);
        } else if let Some(key_id) = OneWay::key_id(bytes) {
            self.one_way(key_id, bytes, take);
            return;
        }
        let now_ns = self.now_ns();
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (start, counter, message, next) = match &mut self.chosen {
            Chosen::Box(end) => match end.receive(from, bytes, now_ns, draw, &mut buffer) {
                Told::Handshake(Some(answer)) => return self.carrier.send(from, answer),
                // A repeated one was carried twice by the network, or came when it had been asked for.
                Told::Handshake(None) | Told::Kept | Told::Repeated => return,
                Told::Nothing => return self.not_opened(bytes, announcement.is_some(), take),
                Told::Message { start, counter, message } => {
                    (start, counter, message, end.first_missing())
                }
            },
            Chosen::OneWay { stream, .. } => {
                // What is lost on such a line cannot be had again.
                let next = stream.window().next();
                match stream.open(bytes) {
                    Some(opened) if opened.counter >= next => {
                        stream.give_up_before(opened.counter);
                        (stream.start(), None, opened.message, None)
                    }
                    _ => return self.not_opened(bytes, announcement.is_some(), take),
                }
            }
            Chosen::None => return self.not_opened(bytes, announcement.is_some(), take),
        };
        let packet = text::printable(Packet { start: Some(start), message });
        let Some(counter) = counter else { return hand(packet, take) };
        let is_same = self.order.as_ref().is_some_and(|(of, _)| *of == start);
        if !is_same {
            if let Some((_, mut before)) = self.order.take() {
                before.flush(&mut |packet| hand(packet, take));
            }
            // The first packet of the stream that is to come, which may be missing still.
            let first = next.unwrap_or(counter).min(counter);
            self.order = Some((start, Order::starting_at(first)));
        }
        if let Some((_, order)) = &mut self.order {
            order.take(counter, packet, Instant::now(), &mut |packet| hand(packet, take));
        }
    }

    /// Counts what could not be opened. Without a session nobody can say whether it is authentic.
    fn not_opened(&self, bytes: &[u8], is_announcement: bool, take: &mut dyn FnMut(Event)) {
        let has_session = match &self.chosen {
            Chosen::None => false,
            Chosen::Box(end) => end.start().is_some(),
            Chosen::OneWay { .. } => true,
        };
        match bytes {
            _ if is_announcement => {}
            [PROTOCOL_VERSION, ..] if has_session => take(Event::NotAuthentic),
            [PROTOCOL_VERSION, ..] => {}
            &[version, _, ..] if has_session || version > PROTOCOL_VERSION => {
                take(Event::Bad(PacketError::OtherVersion { version }));
            }
            _ => take(Event::Bad(PacketError::Short)),
        }
    }

    /// Takes note of what a box says of itself in clear.
    fn announced(&mut self, from: Peer, announcement: &Announcement, take: &mut dyn FnMut(Event)) {
        let mut known = self.boxes.iter().filter(|it| announcement.key_id == Some(it.key.id()));
        let known = known.next().map(|it| (it.name.clone(), it.key.clone()));
        let is_understood = Obstacle::of(announcement).is_none();
        if let Chosen::None = self.chosen
            && let Some((_, key)) = &known
            && is_understood
        {
            self.choose(key.clone(), Some(from));
        }
        // Of the box that was chosen it is said that it cannot be understood, unless it is.
        let is_expected = match &self.chosen {
            Chosen::Box(end) => {
                announcement.key_id == Some(end.key().id())
                    && (is_understood || end.start().is_some())
            }
            Chosen::OneWay { .. } | Chosen::None => false,
        };
        if !is_expected {
            let from = match from {
                Peer::Udp(address) => Some(address),
                Peer::Serial => None,
            };
            let name = known.map(|(name, _)| name);
            self.waiting = Some((name.clone(), announcement.clone()));
            take(Event::Other { from, name, announcement: announcement.clone() });
        }
    }

    /// Takes the announcement of a start on a line without a way back.
    fn one_way(&mut self, key_id: KeyId, bytes: &[u8], take: &mut dyn FnMut(Event)) {
        let Some(known) = self.boxes.iter().find(|it| it.key.id() == key_id) else { return };
        let Some(read) = OneWay::read(&known.key, bytes) else { return take(Event::NotAuthentic) };
        if let Chosen::OneWay { start_count, stream } = &self.chosen
            && (*start_count, stream.start()) == (read.start_count, read.start)
        {
            return;
        }
        if read.schema_hash != SCHEMA_HASH {
            return take(Event::Bad(PacketError::OtherSchema { hash: read.schema_hash }));
        }
        let Some(stream) = StreamOpener::one_way(&known.key, &read) else { return };
        if !self.memory.take_start(key_id, read.start_count) {
            return take(Event::NotAuthentic);
        }
        let (start_count, stream) = (read.start_count, Box::new(stream));
        self.chosen = Chosen::OneWay { start_count, stream };
    }

    /// Has it remembered where the box is, if there is a session now.
    fn remember(&mut self) {
        let Chosen::Box(end) = &self.chosen else { return };
        if let Some(Peer::Udp(address)) = end.peer()
            && self.remembered.replace(address) != Some(address)
        {
            self.memory.met_at(end.key().id(), address);
        }
    }
}

impl<C: Carrier> Transport for Link<C> {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        self.send_due();
        let is_hurried = match &self.chosen {
            Chosen::Box(end) => end.start().is_none() || end.is_missing() || self.holds(),
            Chosen::None | Chosen::OneWay { .. } => false,
        };
        // The carrier is lent while it hands over what came.
        let mut arrived: Vec<Result<(Peer, Vec<u8>), Event>> = Vec::new();
        let wait = if is_hurried { SHORT_WAIT } else { WAIT };
        self.carrier.poll(wait, &mut |one| {
            arrived.push(match one {
                Arrived::Packet { from, bytes } => Ok((from, bytes.to_vec())),
                Arrived::Bad(error) => Err(Event::Bad(error)),
                Arrived::LineLost(why) => Err(Event::LineLost(why)),
                Arrived::LineBack => Err(Event::LineBack),
            });
        })?;
        for one in arrived {
            match one {
                Ok((from, bytes)) => self.packet(from, &bytes, take),
                Err(event) => take(event),
            }
        }
        self.remember();
        if let (Chosen::Box(end), Some((start, order))) = (&self.chosen, &mut self.order)
            && end.start() == Some(*start)
            && let Some(first_missing) = end.first_missing()
        {
            order.pass(Instant::now(), first_missing, &mut |packet| hand(packet, take));
        }
        self.send_due();
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Chosen::Box(end) = &mut self.chosen
            && let Some(Ok((peer, packet))) = end.seal(message, &mut buffer)
        {
            self.carrier.send(peer, packet);
        }
    }

    fn is_missing(&self) -> bool {
        matches!(&self.chosen, Chosen::Box(end) if end.is_missing()) || self.holds()
    }

    fn obstacle(&self) -> Option<(String, String)> {
        if let Chosen::Box(end) = &self.chosen
            && let Some(obstacle) = end.obstacle()
        {
            let key_id = end.key().id();
            let known = self.boxes.iter().find(|it| it.key.id() == key_id);
            return Some(words_of(known.map(|it| it.name.as_str()), obstacle));
        }
        let (name, announcement) = self.waiting.as_ref()?;
        Some(words_of_other(name.as_deref(), announcement))
    }

    fn dropped_here(&self) -> Option<u64> {
        self.carrier.dropped_here()
    }
}

impl<C: Carrier> Link<C> {
    /// Whether packets are held back.
    fn holds(&self) -> bool {
        self.order.as_ref().is_some_and(|(_, order)| order.holds())
    }
}

/// However a program ends but by being killed, the box hears of it.
impl<C: Carrier> Drop for Link<C> {
    fn drop(&mut self) {
        let Chosen::Box(end) = std::mem::replace(&mut self.chosen, Chosen::None) else { return };
        end.leave(|peer, packet| {
            for _ in 0..GOODBYES {
                self.carrier.send(peer, packet);
            }
        });
    }
}

/// Hands over a packet, and before it the same as it is to be kept.
fn hand(packet: Packet, take: &mut dyn FnMut(Event)) {
    let mut buffer = [0; PACKET_BYTES_MAX];
    if let Ok(clear) = encode_datagram(packet.start, &packet.message, &mut buffer) {
        take(Event::Raw(Raw::Datagram(clear.to_vec())));
    }
    take(Event::Packet(packet));
}

/// What this program is called at boxes.
pub(crate) fn caller(program: &str) -> Caller {
    let drawn = draw();
    let mut name = heapless::String::new();
    for letter in program.chars().map(shown) {
        if name.len() + letter.len_utf8() <= CALLER_NAME_BYTES_MAX {
            let _ = name.push(letter);
        }
    }
    let process = u32::from_le_bytes([drawn[0], drawn[1], drawn[2], drawn[3]]);
    Caller { process, name }
}

/// Random bytes from the operating system.
///
/// # Panics
/// When the system has none, on which nothing can be sealed.
pub(crate) fn draw() -> [u8; 32] {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).expect("the operating system gives random bytes");
    bytes
}

pub(crate) fn token() -> [u8; TOKEN_BYTES] {
    let drawn = draw();
    std::array::from_fn(|index| drawn[index])
}
