//! What a reception knows: its counts, who the box is, what the box has told, the recording.

mod arrivals;
mod known;
mod rows;

use std::collections::BTreeMap;
use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, Health, Hello, Message, Packet, PacketError, PosePacket, ResetReason, Start,
};
use plumbline::target::Role;
use plumbline_files::BadInput;

use self::arrivals::Arrivals;
use self::known::Known;
use self::rows::Rows;
use crate::accounting::Counts;
use crate::bad_packets::BadPackets;
use crate::others::{self, Others};
use crate::power::PowerSeen;
use crate::questions::Questions;
use crate::recorder::{Names, Recorder};
use crate::sessions::{EXCHANGED_NS, Judged, LeftOut, Sessions};
use crate::transport::Event;

pub use self::known::Camera;
pub use self::rows::Share;

/// A box that has not said who it is is asked again after this time.
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

/// The request for a Hello.
struct HelloRequest {
    questions: Questions,
    /// When it was last put.
    asked: Option<Instant>,
}

/// The state of a reception. Its only input or output is the recording.
pub struct Receiver<W: Write> {
    rows: Rows<W>,
    sessions: Sessions,
    /// The zero of the sessions' times.
    begun: Option<Instant>,
    bad: BadPackets,
    line_losses: u64,
    /// The last one is under way.
    runs: Vec<Run>,
    /// Of the run that is under way.
    known: Known,
    /// In all runs.
    power: PowerSeen,
    arrivals: Arrivals,
    hello_request: HelloRequest,
    others: Others,
    notices: Vec<String>,
}

impl<W: Write> Receiver<W> {
    /// Before the first packet.
    #[must_use]
    pub fn new(recorder: Option<Recorder<W>>) -> Self {
        Self {
            rows: Rows::new(recorder),
            sessions: Sessions::default(),
            begun: None,
            bad: BadPackets::default(),
            line_losses: 0,
            runs: vec![Run::default()],
            known: Known::default(),
            power: PowerSeen::default(),
            arrivals: Arrivals::default(),
            hello_request: HelloRequest { questions: Questions::of_link(), asked: None },
            others: Others::default(),
            notices: Vec::new(),
        }
    }

    /// Pose packets by what became of them.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.sessions.counts()
    }

    /// Packets that are of another box or start.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.sessions.left_out()
    }

    /// How often the box started, with frames or without.
    #[must_use]
    pub fn sessions(&self) -> u32 {
        self.sessions.count()
    }

    /// Whether anything has come from a box.
    #[must_use]
    pub fn is_heard(&self) -> bool {
        self.arrivals.has_message()
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

    /// The runs of the box; never none.
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

    /// The start and the number of the newest frame of this run.
    #[must_use]
    pub fn newest_pose(&self) -> Option<(Start, u32)> {
        let hello = self.runs.last()?.hello.as_ref()?;
        Some((Start::new(hello.boot_id)?, self.known.latest()?.sequence))
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

    /// A message that the box should get: the request for its Hello while poses wait for it.
    pub fn request(&mut self, now: Instant) -> Option<Message> {
        let HelloRequest { questions, asked } = &mut self.hello_request;
        if !self.sessions.awaits_hello() || asked.is_some_and(|asked| now - asked < REQUEST_EVERY) {
            return None;
        }
        *asked = Some(now);
        Some(questions.ask(Action::SendHello).1)
    }

    /// Why the reception cannot go on: the box has been exchanged for another one.
    #[must_use]
    pub fn exchanged(&self) -> Option<BadInput> {
        let exchanged = self.sessions.exchanged()?;
        let [from, to] = [&exchanged.from, &exchanged.to].map(others::name);
        let silence = Duration::from_nanos(EXCHANGED_NS).as_secs();
        Some(BadInput::whole(
            from,
            format!("it has been silent for {silence} s, and another box sends now: {to}"),
            "a recording is of one box: what came until then is kept; check which boxes are on, \
             and record again",
        ))
    }

    /// Takes note of what came in.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn handle(&mut self, event: Event, now: Instant) -> Result<(), BadInput> {
        match event {
            Event::Packet(packet) => return self.packet(packet, now),
            Event::NotAuthentic => self.bad.not_authentic += 1,
            Event::Other { from, name, announcement } => {
                self.notices.extend(self.others.take(from, name.as_deref(), &announcement));
            }
            Event::Bad(error) => self.bad_packet(error),
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

    /// Lets time pass: poses do not wait for a Hello for ever.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn tick(&mut self, now: Instant) -> Result<(), BadInput> {
        let now_ns = self.since_begun_ns(now);
        self.sessions.pass(now_ns);
        self.take_judged(now)
    }

    /// Nothing more comes: what waits is judged by what is known, and the recording is closed. On
    /// Windows no other file can take the place of one that is open.
    ///
    /// # Errors
    /// When the recording cannot go on.
    pub fn finish(&mut self, now: Instant) -> Result<(), BadInput> {
        self.sessions.finish();
        let judged = self.take_judged(now);
        self.rows.close();
        judged
    }

    fn since_begun_ns(&mut self, now: Instant) -> u64 {
        now.saturating_duration_since(*self.begun.get_or_insert(now)).as_nanos() as u64
    }

    fn packet(&mut self, packet: Packet, now: Instant) -> Result<(), BadInput> {
        let now_ns = self.since_begun_ns(now);
        self.sessions.take(packet, now_ns);
        self.take_judged(now)
    }

    /// Takes what has been judged.
    fn take_judged(&mut self, now: Instant) -> Result<(), BadInput> {
        while let Some(judged) = self.sessions.next_judged() {
            match judged {
                Judged::Begins { session, hello } => self.begin(session, hello),
                Judged::Frame(frame) => {
                    self.arrivals.message(now);
                    self.arrivals.pose(now);
                    self.rows.push(&frame)?;
                    if let Some(run) = self.runs.get_mut(frame.session as usize - 1) {
                        run.frames += 1;
                    }
                    if !frame.is_late && frame.session == self.sessions.count() {
                        self.known.take_pose(frame.packet);
                    }
                }
                Judged::Message(message) => self.message(message, now),
                // Until a box has said who it is, this is all that is known of it; later, only
                // what it says to people is of use.
                Judged::Unnamed(message) => {
                    if self.sessions.count() == 0 || matches!(message, Message::Log(_)) {
                        self.message(message, now);
                    }
                }
                Judged::OtherBox(hello) => self.warn_of(
                    &format!("another box sends here too: {}", others::name(&hello)),
                    "give each box a key of its own",
                ),
                Judged::Conflict(hello) => self.warn_of(
                    &format!("two boxes send at once as {}", others::name(&hello)),
                    "switch one off, and give each a key and a serial number of its own",
                ),
            }
        }
        Ok(())
    }

    fn warn_of(&mut self, what: &str, remedy: &str) {
        self.notices.push(format!("warning: {what}; only the first is recorded: {remedy}"));
    }

    fn message(&mut self, message: Message, now: Instant) {
        self.arrivals.message(now);
        match message {
            Message::Health(health) => {
                let warnings = self.power.take(&health);
                let news = self.known.take_health(health, now);
                self.notices.extend(news.map(str::to_owned));
                self.notices.extend(warnings.iter().map(|text| format!("warning: {text}")));
            }
            Message::Log(log) => self.notices.extend(self.known.take_log(&log)),
            // Known from the session's first, or for those who asked.
            _ => {}
        }
    }

    /// A session begins: what was known of the run before no longer holds.
    fn begin(&mut self, session: u32, hello: Hello) {
        if session > 1 {
            self.notices.push(format!(
                "the box has restarted ({}): session {session} begins",
                start_of(&hello)
            ));
            self.runs.push(Run::default());
            self.known = Known::default();
            self.arrivals.start_run();
        } else if hello.targets.iter().all(|target| target.role == Role::Scene) {
            self.notices.push(
                "warning: this box looks for the scene board alone: its camera may not be \
                 calibrated, and nobody is measured with it; `plumb doctor` says what is missing"
                    .to_owned(),
            );
        }
        self.rows.begin(session, Names::of(&hello));
        if let Some(run) = self.runs.last_mut() {
            run.hello = Some(hello);
        }
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
            PacketError::Body | PacketError::Number => {
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
