//! What comes over the links: mostly nothing, sometimes a flood.
//!
//! Anybody may send datagrams. What is not authentic is thrown away for little; what is answered or
//! acted on is bounded in each turn, so that frames are not late for it.

use std::time::{Duration, Instant};

use plumbline::packet::{Message, Reply, UpdateRequest, UpdateStep};
use plumbline::seal::{
    BoxEnd, Heard, Key, ListenerId, Paired, Peer, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX,
    UpdaterId,
};

use super::udp::DATAGRAM_BYTES_MAX;
use super::{Links, requests};
use crate::machine::clock;
use crate::random;

/// Datagrams that are read in one turn: at 60 turns a second more than 50,000 a second are read and
/// thrown away.
const DATAGRAMS_PER_TURN_MAX: usize = 1024;

/// Frames of the serial line that are read in one turn.
const FRAMES_PER_TURN_MAX: usize = 64;

/// Messages of listeners that are acted on in one turn, of those that come over UDP and of those that
/// come over the serial line; the others wait.
pub const MESSAGES_PER_TURN_MAX: usize = 16;

/// Parts of documents that are taken in one turn, which are as cheap as what is thrown away.
const PARTS_PER_TURN_MAX: usize = 64;

/// Handshakes that are answered in one turn; hosts ask again.
const ANSWERS_PER_TURN_MAX: usize = 128;

/// The longest time for reading in one turn: a quarter of a frame at 60 Hz.
const TIME_PER_TURN_MAX: Duration = Duration::from_millis(4);

/// What a host with the box's key says, and the link does not answer by itself.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "it is handed over at once, and never kept")]
pub enum Said {
    /// A listener says this.
    Message(ListenerId, Message),
    /// The program that updates the box asks this.
    Request(UpdaterId, UpdateRequest),
}

/// What else has happened while messages came.
#[derive(Debug, Clone, Copy, Default)]
pub struct Arrivals {
    /// A listener has joined, or joined anew.
    pub has_joined: bool,
    /// The box has another key, and none of its listeners any more.
    pub is_paired: bool,
    /// Somebody has asked for packets once more.
    pub is_asked_again: bool,
    messages: usize,
    parts: usize,
    answers: usize,
}

impl Arrivals {
    /// Whether a host with the box's key has said anything.
    #[must_use]
    pub fn is_heard(&self) -> bool {
        self.messages + self.parts > 0
    }

    /// Whether the others must wait for the next turn.
    fn is_full(&self) -> bool {
        self.messages == MESSAGES_PER_TURN_MAX || self.parts == PARTS_PER_TURN_MAX
    }
}

impl Links {
    /// Passes on what hosts have said since the last call, except what the link itself answers.
    pub fn receive(&mut self, mut take: impl FnMut(Said)) -> Arrivals {
        let mut arrivals = Arrivals::default();
        let give_up = Instant::now() + TIME_PER_TURN_MAX;
        let mut datagram = [0; DATAGRAM_BYTES_MAX];
        for _ in 0..DATAGRAMS_PER_TURN_MAX {
            if arrivals.is_full() || Instant::now() >= give_up {
                break;
            }
            let Some(udp) = &mut self.ports.udp else { break };
            let Some((length, from)) = udp.receive(&mut datagram) else { break };
            if length <= SEALED_BYTES_MAX {
                self.hear(Peer::Udp(from), &datagram[..length], &mut arrivals, &mut take);
            }
        }
        if !self.ports.hears_serial() {
            return arrivals;
        }
        // A flood on the network does not cost what the cable says.
        let before = (std::mem::take(&mut arrivals.messages), std::mem::take(&mut arrivals.parts));
        let mut frame = [0; SEALED_FRAME_BYTES_MAX];
        for _ in 0..FRAMES_PER_TURN_MAX {
            let Some(serial) = &mut self.ports.serial else { break };
            let Some(length) = serial.receive(&mut frame) else { break };
            self.hear(Peer::Serial, &frame[..length], &mut arrivals, &mut take);
            if arrivals.is_full() {
                break;
            }
        }
        arrivals.messages += before.0;
        arrivals.parts += before.1;
        arrivals
    }

    fn hear(
        &mut self,
        from: Peer,
        packet: &[u8],
        arrivals: &mut Arrivals,
        take: &mut impl FnMut(Said),
    ) {
        let now_ns = clock::monotonic_ns();
        let mut answer = [0; SEALED_BYTES_MAX];
        match self.end.receive(from, packet, now_ns, random::bytes, &mut answer) {
            Heard::Nothing => {}
            Heard::Answer(answer) => {
                if arrivals.answers < ANSWERS_PER_TURN_MAX {
                    arrivals.answers += 1;
                    self.ports.send(from, answer);
                }
            }
            Heard::Message { listener, has_joined, message } => {
                match message {
                    Message::Part(_) => arrivals.parts += 1,
                    _ => arrivals.messages += 1,
                }
                if has_joined {
                    arrivals.has_joined = true;
                    requests::log_joined(from);
                }
                self.take(listener, message, now_ns, arrivals, take);
            }
            Heard::Update { updater, request } => {
                match request.step {
                    UpdateStep::Part { .. } => arrivals.parts += 1,
                    _ => arrivals.messages += 1,
                }
                take(Said::Request(updater, request));
            }
            Heard::Left => {
                // As cheap as they are, a program that joins and leaves again and again gets no more
                // of a turn than others.
                arrivals.messages += 1;
                requests::log_left(from);
            }
            Heard::Pairing(key) => self.pair(key, arrivals),
        }
    }

    fn take(
        &mut self,
        listener: ListenerId,
        message: Message,
        now_ns: u64,
        arrivals: &mut Arrivals,
        take: &mut impl FnMut(Said),
    ) {
        let Message::Command(command) = &message else {
            take(Said::Message(listener, message));
            return;
        };
        match self.answer(listener, command, now_ns) {
            requests::Answer::Outcome(outcome) => {
                let reply = Message::Reply(Reply { id: command.id, outcome });
                self.send_to(listener, &reply);
            }
            requests::Answer::Silent => arrivals.is_asked_again = true,
            requests::Answer::Elsewhere => take(Said::Message(listener, message)),
        }
    }

    /// Stores a key that came over the cable, and uses it from now on.
    fn pair(&mut self, key: Key, arrivals: &mut Arrivals) {
        let now_ns = clock::monotonic_ns();
        let key_id = key.id();
        let is_known = self.end.key().map(Key::id) == Some(key_id);
        let stored = match &self.store {
            _ if is_known => Ok(()),
            Some(store) => store.store(&key),
            None => Err(anyhow::anyhow!("there is no card to keep it")),
        };
        match &stored {
            Ok(()) if is_known => {}
            Ok(()) => {
                log::warn!(
                    "the key {key_id} has come over the serial line; it is used from now on"
                );
                self.end = BoxEnd::new(Some(key), self.start, &random::bytes());
                self.description = self.description.paired(self.is_refusing);
                self.describe(now_ns);
                self.announcing.hurry();
                arrivals.is_paired = true;
            }
            Err(error) => {
                log::error!(
                    "the key {key_id} that has come over the serial line is not stored: {error:#}"
                );
            }
        }
        let paired = Paired { key_id, is_stored: stored.is_ok() };
        self.ports.send(Peer::Serial, paired.packet(&mut [0; SEALED_BYTES_MAX]));
    }
}
