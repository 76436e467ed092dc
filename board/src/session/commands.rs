//! The commands of hosts, and the replies.

use std::time::Instant;

use plumbline::config::Capture;
use plumbline::packet::{Action, Document, Refusal, ReplyOutcome};
use plumbline::seal::ListenerId;

use super::Session;
use crate::provisioning::refused;
use crate::source::{Exposure, FrameSource};

impl Session<'_> {
    /// Carries out what a listener has asked for.
    pub(super) fn carry_out(
        &mut self,
        action: Action,
        listener: ListenerId,
        source: &mut impl FrameSource,
    ) -> ReplyOutcome {
        match action {
            Action::QueryConfig => ReplyOutcome::Config {
                crc: self.hello.config_crc,
                bytes: self.blob.len() as u32,
                next_crc: self.next_crc,
            },
            Action::SendHello => {
                self.send_hello();
                ReplyOutcome::Accepted
            }
            Action::SendHealth => {
                self.send_health();
                ReplyOutcome::Accepted
            }
            Action::SendView => {
                self.views_wanted[listener.place] = Some(listener);
                ReplyOutcome::Accepted
            }
            Action::SendParts { document, offset, bytes } => {
                self.start_sending(listener, document, offset, bytes)
            }
            Action::StoreConfig { bytes, crc } => {
                self.counters.forget_allocations();
                let outcome = self.provisioning.keep(listener, bytes, crc);
                if let ReplyOutcome::Stored { crc } = outcome {
                    self.next_crc = crc;
                }
                outcome
            }
            Action::Aim { seconds } => {
                self.aim.renew(listener, seconds, Instant::now());
                self.send_health();
                ReplyOutcome::Accepted
            }
            Action::TakePicture { .. } | Action::Expose { .. } if !self.aim.is_on(listener) => {
                refused(Refusal::NotAiming, "pictures and exposures are for set-up mode")
            }
            Action::TakePicture { reduction } => {
                self.aim.want(reduction);
                ReplyOutcome::Accepted
            }
            Action::Expose { exposure_us, gain } => {
                self.expose(Exposure { exposure_us, gain }, source)
            }
            Action::Reboot if self.may_reboot => {
                log::warn!("restarting: the host has asked for it");
                self.reboot = true;
                ReplyOutcome::Accepted
            }
            Action::Reboot => refused(
                Refusal::NotSupported,
                "this program does not restart itself: stop and start it where it runs",
            ),
            Action::Ping { .. }
            | Action::Resend { .. }
            | Action::Record { .. }
            | Action::SendPoses { .. }
            | Action::Leave => unreachable!("the link takes these itself"),
        }
    }

    fn start_sending(
        &mut self,
        listener: ListenerId,
        document: Document,
        offset: u32,
        bytes: u32,
    ) -> ReplyOutcome {
        if let Document::Picture(number) = document {
            if !self.aim.is_on(listener) {
                return refused(Refusal::NotAiming, "");
            }
            if self.aim.file(number).is_none() {
                return refused(Refusal::Unusable, "there is a newer picture than that");
            }
        }
        let start = offset as usize;
        self.outgoing.start(listener, document, start..start.saturating_add(bytes as usize));
        ReplyOutcome::Accepted
    }

    fn expose(&mut self, exposure: Exposure, source: &mut impl FrameSource) -> ReplyOutcome {
        let Exposure { exposure_us, gain } = exposure;
        let asked = self.capture.clone().map(|it| Capture { exposure_us, gain, ..it });
        if let Some(Err(error)) = asked.map(|capture| capture.check()) {
            return refused(Refusal::Unusable, error);
        }
        if source.expose(exposure) {
            self.counters.forget_allocations();
            ReplyOutcome::Accepted
        } else {
            refused(Refusal::NotSupported, "a recording is exposed as it is")
        }
    }
}
