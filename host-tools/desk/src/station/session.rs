//! The session of a station: its time, what the operator does, and what is shown of it.

use std::time::{Duration, Instant};

use plumbline_session::folder::StudyFolder;
use plumbline_session::open::OpenSession;
use plumbline_session::session::{Ended, Event, State, Tone as SessionTone, tone};
use plumbline_trial::Manifest;
use plumbline_trial::mark::{Mark, MarkSender, Source};

use super::can::Stage;
use super::orders::Refusal;
use super::{Worker, show};
use crate::studies;
use crate::wire::{
    EventWord, MarkState, Problem, Reason, SessionBegin, SessionEvent, SessionMark, SessionResume,
    Tone, TrialRow,
};
use crate::words::on_page;

/// A key was pressed no longer ago than this.
const MARK_AGE_MAX: Duration = Duration::from_secs(5);

/// A short tone is heard this many times before the start, a second apart.
const COUNTS: u64 = 3;

/// A session that goes on with this box.
pub struct Open {
    /// The session.
    pub open: OpenSession,
    /// The study's folder, as routes have it.
    pub study: String,
    /// The study's title.
    pub title: String,
    /// The marks of the recording that goes on.
    pub marked: Vec<MarkState>,
    /// Through which marks get into the recording that goes on.
    pub marks: Option<MarkSender>,
    /// The seconds of the countdown that have been heard.
    counted: Option<u64>,
    /// Why the latest verdict could not be had.
    unjudged: Option<Problem>,
    /// What stands on the disk of the recordings, as of a step.
    seen: Option<(u64, OnDisk)>,
}

/// What stands on the disk of a session's recordings.
#[derive(Debug, Clone, Default)]
pub struct OnDisk {
    /// All recordings.
    pub trials: Vec<TrialRow>,
    /// The reasons of the verdict on the latest one, if nobody has decided.
    pub reasons: Vec<Reason>,
}

impl Open {
    fn new(open: OpenSession, study: String, title: String) -> Self {
        Self {
            open,
            study,
            title,
            marked: Vec::new(),
            marks: None,
            counted: None,
            unjudged: None,
            seen: None,
        }
    }

    /// What stands on the disk; it is read once for each step.
    pub fn on_disk(&mut self) -> OnDisk {
        let session = self.open.session();
        if let Some((step, seen)) = &self.seen
            && *step == session.step
        {
            return seen.clone();
        }
        let folder = self.open.recording_folder();
        let verdict = folder.and_then(|it| Manifest::read(&it).ok()).map(|it| it.verdict());
        let reasons = verdict.map(|it| it.reasons).unwrap_or_default().into_iter();
        let seen = OnDisk {
            trials: studies::trials(&self.open.folder(), session),
            reasons: reasons.map(|it| show::reason(&it.words, &it.remedy)).collect(),
        };
        self.seen = Some((session.step, seen.clone()));
        seen
    }

    /// Why the latest verdict could not be had, and what else a user should know.
    pub fn warnings(&self) -> Vec<String> {
        let unjudged = self.unjudged.iter().map(|it| {
            format!("the recording cannot be judged: {}: {}; {}", it.place, it.found, it.remedy)
        });
        self.open.warnings().iter().map(|it| on_page(it)).chain(unjudged).collect()
    }
}

impl Worker {
    /// Continues the session that went on when the desk was ended, if there was one.
    pub(super) fn resume_latest(&mut self) {
        let id = self.shared.id();
        let Some((study, session)) = self.around.memory.session_of(&id) else { return };
        let resume = SessionResume { study, session };
        if let Err(refusal) = self.resume_session(&resume) {
            self.around.memory.forget_session(&id);
            let Problem { place, found, remedy } = refusal.problem;
            self.shared.notice(
                true,
                format!("session {} is not continued: {place}: {found}; {remedy}", resume.session),
            );
        }
        self.show_session(Instant::now());
        self.show_can();
    }

    fn opened(&mut self, open: OpenSession, folder: &str, study: &StudyFolder) {
        self.around.memory.note_session(&self.shared.id(), folder, open.name());
        let title = studies::title(study);
        self.session = Some(Open::new(open, folder.to_owned(), title));
        self.shared.hub.study_changed();
    }

    pub(super) fn begin_session(&mut self, begin: &SessionBegin) -> Result<(), Refusal> {
        let study = studies::open(&self.around.folder, &begin.study)?;
        let started = jiff::Timestamp::now().to_string();
        let operator = begin.operator.as_deref().filter(|it| !it.is_empty());
        let open = study.begin(&begin.participant, operator, &started, Instant::now())?;
        self.opened(open, &begin.study, &study);
        Ok(())
    }

    pub(super) fn resume_session(&mut self, resume: &SessionResume) -> Result<(), Refusal> {
        let study = studies::open(&self.around.folder, &resume.study)?;
        let open = study.resume(&resume.session, Instant::now())?;
        self.opened(open, &resume.study, &study);
        Ok(())
    }

    pub(super) fn close_session(&mut self) -> Result<(), Refusal> {
        self.session = None;
        self.around.memory.forget_session(&self.shared.id());
        self.shared.hub.study_changed();
        Ok(())
    }

    /// Lets something happen to the session; what follows from it is heard and remembered.
    pub(super) fn happen(&mut self, event: &Event, now: Instant) -> Result<(), Refusal> {
        let Some(open) = &mut self.session else {
            return Err(Refusal::not_now("the session", "there is none", "begin one"));
        };
        let before = (open.open.session().state.clone(), open.open.session().step);
        let name = open.open.name().to_owned();
        open.open.take(event, now).map_err(|failed| Refusal::of_session(&name, failed))?;
        let session = open.open.session();
        let heard = tone(&before.0, &session.state, session.protocol.tones);
        let is_changed = session.step != before.1;
        if let Some(heard) = heard {
            let tone = match heard {
                SessionTone::Start => Tone::Start,
                SessionTone::End => Tone::End,
            };
            self.shared.hub.tone(&self.shared.id(), tone, now);
        }
        if is_changed {
            self.shared.hub.study_changed();
            self.show_session(now);
            self.show_can();
        }
        Ok(())
    }

    /// Time passes for the session.
    pub(super) fn tick(&mut self, now: Instant) {
        if self.session.is_none() {
            return;
        }
        if let Err(refusal) = self.happen(&Event::Tick, now) {
            self.shared.update(|state| state.failed = Some(refusal.problem));
        }
        self.count(now);
        // A recording needs its box.
        if self.stage == Stage::Away
            && self.session_state().is_some_and(|it| matches!(it, State::Recording { .. }))
        {
            let why = "the box is not heard".to_owned();
            let _ = self.happen(&Event::Nothing(why), now);
        }
    }

    /// The last seconds of a countdown are heard.
    fn count(&mut self, now: Instant) {
        let Some(open) = &mut self.session else { return };
        let State::Countdown { until_ms, .. } = open.open.session().state else {
            open.counted = None;
            return;
        };
        let left_s = until_ms.saturating_sub(open.open.now_ms(now)).div_ceil(1000);
        if (1..=COUNTS).contains(&left_s) && open.counted != Some(left_s) {
            open.counted = Some(left_s);
            self.shared.hub.tone(&self.shared.id(), Tone::Count, now);
        }
    }

    /// The session's state.
    pub(super) fn session_state(&self) -> Option<&State> {
        self.session.as_ref().map(|open| &open.open.session().state)
    }

    /// Judges the recording that has ended.
    pub(super) fn judge(&mut self) -> Result<(), Refusal> {
        let Some(open) = &mut self.session else { return Ok(()) };
        let result = open.open.judge(Instant::now()).map(|_| ());
        open.unjudged = result.as_ref().err().map(|error| error.clone().into());
        self.shared.hub.study_changed();
        result.map_err(|error| Refusal { status: 500, problem: error.into() })
    }

    pub(super) fn session_event(&mut self, asked: &SessionEvent) -> Result<(), Refusal> {
        let Some(open) = &self.session else {
            return Err(Refusal::not_now("the session", "there is none", "begin one"));
        };
        let name = format!("session {}", open.open.name());
        if asked.step != open.open.session().step {
            return Err(Refusal::not_now(
                name,
                "something else has happened meanwhile",
                "look at where the session is now",
            ));
        }
        let given = asked.why.as_ref().map(|why| why.trim().to_owned());
        let given = given.filter(|why| !why.is_empty());
        let needed = || {
            given
                .clone()
                .ok_or_else(|| Refusal::bad(Problem::new(&name, "there is no reason", "say why")))
        };
        let event = match asked.event {
            EventWord::EndRest => Event::EndRest,
            EventWord::Ready if self.stage != Stage::Watching => {
                return Err(Refusal::not_now(
                    name,
                    "the box cannot record now",
                    "wait until it is heard and watched",
                ));
            }
            EventWord::Ready => Event::Ready,
            EventWord::Cancel => Event::Cancel,
            EventWord::End => Event::End,
            EventWord::Accept => Event::Accept(given),
            EventWord::Repeat => Event::Repeat(given),
            EventWord::Skip => Event::Skip(needed()?),
            EventWord::Stop => Event::Stop,
            EventWord::Continue => Event::Continue,
            EventWord::Judge => return self.judge(),
            EventWord::GiveUp => {
                if !matches!(self.session_state(), Some(State::Judging { .. })) {
                    return Err(Refusal::not_now(name, "nothing waits for a verdict", ""));
                }
                Event::Nothing(needed()?)
            }
        };
        self.happen(&event, Instant::now())
    }

    pub(super) fn mark(&mut self, mark: &SessionMark, came: Instant) -> Result<(), Refusal> {
        let sender = self.session.as_ref().and_then(|open| open.marks.as_ref());
        let Some(sender) = sender else {
            return Err(Refusal::not_now("the mark", "nothing is recorded", "mark a recording"));
        };
        let at = match mark.at_ms {
            None => came,
            Some(at_ms) => {
                let at = self.shared.hub.instant(at_ms).filter(|at| {
                    *at <= came + MARK_AGE_MAX
                        && came.saturating_duration_since(*at) <= MARK_AGE_MAX
                });
                at.map(|at| at.min(came)).ok_or_else(|| {
                    Refusal::bad(Problem::new(
                        "the mark: at_ms",
                        format!("{at_ms} is not within the last {} s", MARK_AGE_MAX.as_secs()),
                        "compare the page's clock with the desk's",
                    ))
                })?
            }
        };
        sender.send(at, Mark::new(Source::Key, &mark.label));
        Ok(())
    }

    /// Shows the session.
    pub(super) fn show_session(&mut self, now: Instant) {
        let can_record = self.stage == Stage::Watching;
        let hub = &self.shared.hub;
        let shown = self.session.as_mut().map(|open| show::session(open, hub, now, can_record));
        self.shared.update(|state| state.session = shown);
    }
}

/// How a recording ended, in words.
pub fn ended_words(ended: &Ended) -> String {
    match ended {
        Ended::Complete => "it is as long as the protocol says".to_owned(),
        Ended::NoMark => "the mark that is t = 0 did not come".to_owned(),
        Ended::ByHand => "it was ended by hand".to_owned(),
        Ended::Lost(why) => format!("it was lost: {why}"),
        Ended::CutOff => "the desk had been ended".to_owned(),
    }
}
