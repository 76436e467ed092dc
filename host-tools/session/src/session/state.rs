//! The states of a session, and what happens to it.
//!
//! ```text
//! Resting ──Tick, EndRest──▶ Instruct ──Ready──▶ Countdown ──Tick──▶ Recording ◀──Frame, Mark
//!    ▲                        ▲  ▲ ▲               │                  │     │
//!    │                        │  │ └────Cancel─────┘    Tick, End, Lost     Nothing
//!    │                        │  │                                  ▼     ▼
//!    │                        │  └───────────Nothing──────────── Judging  Instruct
//!    │                        │                                     │
//!    │                        │                                  Judged
//!    │                        │                                     ▼
//!    └────────────────────────┴──────Accept, Repeat, Skip─────── Deciding ──Accept, Skip──▶ Over
//! ```
//!
//! After `Deciding` comes `Resting`, or `Instruct` if the rest is over already: of the same trial
//! after `Repeat`, of the next one after `Accept` and `Skip`, and `Over` if there is none. `Skip` is
//! possible in `Resting` and `Instruct`, too. `Stop` leads from `Resting`, `Instruct`, `Countdown` and
//! `Deciding` to `Stopped`, and `Continue` from there to `Deciding` or `Instruct`. Without a countdown
//! `Ready` leads to `Recording`.
//!
//! `Interrupted` says that the program had ended: a countdown becomes `Instruct`, because nothing was
//! recorded, and a recording becomes `Judging`, because its folder is whole up to its last second. The
//! other states stay as they are.

use plumbline_trial::verdict::Grade;
use serde::{Deserialize, Serialize};

use super::ATTEMPTS_MAX;
use crate::protocol::Tones;

/// What is going on; `place` is the trial's place in the plan, from 1.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case", deny_unknown_fields)]
pub enum State {
    /// The participant rests before the next trial.
    Resting {
        /// The next trial.
        place: usize,
        /// Until when.
        until_ms: u64,
    },
    /// The instruction is read out.
    Instruct {
        /// The trial.
        place: usize,
    },
    /// The participant is ready; the recording begins soon.
    Countdown {
        /// The trial.
        place: usize,
        /// When it begins.
        until_ms: u64,
    },
    /// The latest of the attempts is being recorded.
    Recording {
        /// The trial.
        place: usize,
        /// Since when.
        begun_ms: u64,
        /// When the first frame came.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        first_frame_ms: Option<u64>,
        /// The mark that is t = 0, so far.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        zero: Option<ZeroMark>,
    },
    /// The recording has ended, and the verdict on it is not known yet.
    Judging {
        /// The trial.
        place: usize,
        /// How it ended.
        ended: Ended,
        /// When.
        ended_ms: u64,
    },
    /// The operator decides what becomes of the recording.
    Deciding {
        /// The trial.
        place: usize,
        /// How the recording ended.
        ended: Ended,
        /// When.
        ended_ms: u64,
        /// What it is worth.
        judged: Judged,
    },
    /// The session was stopped before its end.
    Stopped {
        /// The trial with which it continues.
        place: usize,
        /// The recording about which nobody has decided.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        undecided: Option<Undecided>,
    },
    /// Each trial is accepted or skipped.
    Over,
}

/// A mark that is t = 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZeroMark {
    /// When it was made.
    pub at_ms: u64,
    /// Whether it is called zero; another may still be.
    pub is_named: bool,
}

/// How a recording ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// It is as long as the protocol says.
    Complete,
    /// The mark that is t = 0 did not come.
    NoMark,
    /// The operator ended it.
    ByHand,
    /// The box was lost, or the disk is full: why.
    Lost(String),
    /// The program or the computer had stopped.
    CutOff,
}

/// What a recording is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judged {
    /// The verdict on it; `trial.toml` has the reasons.
    pub grade: Grade,
    /// Whether t = 0 is what the protocol says: the mark was made, where it is to be a mark.
    pub is_zeroed: bool,
}

/// A recording about which nobody has decided.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Undecided {
    /// How it ended.
    pub ended: Ended,
    /// When.
    pub ended_ms: u64,
    /// What it is worth.
    pub judged: Judged,
}

/// Something that happens to a session.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// Time has passed.
    Tick,
    /// The rest is long enough.
    EndRest,
    /// The participant is ready.
    Ready,
    /// The participant is not ready after all.
    Cancel,
    /// A frame of the recording has come.
    Frame,
    /// A mark with this label is in the recording.
    Mark(String),
    /// The recording is to end now.
    End,
    /// The recording has failed: why. What was recorded is kept.
    Lost(String),
    /// The program was not running for a while.
    Interrupted,
    /// The verdict on the recording.
    Judged(Judged),
    /// There is no trial in the recording's folder: why.
    Nothing(String),
    /// The recording is the trial; why, which has to be said if its verdict is unusable.
    Accept(Option<String>),
    /// The recording is not the trial, which is recorded again; why, if that is said.
    Repeat(Option<String>),
    /// The trial is not recorded, or no recording of it is accepted: why.
    Skip(String),
    /// The session ends before its time.
    Stop,
    /// A session that was stopped goes on.
    Continue,
}

/// Why an event changes nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// It belongs to another state.
    NotNow {
        /// The event.
        event: &'static str,
        /// The state.
        state: &'static str,
    },
    /// The reason cannot be kept: what is wrong with it, and the remedy.
    Reason(String, String),
    /// A recording without its t = 0 is no trial.
    NoZero,
    /// Whoever accepts an unusable recording says why.
    Unusable,
    /// There are [`ATTEMPTS_MAX`] recordings.
    TooMany,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotNow { event, state } => {
                write!(formatter, "{event:?} is not possible now: the session is at {state:?}")
            }
            Self::Reason(found, remedy) => write!(formatter, "the reason: {found}; {remedy}"),
            Self::NoZero => formatter.write_str(
                "t = 0 of this recording was not marked, so that it cannot be compared; repeat or \
                 skip the trial",
            ),
            Self::Unusable => formatter.write_str(
                "by its verdict this recording is unusable; repeat or skip the trial, or say why it \
                 is accepted all the same",
            ),
            Self::TooMany => {
                write!(formatter, "this session has {ATTEMPTS_MAX} recordings; begin another one")
            }
        }
    }
}

impl std::error::Error for Refused {}

/// A tone that the participant hears.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// The recording begins.
    Start,
    /// It is as long as the protocol says.
    End,
}

/// The tone of the way from one state to the next, if there is one.
#[must_use]
pub fn tone(before: &State, after: &State, tones: Tones) -> Option<Tone> {
    let was_recording = matches!(before, State::Recording { .. });
    match after {
        State::Recording { .. } if tones.start && !was_recording => Some(Tone::Start),
        State::Judging { ended: Ended::Complete, .. } if tones.end && was_recording => {
            Some(Tone::End)
        }
        _ => None,
    }
}

impl State {
    /// Its name in files.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Resting { .. } => "resting",
            Self::Instruct { .. } => "instruct",
            Self::Countdown { .. } => "countdown",
            Self::Recording { .. } => "recording",
            Self::Judging { .. } => "judging",
            Self::Deciding { .. } => "deciding",
            Self::Stopped { .. } => "stopped",
            Self::Over => "over",
        }
    }
}

impl Event {
    pub(super) fn word(&self) -> &'static str {
        match self {
            Self::Tick => "tick",
            Self::EndRest => "end_rest",
            Self::Ready => "ready",
            Self::Cancel => "cancel",
            Self::Frame => "frame",
            Self::Mark(_) => "mark",
            Self::End => "end",
            Self::Lost(_) => "lost",
            Self::Interrupted => "interrupted",
            Self::Judged(_) => "judged",
            Self::Nothing(_) => "nothing",
            Self::Accept(_) => "accept",
            Self::Repeat(_) => "repeat",
            Self::Skip(_) => "skip",
            Self::Stop => "stop",
            Self::Continue => "continue",
        }
    }
}
