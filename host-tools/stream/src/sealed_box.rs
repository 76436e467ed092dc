//! A box on this computer that speaks the sealed link over UDP, and says what it is told to: a
//! recorded trial that is sent again, or what a test wants.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use plumbline::limits::RING_PACKETS;
use plumbline::packet::{
    Action, Command, Message, Reply, ReplyOutcome, Start, UpdateOutcome, UpdateRefusal,
    UpdateReply, UpdateRequest, UpdateStep,
};
use plumbline::seal::{BoxEnd, Heard, Key, ListenerId, OWN_COMMAND, Peer, SEALED_BYTES_MAX};

/// It announces itself this often until a host listens.
const ANNOUNCE_EVERY: Duration = Duration::from_millis(50);

/// And this often while one does: there may be another.
const ANNOUNCE_HEARD_EVERY: Duration = Duration::from_millis(250);

/// A box that a host listens to.
pub struct SealedBox {
    pub(crate) socket: UdpSocket,
    pub(crate) host: SocketAddr,
    pub(crate) end: BoxEnd,
    begun: Instant,
    announced: Option<Instant>,
    /// Every packet of the stream, for hosts that ask for one again.
    pub(crate) sent: BTreeMap<u64, Vec<u8>>,
    /// What hosts have said, but for what is answered here.
    heard: Vec<(ListenerId, Message)>,
    /// When a host has asked for packets once more.
    asked: Option<Instant>,
}

impl SealedBox {
    /// A box that announces itself to a host; the start is that of its packets.
    ///
    /// # Errors
    /// When the system has no socket, or no random bytes.
    pub fn start(host: SocketAddr, start: Start, key: Option<Key>) -> std::io::Result<Self> {
        let any: IpAddr = match host {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = UdpSocket::bind((any, 0))?;
        socket.set_nonblocking(true)?;
        let mut secret = [0; 32];
        getrandom::fill(&mut secret).map_err(std::io::Error::other)?;
        Ok(Self {
            socket,
            host,
            end: BoxEnd::new(key, start, &secret),
            begun: Instant::now(),
            announced: None,
            sent: BTreeMap::new(),
            heard: Vec::new(),
            asked: None,
        })
    }

    /// Its end of the link.
    pub fn end(&mut self) -> &mut BoxEnd {
        &mut self.end
    }

    /// Says something to all that listen: poses, and what concerns everybody.
    ///
    /// # Panics
    /// When it cannot be sealed.
    pub fn send(&mut self, message: &Message) {
        self.serve();
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (counter, packet) = self.end.seal_to_all(message, &mut buffer).expect("a message");
        self.sent.insert(counter, packet.to_vec());
        if self.sent.len() > RING_PACKETS {
            self.sent.pop_first();
        }
        for (_, peer) in self.end.listeners() {
            self.pass(peer, &self.sent[&counter]);
        }
    }

    /// Says something to one host.
    ///
    /// # Panics
    /// When it cannot be sealed.
    pub fn send_to(&mut self, listener: ListenerId, message: &Message) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let Some(sealed) = self.end.seal_to(listener, message, &mut buffer) else { return };
        let (peer, packet) = sealed.expect("a message");
        let packet = packet.to_vec();
        self.pass(peer, &packet);
    }

    /// Answers a command.
    pub fn answer(&mut self, listener: ListenerId, id: u16, outcome: ReplyOutcome) {
        self.send_to(listener, &Message::Reply(Reply { id, outcome }));
    }

    /// What hosts have said since the last call, but for what keeps the link alive.
    pub fn receive(&mut self) -> Vec<(ListenerId, Message)> {
        self.serve();
        std::mem::take(&mut self.heard)
    }

    /// Keeps the link alive for as long.
    pub fn live(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.serve();
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Whether somebody listens.
    #[must_use]
    pub fn is_heard(&self) -> bool {
        !self.end.listeners().is_empty()
    }

    /// How long ago a host last asked for what it has missed.
    #[must_use]
    pub fn since_asked(&self) -> Option<Duration> {
        self.asked.map(|then| then.elapsed())
    }

    /// Takes what has come, and announces itself.
    pub(crate) fn serve(&mut self) {
        let every = if self.is_heard() { ANNOUNCE_HEARD_EVERY } else { ANNOUNCE_EVERY };
        if self.announced.is_none_or(|then| then.elapsed() >= every) {
            self.announced = Some(Instant::now());
            let packet = self.end.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec();
            self.pass(Peer::Udp(self.host), &packet);
        }
        let mut bytes = [0; 2048];
        while let Ok((length, from)) = self.socket.recv_from(&mut bytes) {
            let now_ns = self.begun.elapsed().as_nanos() as u64;
            let mut buffer = [0; SEALED_BYTES_MAX];
            let mut secret = [0; 32];
            getrandom::fill(&mut secret).expect("random bytes");
            let peer = Peer::Udp(from);
            match self.end.receive(peer, &bytes[..length], now_ns, || secret, &mut buffer) {
                Heard::Nothing | Heard::Left | Heard::Pairing(_) => {}
                Heard::Answer(packet) => {
                    let packet = packet.to_vec();
                    self.pass(peer, &packet);
                }
                Heard::Message { listener, message, .. } => self.take(listener, message),
                Heard::Update { request, .. } => self.refuse_update(&request),
            }
        }
    }

    /// Answers what the other end of the link asks by itself; keeps the rest.
    fn take(&mut self, listener: ListenerId, message: Message) {
        let stream_next = self.end.stream_next();
        match message {
            Message::Command(Command {
                id: OWN_COMMAND,
                action: Action::Ping { host_sent_ns },
                ..
            }) => {
                let box_ns = self.begun.elapsed().as_nanos() as u64;
                let outcome = ReplyOutcome::Pong {
                    host_sent_ns,
                    box_received_ns: box_ns,
                    box_sent_ns: box_ns,
                    stream_next,
                };
                self.answer(listener, OWN_COMMAND, outcome);
            }
            Message::Command(Command { action: Action::Resend { first, mask }, .. }) => {
                self.asked = Some(Instant::now());
                let Some((_, peer)) =
                    self.end.listeners().into_iter().find(|(id, _)| *id == listener)
                else {
                    return;
                };
                let oldest = self.sent.keys().next().copied().unwrap_or(stream_next);
                if first < oldest {
                    self.answer(listener, OWN_COMMAND, ReplyOutcome::Gone { first: oldest });
                }
                for bit in (0..64).filter(|bit| mask & (1 << bit) != 0) {
                    if let Some(packet) = self.sent.get(&(first + bit)) {
                        self.pass(peer, packet);
                    }
                }
            }
            message => self.heard.push((listener, message)),
        }
    }

    /// It has no card.
    fn refuse_update(&mut self, request: &UpdateRequest) {
        if let UpdateStep::Part { .. } = request.step {
            return;
        }
        let text = "it is no box, but a program that plays one".try_into().unwrap_or_default();
        let outcome = UpdateOutcome::Refused { refusal: UpdateRefusal::NotSupported, text };
        let reply = UpdateReply { id: request.id, version: heapless::String::new(), outcome };
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(Ok((peer, packet))) = self.end.seal_to_updater(&reply, &mut buffer) {
            let packet = packet.to_vec();
            self.pass(peer, &packet);
        }
    }

    fn pass(&self, to: Peer, packet: &[u8]) {
        if let Peer::Udp(to) = to {
            let _ = self.socket.send_to(packet, to);
        }
    }
}
