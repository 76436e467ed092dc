//! One box: its link, what is known of it, and the trial that is recorded.
//!
//! ```text
//!  watching: who is it, how is it, what does the doctor find? ─▶ recording ─▶ ending: what was lost on
//!      ▲                                                                      the way is still coming
//!      └──────────────────────────────────────────────────────────────────────────┘
//! ```
//!
//! Nothing here waits: whoever has the beds calls [`Bed::turn`] when something has come for a box, and
//! now and then when nothing has.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use plumbline::packet::{Action, Message};
use plumbline_bedside::doctor::{Check, Examining};
use plumbline_bedside::keys::KnownBox;
use plumbline_bedside::recording::amiss;
use plumbline_desk::wire::{CheckGrade, CheckState, HealthState};
use plumbline_files::{BadInput, Late};
use plumbline_stream::questions::Questions;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception::{Backlog, Tap, turn};
use plumbline_stream::recorder::Recorder;
use plumbline_stream::transport::{Event, Link, Transport as _};
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::mark::channel;
use plumbline_trial::recording::Recording;

use crate::judge::{Due, Judge};
use crate::notices::Notices;
use crate::overview::{BoxCounts, BoxNow, Doing, Hearing};
use crate::post::Letterbox;

/// A box that has been silent for this long is no longer heard: it says something once a second.
const SILENT_AFTER: Duration = Duration::from_secs(3);

/// How long a box is examined after each of its starts.
const EXAMINED_FOR: Duration = Duration::from_secs(3);

/// A trial in which no frame has come for this long is over.
const FRAMELESS_MAX: Duration = Duration::from_secs(60);

/// The goodbyes of a recording: one that gets none of these finds out by itself.
const GOODBYES: usize = 3;

/// What the beds share.
pub(crate) struct Around {
    /// The folder with one for each box.
    pub trials: PathBuf,
    /// The folder of trials without a verdict.
    pub due: PathBuf,
    pub judge: Judge,
    pub notices: std::sync::Arc<Notices>,
    /// How long a trial lasts.
    pub lasts: Duration,
    /// Where boxes are heard, in words.
    pub place: String,
}

/// A trial that is recorded.
struct TrialNow {
    receiver: Receiver<Late>,
    recording: Recording,
    due: Due,
    begun: Instant,
    lasts: Duration,
    first_frame: Option<Instant>,
    over: Option<Backlog>,
}

enum Phase {
    Watching(Box<Receiver<Late>>, Option<Box<Examining>>),
    Recording(Box<TrialNow>),
}

/// A box.
pub(crate) struct Bed {
    pub level: String,
    id: String,
    name: String,
    serial_number: Option<String>,
    link: Link<Letterbox>,
    /// Where there is a session with it; its link says so.
    met: Rc<RefCell<Option<SocketAddr>>>,
    phase: Phase,
    /// Whether trials are recorded one after the other.
    pub records_always: bool,
    heard: Option<Instant>,
    hearing: (Hearing, String),
    /// Of the receivers before.
    before: BoxCounts,
    health: Option<HealthState>,
    /// The start that was examined, and what was found.
    examined: Option<u32>,
    checks: Vec<Check>,
    examination: Option<(String, Vec<CheckState>)>,
    failed: Option<(String, String)>,
}

/// Hears whether something authentic comes.
struct Ears(bool);

impl Tap for Ears {
    fn event(&mut self, event: &Event, _: Instant) -> Result<(), BadInput> {
        self.0 |= matches!(event, Event::Packet(_));
        Ok(())
    }

    fn turn(&mut self, _: Instant) -> Result<Option<Message>, BadInput> {
        Ok(None)
    }
}

/// Now, UTC, in whole seconds.
pub(crate) fn utc() -> String {
    jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string()
}

impl Bed {
    pub fn new(
        level: String,
        known: &KnownBox,
        link: Link<Letterbox>,
        met: Rc<RefCell<Option<SocketAddr>>>,
    ) -> Self {
        Self {
            level,
            id: known.key.id().to_string(),
            name: known.name.clone().unwrap_or_else(|| known.title()),
            serial_number: known.serial_number.clone(),
            link,
            met,
            phase: watching(),
            records_always: false,
            heard: None,
            hearing: (Hearing::Searching, utc()),
            before: BoxCounts::default(),
            health: None,
            examined: None,
            checks: Vec::new(),
            examination: None,
            failed: None,
        }
    }

    /// Takes what has come, and does what is due; where the box is, if it was heard for certain.
    pub fn turn(&mut self, around: &Around) -> Option<SocketAddr> {
        let mut ears = Ears(false);
        let result = self.receive(&mut ears);
        let now = Instant::now();
        if let Err(error) = result {
            self.fail(&error, around);
        }
        for words in self.receiver().take_notices() {
            around.notices.say(format!("{}: {words}", self.level));
        }
        self.proceed(around, now);
        if !ears.0 {
            return None;
        }
        self.heard = Some(now);
        *self.met.borrow()
    }

    fn receiver(&mut self) -> &mut Receiver<Late> {
        match &mut self.phase {
            Phase::Watching(receiver, _) => receiver,
            Phase::Recording(trial) => &mut trial.receiver,
        }
    }

    fn receive(&mut self, ears: &mut Ears) -> Result<(), BadInput> {
        let Self { link, phase, .. } = self;
        match phase {
            Phase::Watching(receiver, examining) => {
                let mut nobody = ();
                let tap: &mut dyn Tap = match examining {
                    Some(examining) => &mut **examining,
                    None => &mut nobody,
                };
                let mut taps = (ears as &mut dyn Tap, tap);
                turn(link, receiver, &mut taps, &|_| false)
            }
            Phase::Recording(trial) => {
                let TrialNow { receiver, recording, over, .. } = &mut **trial;
                let mut taps = (ears as &mut dyn Tap, recording as &mut dyn Tap);
                match over {
                    None => turn(link, receiver, &mut taps, &|_| false),
                    Some(backlog) => backlog.turn(link, receiver, &mut taps),
                }
            }
        }
    }

    /// What follows from the time and from what has come.
    fn proceed(&mut self, around: &Around, now: Instant) {
        match &mut self.phase {
            Phase::Watching(receiver, examining) => {
                let hello = receiver.runs().last().and_then(|run| run.hello.as_ref());
                let boot_id = hello.map(|it| it.boot_id);
                if let Some(hello) = hello {
                    self.name = hello.device.to_string();
                    self.serial_number = Some(hello.serial_number.to_string());
                }
                if let Some(over) = examining.take_if(|it| it.is_over(now)) {
                    let (checks, _) = over.end(now);
                    self.examined_now(checks);
                } else if examining.is_none() && boot_id.is_some() && boot_id != self.examined {
                    self.examined = boot_id;
                    let it = Examining::begin(&around.place, false, now, EXAMINED_FOR);
                    *examining = Some(Box::new(it));
                } else if self.records_always && examining.is_none() && boot_id.is_some() {
                    // It goes on until it is stopped; what fails is said.
                    if let Err((found, remedy)) = self.start(None, around.lasts, around) {
                        self.records_always = false;
                        around.notices.say(format!(
                            "warning: {}: nothing is recorded any more: {found}; {remedy}",
                            self.level
                        ));
                    }
                }
            }
            Phase::Recording(trial) => {
                if trial.receiver.counts().received > 0 {
                    trial.first_frame.get_or_insert(now);
                }
                let is_over = match trial.first_frame {
                    Some(first) => now - first >= trial.lasts,
                    None => now - trial.begun >= FRAMELESS_MAX,
                };
                if is_over && trial.over.is_none() {
                    trial.over = Some(Backlog::of(&trial.receiver));
                }
                if trial.over.is_some_and(|backlog| !backlog.is_awaited(&self.link)) {
                    self.finish(around, now);
                }
            }
        }
    }

    fn examined_now(&mut self, checks: Vec<Check>) {
        let mut shown: Vec<CheckState> = checks.iter().map(CheckState::of).collect();
        shown.sort_by_key(|it| std::cmp::Reverse(it.verdict));
        self.examination = Some((utc(), shown));
        self.checks = checks;
    }

    /// The trial that is recorded.
    pub fn trial(&self) -> Option<&str> {
        match &self.phase {
            Phase::Watching(..) => None,
            Phase::Recording(trial) => Some(&trial.due.trial),
        }
    }

    /// Begins a trial; its number, or why not and what to do.
    pub fn start(
        &mut self,
        name: Option<String>,
        lasts: Duration,
        around: &Around,
    ) -> Result<String, (String, String)> {
        let refused = |found: &str, remedy: &str| Err((found.to_owned(), remedy.to_owned()));
        if let Some(trial) = self.trial() {
            return Err((format!("trial {trial} is being recorded"), "stop it first".to_owned()));
        }
        if self.hearing(Instant::now()) != Hearing::Heard {
            return refused("the box is not heard", "check its power and its link");
        }
        if !around.judge.has_room() {
            return refused("too many trials wait for their verdict", "try again in a minute");
        }
        self.begin(name, lasts, around).map_err(|error| {
            let found = format!("{}: {}", error.place, error.found);
            self.failed = Some((found.clone(), error.remedy.clone()));
            (found, error.remedy)
        })
    }

    fn begin(
        &mut self,
        name: Option<String>,
        lasts: Duration,
        around: &Around,
    ) -> Result<String, BadInput> {
        let now = Instant::now();
        let started = jiff::Timestamp::now();
        let number = started.strftime("%Y%m%dT%H%M%SZ").to_string();
        let of_box = around.trials.join(&self.level);
        let folder = |number: &str| match &name {
            Some(name) => of_box.join(format!("{number}-{name}")),
            None => of_box.join(number),
        };
        // Another one may have begun in the same second.
        let numbers = (2..100).map(|further| format!("{number}.{further}"));
        let mut numbers = std::iter::once(number.clone()).chain(numbers);
        let free = numbers.find(|it| !folder(it).exists());
        let trial = free.unwrap_or(number);
        let folder = folder(&trial);
        let due = Due { level: self.level.clone(), trial: trial.clone(), name, folder };
        plumbline_files::make_directory(&of_box)?;
        due.note(&around.due)?;
        let manifest = Manifest {
            checks: amiss(&self.checks),
            ..Manifest::begin(started.to_string(), None, None, None, Zero::Start)
        };
        let (_, marks) = channel();
        let nobody = Box::new(|_: &_, _| {});
        let recording = Recording::begin(&due.folder, &manifest, marks, now, nobody)
            .inspect_err(|_| due.forget(&around.due))?
            .unjudged();
        let csv = recording.csv();
        let recorder = match Late::new(&csv, false) {
            Ok(file) => Recorder::new(file, csv.display().to_string()),
            Err(error) => {
                // Nothing was recorded: no folder is left.
                let _ = recording.close(0);
                due.forget(&around.due);
                return Err(error);
            }
        };
        self.leave_receiver();
        self.failed = None;
        let receiver = Receiver::new(Some(recorder));
        let first_frame = None;
        self.phase = Phase::Recording(Box::new(TrialNow {
            receiver,
            recording,
            due,
            begun: now,
            lasts,
            first_frame,
            over: None,
        }));
        around.judge.counts.begun.fetch_add(1, Ordering::Relaxed);
        Ok(trial)
    }

    /// What was counted stays when another receiver begins.
    fn leave_receiver(&mut self) {
        self.before = self.counts();
    }

    fn counts(&self) -> BoxCounts {
        let receiver = match &self.phase {
            Phase::Watching(receiver, _) => receiver,
            Phase::Recording(trial) => &trial.receiver,
        };
        let counts = receiver.counts();
        BoxCounts {
            frames: self.before.frames + counts.received,
            lost: self.before.lost + counts.lost,
            late: self.before.late + counts.late,
            not_authentic: self.before.not_authentic + receiver.bad().not_authentic,
        }
    }

    /// Ends the trial; its number, if there is one.
    pub fn stop(&mut self) -> Option<String> {
        let Phase::Recording(trial) = &mut self.phase else { return None };
        if trial.over.is_none() {
            trial.over = Some(Backlog::of(&trial.receiver));
        }
        Some(trial.due.trial.clone())
    }

    /// Everything of the trial has come that will.
    fn finish(&mut self, around: &Around, now: Instant) {
        self.leave_receiver();
        let Phase::Recording(trial) = std::mem::replace(&mut self.phase, watching()) else {
            return;
        };
        let TrialNow { mut receiver, recording, due, .. } = *trial;
        for _ in 0..GOODBYES {
            self.link.send(&Questions::of_tap().ask(Action::Record { on: false }).1);
        }
        let finished = receiver.finish(now);
        let frames = receiver.counts().received;
        let closed = recording.close(frames);
        match closed {
            Ok(Some(closed)) => {
                if !around.judge.hand_over(due.clone(), Some(closed)) {
                    around.notices.say(format!(
                        "warning: {}: trial {} gets its verdict after the next start: too many wait",
                        due.level, due.trial
                    ));
                }
            }
            Ok(None) => {
                due.forget(&around.due);
                let found = format!("no frame came for trial {}, which was not kept", due.trial);
                around.notices.say(format!("warning: {}: {found}", self.level));
                let remedy = "see what the examination says of its camera".to_owned();
                self.failed = Some((found, remedy));
            }
            Err(error) => self.broke(&error, around),
        }
        if let Err(error) = finished {
            self.broke(&error, around);
        }
    }

    fn broke(&mut self, error: &BadInput, around: &Around) {
        around.notices.say(format!("warning: {}: {error}", self.level));
        let found = format!("{}: {}", error.place, error.found);
        self.failed = Some((found, error.remedy.clone()));
    }

    /// Something cannot go on: a trial is ended, with what came.
    fn fail(&mut self, error: &BadInput, around: &Around) {
        self.broke(error, around);
        match self.phase {
            Phase::Watching(..) => {
                self.leave_receiver();
                self.phase = watching();
            }
            Phase::Recording(_) => {
                self.records_always = false;
                self.finish(around, Instant::now());
            }
        }
    }

    fn hearing(&self, now: Instant) -> Hearing {
        match self.heard {
            None => Hearing::Searching,
            Some(heard) if now - heard < SILENT_AFTER => Hearing::Heard,
            Some(_) => Hearing::Silent,
        }
    }

    /// As it is now.
    pub fn now(&mut self, now: Instant) -> BoxNow {
        let hearing = self.hearing(now);
        if hearing != self.hearing.0 {
            self.hearing = (hearing, utc());
        }
        let counts = self.counts();
        if let Some(health) = self.receiver().health() {
            self.health = Some(HealthState::of(health));
        }
        let receiver = self.receiver();
        let rate_hz = (10.0 * receiver.rate_hz(now)).round() / 10.0;
        let latency_ms = receiver.latest(now).map(|it| f64::from(it.latency_us) / 1000.0);
        BoxNow {
            level: self.level.clone(),
            id: self.id.clone(),
            name: self.name.clone(),
            serial_number: self.serial_number.clone(),
            hearing,
            since: self.hearing.1.clone(),
            doing: match &self.phase {
                Phase::Watching(..) => Doing::Watching,
                Phase::Recording(trial) if trial.over.is_some() => Doing::Ending,
                Phase::Recording(_) => Doing::Recording,
            },
            trial: self.trial().map(str::to_owned),
            problem: self.problem(hearing),
            rate_hz,
            latency_ms,
            counts,
            health: self.health.clone(),
            examination: self.examination.clone(),
            address: *self.met.borrow(),
        }
    }

    /// What is amiss now.
    fn problem(&self, hearing: Hearing) -> Option<(String, String)> {
        let of = |found: &str, remedy: &str| Some((found.to_owned(), remedy.to_owned()));
        match hearing {
            Hearing::Searching => self.link.obstacle().or_else(|| {
                of("not heard yet", "switch it on, and check that it sends to this computer")
            }),
            Hearing::Silent => of("the box is no longer heard", "check its power and its link"),
            Hearing::Heard | Hearing::Unknown => self.failed.clone().or_else(|| {
                let worst = self.examination.as_ref()?.1.first()?;
                (worst.verdict == CheckGrade::Fail)
                    .then(|| (format!("{}: {}", worst.subject, worst.seen), worst.remedy.clone()))
            }),
        }
    }
}

fn watching() -> Phase {
    Phase::Watching(Box::new(Receiver::new(None)), None)
}
