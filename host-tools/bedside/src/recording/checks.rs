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
use crate::doctor::{Beside, Check, Verdict};

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
    /// And who gets the checks.
    beside: Option<(Beside, Box<Say>)>,
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
        let is_serial = link.kind() == LinkKind::Serial;
        let beside = Beside::new(link.place(), is_serial, begun, duration);
        let beside = (beside, Box::new(say) as Box<Say>);
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
        let Some((beside, mut say)) = self.beside.take() else { return Ok(()) };
        if !beside.is_heard() {
            return Ok(());
        }
        let checks = beside.checks(self.recording.config().cloned(), NO_PICTURE, now);
        say(&checks);
        self.recording.note(amiss(&checks))
    }
}

impl Tap for Recorded {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        if let Some((beside, _)) = &mut self.beside {
            beside.event(event, now);
        }
        self.recording.event(event, now)
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        if self.beside.as_ref().is_some_and(|(beside, _)| beside.is_over(now)) {
            self.conclude(now)?;
        }
        let question = self.recording.turn(now)?;
        self.judge(now);
        let Self { recording, beside: Some((beside, _)), .. } = self else { return Ok(question) };
        if let Some(Message::Command(Command { action: Action::Ping { .. }, .. })) = question
            && beside.asks(now)
        {
            beside.pinged();
        }
        Ok(question.or_else(|| beside.wants_view(now).then(|| recording.ask(Action::SendView))))
    }
}

/// Gets checks that are over.
type Say = dyn FnMut(&[Check]);
