//! A session: one participant, the planned trials, and how far they have come.
//!
//! [`Session::next`] is a pure function of the session, an [`Event`] and the time. What the states are
//! and how they follow each other is in [`state`].
//!
//! **Each recording has a folder of its own**: `03-control` for the third trial, `03-control-2` if it
//! is recorded again. A name is used once, whatever comes of it.
//!
//! **Times** are milliseconds of the session's clock, which begins with the session, goes on with
//! the computer's monotonic clock, and pauses while the program is not running.

pub mod state;

use plumbline_trial::manifest::Zero;
use plumbline_trial::verdict::Grade;
use serde::{Deserialize, Serialize};

pub use self::state::{Ended, Event, Judged, Refused, State, Tone, Undecided, ZeroMark, tone};
use crate::protocol::{Condition, Protocol};
use crate::words::{REASON_LETTERS_MAX, check_text};

/// The most recordings of a session, accepted or not.
pub const ATTEMPTS_MAX: usize = 256;

/// Beyond its baseline, a recording waits for the mark no longer than this: as `plumb receive` does.
pub const AWAITED_MS_MAX: u64 = 600_000;

/// The last frame has come by then.
const FRAME_DELAY_MS_MAX: u64 = 250;

/// The label by which a mark is t = 0 of a trial, whichever comes first.
const ZERO_LABEL: &str = "zero";

/// Why a recording that is recorded again was not accepted, if nobody says why.
const REPEATED: &str = "it was recorded again";

/// The format of `session.toml`.
pub(crate) const FORMAT: u32 = 1;

/// One participant's trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    /// Version of the file.
    pub(crate) format: u32,
    /// Who is measured, as a code.
    pub participant: String,
    /// The participant's number in the study, from 1.
    pub number: u32,
    /// Who measures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// When the session began, UTC.
    pub started: String,
    /// The number of changes until now: a page that shows an earlier one is out of date.
    pub step: u64,
    /// When the latest was.
    pub at_ms: u64,
    /// What is going on.
    pub state: State,
    /// The planned trials, in their order.
    #[serde(rename = "trial")]
    pub plan: Vec<Planned>,
    /// Trials that are not recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
    /// All recordings, in their order.
    #[serde(default, rename = "recording", skip_serializing_if = "Vec::is_empty")]
    pub attempts: Vec<Attempt>,
    /// How the participant is measured: the study's protocol as it was when the session began.
    pub protocol: Protocol,
}

/// A planned trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Planned {
    /// The condition's name.
    pub condition: String,
    /// Which of the condition's trials it is, from 1.
    pub repeat: u32,
}

/// A trial that is not recorded, or of which no recording is accepted.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Skipped {
    /// The trial's place in the plan, from 1.
    pub place: usize,
    /// Why.
    pub why: String,
}

/// A recording of a trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attempt {
    /// The trial's place in the plan, from 1.
    pub place: usize,
    /// The name of its folder, in the session's.
    pub folder: String,
    /// What has become of it.
    pub outcome: Outcome,
}

/// What has become of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case", deny_unknown_fields)]
pub enum Outcome {
    /// It is being recorded, or nobody has decided yet.
    Open,
    /// It is the trial: the study reads it.
    Accepted {
        /// Why, if its verdict is unusable.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        why: Option<String>,
    },
    /// It is kept, and the study does not read it.
    Rejected {
        /// Why.
        why: String,
    },
    /// There is no trial in its folder, or no folder.
    Nothing {
        /// Why.
        why: String,
    },
}

/// What has become of a planned trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status<'a> {
    /// It is still to be recorded.
    Open,
    /// This recording is the trial.
    Accepted(&'a Attempt),
    /// It is not recorded: why.
    Skipped(&'a str),
}

impl Outcome {
    /// Whether the study reads the recording.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        matches!(self, Self::Accepted { .. })
    }
}

impl Session {
    /// A session that begins: the plan is made of the protocol and the participant's number, which
    /// counts from 1. `started` is the time of day, as RFC 3339 writes it.
    ///
    /// # Panics
    /// When the protocol has a fault, or the number is 0.
    #[must_use]
    pub fn begin(
        participant: String,
        number: u32,
        operator: Option<String>,
        started: String,
        protocol: Protocol,
    ) -> Self {
        assert_eq!(protocol.check("the protocol"), Ok(()));
        Self {
            format: FORMAT,
            plan: plan(&protocol, number),
            participant,
            number,
            operator,
            started,
            step: 0,
            at_ms: 0,
            state: State::Instruct { place: 1 },
            skipped: Vec::new(),
            attempts: Vec::new(),
            protocol,
        }
    }

    /// What has become of the trial at this place.
    #[must_use]
    pub fn status(&self, place: usize) -> Status<'_> {
        let accepted = |it: &&Attempt| it.place == place && it.outcome.is_accepted();
        if let Some(attempt) = self.attempts.iter().find(accepted) {
            return Status::Accepted(attempt);
        }
        let skipped = self.skipped.iter().find(|it| it.place == place);
        skipped.map_or(Status::Open, |it| Status::Skipped(&it.why))
    }

    /// The place of the trial that is going on or comes next; `None` when the session is over.
    #[must_use]
    pub fn place(&self) -> Option<usize> {
        match self.state {
            State::Resting { place, .. }
            | State::Instruct { place }
            | State::Countdown { place, .. }
            | State::Recording { place, .. }
            | State::Judging { place, .. }
            | State::Deciding { place, .. }
            | State::Stopped { place, .. } => Some(place),
            State::Over => None,
        }
    }

    /// Its condition.
    #[must_use]
    pub fn condition(&self) -> Option<&Condition> {
        self.protocol.condition(&self.plan.get(self.place()?.checked_sub(1)?)?.condition)
    }

    /// The recording that is going on, or about which nobody has decided.
    #[must_use]
    pub fn attempt(&self) -> Option<&Attempt> {
        self.attempts.last().filter(|it| it.outcome == Outcome::Open)
    }

    /// When the recording that goes on ends, as far as is known: the time, and whether t = 0 is
    /// still awaited.
    #[must_use]
    pub fn ends_ms(&self) -> Option<(u64, bool)> {
        let State::Recording { begun_ms, first_frame_ms, zero, .. } = &self.state else {
            return None;
        };
        let Condition { baseline_s, duration_s, .. } = self.condition()?;
        let [baseline, duration] = [baseline_s, duration_s].map(|it| milliseconds(*it));
        let start = first_frame_ms.unwrap_or(*begun_ms);
        let (end, is_awaited) = match (self.protocol.zero, zero) {
            (Zero::Mark, Some(zero)) => (zero.at_ms.saturating_add(duration), false),
            (Zero::Mark, None) => (start.saturating_add(baseline + AWAITED_MS_MAX), true),
            (Zero::Start | Zero::Onset, _) => (start.saturating_add(baseline + duration), false),
        };
        Some((end, is_awaited))
    }

    /// When the mark is due that is t = 0: after the baseline. `None` while nothing is recorded,
    /// where t = 0 is no mark, and once it has come.
    #[must_use]
    pub fn mark_due_ms(&self) -> Option<u64> {
        let State::Recording { begun_ms, first_frame_ms, zero: None, .. } = &self.state else {
            return None;
        };
        let baseline = milliseconds(self.condition()?.baseline_s);
        let start = first_frame_ms.unwrap_or(*begun_ms);
        (self.protocol.zero == Zero::Mark).then(|| start.saturating_add(baseline))
    }

    /// The session after an event at `now_ms` of its clock. What is always possible and changes
    /// nothing, such as a [`Tick`](Event::Tick) before its time, gives the same session.
    ///
    /// # Errors
    /// When the event is not possible now.
    pub fn next(&self, event: &Event, now_ms: u64) -> Result<Self, Refused> {
        let now_ms = now_ms.max(self.at_ms);
        let mut next = self.clone();
        next.change(event, now_ms)?;
        if next != *self {
            next.step = self.step.saturating_add(1);
            next.at_ms = now_ms;
        }
        Ok(next)
    }

    fn change(&mut self, event: &Event, now_ms: u64) -> Result<(), Refused> {
        let state = self.state.clone();
        self.state = match (state, event) {
            (State::Resting { place, until_ms }, Event::Tick) if now_ms >= until_ms => {
                State::Instruct { place }
            }
            (State::Resting { place, .. }, Event::EndRest) => State::Instruct { place },
            (State::Resting { place, until_ms }, Event::Skip(why)) => {
                self.skip(place, why)?;
                match self.open_place() {
                    Some(place) => State::Resting { place, until_ms },
                    None => State::Over,
                }
            }
            (State::Instruct { place }, Event::Skip(why)) => {
                self.skip(place, why)?;
                self.open_place().map_or(State::Over, |place| State::Instruct { place })
            }
            (State::Instruct { place }, Event::Ready) => {
                if self.attempts.len() >= ATTEMPTS_MAX {
                    return Err(Refused::TooMany);
                }
                match milliseconds(self.protocol.countdown_s) {
                    0 => self.record(place, now_ms),
                    wait => State::Countdown { place, until_ms: now_ms.saturating_add(wait) },
                }
            }
            (State::Countdown { place, until_ms }, Event::Tick) if now_ms >= until_ms => {
                self.record(place, now_ms)
            }
            (State::Countdown { place, .. }, Event::Cancel | Event::Interrupted) => {
                State::Instruct { place }
            }
            (State::Recording { place, begun_ms, first_frame_ms, zero }, Event::Frame) => {
                let first_frame_ms = first_frame_ms.or(Some(now_ms));
                State::Recording { place, begun_ms, first_frame_ms, zero }
            }
            (State::Recording { place, begun_ms, first_frame_ms, zero }, Event::Mark(label)) => {
                let zero = self.zero_after(zero, label, now_ms);
                State::Recording { place, begun_ms, first_frame_ms, zero }
            }
            (state @ State::Recording { place, .. }, Event::Tick) => match self.ends_ms() {
                Some((end, is_awaited)) if now_ms >= end.saturating_add(FRAME_DELAY_MS_MAX) => {
                    let ended = if is_awaited { Ended::NoMark } else { Ended::Complete };
                    State::Judging { place, ended, ended_ms: now_ms }
                }
                _ => state,
            },
            (State::Recording { place, .. }, Event::End) => {
                State::Judging { place, ended: Ended::ByHand, ended_ms: now_ms }
            }
            (State::Recording { place, .. }, Event::Lost(why)) => {
                State::Judging { place, ended: Ended::Lost(brief(why)), ended_ms: now_ms }
            }
            (State::Recording { place, .. }, Event::Interrupted) => {
                // The session's clock stood still meanwhile.
                State::Judging { place, ended: Ended::CutOff, ended_ms: now_ms }
            }
            (
                State::Recording { place, .. } | State::Judging { place, .. },
                Event::Nothing(why),
            ) => {
                self.decide(Outcome::Nothing { why: brief(why) });
                State::Instruct { place }
            }
            (State::Judging { place, ended, ended_ms }, Event::Judged(judged)) => {
                State::Deciding { place, ended, ended_ms, judged: *judged }
            }
            (State::Deciding { ended_ms, judged, .. }, Event::Accept(why)) => {
                if !judged.is_zeroed {
                    return Err(Refused::NoZero);
                }
                match why {
                    Some(why) => check_reason(why)?,
                    None if judged.grade == Grade::Unusable => return Err(Refused::Unusable),
                    None => {}
                }
                self.decide(Outcome::Accepted { why: why.clone() });
                self.go_on(ended_ms, now_ms)
            }
            (State::Deciding { ended_ms, .. }, Event::Repeat(why)) => {
                let why = why.clone().unwrap_or_else(|| REPEATED.to_owned());
                check_reason(&why)?;
                self.decide(Outcome::Rejected { why });
                self.go_on(ended_ms, now_ms)
            }
            (State::Deciding { place, ended_ms, .. }, Event::Skip(why)) => {
                self.skip(place, why)?;
                self.decide(Outcome::Rejected { why: why.clone() });
                self.go_on(ended_ms, now_ms)
            }
            (State::Deciding { place, ended, ended_ms, judged }, Event::Stop) => {
                State::Stopped { place, undecided: Some(Undecided { ended, ended_ms, judged }) }
            }
            (
                State::Resting { place, .. }
                | State::Instruct { place }
                | State::Countdown { place, .. },
                Event::Stop,
            ) => State::Stopped { place, undecided: None },
            (State::Stopped { place, undecided }, Event::Continue) => match undecided {
                Some(Undecided { ended, ended_ms, judged }) => {
                    State::Deciding { place, ended, ended_ms, judged }
                }
                None => State::Instruct { place },
            },
            // The last frame may come after the end.
            (state, Event::Tick | Event::Frame | Event::Interrupted) => state,
            (state, event) => {
                return Err(Refused::NotNow { event: event.word(), state: state.word() });
            }
        };
        Ok(())
    }

    /// Begins a recording, in a folder of its own.
    fn record(&mut self, place: usize, now_ms: u64) -> State {
        let folder = self.next_folder(place);
        self.attempts.push(Attempt { place, folder, outcome: Outcome::Open });
        State::Recording { place, begun_ms: now_ms, first_frame_ms: None, zero: None }
    }

    /// The name of the folder of the next recording of a trial.
    fn next_folder(&self, place: usize) -> String {
        let before = self.attempts.iter().filter(|it| it.place == place).count();
        folder_name(place, &self.plan[place - 1].condition, before + 1)
    }

    /// The mark that is t = 0 after another mark, as the trial's own reader takes it: the first that
    /// is called zero or, if the protocol has none of that name, the first of all.
    fn zero_after(&self, zero: Option<ZeroMark>, label: &str, at_ms: u64) -> Option<ZeroMark> {
        let awaited = self.protocol.zero_mark()?;
        let is_named = label.eq_ignore_ascii_case(ZERO_LABEL);
        let counts = match zero {
            None => is_named || !awaited.eq_ignore_ascii_case(ZERO_LABEL),
            Some(zero) => is_named && !zero.is_named,
        };
        if counts { Some(ZeroMark { at_ms, is_named }) } else { zero }
    }

    fn skip(&mut self, place: usize, why: &str) -> Result<(), Refused> {
        check_reason(why)?;
        self.skipped.push(Skipped { place, why: why.to_owned() });
        Ok(())
    }

    fn decide(&mut self, outcome: Outcome) {
        if let Some(attempt) = self.attempts.last_mut() {
            attempt.outcome = outcome;
        }
    }

    /// The first trial that is neither accepted nor skipped.
    fn open_place(&self) -> Option<usize> {
        (1..=self.plan.len()).find(|place| self.status(*place) == Status::Open)
    }

    /// The state after a recording, which ended at `ended_ms`: the rest has begun then.
    fn go_on(&self, ended_ms: u64, now_ms: u64) -> State {
        let Some(place) = self.open_place() else { return State::Over };
        let until_ms = ended_ms.saturating_add(milliseconds(self.protocol.rest_s));
        if until_ms > now_ms {
            State::Resting { place, until_ms }
        } else {
            State::Instruct { place }
        }
    }
}

/// The planned trials of the participant with this number.
#[must_use]
pub fn plan(protocol: &Protocol, number: u32) -> Vec<Planned> {
    let order = |repeat: u32| {
        let order = protocol.order.of_repeat(protocol.conditions.len(), number, repeat);
        order.into_iter().map(move |at| (at, repeat + 1))
    };
    let planned = (0..protocol.repeats).flat_map(order);
    let condition = |at: usize| protocol.conditions[at].name.clone();
    planned.map(|(at, repeat)| Planned { condition: condition(at), repeat }).collect()
}

/// The name of the folder of a trial's first, second, ... recording.
pub(crate) fn folder_name(place: usize, condition: &str, attempt: usize) -> String {
    let again = if attempt == 1 { String::new() } else { format!("-{attempt}") };
    format!("{place:02}-{condition}{again}")
}

/// Bounded seconds in milliseconds.
fn milliseconds(seconds: f64) -> u64 {
    (seconds * 1000.0).round() as u64
}

/// What a program says, as a reason that can be kept.
fn brief(why: &str) -> String {
    let text = plumbline_files::text::printable(why);
    let text: String = text.trim().chars().take(REASON_LETTERS_MAX).collect();
    let text = text.trim();
    if text.is_empty() { "no reason was given".to_owned() } else { text.to_owned() }
}

fn check_reason(why: &str) -> Result<(), Refused> {
    check_text(why, REASON_LETTERS_MAX).map_err(|(found, remedy)| Refused::Reason(found, remedy))
}

#[cfg(test)]
mod tests;
