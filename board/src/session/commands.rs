//! The commands of hosts, and the replies.

use std::time::Instant;

use plumbline::config::Capture;
use plumbline::packet::{Action, Command, Document, Refusal, Reply, ReplyOutcome};

use super::Session;
use crate::machine::clock;
use crate::provisioning::refused;
use crate::source::{Exposure, FrameSource};

impl Session {
    /// Carries out a command that was received over the link with this index.
    pub(super) fn carry_out(
        &mut self,
        command: Command,
        link: usize,
        box_received_ns: u64,
        source: &mut impl FrameSource,
    ) -> Reply {
        let outcome = match command.action {
            Action::Ping { host_sent_ns } => ReplyOutcome::Pong {
                host_sent_ns,
                box_received_ns,
                box_sent_ns: clock::monotonic_ns(),
            },
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
                self.views_wanted[link] = true;
                ReplyOutcome::Accepted
            }
            Action::SendParts { document, offset, bytes } => {
                self.start_sending(link, document, offset, bytes)
            }
            Action::StoreConfig { bytes, crc } => {
                self.counters.forget_allocations();
                let outcome = self.provisioning.keep(bytes, crc);
                if let ReplyOutcome::Stored { crc } = outcome {
                    self.next_crc = crc;
                }
                outcome
            }
            Action::Aim { seconds } => {
                self.aim.renew(link, seconds, Instant::now());
                self.send_health();
                ReplyOutcome::Accepted
            }
            Action::TakePicture { .. } | Action::Expose { .. } if !self.aim.is_on(link) => {
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
        };
        Reply { id: command.id, outcome }
    }

    fn start_sending(
        &mut self,
        link: usize,
        document: Document,
        offset: u32,
        bytes: u32,
    ) -> ReplyOutcome {
        if let Document::Picture(number) = document {
            if !self.aim.is_on(link) {
                return refused(Refusal::NotAiming, "");
            }
            if self.aim.file(number).is_none() {
                return refused(Refusal::Unusable, "there is a newer picture than that");
            }
        }
        let start = offset as usize;
        self.outgoing.start(link, document, start..start.saturating_add(bytes as usize));
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
