//! The link: a box, three programs that want to hear it, two of which have its key, and two that want to
//! update it, one of which has its key, on a network that does whatever an input says. The input is a list of steps, most of which use a packet that was
//! sent before: it is delivered, to whomever, as it was, damaged or cut, once or again.
//!
//! Laws:
//! - The box hears what a program with its key has said, at most once, and nothing else; a program hears
//!   what the box has said, at most once, and nothing else. Without the key nobody is told anything.
//! - The same holds for what the programs that update it ask, and are answered; and only one at a time
//!   is answered anything but that it must wait.
//! - Who has not shown that packets reach it gets no more bytes than it has sent.
//! - Whatever has happened, once the network is honest again a program with the key is heard, and hears,
//!   and one that updates the box is answered.

use std::collections::HashSet;
use std::net::SocketAddr;

use plumbline::packet::{
    Action, Command, Log, LogLevel, Message, Reply, ReplyOutcome, Start, UpdateOutcome,
    UpdateReply, UpdateRequest, UpdateState, UpdateStep,
};
use plumbline::seal::{
    Announcement, BoxEnd, Caller, Heard, HostEnd, Key, OWN_COMMAND, OneWay, Paired, Peer,
    SEALED_BYTES_MAX, StreamOpener, Told, ToldOfUpdate, UpdateEnd,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::input::{Input, put_block};

/// The most steps of an input.
const STEPS_MAX: usize = 96;

const MS: u64 = 1_000_000;

/// Once the network is honest, everybody is through within this time: a box that had no room is asked
/// again after 5 s, and what nobody has finished it forgets within some seconds.
const THROUGH_WITHIN_MS: u64 = 30_000;

/// The time from one honest step to the next.
const STEP_MS: u64 = 50;

/// Programs that want to hear the box. The first two of them have its key.
const HOSTS: usize = 3;
const WITH_KEY: usize = 2;

/// Programs that want to update it, whose addresses follow. The first of them has its key.
const UPDATERS: usize = 2;

/// Addresses of the box and of all programs.
const PLACES: usize = 1 + HOSTS + UPDATERS;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    if input.byte() & 0x80 != 0 {
        return read_alone(input.rest());
    }
    let mut world = World::new(input.number().into());
    for _ in 0..STEPS_MAX {
        if input.is_empty() {
            break;
        }
        world.step(&mut input);
    }
    world.honest_again();
}

/// What is read of a packet without a session.
fn read_alone(bytes: &[u8]) {
    if let Some(found) = Announcement::parse(bytes) {
        assert!(found.text.chars().count() <= bytes.len());
    }
    let key = key(1);
    if let Some(found) = OneWay::read(&key, bytes) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        assert_eq!(found.packet(&key, &mut buffer), bytes, "it was not made with this key");
        if let Some(mut opener) = StreamOpener::one_way(&key, &found) {
            assert!(opener.open(bytes).is_none());
        }
    }
    let _ = (OneWay::key_id(bytes), Paired::read(bytes));
    if let Ok(text) = std::str::from_utf8(bytes)
        && let Ok(found) = Key::from_text(text)
    {
        let again = Key::from_text(found.text().as_str());
        assert_eq!(again.expect("its own text").bytes(), found.bytes());
    }
}

fn key(seed: u64) -> Key {
    Key::new(draw(&mut ChaCha8Rng::seed_from_u64(seed))).expect("it is random enough")
}

fn draw(random: &mut ChaCha8Rng) -> [u8; 32] {
    let mut bytes = [0; 32];
    random.fill_bytes(&mut bytes);
    bytes
}

fn address(index: usize) -> Peer {
    Peer::Udp(SocketAddr::from(([10, 0, 0, index as u8], 4210)))
}

/// A message that differs from all others.
fn numbered(number: u64) -> Message {
    Message::Log(Log {
        uptime_ms: number,
        level: LogLevel::Info,
        target: heapless::String::new(),
        text: heapless::String::new(),
        cut: 0,
    })
}

fn ping(id: u16) -> Message {
    let action = Action::Ping { host_sent_ns: id.into() };
    Message::Command(Command { id, action, is_forced: false })
}

struct Sent {
    from: Peer,
    to: Peer,
    packet: Vec<u8>,
}

/// What a program has said or heard: of which box, and what.
type Words = HashSet<(u32, usize, String)>;

struct World {
    random: ChaCha8Rng,
    now_ns: u64,
    bx: BoxEnd,
    start: u32,
    hosts: Vec<HostEnd>,
    updaters: Vec<UpdateEnd>,
    /// All that was sent, and where what is not delivered yet begins.
    sent: Vec<Sent>,
    next: usize,
    /// By program: what was said to the box, by the number of its command, and what it has heard.
    said: Words,
    heard: Words,
    /// What the box has said, to all or to one, and who has heard it.
    told: HashSet<(u32, Option<u64>, String)>,
    reached: Words,
    /// Requests about an update that were sent, those that the box has heard, and the replies that
    /// were heard, by their numbers.
    asked: HashSet<u16>,
    answered: HashSet<u16>,
    told_of_update: HashSet<u16>,
    number: u16,
    bytes_to_strangers: usize,
    bytes_of_strangers: usize,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let start = 1;
        let bx = BoxEnd::new(Some(key(1)), Start::new(start).expect("not 0"), &draw(&mut random));
        let host = |index: usize| {
            let caller = Caller {
                process: index as u32 + 1,
                name: "a program".try_into().expect("it is short"),
            };
            let key = if index < WITH_KEY { key(1) } else { key(2) };
            // The second one waits for an announcement.
            HostEnd::new(key, caller, (index != 1).then(|| address(0)))
        };
        let updater = |index: usize| {
            let process = (HOSTS + index) as u32 + 1;
            let caller = Caller { process, name: "an updater".try_into().expect("it is short") };
            let key = if index == 0 { key(1) } else { key(2) };
            UpdateEnd::new(key, caller, Some(address(0)))
        };
        Self {
            random,
            now_ns: 1_000_000 * MS,
            bx,
            start,
            hosts: (0..HOSTS).map(host).collect(),
            updaters: (0..UPDATERS).map(updater).collect(),
            asked: HashSet::new(),
            answered: HashSet::new(),
            told_of_update: HashSet::new(),
            sent: Vec::new(),
            next: 0,
            said: HashSet::new(),
            heard: HashSet::new(),
            told: HashSet::new(),
            reached: HashSet::new(),
            number: 0,
            bytes_to_strangers: 0,
            bytes_of_strangers: 0,
        }
    }

    fn step(&mut self, input: &mut Input<'_>) {
        match input.below(13) {
            0 => self.due(),
            // The next packet arrives, or is lost.
            1 => self.deliver_next(),
            2 => self.next = (self.next + 1).min(self.sent.len()),
            // One of the packets arrives again, or for the first time, at somebody's.
            3 => {
                if let Some(sent) = self.chosen(input) {
                    let (from, packet) = (sent.from, sent.packet.clone());
                    let from = self.perhaps_another(input, from);
                    let to = input.below(PLACES);
                    self.deliver(from, address(to), &packet);
                }
            }
            // Likewise, damaged.
            4 => {
                if let Some(sent) = self.chosen(input) {
                    let (from, to, mut packet) = (sent.from, sent.to, sent.packet.clone());
                    let at = usize::from(input.byte()) % packet.len().max(1);
                    if let Some(byte) = packet.get_mut(at) {
                        *byte ^= input.byte();
                    }
                    let from = self.perhaps_another(input, from);
                    self.deliver(from, to, &packet);
                }
            }
            // Likewise, with the end of another one.
            5 => {
                let at = usize::from(input.byte());
                let other = self.chosen(input).map(|it| it.packet.clone()).unwrap_or_default();
                if let Some(sent) = self.chosen(input) {
                    let (from, to) = (sent.from, sent.to);
                    let head = &sent.packet[..at.min(sent.packet.len())];
                    let packet = [head, other.get(at..).unwrap_or_default()].concat();
                    self.deliver(from, to, &packet);
                }
            }
            // Bytes of a stranger.
            6 => {
                let (from, to) = (input.below(8), input.below(PLACES));
                let packet = input.block();
                self.deliver(address(from), address(to), packet);
            }
            7 => self.pass(u64::from(input.word())),
            8 => {
                self.says(input.below(3));
            }
            9 => self.tells(),
            10 => self.announces(),
            11 => self.restarts(),
            _ => {
                self.asks(input.below(UPDATERS));
            }
        }
    }

    fn chosen(&self, input: &mut Input<'_>) -> Option<&Sent> {
        let back = usize::from(input.byte());
        self.sent.len().checked_sub(1 + back).map(|at| &self.sent[at])
    }

    fn perhaps_another(&self, input: &mut Input<'_>, from: Peer) -> Peer {
        match input.below(8) {
            other @ 4.. => address(other),
            _ => from,
        }
    }

    fn send(&mut self, from: Peer, to: Peer, packet: Vec<u8>) {
        self.sent.push(Sent { from, to, packet });
    }

    fn pass(&mut self, ms: u64) {
        self.now_ns += ms * MS;
        self.bx.pass(self.now_ns);
    }

    /// The programs send what is due.
    fn due(&mut self) {
        for index in 0..self.hosts.len() {
            for _ in 0..16 {
                let mut buffer = [0; SEALED_BYTES_MAX];
                let (now_ns, random) = (self.now_ns, &mut self.random);
                let due = self.hosts[index].due(now_ns, || draw(random), &mut buffer);
                let Some((to, packet)) = due else { break };
                let packet = packet.to_vec();
                self.send(address(index + 1), to, packet);
            }
        }
        for index in 0..self.updaters.len() {
            for _ in 0..16 {
                let mut buffer = [0; SEALED_BYTES_MAX];
                let (now_ns, random) = (self.now_ns, &mut self.random);
                let due = self.updaters[index].due(now_ns, || draw(random), &mut buffer);
                let Some((to, packet)) = due else { break };
                let packet = packet.to_vec();
                self.send(address(1 + HOSTS + index), to, packet);
            }
        }
    }

    fn deliver_next(&mut self) {
        if let Some(sent) = self.sent.get(self.next) {
            let (from, to, packet) = (sent.from, sent.to, sent.packet.clone());
            self.next += 1;
            self.deliver(from, to, &packet);
        }
    }

    fn deliver(&mut self, from: Peer, to: Peer, packet: &[u8]) {
        match (0..PLACES).find(|index| address(*index) == to) {
            Some(0) => self.box_receives(from, packet),
            Some(host) if host <= HOSTS => self.host_receives(host - 1, from, packet),
            Some(updater) => self.updater_receives(updater - 1 - HOSTS, from, packet),
            None => {}
        }
    }

    fn box_receives(&mut self, from: Peer, packet: &[u8]) {
        let was_known = self.bx.listeners().iter().any(|(_, peer)| *peer == from);
        let (now_ns, random) = (self.now_ns, &mut self.random);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (mut answer, mut was_asked) = (None, false);
        match self.bx.receive(from, packet, now_ns, || draw(random), &mut buffer) {
            Heard::Nothing | Heard::Left => {}
            Heard::Answer(packet) => answer = Some(packet.to_vec()),
            Heard::Pairing(_) => panic!("nobody pairs"),
            Heard::Update { request, .. } => {
                assert!(self.asked.contains(&request.id), "nobody has asked {request:?}");
                assert!(self.answered.insert(request.id), "it hears {request:?} twice");
                let state = UpdateState::Receiving { next: request.id.into() };
                let outcome = UpdateOutcome::State { state, text: heapless::String::new() };
                let version = heapless::String::new();
                let reply = UpdateReply { id: request.id, version, outcome };
                let sealed = self.bx.seal_to_updater(&reply, &mut buffer);
                let (to, packet) = sealed.expect("it has just asked").expect("it is short");
                assert_eq!(to, from, "somebody else is answered");
                was_asked = true;
                answer = Some(packet.to_vec());
            }
            Heard::Message { listener, message, .. } => {
                let Message::Command(command) = message else { panic!("it hears {message:?}") };
                let listeners = self.bx.listeners();
                assert!(listeners.iter().any(|(id, _)| *id == listener), "who is heard listens");
                if command.id != OWN_COMMAND {
                    let host = self.who_said(command.id).expect("nobody has said this");
                    let words = (self.start, host, format!("{message:?}"));
                    assert!(self.said.contains(&words), "nobody has said {message:?} to it");
                    assert!(self.heard.insert(words), "it hears {message:?} twice");
                }
                let outcome = match command.action {
                    Action::Ping { host_sent_ns } => ReplyOutcome::Pong {
                        host_sent_ns,
                        box_received_ns: now_ns,
                        box_sent_ns: now_ns,
                        stream_next: self.bx.stream_next(),
                    },
                    _ => ReplyOutcome::Accepted,
                };
                let reply = Message::Reply(Reply { id: command.id, outcome });
                let sealed = self.bx.seal_to(listener, &reply, &mut buffer);
                if let Some(Ok((_, packet))) = sealed {
                    answer = Some(packet.to_vec());
                    self.told.insert((self.start, None, format!("{reply:?}")));
                }
            }
        }
        if !was_known && !was_asked {
            self.bytes_of_strangers += packet.len();
            self.bytes_to_strangers += answer.as_ref().map_or(0, Vec::len);
            assert!(
                self.bytes_to_strangers <= self.bytes_of_strangers,
                "strangers get {} bytes for {}",
                self.bytes_to_strangers,
                self.bytes_of_strangers
            );
        }
        if let Some(answer) = answer {
            self.send(address(0), from, answer);
        }
    }

    fn host_receives(&mut self, host: usize, from: Peer, packet: &[u8]) {
        let (now_ns, random) = (self.now_ns, &mut self.random);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let told = self.hosts[host].receive(from, packet, now_ns, || draw(random), &mut buffer);
        match told {
            Told::Nothing | Told::Repeated | Told::Kept => {}
            Told::Handshake(answer) => {
                if let Some(answer) = answer.map(<[u8]>::to_vec) {
                    self.send(address(host + 1), from, answer);
                }
            }
            Told::Message { start, counter, message } => {
                assert!(host < WITH_KEY, "who has no key hears {message:?}");
                let words = (start.get(), counter, format!("{message:?}"));
                assert!(self.told.contains(&words), "nobody has told {words:?}");
                let (start, counter, message) = words;
                let reached = (start, host, format!("{counter:?} {message}"));
                assert!(self.reached.insert(reached), "it is told {message} twice");
            }
        }
    }

    fn updater_receives(&mut self, updater: usize, from: Peer, packet: &[u8]) {
        let (now_ns, random) = (self.now_ns, &mut self.random);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let end = &mut self.updaters[updater];
        match end.receive(from, packet, now_ns, || draw(random), &mut buffer) {
            ToldOfUpdate::Nothing => {}
            ToldOfUpdate::Handshake(answer) => {
                if let Some(answer) = answer.map(<[u8]>::to_vec) {
                    self.send(address(1 + HOSTS + updater), from, answer);
                }
            }
            ToldOfUpdate::Reply { reply, .. } => {
                assert_eq!(updater, 0, "who has no key hears {reply:?}");
                assert!(self.answered.contains(&reply.id), "nobody has told {reply:?}");
                assert!(self.told_of_update.insert(reply.id), "it is told {reply:?} twice");
                let UpdateOutcome::State { state, .. } = &reply.outcome else {
                    panic!("nobody else updates the box: {reply:?}");
                };
                assert_eq!(*state, UpdateState::Receiving { next: reply.id.into() });
            }
        }
    }

    /// A program asks something about an update, if it has a session.
    fn asks(&mut self, updater: usize) -> Option<u16> {
        let id = self.number + 1;
        let mut buffer = [0; SEALED_BYTES_MAX];
        let request = UpdateRequest { id, step: UpdateStep::Query };
        let sealed = self.updaters[updater].seal(&request, &mut buffer)?;
        assert_eq!(updater, 0, "who has no key has a session");
        let (to, packet) = sealed.expect("it is short");
        let packet = packet.to_vec();
        self.number = id;
        self.asked.insert(id);
        self.send(address(1 + HOSTS + updater), to, packet);
        Some(id)
    }

    fn who_said(&self, id: u16) -> Option<usize> {
        let words = format!("{:?}", ping(id));
        (0..self.hosts.len()).find(|host| self.said.contains(&(self.start, *host, words.clone())))
    }

    /// A program says something, if it has a session.
    fn says(&mut self, host: usize) -> Option<u16> {
        let id = self.number + 1;
        let (message, mut buffer) = (ping(id), [0; SEALED_BYTES_MAX]);
        let (to, packet) = self.hosts[host].seal(&message, &mut buffer)?.expect("it is short");
        assert!(host < WITH_KEY, "who has no key has a session");
        let packet = packet.to_vec();
        self.number = id;
        let start = self.hosts[host].start().map_or(self.start, Start::get);
        self.said.insert((start, host, format!("{message:?}")));
        self.send(address(host + 1), to, packet);
        Some(id)
    }

    /// The box says something to all.
    fn tells(&mut self) {
        let (next, mut buffer) = (self.bx.stream_next(), [0; SEALED_BYTES_MAX]);
        let message = numbered(next);
        let (counter, packet) = self.bx.seal_to_all(&message, &mut buffer).expect("it is short");
        let packet = packet.to_vec();
        self.told.insert((self.start, Some(counter), format!("{message:?}")));
        for (_, peer) in &self.bx.listeners() {
            self.send(address(0), *peer, packet.clone());
        }
    }

    fn announces(&mut self) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let packet = self.bx.announcement(&mut buffer).to_vec();
        for place in 1..PLACES {
            self.send(address(0), address(place), packet.clone());
        }
    }

    /// Nothing that was said to the box before reaches it any more.
    fn restarts(&mut self) {
        self.start += 1;
        let start = Start::new(self.start).expect("not 0");
        self.bx = BoxEnd::new(Some(key(1)), start, &draw(&mut self.random));
    }

    /// What is sent arrives, at once, until the programs with the key have been heard and have heard.
    fn honest_again(&mut self) {
        self.next = self.sent.len();
        let mut elapsed_ms = 0;
        let mut asked = [None; WITH_KEY];
        let is_through = |world: &Self, asked: &[Option<u16>; WITH_KEY]| {
            (0..WITH_KEY).all(|host| {
                asked[host].is_some_and(|id| {
                    let pong = format!("Reply {{ id: {id},");
                    world.reached.iter().any(|it| it.1 == host && it.2.contains(&pong))
                })
            })
        };
        let mut update = None;
        let is_updated = |world: &Self, update: &Option<u16>| {
            update.is_some_and(|id| world.told_of_update.contains(&id))
        };
        while !is_through(self, &asked) || !is_updated(self, &update) {
            assert!(elapsed_ms < THROUGH_WITHIN_MS, "{:?} are not through", self.hosts);
            elapsed_ms += STEP_MS;
            self.pass(STEP_MS);
            if elapsed_ms % 500 == 0 {
                self.announces();
            }
            self.due();
            for (host, asked) in asked.iter_mut().enumerate() {
                if elapsed_ms % 500 == 0 && self.hosts[host].peer().is_some() {
                    *asked = self.says(host).or(*asked);
                }
            }
            if elapsed_ms % 500 == 0 && self.updaters[0].peer().is_some() {
                update = self.asks(0).or(update);
            }
            while self.next < self.sent.len() {
                self.deliver_next();
            }
        }
    }
}

/// Inputs in which programs join and talk, by an honest network and by others.
pub fn seeds() -> Vec<Vec<u8>> {
    // An announcement, what is due, and enough arrivals for both handshakes; then everybody speaks.
    let join: &[&[u8]] =
        &[&[10], &[1; 5], &[0], &[1; 26], &[8, 0], &[8, 1], &[12, 0], &[1; 10], &[9], &[1; 6]];
    let join = join.concat();
    let with = |steps: &[u8]| [&[0, 1, 0, 0, 0][..], &join, steps].concat();
    let mut noise = vec![6, 5, 0];
    put_block(&mut noise, b"PLU\x04\x01");
    let mut seeds = vec![
        vec![0],
        with(&[1, 1, 7, 250, 0, 0, 1, 1]),
        // Again, damaged, put together, by a stranger, and after a restart.
        with(&[3, 0, 0, 0, 3, 1, 0, 0, 3, 2, 5, 0]),
        with(&[4, 0, 30, 1, 0, 4, 1, 8, 255, 0]),
        with(&[5, 20, 3, 0]),
        with(&noise),
        with(&[11, 10, 1, 1, 1, 0, 1, 1, 1, 8, 0, 1]),
    ];
    let mut buffer = [0; SEALED_BYTES_MAX];
    let bx = BoxEnd::new(Some(key(1)), Start::new(1).expect("not 0"), &[7; 32]);
    let alone = |bytes: &[u8]| [&[0x80], bytes].concat();
    seeds.push(alone(bx.announcement(&mut buffer)));
    seeds.push(alone(key(1).text().as_str().as_bytes()));
    seeds
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Otherwise nothing is tried but packets that nobody takes.
    #[test]
    fn programs_are_heard_in_the_seeds() {
        let mut heard = 0;
        for seed in seeds().iter().filter(|seed| seed[0] & 0x80 == 0) {
            let mut input = Input::new(&seed[1..]);
            let mut world = World::new(input.number().into());
            while !input.is_empty() {
                world.step(&mut input);
            }
            let is_heard = !world.heard.is_empty() && !world.reached.is_empty();
            heard += usize::from(is_heard && !world.told_of_update.is_empty());
        }
        assert!(heard >= 4, "somebody is heard and hears in {heard} of them");
    }
}
