//! What a station is told to do.

use std::time::Instant;

use plumbline_bedside::box_settings::BoxSettings;
use plumbline_files::BadInput;
use plumbline_session::open::Failed;
use tokio::sync::oneshot;

use crate::wire::{
    AimBegin, AimExpose, CalibrationDeliver, Can, PhotographRemove, PhotographsAuto,
    PhotographsBegin, Problem, SceneMeasure, SessionBegin, SessionEvent, SessionMark,
    SessionResume,
};

/// An action on a box.
#[derive(Debug)]
pub enum Order {
    /// The doctor examines it.
    Examine,
    /// Movement is drawn from where the person is now.
    Reference,
    /// Set-up mode begins.
    AimBegin(AimBegin),
    /// The exposure is sought.
    AimExpose(AimExpose),
    /// The search ends.
    AimCancel,
    /// Set-up mode ends.
    AimEnd,
    /// A new set of photographs.
    PhotographsBegin(PhotographsBegin),
    /// One now.
    PhotographsTake,
    /// Several by themselves.
    PhotographsAuto(PhotographsAuto),
    /// None by itself.
    PhotographsPause,
    /// One is removed.
    PhotographsRemove(PhotographRemove),
    /// A camera is fitted to them.
    CalibrationFit,
    /// The box gets it.
    CalibrationDeliver(CalibrationDeliver),
    /// The scene is measured.
    SceneMeasure(SceneMeasure),
    /// The box gets it.
    SceneStore,
    /// The box gets other settings, which were checked.
    SettingsSend(BoxSettings),
    /// A session begins.
    SessionBegin(SessionBegin),
    /// A session goes on.
    SessionResume(SessionResume),
    /// The operator does something.
    SessionEvent(SessionEvent),
    /// A mark, at this moment.
    SessionMark(SessionMark, Instant),
    /// The session is closed.
    SessionClose,
}

impl Order {
    /// What has to be possible.
    #[must_use]
    pub fn needs(&self) -> Can {
        match self {
            Self::Examine => Can::Examine,
            Self::Reference => Can::Reference,
            Self::AimBegin(_) => Can::AimBegin,
            Self::AimExpose(_) => Can::AimExpose,
            Self::AimCancel => Can::AimCancel,
            Self::AimEnd => Can::AimEnd,
            Self::PhotographsBegin(_) => Can::PhotographsBegin,
            Self::PhotographsTake => Can::PhotographsTake,
            Self::PhotographsAuto(_) => Can::PhotographsAuto,
            Self::PhotographsPause => Can::PhotographsPause,
            Self::PhotographsRemove(_) => Can::PhotographsRemove,
            Self::CalibrationFit => Can::CalibrationFit,
            Self::CalibrationDeliver(_) => Can::CalibrationDeliver,
            Self::SceneMeasure(_) => Can::SceneMeasure,
            Self::SceneStore => Can::SceneStore,
            Self::SettingsSend(_) => Can::SettingsSend,
            Self::SessionBegin(_) | Self::SessionResume(_) => Can::SessionBegin,
            Self::SessionEvent(_) => Can::SessionEvent,
            Self::SessionMark(..) => Can::SessionMark,
            Self::SessionClose => Can::SessionClose,
        }
    }
}

/// Why an order was not carried out.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// The status of the answer.
    pub status: u16,
    /// Why.
    pub problem: Problem,
}

impl Refusal {
    /// What was sent cannot be used.
    #[must_use]
    pub fn bad(problem: impl Into<Problem>) -> Self {
        Self { status: 400, problem: problem.into() }
    }

    /// Not now.
    #[must_use]
    pub fn not_now(
        place: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { status: 409, problem: Problem::new(place, found, remedy) }
    }
}

impl From<BadInput> for Refusal {
    fn from(error: BadInput) -> Self {
        Self::bad(error)
    }
}

impl Refusal {
    /// Why a session has not taken an event.
    #[must_use]
    pub fn of_session(name: &str, failed: Failed) -> Self {
        match failed {
            Failed::Refused(refused) => {
                Self::not_now(format!("session {name}"), refused.to_string(), "")
            }
            Failed::Input(error) => Self { status: 500, problem: error.into() },
        }
    }
}

/// An order, and where its answer goes.
#[derive(Debug)]
pub struct Envelope {
    /// The order.
    pub order: Order,
    /// Who waits for the answer.
    pub answer: oneshot::Sender<Result<(), Refusal>>,
}
