//! What is possible with a box now.

use plumbline_calibration::PHOTOGRAPHS_MIN;
use plumbline_session::session::State;

use super::orders::Refusal;
use super::{Reach, Worker};
use crate::wire::{BoxState, Can, Doing};

/// What a station does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Its box is not heard.
    Away,
    Watching,
    Examining,
    Aiming,
    /// The exposure is sought.
    Exposing,
    Delivering,
    Measuring,
    Recording,
}

impl Worker {
    /// The actions that are possible now.
    pub(super) fn possible(&self) -> Vec<Can> {
        let mut can = Vec::new();
        let session = self.session.as_ref().map(|open| &open.open.session().state);
        match self.stage {
            Stage::Watching => {
                let is_calm =
                    !matches!(session, Some(State::Countdown { .. } | State::Recording { .. }));
                if is_calm {
                    can.push(Can::Examine);
                }
                if session.is_none() {
                    can.extend([
                        Can::AimBegin,
                        Can::PhotographsBegin,
                        Can::SceneMeasure,
                        Can::SettingsSend,
                    ]);
                    if self.measured.is_some() {
                        can.push(Can::SceneStore);
                    }
                    if self.calibrated.is_some() && self.fitting.is_none() {
                        can.push(Can::CalibrationDeliver);
                    }
                }
                can.push(Can::Reference);
            }
            Stage::Aiming => {
                can.extend([Can::AimExpose, Can::AimEnd, Can::PhotographsBegin]);
                if let Some(photographs) = &self.photographs {
                    can.extend([Can::PhotographsTake, Can::PhotographsAuto]);
                    if photographs.is_automatic() {
                        can.push(Can::PhotographsPause);
                    }
                }
                if self.calibrated.is_some() && self.fitting.is_none() {
                    can.push(Can::CalibrationDeliver);
                }
            }
            Stage::Exposing => can.push(Can::AimCancel),
            Stage::Away
            | Stage::Examining
            | Stage::Delivering
            | Stage::Measuring
            | Stage::Recording => {}
        }
        if matches!(self.stage, Stage::Away | Stage::Watching | Stage::Aiming)
            && self.fitting.is_none()
            && let Some(photographs) = &self.photographs
        {
            if !photographs.is_empty() {
                can.push(Can::PhotographsRemove);
            }
            if photographs.found() >= PHOTOGRAPHS_MIN {
                can.push(Can::CalibrationFit);
            }
        }
        match session {
            // Without its box, nobody knows what is at a serial line.
            None if matches!(self.stage, Stage::Away | Stage::Watching)
                && (matches!(self.reach, Reach::Udp(_)) || self.hello.is_some()) =>
            {
                can.push(Can::SessionBegin);
            }
            None => {}
            Some(state) => {
                can.push(Can::SessionEvent);
                match state {
                    State::Recording { .. } => can.push(Can::SessionMark),
                    State::Judging { .. } => {}
                    _ => can.push(Can::SessionClose),
                }
            }
        }
        can
    }

    /// Shows them.
    pub(super) fn show_can(&self) {
        let can = self.possible();
        self.shared.update(|state| state.can = can);
    }
}

/// Why something is not possible now.
pub fn not_now(state: &BoxState, what: Can) -> Refusal {
    let doing = match state.doing {
        Doing::Nothing => "the box is not heard",
        Doing::Watching if state.session.is_some() => "a session goes on with this box",
        Doing::Watching => "the box is only watched",
        Doing::Examining => "the box is being examined",
        Doing::Aiming => "the box is in set-up mode",
        Doing::Exposing => "the exposure is being sought",
        Doing::Delivering => "the box is being given another configuration",
        Doing::MeasuringScene => "the scene is being measured",
        Doing::Recording => "a trial is being recorded",
    };
    let remedy = match state.doing {
        Doing::Nothing => "switch it on, and check its link",
        Doing::Watching if state.session.is_some() => "close the session first; it can be resumed",
        Doing::Watching => "look at what is possible now",
        Doing::Aiming => "end it first",
        _ => "wait until that is over",
    };
    let what = serde_json::to_value(what).ok();
    let what = what.as_ref().and_then(serde_json::Value::as_str).unwrap_or_default().to_owned();
    Refusal::not_now(&state.name, format!("{what} is not possible now: {doing}"), remedy)
}
