//! What a host that updates the box is answered.

use plumbline::packet::{
    UPDATE_TEXT_BYTES_MAX, UpdateOutcome, UpdateRefusal, UpdateState, UpdateStep,
};
use plumbline::seal::UpdaterId;

use super::Updates;
use crate::logger;

impl Updates {
    /// Does what a host asks; `recorder` names who records a trial. A part is not answered.
    ///
    /// While a trial is recorded a host that sends an update waits, unless it has begun by force: a card
    /// that is busy may disturb it.
    pub fn answer(
        &mut self,
        updater: UpdaterId,
        step: UpdateStep,
        recorder: Option<&str>,
    ) -> Option<UpdateOutcome> {
        let is_forced = match &step {
            UpdateStep::Query | UpdateStep::Part { .. } => {
                !self.is_receiving() || self.receives_by_force()
            }
            UpdateStep::Begin { is_forced } | UpdateStep::Try { is_forced } => *is_forced,
            UpdateStep::Leave => true,
        };
        let is_part = matches!(step, UpdateStep::Part { .. });
        if let Some(recorder) = recorder
            && !is_forced
        {
            let words = format_args!("{recorder} records a trial, which it would disturb");
            return (!is_part).then(|| refused(UpdateRefusal::Recording, words));
        }
        match step {
            UpdateStep::Query => Some(self.query()),
            UpdateStep::Begin { is_forced } => Some(self.begin(updater, is_forced)),
            UpdateStep::Part { offset, bytes } => {
                self.take(updater, offset, &bytes);
                None
            }
            UpdateStep::Try { .. } => Some(self.try_it()),
            UpdateStep::Leave => None,
        }
    }
}

/// That something is not done, and why.
pub fn refused(refusal: UpdateRefusal, why: impl std::fmt::Display) -> UpdateOutcome {
    UpdateOutcome::Refused { refusal, text: logger::cut::<UPDATE_TEXT_BYTES_MAX>(why) }
}

/// How far the update is, with words for people.
pub(super) fn at(state: UpdateState, text: impl std::fmt::Display) -> UpdateOutcome {
    UpdateOutcome::State { state, text: logger::cut::<UPDATE_TEXT_BYTES_MAX>(text) }
}
