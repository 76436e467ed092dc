//! Which box a reception is of, which of its starts each packet belongs to, and what belongs to
//! neither.
//!
//! A reception is of one box: that of the first [`Hello`]. Each start of it is a session. Another
//! start begins one once its Hello has named the same box and the start before has been silent for
//! a while; until then its poses are held back.
//!
//! ```text
//! packet of ─┬ a session ─────────▶ a frame of that session: new, late, repeated, implausible
//!            ├ a start unknown yet ▶ held back ┬ the same box, the session before is silent ▶ a session
//!            │                                 ├ the same box, both send ───▶ a conflict: left out
//!            │                                 ├ another box ───────────────▶ left out
//!            │                                 └ no Hello in time ──────────▶ left out
//!            └ a host ────────────▶ nothing
//! ```
//!
//! Whatever is left out is counted. The judgement depends on nothing but the packets and their
//! times of arrival, so that a recording is judged anew as it was when it was made.

use std::collections::VecDeque;

use plumbline::packet::{Hello, Message, Packet, PosePacket, Start, Trigger};

use crate::accounting::{Accounting, Arrival, Counts};
use crate::others;

/// Poses of a start wait no longer for its Hello, which a box sends once a second and on request.
const HELLO_WAIT_NS: u64 = 6_000_000_000;

/// The most that waits: the poses of a camera of 1 kHz.
const HELD_MAX: usize = 6_000;

/// A start has ended when nothing of it has come for this long: a box sends a Health every second.
const QUIET_NS: u64 = 2_000_000_000;

/// What two starts of one box send at the same time may overlap by this, the time that a Health
/// may be under way. With more, they are not one box.
const OVERLAP_NS: u64 = 3_000_000_000;

/// A box that has been silent for this long while another one sends has been exchanged for it.
pub const EXCHANGED_NS: u64 = 3_000_000_000;

/// The first frame of a session is later than the last of the one before by at least this: more
/// than one and a half periods of the slowest camera, which every analysis takes for a gap.
const BORDER_S: f64 = 1.6;

/// Sessions whose late packets are still known as theirs.
const SESSIONS_MAX: usize = 8;

/// Starts besides the sessions' that are kept apart; packets of further ones count as unknown.
const STRANGERS_MAX: usize = 8;

/// The delay of packets is the smallest in this number of frames, and the same before.
const DELAY_FRAMES: u32 = 256;

/// Packets that are no part of what is received, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Of another box.
    pub other_box: u64,
    /// Of the same box by their Hello, but of another start while the session's still sends: two
    /// boxes have one serial number, or somebody pretends.
    pub conflicting: u64,
    /// Of a start that no Hello has named in time.
    pub unknown_start: u64,
}

/// The time of a session's frames on the common clock of all sessions: seconds since the first
/// frame of all.
///
/// Within a session times are the box's, exact to the nanosecond; between sessions they are only
/// as good as the arrival of the packets, and there is always a gap.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SessionClock {
    /// The capture time of the session's first frame.
    first_ns: u64,
    /// Its time on the common clock.
    first_s: f64,
}

impl SessionClock {
    /// The time of this capture time.
    #[must_use]
    pub fn time_s(&self, capture_ns: u64) -> f64 {
        // A packet that was overtaken can be older than the session's first.
        let since_ns = i128::from(capture_ns) - i128::from(self.first_ns);
        self.first_s + since_ns as f64 / 1e9
    }
}

/// What a packet has turned out to be, or one that was held back until now.
#[derive(Debug, PartialEq)]
pub enum Judged {
    /// A session begins.
    Begins {
        /// Its number, from 1.
        session: u32,
        /// Who the box is.
        hello: Hello,
    },
    /// A frame that was not there before.
    Frame(Frame),
    /// Something else of the box in its latest session.
    Message(Message),
    /// Something else of a start that no Hello has named.
    Unnamed(Message),
    /// Another box is heard.
    OtherBox(Hello),
    /// A second start of the box is heard while the first one sends.
    Conflict(Hello),
}

/// A frame in its place.
#[derive(Debug, PartialEq)]
pub struct Frame {
    /// The number of its session.
    pub session: u32,
    /// That session's clock.
    pub clock: SessionClock,
    /// It was overtaken by a later one.
    pub is_late: bool,
    /// When it came.
    pub arrival_ns: u64,
    /// What the box sent.
    pub packet: PosePacket,
}

/// The two boxes of an exchange.
#[derive(Debug, Clone, PartialEq)]
pub struct Exchanged {
    /// The one that fell silent.
    pub from: Hello,
    /// The one that sends.
    pub to: Hello,
}

/// A start of the box that is received.
#[derive(Debug)]
struct Session {
    number: u32,
    start: Start,
    hello: Hello,
    begun_ns: u64,
    /// When the latest packet came.
    heard_ns: u64,
    /// When the box has sent something, at the latest.
    sent_ns: u64,
    frames: Accounting,
    delay: Delay,
    clock: Option<SessionClock>,
    /// The latest frame's time.
    last_s: f64,
}

impl Session {
    /// When the box sent this at the latest: a pose that is late was sent before it came.
    fn sent_ns(&mut self, message: &Message, now_ns: u64) -> u64 {
        match message {
            Message::Pose(packet) => self.delay.sent_ns(packet.capture_time_ns, now_ns),
            _ => now_ns,
        }
    }
}

/// The smallest difference of arrival and capture time, lately.
#[derive(Debug, Default)]
struct Delay {
    before_ns: Option<i64>,
    least_ns: Option<i64>,
    frames: u32,
}

impl Delay {
    /// Takes note of a frame; returns when it would have come without waiting.
    fn sent_ns(&mut self, capture_ns: u64, now_ns: u64) -> u64 {
        let this_ns = now_ns.wrapping_sub(capture_ns).cast_signed();
        if self.frames == DELAY_FRAMES {
            *self = Self { before_ns: self.least_ns, least_ns: None, frames: 0 };
        }
        self.frames += 1;
        let least_ns = self.least_ns.map_or(this_ns, |it| it.min(this_ns));
        self.least_ns = Some(least_ns);
        let least_ns = self.before_ns.map_or(least_ns, |it| it.min(least_ns));
        capture_ns.wrapping_add_signed(least_ns)
    }
}

/// What is known of a start that is no session.
#[derive(Debug, PartialEq)]
enum Standing {
    /// No Hello yet.
    Unnamed,
    /// The same box; the session before may still send.
    Named(Hello),
    OtherBox(Hello),
    Conflict(Hello),
}

/// A start that is no session, or not yet.
#[derive(Debug)]
struct Stranger {
    start: Start,
    first_ns: u64,
    /// When the latest packet came.
    heard_ns: u64,
    standing: Standing,
    /// What waits for its Hello, and when it came.
    held: VecDeque<(u64, Held)>,
}

/// What is not said again.
#[derive(Debug)]
enum Held {
    Pose(Box<PosePacket>),
    Trigger(Trigger),
}

/// The sessions of one box, and what else is heard.
#[derive(Debug, Default)]
pub struct Sessions {
    /// The latest ones; the last is under way.
    sessions: VecDeque<Session>,
    /// How many there were.
    count: u32,
    strangers: Vec<Stranger>,
    /// Of the sessions that are not remembered any more.
    before: Counts,
    left_out: LeftOut,
    /// When the first frame of all came.
    first_arrival_ns: Option<u64>,
    exchanged: Option<Exchanged>,
    judged: VecDeque<Judged>,
}

impl Sessions {
    /// Pose packets of all sessions, by what became of them.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.sessions.iter().fold(self.before, |mut sum, session| {
            sum += session.frames.counts();
            sum
        })
    }

    /// Packets that belong to no session.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// How many sessions there were.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Whether poses wait for a Hello.
    #[must_use]
    pub fn awaits_hello(&self) -> bool {
        self.strangers.iter().any(|it| it.standing == Standing::Unnamed && !it.held.is_empty())
    }

    /// The exchange of the box for another one, if there was one: a reception ends with it.
    #[must_use]
    pub fn exchanged(&self) -> Option<&Exchanged> {
        self.exchanged.as_ref()
    }

    /// The next thing that has been judged.
    pub fn next_judged(&mut self) -> Option<Judged> {
        self.judged.pop_front()
    }

    /// Takes a packet that came at this time of a monotonic clock, whose zero does not matter.
    pub fn take(&mut self, packet: Packet, now_ns: u64) {
        self.pass(now_ns);
        let Packet { start, message } = packet;
        // Commands are this computer's own, or another program's.
        let Some(start) = start else { return };
        match self.sessions.iter().position(|session| session.start == start) {
            Some(index) => self.of_session(index, message, now_ns),
            None => self.of_stranger(start, message, now_ns),
        }
    }

    /// Lets time pass: a start does not wait for ever.
    pub fn pass(&mut self, now_ns: u64) {
        while let Some((index, due_ns)) = self.next_to_begin().filter(|(_, due)| *due <= now_ns) {
            self.expire(due_ns);
            self.begin(index);
        }
        self.expire(now_ns);
    }

    /// Nothing more comes: what waits is judged by what is known.
    pub fn finish(&mut self) {
        while let Some((index, _)) = self.next_to_begin() {
            let first_ns = self.strangers[index].first_ns;
            match self.sessions.back() {
                Some(session) if session.sent_ns > first_ns => self.leave_in_conflict(index),
                _ => self.begin(index),
            }
        }
        self.expire(u64::MAX);
    }

    /// The start that becomes the next session, and when: once the one before it is silent.
    fn next_to_begin(&self) -> Option<(usize, u64)> {
        let quiet_ns = self.sessions.back().map_or(0, |it| it.heard_ns.saturating_add(QUIET_NS));
        let is_named = |stranger: &Stranger| matches!(stranger.standing, Standing::Named(_));
        let index = self.strangers.iter().position(is_named)?;
        Some((index, quiet_ns))
    }

    /// A start becomes a session.
    fn begin(&mut self, index: usize) {
        let Stranger { start, first_ns, heard_ns, standing, held } = self.strangers.remove(index);
        let Standing::Named(hello) = standing else { return };
        self.count += 1;
        if self.sessions.len() == SESSIONS_MAX
            && let Some(oldest) = self.sessions.pop_front()
        {
            self.before += oldest.frames.counts();
        }
        self.judged.push_back(Judged::Begins { session: self.count, hello: hello.clone() });
        self.sessions.push_back(Session {
            number: self.count,
            start,
            hello,
            begun_ns: first_ns,
            heard_ns,
            sent_ns: heard_ns,
            frames: Accounting::default(),
            delay: Delay::default(),
            clock: None,
            last_s: 0.0,
        });
        for (arrival_ns, held) in held {
            match held {
                Held::Pose(packet) => self.pose(self.sessions.len() - 1, *packet, arrival_ns),
                Held::Trigger(trigger) => {
                    self.judged.push_back(Judged::Message(Message::Trigger(trigger)));
                }
            }
        }
    }

    /// What has waited for too long is left out.
    fn expire(&mut self, now_ns: u64) {
        for stranger in &mut self.strangers {
            let is_over =
                |(came_ns, _): &(u64, Held)| now_ns.saturating_sub(*came_ns) >= HELLO_WAIT_NS;
            while stranger.held.front().is_some_and(is_over) {
                stranger.held.pop_front();
                self.left_out.unknown_start += 1;
            }
        }
    }

    fn of_session(&mut self, index: usize, message: Message, now_ns: u64) {
        let is_latest = index + 1 == self.sessions.len();
        let begun_ns = self.sessions.back().map_or(0, |it| it.begun_ns);
        let session = &mut self.sessions[index];
        let sent_ns = session.sent_ns(&message, now_ns);
        if !is_latest && sent_ns > begun_ns.saturating_add(OVERLAP_NS) {
            // It has not ended, although another start has begun.
            let hello = session.hello.clone();
            if self.left_out.conflicting == 0 {
                self.judged.push_back(Judged::Conflict(hello));
            }
            self.left_out.conflicting += 1;
            return;
        }
        session.heard_ns = now_ns;
        session.sent_ns = session.sent_ns.max(sent_ns);
        if is_latest {
            self.find_conflicts(sent_ns);
        }
        match message {
            Message::Pose(packet) => self.pose(index, packet, now_ns),
            Message::Hello(hello) if !others::is_same_box(&hello, &self.sessions[index].hello) => {
                self.left_out.other_box += 1;
            }
            message if is_latest => self.judged.push_back(Judged::Message(message)),
            // Of a start that is over.
            _ => {}
        }
    }

    /// Starts of the box that were heard well before the session sent this are no later ones.
    fn find_conflicts(&mut self, sent_ns: u64) {
        for index in 0..self.strangers.len() {
            if sent_ns > self.strangers[index].first_ns.saturating_add(OVERLAP_NS) {
                self.leave_in_conflict(index);
            }
        }
    }

    /// A named start is left out, because the one before it still sends.
    fn leave_in_conflict(&mut self, index: usize) {
        let stranger = &mut self.strangers[index];
        let Standing::Named(hello) = &stranger.standing else { return };
        self.judged.push_back(Judged::Conflict(hello.clone()));
        // Its Hello, and what was held back.
        self.left_out.conflicting += 1 + stranger.held.len() as u64;
        stranger.held.clear();
        stranger.standing = Standing::Conflict(hello.clone());
    }

    fn pose(&mut self, index: usize, packet: PosePacket, now_ns: u64) {
        let before = index.checked_sub(1).map(|before| &self.sessions[before]);
        // The very first packet may have been late: sessions follow one another all the same.
        let from_s = before.map_or(0.0, |it| it.last_s + BORDER_S);
        let session = &mut self.sessions[index];
        let arrival = session.frames.pose(packet.sequence, packet.capture_time_ns, now_ns);
        if !arrival.is_frame() {
            return;
        }
        let clock = *session.clock.get_or_insert_with(|| {
            let first_ns = *self.first_arrival_ns.get_or_insert(now_ns);
            let since_s = now_ns.saturating_sub(first_ns) as f64 / 1e9;
            SessionClock { first_ns: packet.capture_time_ns, first_s: since_s.max(from_s) }
        });
        session.last_s = session.last_s.max(clock.time_s(packet.capture_time_ns));
        self.judged.push_back(Judged::Frame(Frame {
            session: session.number,
            clock,
            is_late: arrival == Arrival::Late,
            arrival_ns: now_ns,
            packet,
        }));
    }

    fn of_stranger(&mut self, start: Start, message: Message, now_ns: u64) {
        let known = self.strangers.iter().position(|it| it.start == start);
        let index = known.unwrap_or_else(|| self.meet(start, now_ns));
        let stranger = &mut self.strangers[index];
        stranger.heard_ns = now_ns;
        match (&stranger.standing, message) {
            (Standing::OtherBox(_), _) => self.left_out.other_box += 1,
            (Standing::Conflict(_), _) => self.left_out.conflicting += 1,
            (Standing::Unnamed | Standing::Named(_), Message::Pose(packet)) => {
                self.hold(index, Held::Pose(Box::new(packet)), now_ns);
            }
            (Standing::Unnamed | Standing::Named(_), Message::Trigger(trigger)) => {
                self.hold(index, Held::Trigger(trigger), now_ns);
            }
            (Standing::Unnamed, Message::Hello(hello)) => self.name(index, hello, now_ns),
            (Standing::Unnamed, message) => self.judged.push_back(Judged::Unnamed(message)),
            // What it says of itself will be said again.
            (Standing::Named(_), _) => {}
        }
        self.find_exchange(start, now_ns);
    }

    fn hold(&mut self, index: usize, held: Held, now_ns: u64) {
        let stranger = &mut self.strangers[index];
        if stranger.held.len() == HELD_MAX {
            stranger.held.pop_front();
            self.left_out.unknown_start += 1;
        }
        stranger.held.push_back((now_ns, held));
    }

    /// A start that was not heard before, in place of one that matters least if there are many.
    fn meet(&mut self, start: Start, now_ns: u64) -> usize {
        if self.strangers.len() == STRANGERS_MAX {
            let matters = |it: &Stranger| (it.standing != Standing::Unnamed, it.heard_ns);
            let least = (0..STRANGERS_MAX).min_by_key(|at| matters(&self.strangers[*at]));
            let forgotten = least.map(|at| self.strangers.remove(at));
            self.left_out.unknown_start += forgotten.map_or(0, |it| it.held.len() as u64);
        }
        self.strangers.push(Stranger {
            start,
            first_ns: now_ns,
            heard_ns: now_ns,
            standing: Standing::Unnamed,
            held: VecDeque::new(),
        });
        self.strangers.len() - 1
    }

    /// A start has said which box it is of.
    fn name(&mut self, index: usize, hello: Hello, now_ns: u64) {
        let stranger = &mut self.strangers[index];
        let the_box = self.sessions.back().map(|session| &session.hello);
        if the_box.is_some_and(|the_box| !others::is_same_box(the_box, &hello)) {
            self.left_out.other_box += 1 + stranger.held.len() as u64;
            stranger.held.clear();
            stranger.standing = Standing::OtherBox(hello.clone());
            self.judged.push_back(Judged::OtherBox(hello));
            return;
        }
        stranger.standing = Standing::Named(hello);
        self.pass(now_ns);
    }

    /// Notices that the box has been exchanged, when a packet of another one comes.
    fn find_exchange(&mut self, start: Start, now_ns: u64) {
        let Some(session) = self.sessions.back() else { return };
        let Some(stranger) = self.strangers.iter().find(|it| it.start == start) else { return };
        if let Standing::OtherBox(to) | Standing::Conflict(to) = &stranger.standing
            && now_ns.saturating_sub(session.heard_ns) >= EXCHANGED_NS
        {
            let from = session.hello.clone();
            self.exchanged.get_or_insert_with(|| Exchanged { from, to: to.clone() });
        }
    }
}

#[cfg(test)]
mod tests;
