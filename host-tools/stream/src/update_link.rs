//! The link to a box that is updated, of whatever release it is: see [`UpdateEnd`].
//!
//! The link may lose and repeat packets. A request is repeated until it is answered, with another
//! number each time; repeating one does no harm. No wait is unlimited.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use plumbline::packet::{
    LinkKind, Start, UPDATE_PART_BYTES_MAX, UpdateOutcome, UpdateReply, UpdateRequest, UpdateStep,
};
use plumbline::seal::{
    Announcement, Caller, Key, Peer, SEALED_BYTES_MAX, ToldOfUpdate, UpdateEnd, greeting,
};
use plumbline_files::BadInput;

use crate::deadline::Deadline;
use crate::link::{HEARD_WITHIN, NOT_HEARD_REMEDY};
use crate::text;
use crate::transport::{
    Arrived, Carrier, GREET_EVERY, KnownBox, Memory, caller, draw, token, words_of_other,
};

/// The wait for packets.
const WAIT: Duration = Duration::from_millis(20);

/// A request is repeated after this time.
const ANSWER_WITHIN: Duration = Duration::from_millis(700);

/// The most times that a request is sent.
const TRIES: usize = 8;

/// Parts that are sent before the box is asked how far it is: few enough for its socket, or for a third
/// of a second of a serial line.
const PARTS_ON_UDP: usize = 128;
const PARTS_ON_SERIAL: usize = 16;

/// What a box has answered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// Which start of the box.
    pub start: Start,
    /// The program that it runs.
    pub version: String,
    /// What came of the request.
    pub outcome: UpdateOutcome,
}

/// The link to a box that is updated. When it is dropped the box is told, so that another host can
/// update it at once.
pub struct UpdateLink {
    carrier: Box<dyn Carrier>,
    place: String,
    kind: LinkKind,
    boxes: Vec<KnownBox>,
    caller: Caller,
    memory: Box<dyn Memory>,
    begun: Instant,
    end: Option<UpdateEnd>,
    greeted: Option<Instant>,
    /// Where the box was remembered to be.
    remembered: Option<SocketAddr>,
    /// A box that cannot be updated says that it is there.
    waiting: Option<Announcement>,
    last_id: u16,
    /// When the box last answered.
    answered: Option<Instant>,
}

impl UpdateLink {
    /// A link to the first of these boxes that is heard, unless there is only one that it can be, for a
    /// program of this name; `place` names it in messages.
    #[must_use]
    pub fn new(
        carrier: Box<dyn Carrier>,
        place: String,
        kind: LinkKind,
        boxes: Vec<KnownBox>,
        program: &str,
        memory: Box<dyn Memory>,
    ) -> Self {
        let mut link = Self {
            carrier,
            place,
            kind,
            boxes,
            caller: caller(program),
            memory,
            begun: Instant::now(),
            end: None,
            greeted: None,
            remembered: None,
            waiting: None,
            last_id: 0,
            answered: None,
        };
        if let [KnownBox { key, address: Some(address), .. }] = &link.boxes[..] {
            let (key, peer) = (key.clone(), Peer::Udp(*address));
            link.choose(key, peer);
        }
        link
    }

    /// Its name in messages.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// The most bytes that are to be sent before the box is asked how far it is.
    #[must_use]
    pub fn bytes_at_once(&self) -> usize {
        let parts = match self.kind {
            LinkKind::Serial => PARTS_ON_SERIAL,
            LinkKind::Udp | LinkKind::File => PARTS_ON_UDP,
        };
        parts * UPDATE_PART_BYTES_MAX
    }

    /// Repeats a request until it is answered.
    ///
    /// # Errors
    /// When no box is heard, it does not answer, or the link can no longer be used.
    pub fn ask(&mut self, step: &UpdateStep) -> Result<Answer, BadInput> {
        let mut heard = Deadline::after(HEARD_WITHIN);
        while self.peer().is_none() {
            heard.look(|| self.poll()).ok_or_else(|| self.not_heard())??;
        }
        let first = self.last_id.wrapping_add(1);
        for _ in 0..TRIES {
            self.last_id = self.last_id.wrapping_add(1);
            self.send(UpdateRequest { id: self.last_id, step: step.clone() });
            let mut answer = Deadline::after(ANSWER_WITHIN);
            while let Some(replies) = answer.look(|| self.poll()) {
                for (start, UpdateReply { id, version, outcome }) in replies? {
                    if id.wrapping_sub(first) < TRIES as u16 {
                        self.answered = Some(Instant::now());
                        let version = version.as_str().to_owned();
                        return Ok(Answer { start, version, outcome });
                    }
                }
            }
        }
        Err(BadInput::whole(
            &self.place,
            "the box does not answer what it is asked about the update",
            "check with `plumb doctor` that nothing stops packets on the way to the box",
        ))
    }

    /// Whether the box has answered nothing since then.
    #[must_use]
    pub fn is_silent_since(&self, then: Instant) -> bool {
        self.answered.is_none_or(|answered| answered < then)
    }

    /// Sends bytes of an update's file that begin at `offset` in it, without waiting for anything.
    pub fn send_parts(&mut self, offset: usize, bytes: &[u8]) {
        for (index, bytes) in bytes.chunks(UPDATE_PART_BYTES_MAX).enumerate() {
            let offset = (offset + index * UPDATE_PART_BYTES_MAX) as u32;
            let bytes = bytes.iter().copied().collect();
            self.send(UpdateRequest { id: 0, step: UpdateStep::Part { offset, bytes } });
        }
    }

    /// Lets time pass with an open ear.
    ///
    /// # Errors
    /// When the link can no longer be used.
    pub fn wait(&mut self, time: Duration) -> Result<(), BadInput> {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.poll()?;
        }
        Ok(())
    }

    fn peer(&self) -> Option<Peer> {
        self.end.as_ref().and_then(UpdateEnd::peer)
    }

    fn not_heard(&self) -> BadInput {
        match &self.waiting {
            Some(announcement) => {
                let (what, remedy) = words_of_other(None, announcement);
                BadInput::whole(&self.place, what, remedy)
            }
            None => BadInput::whole(&self.place, "no box is heard", NOT_HEARD_REMEDY),
        }
    }

    fn choose(&mut self, key: Key, peer: Peer) {
        self.end = Some(UpdateEnd::new(key, self.caller.clone(), Some(peer)));
    }

    fn now_ns(&self) -> u64 {
        self.begun.elapsed().as_nanos() as u64
    }

    fn send(&mut self, request: UpdateRequest) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        if let Some(end) = &mut self.end
            && let Some(Ok((peer, packet))) = end.seal(&request, &mut buffer)
        {
            self.carrier.send(peer, packet);
        }
    }

    /// Sends what is due, and waits a moment for what comes: the box's replies.
    fn poll(&mut self) -> Result<Vec<(Start, UpdateReply)>, BadInput> {
        self.send_due();
        // The carrier is lent while it hands over what came.
        let mut arrived = Vec::new();
        self.carrier.poll(WAIT, &mut |one| {
            if let Arrived::Packet { from, bytes } = one {
                arrived.push((from, bytes.to_vec()));
            }
        })?;
        let replies = arrived.iter().filter_map(|(from, bytes)| self.take(*from, bytes)).collect();
        self.remember();
        Ok(replies)
    }

    fn send_due(&mut self) {
        let now_ns = self.now_ns();
        let mut buffer = [0; SEALED_BYTES_MAX];
        match &mut self.end {
            Some(end) => {
                while let Some((peer, packet)) = end.due(now_ns, draw, &mut buffer) {
                    self.carrier.send(peer, packet);
                }
            }
            None => {
                let is_due = self.greeted.is_none_or(|then| then.elapsed() >= GREET_EVERY);
                if let Some(peer) = self.carrier.only_peer().filter(|_| is_due) {
                    self.greeted = Some(Instant::now());
                    self.carrier.send(peer, greeting(token(), &mut buffer));
                }
            }
        }
    }

    fn take(&mut self, from: Peer, bytes: &[u8]) -> Option<(Start, UpdateReply)> {
        if let Some(announcement) = Announcement::parse(bytes) {
            let known = self.boxes.iter().find(|it| announcement.key_id == Some(it.key.id()));
            match known.map(|it| it.key.clone()) {
                Some(key) if self.end.is_none() => self.choose(key, from),
                Some(_) => {}
                None => self.waiting = Some(announcement),
            }
        }
        let now_ns = self.now_ns();
        let mut buffer = [0; SEALED_BYTES_MAX];
        match self.end.as_mut()?.receive(from, bytes, now_ns, draw, &mut buffer) {
            ToldOfUpdate::Nothing | ToldOfUpdate::Handshake(None) => None,
            ToldOfUpdate::Handshake(Some(packet)) => {
                self.carrier.send(from, packet);
                None
            }
            ToldOfUpdate::Reply { start, reply } => Some((start, text::printable_reply(reply))),
        }
    }

    /// Has it remembered where the box is, if there is a session now.
    fn remember(&mut self) {
        if let Some(end) = &self.end
            && let Some(Peer::Udp(address)) = end.peer()
            && self.remembered.replace(address) != Some(address)
        {
            self.memory.met_at(end.key().id(), address);
        }
    }
}

/// However a program ends but by being killed, the box hears of it.
impl Drop for UpdateLink {
    fn drop(&mut self) {
        self.last_id = self.last_id.wrapping_add(1);
        self.send(UpdateRequest { id: self.last_id, step: UpdateStep::Leave });
    }
}
