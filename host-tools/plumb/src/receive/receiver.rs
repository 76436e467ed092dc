//! What a reception knows: counters, the box's identity, the names of its
//! targets, the recording.

use std::collections::{BTreeMap, VecDeque};
use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, Command, Health, Hello, Message, PacketError, PosePacket, ResetReason,
};
use plumbline::target::Role;

use super::accounting::{Accounting, Arrival, Counts};
use super::recorder::{Names, Recorder};
use super::transport::Event;
use crate::error::BadInput;

/// Rows wait for the targets' names no longer than this: whatever ends the
/// program, no more than the last second is lost.
const NAMES_WAIT: Duration = Duration::from_millis(900);

/// A box that has not said its name is asked again after this time.
const REQUEST_EVERY: Duration = Duration::from_millis(200);

/// The rate shown is over this time.
const RATE_SPAN: Duration = Duration::from_secs(2);

/// How many packets were bad, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BadPackets {
    /// Bits changed on the way: checksum, COBS, length.
    pub corrupt: u64,
    /// Beginnings missed because listening began in the middle.
    pub fragments: u64,
    /// Intact, of another protocol version.
    pub other_version: u64,
    /// Intact, of this version, with another program's messages.
    pub other_schema: u64,
    /// Intact, of this schema, and yet no message.
    pub malformed: u64,
    /// Of another box.
    pub other_sender: u64,
}

/// One target's share of the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Share {
    /// Frames received.
    pub frames: u64,
    /// Frames with a pose.
    pub poses: u64,
}

/// A packet that waits for the targets' names.
struct Held {
    packet: PosePacket,
    /// When it came, if it begins a session.
    begins: Option<Instant>,
}

/// The state of a reception. It does no input or output but the recording.
pub struct Receiver<W: Write> {
    recorder: Option<Recorder<W>>,
    accounting: Accounting,
    bad: BadPackets,
    shares: BTreeMap<String, Share>,
    hello: Option<Hello>,
    health: Option<Health>,
    latest: Option<PosePacket>,
    arrivals: VecDeque<Instant>,
    line_losses: u64,
    /// The names in use in this session, once they are settled.
    names: Option<Names>,
    /// The names heard last.
    names_heard: Names,
    held: VecDeque<Held>,
    held_since: Option<Instant>,
    asked: Option<Instant>,
    commands: u16,
    notices: Vec<String>,
}

impl<W: Write> Receiver<W> {
    /// Before the first packet.
    #[must_use]
    pub fn new(recorder: Option<Recorder<W>>) -> Self {
        Self {
            recorder,
            accounting: Accounting::default(),
            bad: BadPackets::default(),
            shares: BTreeMap::new(),
            hello: None,
            health: None,
            latest: None,
            arrivals: VecDeque::new(),
            line_losses: 0,
            names: None,
            names_heard: Names::default(),
            held: VecDeque::new(),
            held_since: None,
            asked: None,
            commands: 0,
            notices: Vec::new(),
        }
    }

    /// Pose packets by what became of them.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.accounting.counts()
    }

    /// Packets that could not be used.
    #[must_use]
    pub fn bad(&self) -> BadPackets {
        self.bad
    }

    /// Each target's share of the frames, by name.
    #[must_use]
    pub fn shares(&self) -> &BTreeMap<String, Share> {
        &self.shares
    }

    /// The box's latest Hello.
    #[must_use]
    pub fn hello(&self) -> Option<&Hello> {
        self.hello.as_ref()
    }

    /// The box's latest Health.
    #[must_use]
    pub fn health(&self) -> Option<&Health> {
        self.health.as_ref()
    }

    /// The latest pose packet.
    #[must_use]
    pub fn latest(&self) -> Option<&PosePacket> {
        self.latest.as_ref()
    }

    /// How often the serial line was lost.
    #[must_use]
    pub fn line_losses(&self) -> u64 {
        self.line_losses
    }

    /// A target's name as known now.
    #[must_use]
    pub fn name(&self, role: Role) -> &str {
        self.names.as_ref().unwrap_or(&self.names_heard).name(role)
    }

    /// How many corners a target has, if the box has told.
    #[must_use]
    pub fn corners_total(&self, role: Role) -> Option<u8> {
        let hello = self.hello.as_ref()?;
        hello.targets.iter().find(|target| target.role == role).map(|target| target.corners)
    }

    /// Pose packets per second, lately.
    #[must_use]
    pub fn rate_hz(&self, now: Instant) -> f64 {
        let lately = |arrival: &&Instant| now.saturating_duration_since(**arrival) <= RATE_SPAN;
        let arrivals = self.arrivals.iter().filter(lately).count();
        let oldest = self.arrivals.iter().find(lately);
        let span = oldest.map_or(Duration::ZERO, |oldest| now.saturating_duration_since(*oldest));
        if arrivals < 2 { 0.0 } else { arrivals as f64 / span.as_secs_f64().max(0.1) }
    }

    /// What there is to say to the user since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// A message that the box should get: while the names are missing, the
    /// request for them.
    pub fn request(&mut self) -> Option<Message> {
        let since = self.held_since?;
        let now = Instant::now();
        if self.asked.is_some_and(|asked| asked >= since && now - asked < REQUEST_EVERY) {
            return None;
        }
        self.asked = Some(now);
        self.commands = self.commands.wrapping_add(1);
        Some(Message::Command(Command { id: self.commands, action: Action::SendHello }))
    }

    /// Takes note of what came in.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn handle(&mut self, event: Event, now: Instant) -> Result<(), BadInput> {
        match event {
            Event::Message(message) => self.message(message, now)?,
            Event::Bad(error) => self.bad_packet(error),
            Event::OtherSender(address) => {
                if self.bad.other_sender == 0 {
                    self.notices.push(format!(
                        "{address} sends here too; only the first box is recorded: \
                         give each box a port of its own"
                    ));
                }
                self.bad.other_sender += 1;
            }
            Event::LineLost(why) => {
                self.line_losses += 1;
                self.notices.push(format!("the serial line is lost ({why}); waiting for it"));
            }
            Event::LineBack => self.notices.push("the serial line is back".to_owned()),
        }
        Ok(())
    }

    /// Lets time pass: rows do not wait for the targets' names for ever.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn tick(&mut self, now: Instant) -> Result<(), BadInput> {
        if self.held_since.is_some_and(|since| now.saturating_duration_since(since) >= NAMES_WAIT) {
            self.notices.push(
                "the box has not told its targets' names: the recording uses those known so far"
                    .to_owned(),
            );
            return self.settle();
        }
        Ok(())
    }

    /// Writes what is still held.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn finish(&mut self) -> Result<(), BadInput> {
        if self.held.is_empty() { Ok(()) } else { self.settle() }
    }

    fn message(&mut self, message: Message, now: Instant) -> Result<(), BadInput> {
        match message {
            Message::Pose(packet) => return self.pose(packet, now),
            Message::Hello(hello) => return self.take_hello(hello),
            Message::Health(health) => {
                self.uptime(health.uptime_ms);
                self.health = Some(health);
            }
            Message::Log(log) => {
                self.uptime(log.uptime_ms);
                let cut = if log.cut == 0 {
                    String::new()
                } else {
                    format!(" (and {} bytes more)", log.cut)
                };
                let level = format!("{:?}", log.level).to_uppercase();
                let text: String =
                    log.text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
                self.notices.push(format!("box {level} {}: {text}{cut}", log.target));
            }
            // Ours, or none of ours.
            Message::Command(_) | Message::Reply(_) => (),
        }
        Ok(())
    }

    fn uptime(&mut self, uptime_ms: u64) {
        if self.accounting.uptime(uptime_ms) {
            self.names = None;
        }
    }

    fn take_hello(&mut self, hello: Hello) -> Result<(), BadInput> {
        if self.accounting.hello(hello.boot_id) {
            self.notices.push(format!("the box has started anew ({})", start_of(&hello)));
            // What is held belongs to the run before.
            self.finish()?;
            self.names = None;
        }
        self.names_heard = Names::of(&hello);
        self.hello = Some(hello);
        if self.names.is_none() || self.accounting.awaits_session() {
            self.settle()?;
        }
        Ok(())
    }

    fn pose(&mut self, packet: PosePacket, now: Instant) -> Result<(), BadInput> {
        let by_number = !self.accounting.awaits_session();
        let arrival = self.accounting.pose(packet.sequence, packet.capture_time_ns);
        let begins = match arrival {
            Arrival::Repeated => return Ok(()),
            Arrival::New { .. } | Arrival::Late => None,
            Arrival::NewSession => {
                let session = self.counts().sessions;
                if session > 1 {
                    self.notices.push(format!(
                        "session {session} begins: the box's frames begin again at {}",
                        packet.sequence
                    ));
                }
                if by_number {
                    self.finish()?;
                    self.names = None;
                }
                Some(now)
            }
        };
        self.arrivals.push_back(now);
        while self.arrivals.front().is_some_and(|first| now.duration_since(*first) > RATE_SPAN) {
            self.arrivals.pop_front();
        }
        if arrival != Arrival::Late {
            self.latest = Some(packet.clone());
        }
        self.held.push_back(Held { packet, begins });
        if self.names.is_some() {
            self.settle()
        } else {
            self.held_since.get_or_insert(now);
            Ok(())
        }
    }

    /// Uses the names known now for the rest of the session, and writes what
    /// has waited for them.
    fn settle(&mut self) -> Result<(), BadInput> {
        let names = self.names.get_or_insert_with(|| self.names_heard.clone());
        self.held_since = None;
        while let Some(Held { packet, begins }) = self.held.pop_front() {
            for target in &packet.targets {
                let name = names.name(target.role);
                if !self.shares.contains_key(name) {
                    self.shares.insert(name.to_owned(), Share::default());
                }
                if let Some(share) = self.shares.get_mut(name) {
                    share.frames += 1;
                    share.poses += u64::from(target.pose.is_ok());
                }
            }
            if let Some(recorder) = &mut self.recorder {
                if let Some(arrival) = begins {
                    recorder.start_session(packet.capture_time_ns, arrival);
                }
                recorder.write(&packet, names)?;
            }
        }
        Ok(())
    }

    fn bad_packet(&mut self, error: PacketError) {
        let (counter, remedy) = match error {
            PacketError::Fragment => (&mut self.bad.fragments, None),
            PacketError::Oversize
            | PacketError::Cobs
            | PacketError::Short
            | PacketError::Checksum => (&mut self.bad.corrupt, None),
            PacketError::OtherVersion { .. } => (
                &mut self.bad.other_version,
                Some("the box speaks another protocol: update the older of the two programs"),
            ),
            PacketError::OtherSchema { .. } => (
                &mut self.bad.other_schema,
                Some("the box's messages are another program's: update the older of the two"),
            ),
            PacketError::Body => (
                &mut self.bad.malformed,
                Some("the box sends intact packets without a sensible message: report it"),
            ),
        };
        *counter += 1;
        // Once is enough: such a box repeats itself at 60 Hz.
        if let Some(remedy) = remedy.filter(|_| *counter == 1) {
            self.notices.push(format!("{remedy} ({error})"));
        }
    }
}

/// Which start of the box this is and why, for people.
fn start_of(hello: &Hello) -> String {
    let reason = match hello.reset_reason {
        ResetReason::Unknown => "for a reason it does not know",
        ResetReason::PowerOn => "power on or an orderly restart",
        ResetReason::Watchdog => "the watchdog restarted it: no frame was processed for too long",
    };
    match hello.boot_count {
        Some(count) => format!("start {count}, {reason}"),
        None => reason.into(),
    }
}
