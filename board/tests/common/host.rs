//! A host: it listens to a box with its key, over UDP or a serial line, and never waits without end.

use std::io::{Read, Write};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, CameraState, Command, Deframer, Health, Message, ReplyOutcome, frame_packet,
};
use plumbline::seal::{
    Announcement, Caller, HostEnd, Key, Peer, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX, Told,
};
use serialport::{SerialPort, TTYPort};

use super::PATIENCE;

/// The key of the box under test.
pub fn key() -> Key {
    Key::new(std::array::from_fn(|at| at as u8 + 1)).unwrap()
}

/// How long a turn waits for a packet.
const TURN: Duration = Duration::from_millis(5);

/// What a packet is, by its second byte.
pub const STREAM: u8 = 7;

enum Wire {
    Udp(UdpSocket),
    Serial(TTYPort, Box<Deframer<SEALED_FRAME_BYTES_MAX>>),
}

/// A message of the box, with its place in the stream unless it was for this host alone.
pub type Heard = (Option<u64>, Message);

/// Whether a packet is lost.
pub type Loss = Box<dyn FnMut(&[u8]) -> bool>;

pub struct Host {
    wire: Wire,
    end: HostEnd,
    began: Instant,
    questions: u16,
    /// All that was heard, in the order in which it came.
    pub heard: Vec<Heard>,
    /// The latest announcement, of any box.
    pub announced: Option<(Peer, Announcement)>,
    /// Packets that came, whether they were opened or not.
    pub packets: Vec<Vec<u8>>,
    /// Packets that are thrown away unopened.
    pub lose: Loss,
    /// Those packets.
    pub lost: Vec<Vec<u8>>,
    /// Packets that were sent to the box.
    pub sent: Vec<Vec<u8>>,
}

impl Host {
    /// A host that listens on a UDP port of its own, and with which key.
    pub fn udp_with(key: Key, name: &str) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(TURN)).unwrap();
        Self::new(Wire::Udp(socket), key, name, None)
    }

    pub fn udp() -> Self {
        Self::udp_with(key(), "test")
    }

    /// A host at the other end of a line.
    pub fn serial(mut line: TTYPort) -> Self {
        line.set_timeout(TURN).unwrap();
        Self::new(Wire::Serial(line, Box::default()), key(), "cable", Some(Peer::Serial))
    }

    fn new(wire: Wire, key: Key, name: &str, known: Option<Peer>) -> Self {
        let caller = Caller { process: rand::random(), name: name.try_into().unwrap() };
        Self {
            wire,
            end: HostEnd::new(key, caller, known),
            began: Instant::now(),
            questions: 0,
            heard: Vec::new(),
            announced: None,
            packets: Vec::new(),
            lose: Box::new(|_| false),
            lost: Vec::new(),
            sent: Vec::new(),
        }
    }

    /// Where it is, for the box's command line.
    pub fn address(&self) -> String {
        let Wire::Udp(socket) = &self.wire else { panic!("a host on a line") };
        socket.local_addr().unwrap().to_string()
    }

    pub fn end(&self) -> &HostEnd {
        &self.end
    }

    /// Wants every such pose only; on return the box knows.
    pub fn want_poses(&mut self, every: u16) {
        self.end.want_poses(every);
        self.turn();
        // What is sent later is answered later.
        assert!(matches!(self.ask(Action::Ping { host_sent_ns: 0 }), ReplyOutcome::Pong { .. }));
    }

    /// Where the box is, once it has been heard.
    pub fn find(&mut self) -> Peer {
        self.turn_until("an announcement", |host| host.announced.as_ref().map(|(peer, _)| *peer))
    }

    /// Tries the box at this address.
    pub fn knock(&mut self, peer: Peer) {
        let now_ns = self.now_ns();
        self.end.try_at(peer, now_ns, rand::random);
    }

    /// Listens: on return the box has said who it is.
    pub fn join(&mut self) -> &mut Self {
        self.turn_until("a Hello", |host| {
            host.heard.iter().any(|(_, it)| matches!(it, Message::Hello(_))).then_some(())
        });
        self
    }

    fn now_ns(&self) -> u64 {
        // Some time after zero, as everywhere.
        self.began.elapsed().as_nanos() as u64 + 1_000_000_000
    }

    pub fn send_raw(&mut self, packet: &[u8], to: Peer) {
        self.sent.push(packet.to_vec());
        match (&mut self.wire, to) {
            (Wire::Udp(socket), Peer::Udp(address)) => {
                // The box may be gone already.
                let _ = socket.send_to(packet, address);
            }
            (Wire::Serial(line, _), _) => {
                let mut frame = [0; SEALED_FRAME_BYTES_MAX];
                let _ = line.write_all(frame_packet(packet, &mut frame).unwrap());
            }
            (Wire::Udp(_), Peer::Serial) => panic!("a host on UDP"),
        }
    }

    /// Sends what is due, and takes what has come meanwhile, or in the next moment.
    pub fn turn(&mut self) {
        loop {
            let now_ns = self.now_ns();
            let mut buffer = [0; SEALED_BYTES_MAX];
            let Some((to, packet)) = self.end.due(now_ns, rand::random, &mut buffer) else { break };
            let packet = packet.to_vec();
            self.send_raw(&packet, to);
        }
        for (from, packet) in self.receive() {
            self.take(from, packet);
        }
    }

    fn receive(&mut self) -> Vec<(Peer, Vec<u8>)> {
        let mut bytes = [0; 2048];
        match &mut self.wire {
            Wire::Udp(socket) => {
                let received = socket.recv_from(&mut bytes);
                let packet = |(length, from)| (Peer::Udp(from), bytes[..length].to_vec());
                received.ok().map(packet).into_iter().collect()
            }
            Wire::Serial(line, deframer) => {
                let length = line.read(&mut bytes).unwrap_or(0);
                let mut packets = Vec::new();
                for byte in &bytes[..length] {
                    if let Some(Ok(packet)) = deframer.frame(*byte) {
                        packets.push((Peer::Serial, packet.to_vec()));
                    }
                }
                packets
            }
        }
    }

    fn take(&mut self, from: Peer, packet: Vec<u8>) {
        if let Some(announcement) = Announcement::parse(&packet) {
            self.announced = Some((from, announcement));
        }
        if (self.lose)(&packet) {
            self.lost.push(packet);
            return;
        }
        let now_ns = self.now_ns();
        let mut buffer = [0; SEALED_BYTES_MAX];
        match self.end.receive(from, &packet, now_ns, rand::random, &mut buffer) {
            Told::Handshake(Some(answer)) => {
                let answer = answer.to_vec();
                self.send_raw(&answer, from);
            }
            Told::Message { counter, message, .. } => self.heard.push((counter, message)),
            Told::Handshake(None) | Told::Kept | Told::Repeated | Told::Nothing => {}
        }
        self.packets.push(packet);
    }

    /// Goes on until `is_done` gives something.
    pub fn turn_until<T>(&mut self, what: &str, is_done: impl Fn(&Self) -> Option<T>) -> T {
        let give_up = Instant::now() + PATIENCE;
        loop {
            if let Some(done) = is_done(self) {
                return done;
            }
            assert!(Instant::now() < give_up, "{what} never came: {:?}", self.end);
            self.turn();
        }
    }

    pub fn turn_for(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.turn();
        }
    }

    /// The next message, from now on, in which something is found.
    pub fn wait_for<T>(&mut self, find: impl Fn(&Message) -> Option<T>) -> T {
        let before = self.heard.len();
        self.turn_until("a message", |host| host.heard[before..].iter().find_map(|it| find(&it.1)))
    }

    pub fn send(&mut self, message: &Message) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (to, packet) = self.end.seal(message, &mut buffer).expect("a session").unwrap();
        let packet = packet.to_vec();
        self.send_raw(&packet, to);
    }

    /// Ends, and says so; returns its socket, and what it has said last.
    pub fn leave(self) -> (UdpSocket, Vec<Vec<u8>>) {
        let Wire::Udp(socket) = self.wire else { panic!("a host on a line") };
        let mut sent = Vec::new();
        self.end.leave(|to, packet| {
            if let Peer::Udp(address) = to {
                socket.send_to(packet, address).unwrap();
            }
            sent.push(packet.to_vec());
        });
        (socket, sent)
    }

    /// Sends a command, and waits for the answer to it.
    pub fn ask(&mut self, action: Action) -> ReplyOutcome {
        self.ask_with(action, false)
    }

    pub fn ask_with(&mut self, action: Action, is_forced: bool) -> ReplyOutcome {
        self.questions += 1;
        let id = self.questions;
        let before = self.heard.len();
        self.send(&Message::Command(Command { id, action, is_forced }));
        self.turn_until("an answer", |host| {
            host.heard[before..].iter().find_map(|(_, message)| match message {
                Message::Reply(reply) if reply.id == id => Some(reply.outcome.clone()),
                _ => None,
            })
        })
    }

    /// The box's Health now: the latest of the stream. An earlier one that was lost, and comes again
    /// meanwhile, is not taken for it.
    pub fn health(&mut self) -> Health {
        let before = self.heard.iter().filter_map(|(counter, _)| *counter).max();
        assert_eq!(self.ask(Action::SendHealth), ReplyOutcome::Accepted);
        // It is sent before the answer.
        self.turn_until("a Health", |host| {
            let later = host.heard.iter().filter(|(counter, _)| *counter > before);
            let healths = later.filter_map(|(counter, message)| match message {
                Message::Health(health) => Some((counter, health)),
                _ => None,
            });
            let latest = healths.max_by_key(|(counter, _)| **counter);
            latest.filter(|_| !host.end.is_missing()).map(|(_, health)| health.clone())
        })
    }

    /// What was said to all up to the last Health, in the order of the stream.
    pub fn until_the_end(&mut self) -> Vec<Message> {
        self.turn_until("the last Health", |host| {
            host.heard.iter().any(|(_, message)| is_last(message)).then_some(())
        });
        self.stream()
    }

    /// What has been said to all, in the order of the stream.
    pub fn stream(&self) -> Vec<Message> {
        let mut stream: Vec<_> =
            self.heard.iter().filter_map(|(counter, it)| Some(((*counter)?, it.clone()))).collect();
        stream.sort_by_key(|(counter, _)| *counter);
        stream.into_iter().map(|(_, message)| message).collect()
    }
}

fn is_last(message: &Message) -> bool {
    matches!(message, Message::Health(health) if health.camera == CameraState::Ended)
}
