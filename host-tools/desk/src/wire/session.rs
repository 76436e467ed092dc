//! A session, as a page shows it.

use serde::{Deserialize, Serialize};

use super::studies::TrialRow;

/// A session that goes on with a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SessionState {
    /// The study's folder.
    pub study: String,
    /// The study's title.
    pub title: String,
    /// The session's name, `P01-1`.
    pub name: String,
    /// Who is measured: a code.
    pub participant: String,
    /// Who measures.
    pub operator: Option<String>,
    /// Rises with every change: an event says which one its page has seen.
    pub step: u64,
    /// What goes on.
    pub at: SessionAt,
    /// The events that are possible now.
    pub can: Vec<EventWord>,
    /// The planned trials, in their order.
    pub plan: Vec<PlannedRow>,
    /// All recordings, in their order.
    pub trials: Vec<TrialRow>,
    /// The condition of the trial that goes on or comes next.
    pub condition: Option<ConditionState>,
    /// The labels of the marks among which one chooses; the first has the key 1, and so on.
    pub marks: Vec<String>,
    /// The marks of the recording that goes on.
    pub marked: Vec<MarkState>,
    /// What a user should know of the study's files.
    pub warnings: Vec<String>,
}

/// What goes on in a session; `place` is the trial's place in the plan, from 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum SessionAt {
    /// The participant rests before the next trial.
    Resting {
        /// The next trial.
        place: usize,
        /// Until when.
        until_at_ms: f64,
    },
    /// The instruction is read out.
    Instruct {
        /// The trial.
        place: usize,
    },
    /// The recording begins soon.
    Countdown {
        /// The trial.
        place: usize,
        /// When.
        until_at_ms: f64,
    },
    /// A trial is recorded.
    Recording {
        /// The trial.
        place: usize,
        /// Since when.
        begun_at_ms: f64,
        /// When the first frame came.
        first_frame_at_ms: Option<f64>,
        /// When the mark came that is t = 0, where t = 0 is a mark.
        zero_at_ms: Option<f64>,
        /// When that mark is due: after the baseline; `null` once it has come.
        mark_due_at_ms: Option<f64>,
        /// When it ends by itself.
        ends_at_ms: Option<f64>,
    },
    /// The recording has ended, and is judged.
    Judging {
        /// The trial.
        place: usize,
    },
    /// The operator decides.
    Deciding {
        /// The trial.
        place: usize,
        /// The recording's folder.
        trial: String,
        /// What it is worth.
        grade: Grade,
        /// Whether t = 0 is what the protocol says; a recording without it cannot be accepted.
        is_zeroed: bool,
        /// How it ended, in words.
        ended: String,
        /// The reasons of the verdict.
        reasons: Vec<super::Reason>,
        /// Whether accepting needs a reason.
        needs_reason: bool,
    },
    /// It was stopped before its end.
    Stopped {
        /// The trial with which it continues.
        place: usize,
    },
    /// Each trial is accepted or skipped.
    Over,
}

/// What a recording is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// It can be used.
    Good,
    /// It is worth a look.
    Doubtful,
    /// It cannot be used.
    Unusable,
}

/// An event's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventWord {
    /// The rest is long enough: from `resting`.
    EndRest,
    /// The participant is ready: from `instruct`, once the box is watched and was examined.
    Ready,
    /// Not ready after all: from `countdown`.
    Cancel,
    /// The recording is to end now.
    End,
    /// The recording is the trial: from `deciding`; with a reason if it is unusable.
    Accept,
    /// It is recorded again: from `deciding`; with or without a reason.
    Repeat,
    /// The trial is left out: from `resting`, `instruct` and `deciding`; with a reason.
    Skip,
    /// The session ends before its time: not from `recording` and `judging`.
    Stop,
    /// A stopped session goes on.
    Continue,
    /// The verdict is tried again: from `judging`, where that failed.
    Judge,
    /// A recording that cannot be judged is given up: from `judging`; with a reason.
    GiveUp,
}

/// A planned trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedRow {
    /// Its place, from 1.
    pub place: usize,
    /// The condition's name in files.
    pub condition: String,
    /// The condition's name on the screen.
    pub label: String,
    /// Which of the condition's trials, from 1.
    pub repeat: u32,
    /// `open`, `now`, `accepted` or `skipped`.
    pub status: String,
    /// Why it was skipped.
    pub why: Option<String>,
}

/// A condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConditionState {
    /// Its name in files.
    pub name: String,
    /// Its name on the screen.
    pub label: String,
    /// What is read out.
    pub instruction: String,
    /// The time before the mark is due, or before the person is expected to stand.
    pub baseline_s: f64,
    /// The time that is measured from t = 0 on.
    pub duration_s: f64,
    /// What t = 0 is: `mark`, `start` or `onset`.
    pub zero: String,
}

/// A mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkState {
    /// When.
    pub at_ms: f64,
    /// Its label.
    pub label: String,
    /// Where it comes from: `key`, `lsl`, `udp`, `serial`.
    pub source: String,
}
