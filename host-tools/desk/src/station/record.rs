//! A trial of the session is recorded.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::packet::Action;
use plumbline_bedside::doctor::Check;
use plumbline_bedside::recording::{Course, Live as LiveSeen, Recorded, Zeroing, amiss};
use plumbline_files::BadInput;
use plumbline_session::session::{Event, State};
use plumbline_stream::link::BoxLink;
use plumbline_stream::questions::Questions;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception::receive;
use plumbline_stream::recorder::Recorder;
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::mark::{Mark, Source, channel};
use plumbline_trial::recording::Recording;

use super::can::Stage;
use super::{Next, SHOW_EVERY, Worker, show};
use crate::wire::MarkState;

/// A box that was examined no longer ago than this, in the same start, is not examined beside the
/// recording once more.
const EXAMINED_WITHIN: Duration = Duration::from_secs(15 * 60);

/// An examination that was not to be had is tried again after this.
const EXAMINED_AGAIN_AFTER: Duration = Duration::from_secs(60);

/// How long a box is examined beside a recording.
const EXAMINED_FOR: Duration = Duration::from_secs(3);

/// What the recording has heard of marks.
type Heard = Rc<RefCell<Vec<(Mark, f64)>>>;

impl Worker {
    /// Records the trial that the session has begun, until the session says that it is over.
    pub(super) fn record(&mut self, link: BoxLink) -> Result<(BoxLink, Next), BadInput> {
        self.enter(Stage::Recording);
        self.refer();
        let (place, kind) = (link.place().to_owned(), link.kind());
        let now = Instant::now();
        let begun = now;
        let (recorded, heard, course, criteria) = match self.begin(&link, now) {
            Ok(parts) => parts,
            Err(error) => {
                let _ = self.happen(&Event::Nothing(error.to_string()), Instant::now());
                self.shared.update(|state| state.failed = Some(error.into()));
                return Ok((link, Next::Watch));
            }
        };
        let mut transport = link.into_transport();
        let csv = recorded.recording().csv();
        let recorder = plumbline_files::Late::new(&csv, false)
            .map(|file| Recorder::new(file, csv.display().to_string()));
        let (mut receiver, mut recorded) = (Receiver::new(Some(recorder?)), recorded);
        let live = LiveSeen::without_motion(Some(criteria), now);
        // The desk's end is a step of the session, after which the recording ends.
        let never = AtomicBool::new(false);
        let mut counted = 0;
        let mut was_zeroed = false;
        let hub = Arc::clone(&self.shared.hub);
        let result =
            receive(&mut *transport, &mut receiver, &mut recorded, None, &never, |receiver| {
                let now = Instant::now();
                if receiver.counts().received > 0 && counted == 0 {
                    counted = receiver.counts().received;
                    course.borrow_mut().frame(now);
                    let _ = self.happen(&Event::Frame, now);
                }
                self.take_marks(&heard, begun, now);
                let is_zeroed = course.borrow().zero().is_some();
                if is_zeroed && !was_zeroed {
                    was_zeroed = true;
                    self.refer();
                }
                self.tick(now);
                if hub.stop.load(Ordering::Relaxed) {
                    let _ = self.happen(&Event::Interrupted, now);
                }
                while let Some(envelope) = self.next_order() {
                    self.take_without_link(envelope);
                }
                if now >= self.show_at {
                    self.show_at = now + SHOW_EVERY;
                    self.take_frames(now);
                    let course = course.borrow();
                    let seen = live.seen(receiver, &course, now);
                    let reasons = seen.judgement.reasons.iter();
                    let reasons = reasons.map(|it| show::reason(&it.words, &it.remedy));
                    let word = seen.judgement.word.map(show::judged);
                    let shown = self.live(receiver, now, word, reasons.collect(), seen.time);
                    let shown = crate::wire::Live { counts: seen.counts, ..shown };
                    self.show_reception(receiver, shown, now);
                    self.show_session(now);
                    self.show_can();
                }
                let state = self.session_state();
                match state {
                    Some(State::Recording { .. }) => ControlFlow::Continue(()),
                    _ => ControlFlow::Break(()),
                }
            });
        for _ in 0..3 {
            transport.send(&Questions::of_tap().ask(Action::Record { on: false }).1);
        }
        self.around.marks.forget(&self.shared.id());
        if let Some(open) = &mut self.session {
            open.marks = None;
        }
        let received = receiver.counts().received;
        let ended = recorded.end(Instant::now()).and_then(|it| it.end(received));
        let failed = result.err().or_else(|| ended.as_ref().err().cloned());
        if let Some(error) = &failed {
            // Where the session has it over already, that stays.
            let _ = self.happen(&Event::Lost(error.to_string()), Instant::now());
            self.shared.update(|state| state.failed = Some(error.clone().into()));
        }
        if let Err(refusal) = self.judge() {
            self.shared.update(|state| state.failed = Some(refusal.problem));
        }
        self.show_session(Instant::now());
        let next = if failed.is_some() { Next::Reopen } else { Next::Watch };
        Ok((BoxLink::new(transport, place, kind), next))
    }

    /// Begins the recording.
    #[expect(clippy::type_complexity, reason = "the parts of one thing, taken apart at once")]
    fn begin(
        &mut self,
        link: &BoxLink,
        now: Instant,
    ) -> Result<(Recorded, Heard, Rc<RefCell<Course>>, plumbline_trial::verdict::Criteria), BadInput>
    {
        let none = || BadInput::whole("the session", "nothing is to be recorded", "begin a trial");
        let checks = self.examined_lately(now);
        let open = self.session.as_mut().ok_or_else(none)?;
        let started = jiff::Timestamp::now().to_string();
        let folder = open.open.recording_folder().ok_or_else(none)?;
        let manifest = open.open.manifest(&started).ok_or_else(none)?;
        let manifest =
            Manifest { checks: checks.as_deref().map(amiss).unwrap_or_default(), ..manifest };
        let session = open.open.session();
        let (baseline_s, duration_s) =
            session.condition().map_or((0.0, 0.0), |it| (it.baseline_s, it.duration_s));
        let (zeroing, lasts_s) = match session.protocol.zero {
            Zero::Mark => (Zeroing::Mark, duration_s),
            Zero::Start => (Zeroing::Start, duration_s),
            Zero::Onset => (Zeroing::Onset, baseline_s + duration_s),
        };
        let duration = Duration::try_from_secs_f64(lasts_s).ok();
        let course = Rc::new(RefCell::new(Course::new(now, duration, zeroing)));
        let (sender, marks) = channel();
        let heard = Heard::default();
        let told = {
            let (heard, course) = (Rc::clone(&heard), Rc::clone(&course));
            let feed = self.mark_feed.clone();
            let ahead_s = now.saturating_duration_since(self.zero).as_secs_f64();
            move |mark: &Mark, since_s: f64| {
                course.borrow_mut().mark(mark, since_s);
                heard.borrow_mut().push((mark.clone(), since_s));
                // The publisher hears the box's triggers itself, and knows their times better.
                if let Some(feed) = feed.as_ref().filter(|_| mark.source != Source::Trigger) {
                    feed.mark(&mark.label, mark.source.word(), ahead_s + since_s);
                }
            }
        };
        let recording = Recording::begin(&folder, &manifest, marks, now, Box::new(told))?;
        open.marked.clear();
        open.marks = Some(sender.clone());
        self.around.marks.take(&self.shared.id(), sender);
        let criteria = manifest.criteria.clone();
        let recorded = if checks.is_some() {
            Recorded::checked(recording, Rc::clone(&course))
        } else {
            let shared = Arc::clone(&self.shared);
            let say = move |checks: &[Check]| super::jobs::show_checks(&shared, checks);
            Recorded::unchecked(recording, Rc::clone(&course), link, now, EXAMINED_FOR, say)
        };
        Ok((recorded, heard, course, criteria))
    }

    /// Whether the box is to be examined before the next trial, while the participant gets ready.
    pub(super) fn wants_examination(&self, now: Instant) -> bool {
        let state = self.session_state();
        let is_time = matches!(state, Some(State::Instruct { .. } | State::Resting { .. }));
        let is_tried = |at: Instant| now.saturating_duration_since(at) < EXAMINED_AGAIN_AFTER;
        is_time && self.examined_lately(now).is_none() && !self.examine_tried.is_some_and(is_tried)
    }

    /// What was found lately of this start of the box.
    fn examined_lately(&self, now: Instant) -> Option<Vec<Check>> {
        let (at, boot_id, checks) = self.examined.as_ref()?;
        let is_same = self.hello.as_ref().is_some_and(|it| it.boot_id == *boot_id);
        (is_same && now.saturating_duration_since(*at) <= EXAMINED_WITHIN).then(|| checks.clone())
    }

    /// Tells the session of the marks that are in the recording.
    fn take_marks(&mut self, heard: &Heard, begun: Instant, now: Instant) {
        let marks = std::mem::take(&mut *heard.borrow_mut());
        for (mark, since_s) in marks {
            let at = begun + Duration::try_from_secs_f64(since_s.max(0.0)).unwrap_or_default();
            let shown = MarkState {
                at_ms: self.shared.ms(at).round(),
                label: mark.label.clone(),
                source: mark.source.word().to_owned(),
            };
            if let Some(open) = &mut self.session {
                open.marked.push(shown);
            }
            let _ = self.happen(&Event::Mark(mark.label), at.min(now));
        }
    }
}
