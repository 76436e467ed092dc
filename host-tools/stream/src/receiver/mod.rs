//! What a reception knows: its counts, who the box is, what the box has told, the recording.

mod arrivals;
mod known;
mod rows;

use std::collections::BTreeMap;
use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::{Action, Health, Hello, Message, PacketError, PosePacket, ResetReason};
use plumbline::target::Role;
use plumbline_files::BadInput;

use self::arrivals::Arrivals;
use self::known::Known;
use self::rows::{Begin, Rows};
use crate::accounting::{Accounting, Arrival, Counts};
use crate::bad_packets::BadPackets;
use crate::others::{self, Others, is_same_box};
use crate::power::PowerSeen;
use crate::questions::Questions;
use crate::recorder::{Names, Recorder};
use crate::transport::Event;

pub use self::known::Camera;
pub use self::rows::Share;

/// A box that has not told its targets' names is asked again after this time.
const REQUEST_EVERY: Duration = Duration::from_millis(200);

/// A pose is the latest for no longer than this; the slowest camera gives one a second.
const FRESH: Duration = Duration::from_millis(1500);

/// A box that has been silent for this long is no longer heard.
const UNHEARD: Duration = Duration::from_secs(3);

/// From one start of a box to the next.
#[derive(Debug, Default)]
pub struct Run {
    /// Who the box is, once it has told.
    pub hello: Option<Hello>,
    /// Frames received.
    pub frames: u64,
}

/// The request for the targets' names.
struct NamesRequest {
    questions: Questions,
    /// When it was last put.
    asked: Option<Instant>,
}

/// The state of a reception. Its only input or output is the recording.
pub struct Receiver<W: Write> {
    rows: Rows<W>,
    accounting: Accounting,
    bad: BadPackets,
    line_losses: u64,
    others: Others,
    /// The last one is under way.
    runs: Vec<Run>,
    /// Of the run that is under way.
    known: Known,
    /// In all runs.
    power: PowerSeen,
    arrivals: Arrivals,
    names_request: NamesRequest,
    notices: Vec<String>,
}

impl<W: Write> Receiver<W> {
    /// Before the first packet.
    #[must_use]
    pub fn new(recorder: Option<Recorder<W>>) -> Self {
        Self {
            rows: Rows::new(recorder),
            accounting: Accounting::default(),
            bad: BadPackets::default(),
            line_losses: 0,
            others: Others::default(),
            runs: vec![Run::default()],
            known: Known::default(),
            power: PowerSeen::default(),
            arrivals: Arrivals::default(),
            names_request: NamesRequest { questions: Questions::of_link(), asked: None },
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
        self.rows.shares()
    }

    /// The runs of the box, or of the boxes one after the other; never none.
    #[must_use]
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The latest Health of this run.
    #[must_use]
    pub fn health(&self) -> Option<&Health> {
        self.known.health()
    }

    /// What the box has told of its power supply, in all runs.
    #[must_use]
    pub fn power(&self) -> PowerSeen {
        self.power
    }

    /// The camera of this run, once the box has told of it.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        self.known.camera()
    }

    /// The faults that the box has logged since its camera's state last changed.
    #[must_use]
    pub fn faults(&self) -> String {
        self.known.faults()
    }

    /// The latest pose packet of this run, unless it is an old one.
    #[must_use]
    pub fn latest(&self, now: Instant) -> Option<&PosePacket> {
        self.known.latest().filter(|_| self.silence(now).is_some_and(|silence| silence <= FRESH))
    }

    /// How long ago the latest pose packet of all runs came.
    #[must_use]
    pub fn silence(&self, now: Instant) -> Option<Duration> {
        self.arrivals.since_pose(now)
    }

    /// How long the box has been silent, if that is too long. It sends a Health once a second
    /// until its program ends.
    #[must_use]
    pub fn unheard(&self, now: Instant) -> Option<Duration> {
        let silence = self.arrivals.since_message(now)?;
        let has_ended = self.known.camera().is_some_and(|camera| camera.ended);
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
        self.rows.name(role)
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
        self.arrivals.rate_hz(now)
    }

    /// What there is to say to the user since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// A message that the box should get: the request for the targets' names while rows wait
    /// for them.
    pub fn request(&mut self, now: Instant) -> Option<Message> {
        let since = self.rows.held_since()?;
        let NamesRequest { questions, asked } = &mut self.names_request;
        if asked.is_some_and(|asked| asked >= since && now - asked < REQUEST_EVERY) {
            return None;
        }
        *asked = Some(now);
        Some(questions.ask(Action::SendHello).1)
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
        if self.rows.is_overdue(now) {
            self.notices.push(
                "the box has not told its targets' names: the recording uses those known so far"
                    .to_owned(),
            );
            return self.rows.settle();
        }
        Ok(())
    }

    /// Writes what is still held.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn finish(&mut self) -> Result<(), BadInput> {
        self.rows.finish()
    }

    fn message(&mut self, message: Message, now: Instant) -> Result<(), BadInput> {
        self.arrivals.message(now);
        match message {
            Message::Pose(packet) => return self.pose(packet, now),
            Message::Hello(hello) => return self.take_hello(hello),
            Message::Health(health) => {
                self.uptime(health.uptime_ms)?;
                let warnings = self.power.take(&health);
                let news = self.known.take_health(health, now);
                self.notices.extend(news.map(str::to_owned));
                self.notices.extend(warnings.iter().map(|text| format!("warning: {text}")));
            }
            Message::Log(log) => {
                self.uptime(log.uptime_ms)?;
                self.notices.extend(self.known.take_log(&log));
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

    /// The box has restarted: what was known of the run before no longer holds.
    fn start_run(&mut self) -> Result<(), BadInput> {
        self.rows.start_run()?;
        self.runs.push(Run::default());
        self.known = Known::default();
        self.arrivals.start_run();
        Ok(())
    }

    fn take_hello(&mut self, hello: Hello) -> Result<(), BadInput> {
        if self.accounting.hello(hello.boot_id) {
            let known = self.runs.iter().rev().find_map(|run| run.hello.as_ref());
            let is_another = known.is_some_and(|known| !is_same_box(known, &hello));
            self.notices.push(if is_another {
                format!("another box is heard now: {}", others::name(&hello))
            } else {
                format!("the box has restarted ({})", start_of(&hello))
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
        self.rows.hear(Names::of(&hello));
        if let Some(run) = self.runs.last_mut() {
            run.hello = Some(hello);
        }
        if !self.rows.has_names() || self.accounting.awaits_session() {
            self.rows.settle()?;
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
                Some(Begin { session, arrival: now })
            }
        };
        if let Some(run) = self.runs.last_mut() {
            run.frames += 1;
        }
        self.arrivals.pose(now);
        if arrival != Arrival::Late {
            self.known.take_pose(&packet);
        }
        self.rows.push(packet, begins, now)
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
