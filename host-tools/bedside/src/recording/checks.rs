//! The doctor's checks of a box that is being recorded.
//!
//! Usually they come before: [`examine`](crate::doctor::examine), and what is [`amiss`] is written
//! into the trial. A recording that does not wait for them is checked by the packets that are being
//! recorded. While it is recorded, the trial itself is judged, again and again.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use plumbline::packet::{Action, Command, LinkKind, Message};
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;
use plumbline_stream::reception::Tap;
use plumbline_stream::transport::Event;
use plumbline_trial::manifest::{CheckSeen, CheckVerdict};
use plumbline_trial::recording::Recording;

use super::course::Course;
use crate::doctor::{self, Background, Check, Findings, LAST_ANSWERS, VIEW_EVERY, Verdict};
use crate::scale;

/// Why the background is not looked at.
const NO_PICTURE: &str = "with --anyway the recording does not wait for a picture, so that a camera \
                          that was turned since `plumb scene` would not be noticed";

/// The checks that are not good, as the trial keeps them.
#[must_use]
pub fn amiss(checks: &[Check]) -> Vec<CheckSeen> {
    let seen = |check: &Check| {
        let verdict = match check.verdict {
            Verdict::Good => return None,
            Verdict::Skipped => CheckVerdict::Skipped,
            Verdict::Warn => CheckVerdict::Warn,
            Verdict::Fail => CheckVerdict::Fail,
        };
        Some(CheckSeen { subject: check.subject.clone(), verdict, seen: check.seen.clone() })
    };
    checks.iter().filter_map(seen).collect()
}

/// The trial is judged this often, or less often if that takes more than [`JUDGING_SHARE`] of the
/// time: it looks at all frames.
const JUDGED_EVERY: Duration = Duration::from_secs(1);

/// Judging takes one part in so many of the time at most.
const JUDGING_SHARE: u32 = 50;

/// A recording, what it is worth so far, and the checks beside it until they are done.
pub struct Recorded {
    recording: Recording,
    /// Is told what the recording is worth.
    course: Rc<RefCell<Course>>,
    judge_at: Option<Instant>,
    beside: Option<Beside>,
}

impl Recorded {
    /// A recording of a box that was checked.
    #[must_use]
    pub fn checked(recording: Recording, course: Rc<RefCell<Course>>) -> Self {
        Self { recording, course, judge_at: None, beside: None }
    }

    /// A recording that began at this moment, of a box that is checked meanwhile, for this time.
    /// `say` gets the checks.
    pub fn unchecked(
        recording: Recording,
        course: Rc<RefCell<Course>>,
        link: &BoxLink,
        begun: Instant,
        duration: Duration,
        say: impl FnMut(&[Check]) + 'static,
    ) -> Self {
        let findings = Findings {
            place: link.place().to_owned(),
            is_serial: link.kind() == LinkKind::Serial,
            ..Findings::default()
        };
        let say = Box::new(say);
        let beside = Beside { findings, begun, duration, first: None, view_at: begun, say };
        Self { beside: Some(beside), ..Self::checked(recording, course) }
    }

    /// Judges the trial, if it is time.
    fn judge(&mut self, now: Instant) {
        let mut course = self.course.borrow_mut();
        if let Some(config) = self.recording.config().filter(|_| course.body().is_none()) {
            course.told(config);
        }
        if !course.is_settled(now) || self.judge_at.is_some_and(|at| now < at) {
            return;
        }
        let begun = Instant::now();
        let verdict = self.recording.verdict().so_far(course.awaits_mark());
        course.judged(verdict);
        self.judge_at = Some(now + JUDGED_EVERY.max(JUDGING_SHARE * begun.elapsed()));
    }

    /// The recording, whose checks end with it.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn end(mut self, now: Instant) -> Result<Recording, BadInput> {
        self.conclude(now)?;
        Ok(self.recording)
    }

    /// What is recorded.
    #[must_use]
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// The checks are over: gives them, and writes down what is amiss. A recording without a packet
    /// has nothing to be checked.
    fn conclude(&mut self, now: Instant) -> Result<(), BadInput> {
        let Some(mut beside) = self.beside.take() else { return Ok(()) };
        if beside.first.is_none() {
            return Ok(());
        }
        let mut findings = beside.findings;
        findings.silence_s = now.saturating_duration_since(beside.begun).as_secs_f64()
            - findings.heard_ns as f64 * 1e-9;
        findings.config = self.recording.config().cloned().map(Ok);
        findings.compared = findings.config().map(scale::all_kept).unwrap_or_default();
        let has_scene = findings.config().is_some_and(|it| it.cam_from_scene_theta.is_some());
        findings.background = has_scene.then(|| Background::NotCompared(NO_PICTURE.into()));
        let checks = doctor::judged(&findings);
        (beside.say)(&checks);
        self.recording.note(amiss(&checks))
    }
}

impl Tap for Recorded {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        if let Some(beside) = &mut self.beside {
            beside.event(event, now);
        }
        self.recording.event(event, now)
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        if self.beside.as_ref().is_some_and(|beside| beside.is_over(now)) {
            self.conclude(now)?;
        }
        let question = self.recording.turn(now)?;
        self.judge(now);
        let Self { recording, beside: Some(beside), .. } = self else { return Ok(question) };
        if let Some(Message::Command(Command { action: Action::Ping { .. }, .. })) = question {
            beside.findings.pings += usize::from(beside.asks(now));
        }
        Ok(question.or_else(|| beside.wants_view(now).then(|| recording.ask(Action::SendView))))
    }
}

/// Gets checks that are over.
type Say = dyn FnMut(&[Check]);

/// What is seen of a box while it is being recorded.
struct Beside {
    findings: Findings,
    /// When the recording began: the zero of its questions for the time.
    begun: Instant,
    duration: Duration,
    /// When the first packet came.
    first: Option<Instant>,
    view_at: Instant,
    /// Gets the checks.
    say: Box<Say>,
}

impl Beside {
    fn event(&mut self, event: &Event, now: Instant) {
        if matches!(event, Event::Packet(_)) {
            self.first.get_or_insert(now);
        }
        let since = now.saturating_duration_since(self.begun);
        self.findings.take(event, since.as_nanos() as u64);
    }

    /// How long the box has been heard.
    fn heard_for(&self, now: Instant) -> Option<Duration> {
        self.first.map(|first| now.saturating_duration_since(first))
    }

    fn is_over(&self, now: Instant) -> bool {
        self.heard_for(now).is_some_and(|heard| heard >= self.duration + LAST_ANSWERS)
    }

    /// Whether an answer to a question of now is waited for.
    fn asks(&self, now: Instant) -> bool {
        self.heard_for(now).is_some_and(|heard| heard < self.duration)
    }

    fn wants_view(&mut self, now: Instant) -> bool {
        let is_due = self.asks(now) && now >= self.view_at;
        if is_due {
            self.view_at = now + VIEW_EVERY;
        }
        is_due
    }
}
