//! A box and its hosts on a simulated network.

extern crate std;

use std::boxed::Box;
use std::collections::{BTreeMap, HashMap};
use std::net::SocketAddr;
use std::vec::Vec;

use super::super::wire::{HEAD_BYTES, Kind, Reader, take_counter};
use super::super::*;
use crate::tell::packet::{Action, Log, LogLevel, Message, Reply, ReplyOutcome, Start};
use crate::test_support::Random;

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1_000 * MS;

/// Both ends act this often, and the box seals as many packets for all: 200 a second.
pub const STEP_NS: u64 = 5 * MS;

/// Packets that the box sends once more in each step, to each listener.
const RESENDS: usize = 10;

/// A minute at 200 Hz, as on the board; the packets of these tests are shorter.
pub type TestRing = Ring<{ 12_288 * 40 }, 12_288>;

pub fn draw(random: &mut Random) -> [u8; 32] {
    core::array::from_fn(|_| random.bits() as u8)
}

pub fn key(seed: u64) -> Key {
    Key::new(draw(&mut Random::new(seed))).unwrap()
}

pub fn address(index: usize) -> Peer {
    let host = 10 + index / 50_000;
    Peer::Udp(SocketAddr::from((
        [10, 0, (host >> 8) as u8, host as u8],
        10_000 + (index % 50_000) as u16,
    )))
}

/// The message that is the packet of the stream with this counter.
pub fn numbered(counter: u64) -> Message {
    Message::Log(Log {
        uptime_ms: counter,
        level: LogLevel::Info,
        target: heapless::String::new(),
        text: heapless::String::new(),
        cut: 0,
    })
}

/// What happens to packets, in parts of one.
#[derive(Clone, Default)]
pub struct Weather {
    pub lost: f64,
    pub twice: f64,
    pub late: f64,
    /// Nothing comes through from the first time to the second.
    pub cut: Vec<(u64, u64)>,
}

pub struct BoxSide {
    pub end: BoxEnd,
    pub start: Start,
    pub ring: Box<TestRing>,
    pub announced_ns: u64,
    /// What its listeners have said besides what the ends say to each other.
    pub heard: Vec<(ListenerId, Message)>,
}

impl BoxSide {
    pub fn new(key: Key, random: &mut Random) -> Self {
        let start = Start::new(random.bits() as u32 | 1).unwrap();
        let end = BoxEnd::new(Some(key), start, &draw(random));
        Self { end, start, ring: Box::default(), announced_ns: 0, heard: Vec::new() }
    }
}

/// A program that says who it is.
pub fn caller(process: u32, name: &str) -> Caller {
    Caller { process, name: name.try_into().unwrap() }
}

pub struct HostSide {
    pub end: HostEnd,
    pub peer: Peer,
    /// How often each packet of each start has been handed out.
    pub received: BTreeMap<(Start, u64), u32>,
    pub told: Vec<Message>,
}

impl HostSide {
    pub fn new(key: Key, process: u32, peer: Peer, known: Option<Peer>) -> Self {
        let end = HostEnd::new(key, caller(process, "a test"), known);
        Self { end, peer, received: BTreeMap::new(), told: Vec::new() }
    }

    /// How many counters of a start have come.
    pub fn count(&self, start: Start) -> u64 {
        self.received.range((start, 0)..=(start, u64::MAX)).count() as u64
    }

    pub fn holes(&self, start: Start) -> u64 {
        let mut counters = self.received.range((start, 0)..=(start, u64::MAX)).map(|it| it.0.1);
        let Some(first) = counters.next() else { return 0 };
        let last = counters.next_back().unwrap_or(first);
        last - first + 1 - self.count(start)
    }
}

pub struct World {
    pub now_ns: u64,
    pub random: Random,
    pub weather: Weather,
    pub at: Peer,
    /// `None` while it restarts.
    pub bx: Option<BoxSide>,
    pub hosts: Vec<HostSide>,
    pub streams: bool,
    /// Whether nothing reaches the box.
    pub deaf_box: bool,
    /// By time and order: from, to, packet.
    flights: BTreeMap<(u64, u64), (Peer, Peer, Vec<u8>)>,
    order: u64,
    /// All that was sent, for who wants to replay it.
    pub log: Option<Vec<(Peer, Peer, Vec<u8>)>>,
    /// Each sealed packet by what makes its nonce.
    pub sealed: HashMap<(bool, u32, u32, u64), Vec<u8>>,
}

impl World {
    pub fn new(seed: u64, weather: Weather) -> Self {
        let mut random = Random::new(seed);
        let at = address(0);
        let bx = Some(BoxSide::new(key(1), &mut random));
        Self {
            now_ns: 10_000 * S,
            random,
            weather,
            at,
            bx,
            hosts: Vec::new(),
            streams: true,
            deaf_box: false,
            flights: BTreeMap::new(),
            order: 0,
            log: None,
            sealed: HashMap::new(),
        }
    }

    pub fn with_hosts(mut self, count: usize) -> Self {
        for index in 0..count {
            let known = (index % 2 == 0).then_some(self.at);
            let process = index as u32 + 1;
            self.hosts.push(HostSide::new(key(1), process, address(process as usize), known));
        }
        self
    }

    pub fn bx(&mut self) -> &mut BoxSide {
        self.bx.as_mut().unwrap()
    }

    fn chance(&mut self, of: f64) -> bool {
        self.random.uniform(0.0, 1.0) < of
    }

    pub fn send(&mut self, from: Peer, to: Peer, packet: &[u8]) {
        self.check_nonce(from, packet);
        if let Some(log) = &mut self.log {
            log.push((from, to, packet.to_vec()));
        }
        let weather = self.weather.clone();
        let copies = if self.chance(weather.twice) { 2 } else { 1 };
        for _ in 0..copies {
            let is_cut = weather.cut.iter().any(|cut| (cut.0..cut.1).contains(&self.now_ns));
            if is_cut || self.chance(weather.lost) {
                continue;
            }
            let late_ns = if self.chance(weather.late) { 2_500 * MS } else { 0 };
            let arrives_ns = self.now_ns + late_ns + MS + self.random.bits() % (6 * MS);
            self.order += 1;
            self.flights.insert((arrives_ns, self.order), (from, to, packet.to_vec()));
        }
    }

    /// No key seals two things with one counter.
    fn check_nonce(&mut self, from: Peer, packet: &[u8]) {
        let is_box = from == self.at;
        let start = match &self.bx {
            Some(bx) if is_box => Some(bx.start),
            _ => self.hosts.iter().find(|it| it.peer == from).and_then(|it| it.end.session_start()),
        };
        let (session, counter) = match Kind::of(packet) {
            Some((Kind::Stream, rest)) => (0, take_counter(&mut Reader(rest)).unwrap()),
            Some((Kind::Channel, rest)) => {
                let session = channel::session_of(packet).unwrap();
                // The sessions of a start are counted from 0; 65,536 are more than a test has.
                (u32::from(session) + 1, take_counter(&mut Reader(&rest[HEAD_BYTES..])).unwrap())
            }
            _ => return,
        };
        let Some(start) = start else { return };
        let before =
            self.sealed.entry((is_box, start.get(), session, counter)).or_insert(packet.to_vec());
        assert_eq!(before, packet, "sealed twice with one nonce");
    }

    /// One step of everybody.
    pub fn step(&mut self) {
        self.now_ns += STEP_NS;
        while let Some(first) = self.flights.first_entry() {
            if first.key().0 > self.now_ns {
                break;
            }
            let (from, to, packet) = first.remove();
            self.deliver(from, to, &packet);
        }
        self.box_acts();
        for index in 0..self.hosts.len() {
            loop {
                let (host, random) = (&mut self.hosts[index], &mut self.random);
                let mut buffer = [0; SEALED_BYTES_MAX];
                let due = host.end.due(self.now_ns, || draw(random), &mut buffer);
                let Some((to, packet)) = due else { break };
                let from = host.peer;
                let packet = packet.to_vec();
                self.send(from, to, &packet);
            }
        }
    }

    pub fn run(&mut self, duration_ns: u64) {
        let end_ns = self.now_ns + duration_ns;
        while self.now_ns < end_ns {
            self.step();
        }
    }

    /// Runs until it is so, and tells how long that took; at most that long.
    pub fn run_until(&mut self, at_most_ns: u64, mut is_so: impl FnMut(&Self) -> bool) -> u64 {
        let from_ns = self.now_ns;
        while !is_so(self) {
            self.step();
            assert!(
                self.now_ns - from_ns <= at_most_ns,
                "it takes too long: {:?}",
                self.hosts[0].end
            );
        }
        self.now_ns - from_ns
    }

    pub fn deliver(&mut self, from: Peer, to: Peer, packet: &[u8]) {
        if to == self.at {
            if self.bx.is_some() && !self.deaf_box {
                let answers = self.box_receives(from, packet);
                for answer in answers {
                    self.send(to, from, &answer);
                }
            }
        } else if let Some(index) = self.hosts.iter().position(|it| it.peer == to)
            && let Some(answer) = self.host_receives(index, from, packet)
        {
            self.send(to, from, &answer);
        }
    }

    /// What the box sends back.
    pub fn box_receives(&mut self, from: Peer, packet: &[u8]) -> Vec<Vec<u8>> {
        let (now_ns, random) = (self.now_ns, &mut self.random);
        let bx = self.bx.as_mut().unwrap();
        let mut buffer = [0; SEALED_BYTES_MAX];
        let mut answers = Vec::new();
        match bx.end.receive(from, packet, now_ns, || draw(random), &mut buffer) {
            Heard::Nothing | Heard::Left => {}
            Heard::Answer(answer) => answers.push(answer.to_vec()),
            Heard::Message { listener, message, .. } => {
                let Message::Command(command) = message else { panic!("{message:?}") };
                let outcome = match command.action {
                    Action::Ping { host_sent_ns } => ReplyOutcome::Pong {
                        host_sent_ns,
                        box_received_ns: now_ns,
                        box_sent_ns: now_ns,
                        stream_next: bx.end.stream_next(),
                    },
                    Action::Resend { first, mask } => {
                        bx.end.resend(listener, command.id, first, mask);
                        return answers;
                    }
                    Action::SendPoses { every } => {
                        bx.end.send_poses(listener, every);
                        ReplyOutcome::Accepted
                    }
                    _ => {
                        bx.heard.push((listener, message));
                        ReplyOutcome::Accepted
                    }
                };
                let reply = Message::Reply(Reply { id: command.id, outcome });
                let (_, packet) = bx.end.seal_to(listener, &reply, &mut buffer).unwrap().unwrap();
                answers.push(packet.to_vec());
            }
            Heard::Pairing(_) | Heard::Update { .. } => panic!("nobody pairs or updates"),
        }
        answers
    }

    pub fn host_receives(&mut self, index: usize, from: Peer, packet: &[u8]) -> Option<Vec<u8>> {
        let (now_ns, random) = (self.now_ns, &mut self.random);
        let host = &mut self.hosts[index];
        let mut buffer = [0; SEALED_BYTES_MAX];
        match host.end.receive(from, packet, now_ns, || draw(random), &mut buffer) {
            Told::Nothing | Told::Repeated | Told::Kept => None,
            Told::Handshake(answer) => answer.map(<[u8]>::to_vec),
            Told::Message { start, counter: Some(counter), message } => {
                assert_eq!(message, numbered(counter));
                let times = host.received.entry((start, counter)).or_default();
                *times += 1;
                assert_eq!(*times, 1, "{counter} was handed out again");
                None
            }
            Told::Message { message, .. } => {
                host.told.push(message);
                None
            }
        }
    }

    fn box_acts(&mut self) {
        let (now_ns, at) = (self.now_ns, self.at);
        let Some(bx) = &mut self.bx else { return };
        let mut buffer = [0; SEALED_BYTES_MAX];
        let mut out = Vec::new();
        bx.end.pass(now_ns);
        let listeners = bx.end.listeners();
        let every_ns = if listeners.is_empty() { S / 4 } else { S };
        if now_ns - bx.announced_ns >= every_ns {
            bx.announced_ns = now_ns;
            let packet = bx.end.announcement(&mut buffer).to_vec();
            out.extend(self.hosts.iter().map(|host| (host.peer, packet.clone())));
        }
        if self.streams {
            let next = bx.end.stream_next();
            let (counter, packet) = bx.end.seal_to_all(&numbered(next), &mut buffer).unwrap();
            assert_eq!(counter, next);
            bx.ring.push(counter, packet);
            let packet = packet.to_vec();
            for &(listener, peer) in &listeners {
                if bx.end.takes_pose(listener) {
                    out.push((peer, packet.clone()));
                }
            }
        }
        for &(listener, _) in &listeners {
            for _ in 0..RESENDS {
                let resend = bx.end.next_resend(listener, &bx.ring, &mut buffer);
                let Some((peer, packet)) = resend else { break };
                out.push((peer, packet.to_vec()));
            }
        }
        for (to, packet) in out {
            self.send(at, to, &packet);
        }
    }
}
