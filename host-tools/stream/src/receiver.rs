//! What a reception knows: counters, the box's identity, the names of its
//! targets, the recording.

use std::collections::{BTreeMap, VecDeque};
use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, CameraState, Command, Health, Hello, Log, LogLevel, Message, PacketError, PosePacket,
    ResetReason,
};
use plumbline::target::Role;
use plumbline_files::BadInput;

use crate::accounting::{Accounting, Arrival, Counts};
use crate::bad_packets::BadPackets;
use crate::complaints;
use crate::others::{self, Others, is_same_box};
use crate::power::PowerSeen;
use crate::recorder::{Names, Recorder};
use crate::transport::Event;

/// Rows wait for the targets' names no longer than this: whatever ends the
/// program, no more than the last second is lost.
const NAMES_WAIT: Duration = Duration::from_millis(900);

/// A box that has not said its name is asked again after this time.
const REQUEST_EVERY: Duration = Duration::from_millis(200);

/// The rate shown is over this time.
const RATE_SPAN: Duration = Duration::from_secs(2);

/// A pose is the latest for no longer than this; the slowest camera gives one a second.
const FRESH: Duration = Duration::from_millis(1500);

/// A box that has said nothing for so long is not heard any more.
const UNHEARD: Duration = Duration::from_secs(3);

/// So many of the box's own messages are remembered.
const TOLD_MAX: usize = 16;

/// One target's share of the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Share {
    /// Frames received.
    pub frames: u64,
    /// Frames with a pose.
    pub poses: u64,
}

/// From one start of a box to the next.
#[derive(Debug, Default)]
pub struct Run {
    /// Who the box is, once it has told.
    pub hello: Option<Hello>,
    /// Frames received.
    pub frames: u64,
}

/// The box's camera, as its Health tells.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// How it is, or was before the box's program ended.
    pub state: CameraState,
    /// When that was heard first.
    pub since: Instant,
    /// It was so when the box was first heard, and perhaps long before.
    pub from_before: bool,
    /// The box's program has ended.
    pub ended: bool,
}

impl Camera {
    /// There is no camera that gives frames.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        matches!(self.state, CameraState::Lost | CameraState::Stalled)
    }
}

/// What the box has said of itself.
struct Told {
    level: LogLevel,
    text: String,
}

/// A packet that waits for the targets' names.
struct Held {
    packet: PosePacket,
    /// The number of the session that it begins, if so, and when it came.
    begins: Option<(u32, Instant)>,
}

/// The state of a reception. It does no input or output but the recording.
pub struct Receiver<W: Write> {
    recorder: Option<Recorder<W>>,
    accounting: Accounting,
    bad: BadPackets,
    others: Others,
    shares: BTreeMap<String, Share>,
    /// The last one is under way.
    runs: Vec<Run>,
    health: Option<Health>,
    /// In all runs.
    power: PowerSeen,
    camera: Option<Camera>,
    /// Since the camera's state has changed.
    told: VecDeque<Told>,
    latest: Option<PosePacket>,
    latest_came: Option<Instant>,
    /// When anything of the box came last.
    heard: Option<Instant>,
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
            others: Others::default(),
            shares: BTreeMap::new(),
            runs: vec![Run::default()],
            health: None,
            power: PowerSeen::default(),
            camera: None,
            told: VecDeque::new(),
            latest: None,
            latest_came: None,
            heard: None,
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

    /// The runs of the box, or of the boxes one after the other; never none.
    #[must_use]
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The latest Health of this run.
    #[must_use]
    pub fn health(&self) -> Option<&Health> {
        self.health.as_ref()
    }

    /// What the box has told of its power, in all runs.
    #[must_use]
    pub fn power(&self) -> PowerSeen {
        self.power
    }

    /// The camera of this run, once the box has told of it.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        self.camera
    }

    /// The faults that the box has told of since its camera's state has changed.
    #[must_use]
    pub fn faults(&self) -> String {
        let faults = self.told.iter().filter(|told| told.level == LogLevel::Error);
        faults.map(|told| told.text.as_str()).collect::<Vec<_>>().join(" ")
    }

    /// The latest pose packet of this run, unless it is an old one.
    #[must_use]
    pub fn latest(&self, now: Instant) -> Option<&PosePacket> {
        self.latest.as_ref().filter(|_| self.silence(now).is_some_and(|silence| silence <= FRESH))
    }

    /// How long ago the latest pose packet of all runs came.
    #[must_use]
    pub fn silence(&self, now: Instant) -> Option<Duration> {
        self.latest_came.map(|came| now.saturating_duration_since(came))
    }

    /// How long the box has been silent, if for too long: it says how it is once a second,
    /// unless its program has ended.
    #[must_use]
    pub fn unheard(&self, now: Instant) -> Option<Duration> {
        let silence = now.saturating_duration_since(self.heard?);
        let has_ended = self.camera.is_some_and(|camera| camera.ended);
        (silence >= UNHEARD && !has_ended).then_some(silence)
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
        let hello = self.runs.last()?.hello.as_ref()?;
        hello.targets.iter().find(|target| target.role == role).map(|target| target.corners)
    }

    /// Pose packets per second, lately.
    #[must_use]
    pub fn rate_hz(&self, now: Instant) -> f64 {
        let lately = |arrival: &&Instant| now.saturating_duration_since(**arrival) <= RATE_SPAN;
        let mut arrivals = self.arrivals.iter().filter(lately);
        let Some(first) = arrivals.next() else { return 0.0 };
        // From the first on, each packet has come one period after another.
        let (periods, last) = arrivals.fold((0, first), |(count, _), arrival| (count + 1, arrival));
        f64::from(periods) / (*last - *first).as_secs_f64().max(0.1)
    }

    /// What there is to say to the user since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// A message that the box should get: while the names are missing, the
    /// request for them.
    pub fn request(&mut self, now: Instant) -> Option<Message> {
        let since = self.held_since?;
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
            Event::OtherSender { from, hello } => {
                self.bad.other_sender += 1;
                if let Some(news) = self.others.take(from, hello.as_ref()) {
                    self.notices.push(format!(
                        "{news}; only the first box is recorded: give each box a port of its own"
                    ));
                }
            }
            Event::LineLost(why) => {
                self.line_losses += 1;
                self.notices.push(format!("the serial line is lost ({why}); waiting for it"));
            }
            // The next event says what it is.
            Event::Raw(_) => {}
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
        self.heard = Some(now);
        match message {
            Message::Pose(packet) => return self.pose(packet, now),
            Message::Hello(hello) => return self.take_hello(hello),
            Message::Health(health) => {
                self.uptime(health.uptime_ms)?;
                self.take_camera(health.camera, now);
                self.take_set_up_mode(health.aiming_s > 0);
                let news = self.power.take(&health);
                self.notices.extend(news.iter().map(|news| format!("warning: {news}")));
                self.health = Some(health);
            }
            Message::Log(log) => {
                self.uptime(log.uptime_ms)?;
                self.take_log(&log);
            }
            // Ours, or for another program on this computer.
            Message::Command(_)
            | Message::Reply(_)
            | Message::View(_)
            | Message::Picture(_)
            | Message::Part(_) => (),
        }
        Ok(())
    }

    fn uptime(&mut self, uptime_ms: u64) -> Result<(), BadInput> {
        if self.accounting.uptime(uptime_ms) { self.start_run() } else { Ok(()) }
    }

    /// The box has started anew: what was known of the run before does not hold any more.
    fn start_run(&mut self) -> Result<(), BadInput> {
        // What is held belongs to the run before.
        self.finish()?;
        self.runs.push(Run::default());
        self.names = None;
        self.health = None;
        self.camera = None;
        self.told.clear();
        self.latest = None;
        self.arrivals.clear();
        Ok(())
    }

    fn take_camera(&mut self, state: CameraState, now: Instant) {
        match &mut self.camera {
            Some(camera) if state == CameraState::Ended => camera.ended = true,
            Some(camera) if camera.state == state => {}
            known => {
                let from_before = known.is_none();
                let ended = state == CameraState::Ended;
                *known = Some(Camera { state, since: now, from_before, ended });
                self.told.clear();
            }
        }
    }

    fn take_set_up_mode(&mut self, is_on: bool) {
        if is_on != self.health.as_ref().is_some_and(|before| before.aiming_s > 0) {
            self.notices.push(if is_on {
                "the box is in set-up mode: pictures may leave it".to_owned()
            } else {
                "the box has left set-up mode".to_owned()
            });
        }
    }

    fn take_log(&mut self, log: &Log) {
        let text = complaints::text_of(log);
        // A box that does not track repeats why, for hosts that begin to listen.
        let tracks = self.camera.is_some_and(|camera| camera.state == CameraState::Running);
        if !tracks && self.told.iter().any(|told| told.text == text) {
            return;
        }
        let level = format!("{:?}", log.level).to_uppercase();
        self.notices.push(format!("box {level} {}: {text}", log.target));
        if self.told.len() == TOLD_MAX {
            self.told.pop_front();
        }
        self.told.push_back(Told { level: log.level, text });
    }

    fn take_hello(&mut self, hello: Hello) -> Result<(), BadInput> {
        if self.accounting.hello(hello.boot_id) {
            let known = self.runs.iter().rev().find_map(|run| run.hello.as_ref());
            let is_another = known.is_some_and(|known| !is_same_box(known, &hello));
            self.notices.push(if is_another {
                format!("another box is heard now: {}", others::name(&hello))
            } else {
                format!("the box has started anew ({})", start_of(&hello))
            });
            self.start_run()?;
        }
        if self.runs.last().is_none_or(|run| run.hello.is_none())
            && hello.targets.iter().all(|target| target.role == Role::Scene)
        {
            self.notices.push(
                "warning: this box looks for the scene board alone: its camera may not be \
                 calibrated, and nobody is measured with it; `plumb doctor` says what is missing"
                    .to_owned(),
            );
        }
        self.names_heard = Names::of(&hello);
        if let Some(run) = self.runs.last_mut() {
            run.hello = Some(hello);
        }
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
                    self.start_run()?;
                }
                Some((session, now))
            }
        };
        if let Some(run) = self.runs.last_mut() {
            run.frames += 1;
        }
        self.latest_came = Some(now);
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
                if let Some((session, arrival)) = begins {
                    recorder.start_session(session, packet.capture_time_ns, arrival);
                }
                recorder.write(&packet, names)?;
            }
        }
        Ok(())
    }

    fn bad_packet(&mut self, error: PacketError) {
        let count = self.bad.count(error);
        let remedy = match error {
            PacketError::OtherVersion { .. } => {
                "the box speaks another protocol: update the older of the two programs"
            }
            PacketError::OtherSchema { .. } => {
                "the box's messages are another program's: update the older of the two"
            }
            PacketError::Body => {
                "the box sends intact packets without a sensible message: report it"
            }
            _ => return,
        };
        // Once is enough: such a box repeats itself at 60 Hz.
        if count == 1 {
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
