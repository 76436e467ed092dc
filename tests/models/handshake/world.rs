//! A box, a program, and all the packets that they ever sent.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::net::SocketAddr;

use plumbline::packet::{Action, Command, Log, LogLevel, Message, Reply, ReplyOutcome, Start};
use plumbline::seal::{
    BoxEnd, Caller, Heard, HostEnd, Key, OWN_COMMAND, Peer, Ring, SEALED_BYTES_MAX, Told,
};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest as _, Sha256};

const MS: u64 = 1_000_000;

/// When it begins. No other number that an end says of itself is as large and so near.
const BEGUN_NS: u64 = 1 << 60;
const LASTS_NS: u64 = 1 << 42;

/// A cookie is good for one or two of these.
const COOKIE_PERIOD_NS: u64 = 10_000 * MS;

/// Once packets come through, everybody is heard within this time.
const THROUGH_WITHIN_MS: u64 = 30_000;

/// The time from one honest step to the next.
const STEP_MS: u64 = 50;

/// What may happen next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// So many milliseconds pass, and the program sends what is due.
    Passes(u64),
    /// The packet of this number comes, for the first time or again.
    Comes(usize),
    ProgramRestarts,
    BoxRestarts,
    ProgramSays,
    BoxTells,
    BoxAnnounces,
}

/// Long enough that a message is sent again, that a session counts as silent, and that the box forgets
/// who has not gone on.
const PAUSES_MS: [u64; 3] = [250, 1_100, 3_100];

/// A packet that is, or was, on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Packet {
    to_box: bool,
    bytes: Vec<u8>,
    /// Whether it has been taken.
    is_taken: bool,
}

pub struct World {
    now_ns: u64,
    bx: BoxEnd,
    ring: Ring<8_192, 64>,
    host: HostEnd,
    starts: u32,
    processes: u32,
    /// Random numbers drawn so far, by the box and by the program.
    drawn: [u64; 2],
    /// All that were ever sent, each once.
    packets: Vec<Packet>,
    /// Those that an honest network still has to deliver.
    under_way: VecDeque<usize>,
    /// What the program has said, what the box has told, and what came of both.
    said: u16,
    heard: Vec<u16>,
    told: u64,
    reached: Vec<u64>,
}

fn key() -> Key {
    Key::new(draw(2, &mut 0)).expect("it is random enough")
}

/// The next random bytes of a side: the same in every run.
fn draw(side: u64, drawn: &mut u64) -> [u8; 32] {
    let mut bytes = [0; 32];
    ChaCha8Rng::seed_from_u64(side << 32 | *drawn).fill_bytes(&mut bytes);
    *drawn += 1;
    bytes
}

fn address(port: u16) -> Peer {
    Peer::Udp(SocketAddr::from(([127, 0, 0, 1], port)))
}

const BOX: u16 = 1;
const PROGRAM: u16 = 2;

fn box_end(starts: u32, drawn: &mut u64) -> BoxEnd {
    BoxEnd::new(Some(key()), Start::new(starts).expect("not 0"), &draw(0, drawn))
}

fn host_end(process: u32) -> HostEnd {
    let caller = Caller { process, name: "a program".try_into().expect("it is short") };
    HostEnd::new(key(), caller, Some(address(BOX)))
}

/// The message of this number.
fn numbered(uptime_ms: u64) -> Message {
    let (target, text) = (heapless::String::new(), heapless::String::new());
    Message::Log(Log { uptime_ms, level: LogLevel::Info, target, text, cut: 0 })
}

impl World {
    /// A program that knows where the box is, and says so.
    fn new() -> Self {
        let mut drawn = [0; 2];
        let mut world = Self {
            now_ns: BEGUN_NS,
            bx: box_end(1, &mut drawn[0]),
            ring: Ring::new(),
            host: host_end(1),
            starts: 1,
            processes: 1,
            drawn,
            packets: Vec::new(),
            under_way: VecDeque::new(),
            said: 0,
            heard: Vec::new(),
            told: 0,
            reached: Vec::new(),
        };
        world.pass(0);
        world
    }

    /// After these steps, of which those of an honest network are left out.
    pub fn after(base: Base, events: &[Event]) -> Self {
        let mut world = Self::new();
        if base == Base::Session {
            world.honest();
            world.under_way.clear();
            // What it took to come here is not tried again, all at once.
            let keep = world.packets.len().saturating_sub(PACKETS_KEPT);
            world.packets.drain(..keep);
        }
        for event in events {
            world.happens(*event);
        }
        world
    }

    /// Something happens, and is over.
    pub fn happens(&mut self, event: Event) {
        match event {
            Event::Passes(ms) => self.pass(ms),
            Event::Comes(index) => self.deliver(index),
            Event::ProgramRestarts => {
                self.processes += 1;
                self.host = host_end(self.processes);
            }
            Event::BoxRestarts => {
                self.starts += 1;
                self.bx = box_end(self.starts, &mut self.drawn[0]);
                self.ring = Ring::new();
            }
            Event::ProgramSays => drop(self.says()),
            Event::BoxTells => drop(self.tells()),
            Event::BoxAnnounces => {
                let packet = self.bx.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec();
                self.send(false, packet);
            }
        }
        self.under_way.clear();
    }

    /// What may happen now.
    pub fn possible(&self) -> impl Iterator<Item = Event> + use<> {
        let pauses = PAUSES_MS.into_iter().map(Event::Passes);
        let rest = [
            Event::ProgramRestarts,
            Event::BoxRestarts,
            Event::ProgramSays,
            Event::BoxTells,
            Event::BoxAnnounces,
        ];
        (0..self.packets.len()).map(Event::Comes).chain(pauses).chain(rest)
    }

    fn send(&mut self, to_box: bool, bytes: Vec<u8>) {
        let known = self.packets.iter().position(|it| it.to_box == to_box && it.bytes == bytes);
        let index = known.unwrap_or_else(|| {
            self.packets.push(Packet { to_box, bytes, is_taken: false });
            self.packets.len() - 1
        });
        self.under_way.push_back(index);
    }

    fn pass(&mut self, ms: u64) {
        self.now_ns += ms * MS;
        self.bx.pass(self.now_ns);
        loop {
            let mut buffer = [0; SEALED_BYTES_MAX];
            let (now_ns, drawn) = (self.now_ns, &mut self.drawn[1]);
            let Some((_, packet)) = self.host.due(now_ns, || draw(1, drawn), &mut buffer) else {
                return;
            };
            let packet = packet.to_vec();
            self.send(true, packet);
        }
    }

    fn says(&mut self) -> Option<u16> {
        let id = self.said + 1;
        let action = Action::SendHello;
        let message = Message::Command(Command { id, action, is_forced: false });
        let mut buffer = [0; SEALED_BYTES_MAX];
        let packet = self.host.seal(&message, &mut buffer)?.expect("it is short").1.to_vec();
        self.said = id;
        self.send(true, packet);
        Some(id)
    }

    fn tells(&mut self) -> u64 {
        self.told += 1;
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (counter, packet) =
            self.bx.seal_to_all(&numbered(self.told), &mut buffer).expect("it is short");
        self.ring.push(counter, packet);
        let packet = packet.to_vec();
        for _ in self.bx.listeners() {
            self.send(false, packet.clone());
        }
        self.told
    }

    /// A packet comes; whether it has been taken is asserted to be right.
    fn deliver(&mut self, index: usize) {
        let Packet { to_box, bytes, is_taken } = self.packets[index].clone();
        let takes = if to_box { self.box_receives(&bytes) } else { self.host_receives(&bytes) };
        assert!(!(takes && is_taken), "packet {index} is taken twice");
        self.packets[index].is_taken |= takes;
    }

    /// Whether the box has taken a message from it.
    fn box_receives(&mut self, bytes: &[u8]) -> bool {
        let (now_ns, drawn) = (self.now_ns, &mut self.drawn[0]);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let from = address(PROGRAM);
        let (listener, command) =
            match self.bx.receive(from, bytes, now_ns, || draw(0, drawn), &mut buffer) {
                Heard::Nothing => return false,
                Heard::Answer(answer) => {
                    let answer = answer.to_vec();
                    self.send(false, answer);
                    return false;
                }
                Heard::Message { listener, message: Message::Command(command), .. } => {
                    (listener, command)
                }
                other => panic!("nobody has said that: {other:?}"),
            };
        let outcome = match command.action {
            Action::Ping { host_sent_ns } => ReplyOutcome::Pong {
                host_sent_ns,
                box_received_ns: now_ns,
                box_sent_ns: now_ns,
                stream_next: self.bx.stream_next(),
            },
            Action::Resend { first, mask } => {
                self.bx.resend(listener, command.id, first, mask);
                while let Some((_, packet)) = self.bx.next_resend(listener, &self.ring, &mut buffer)
                {
                    let packet = packet.to_vec();
                    self.send(false, packet);
                }
                return true;
            }
            Action::SendHello if (1..=self.said).contains(&command.id) => {
                assert!(!self.heard.contains(&command.id), "{command:?} is heard twice");
                self.heard.push(command.id);
                ReplyOutcome::Accepted
            }
            other => panic!("nobody has said that: {other:?}"),
        };
        assert!(command.id == OWN_COMMAND || command.action == Action::SendHello);
        let reply = Message::Reply(Reply { id: command.id, outcome });
        let sealed = self.bx.seal_to(listener, &reply, &mut buffer).expect("it is there");
        let packet = sealed.expect("it is short").1.to_vec();
        self.send(false, packet);
        true
    }

    /// Whether the program has taken a message from it.
    fn host_receives(&mut self, bytes: &[u8]) -> bool {
        let (now_ns, drawn) = (self.now_ns, &mut self.drawn[1]);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let from = address(BOX);
        match self.host.receive(from, bytes, now_ns, || draw(1, drawn), &mut buffer) {
            Told::Nothing | Told::Repeated | Told::Handshake(None) => false,
            Told::Handshake(Some(answer)) => {
                let answer = answer.to_vec();
                self.send(true, answer);
                false
            }
            Told::Kept => true,
            Told::Message { counter: Some(_), message: Message::Log(log), .. } => {
                let number = log.uptime_ms;
                assert!((1..=self.told).contains(&number), "{number} was never told");
                assert!(!self.reached.contains(&number), "{number} is told twice");
                self.reached.push(number);
                true
            }
            Told::Message { counter: None, message: Message::Reply(reply), .. } => {
                assert!((1..=self.said).contains(&reply.id), "nobody has asked for {reply:?}");
                true
            }
            other @ Told::Message { .. } => panic!("nobody has told that: {other:?}"),
        }
    }

    /// All that can make a difference to what follows, but for the time of day.
    pub fn state(&self) -> [u8; 32] {
        let mut text = format!("{:?} {:?} {:?}", self.bx, self.host, self.ring.kept());
        let period = self.now_ns / COOKIE_PERIOD_NS;
        let _ = write!(
            text,
            "{:?} {:?} {} {} {:?} {} {:?} {period}",
            self.packets, self.drawn, self.starts, self.said, self.heard, self.told, self.reached
        );
        Sha256::digest(without_the_time(&text, self.now_ns)).into()
    }

    /// What was changed on its way, or comes back to who sent it, changes nothing.
    pub fn assert_forgeries_are_worthless(&mut self) {
        let before = self.ends();
        for index in 0..self.packets.len() {
            let Packet { to_box, bytes, .. } = self.packets[index].clone();
            // Greetings and announcements are in clear, and nobody believes them.
            if !matches!(bytes[1], 3..=7) {
                continue;
            }
            for at in [2, bytes.len() / 2, bytes.len() - 1] {
                let mut forged = bytes.clone();
                forged[at] ^= 1;
                self.assert_ignored(to_box, &forged);
            }
            self.assert_ignored(!to_box, &bytes);
        }
        assert_eq!(self.ends(), before, "by something forged");
    }

    fn assert_ignored(&mut self, to_box: bool, bytes: &[u8]) {
        let sent = self.under_way.len();
        let is_taken = if to_box { self.box_receives(bytes) } else { self.host_receives(bytes) };
        assert!(!is_taken && self.under_way.len() == sent, "{bytes:?} is believed");
    }

    fn ends(&self) -> String {
        format!("{:?} {:?} {:?}", self.bx, self.host, self.drawn)
    }

    /// Whatever has happened, it is over: what is sent comes, and nothing else, until the program has
    /// been heard and hears.
    pub fn honest(&mut self) {
        self.under_way.clear();
        let (mut asked, mut told) = (Vec::new(), Vec::new());
        let mut passed_ms = 0;
        while !(asked.iter().any(|id| self.heard.contains(id))
            && told.iter().any(|number| self.reached.contains(number)))
        {
            assert!(passed_ms < THROUGH_WITHIN_MS, "not through: {:?}\n{:?}", self.host, self.bx);
            passed_ms += STEP_MS;
            self.pass(STEP_MS);
            if passed_ms % 500 == 0 {
                let packet = self.bx.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec();
                self.send(false, packet);
            }
            if passed_ms % 250 == 0 && self.host.peer().is_some() {
                asked.extend(self.says());
                told.push(self.tells());
            }
            while let Some(index) = self.under_way.pop_front() {
                self.deliver(index);
            }
        }
    }
}

/// A text in which times are told by how long ago they were.
fn without_the_time(text: &str, now_ns: u64) -> String {
    let mut told = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(from) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let (before, number) = rest.split_at(from);
        let end = number.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(number.len());
        let (digits, after) = number.split_at(end);
        told += before;
        match digits.parse::<u64>() {
            Ok(time_ns) if (BEGUN_NS..BEGUN_NS + LASTS_NS).contains(&time_ns) => {
                let _ = write!(told, "@{}", now_ns.abs_diff(time_ns));
            }
            _ => told += digits,
        }
        rest = after;
    }
    told + rest
}

/// Where it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// With a greeting.
    Greeting,
    /// With a session in which everybody has been heard.
    Session,
}

/// Packets from before it begins that may still come: those of the last handshake among them.
const PACKETS_KEPT: usize = 6;
