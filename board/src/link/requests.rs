//! The commands that concern the link, which it answers itself, whatever else the box is doing.

use plumbline::packet::{Action, Command, Refusal, ReplyOutcome};
use plumbline::seal::{ListenerId, Peer};

use super::Links;
use crate::machine::clock;
use crate::provisioning::refused;

/// What comes of a command.
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the words")]
pub(super) enum Answer {
    /// It is answered.
    Outcome(ReplyOutcome),
    /// The packets that it has asked for are the answer.
    Silent,
    /// It does not concern the link.
    Elsewhere,
}

impl Links {
    /// Answers a command that concerns the link, and refuses those that would disturb a trial.
    pub(super) fn answer(
        &mut self,
        listener: ListenerId,
        command: &Command,
        received_ns: u64,
    ) -> Answer {
        if command.action.changes_box()
            && !command.is_forced
            && let Some(recorder) = self.end.recorder()
        {
            let words = format_args!("{} records a trial, which it would disturb", recorder.name);
            return Answer::Outcome(refused(Refusal::Recording, words));
        }
        match command.action {
            Action::Ping { host_sent_ns } => Answer::Outcome(ReplyOutcome::Pong {
                host_sent_ns,
                box_received_ns: received_ns,
                box_sent_ns: clock::monotonic_ns(),
                stream_next: self.end.stream_next(),
            }),
            Action::Resend { first, mask } => self.resend(listener, command.id, first, mask),
            Action::Record { on } => {
                self.end.record(listener, on);
                Answer::Outcome(ReplyOutcome::Accepted)
            }
            Action::SendPoses { every } => {
                self.end.send_poses(listener, every);
                Answer::Outcome(ReplyOutcome::Accepted)
            }
            _ => Answer::Elsewhere,
        }
    }

    /// Takes note of what is to be sent again; without a ring nothing can be.
    fn resend(&mut self, listener: ListenerId, id: u16, first: u64, mask: u64) -> Answer {
        if self.ring.is_none() {
            return Answer::Outcome(ReplyOutcome::Gone { first: self.end.stream_next() });
        }
        self.end.resend(listener, id, first, mask);
        Answer::Silent
    }
}

/// Logs that a listener has joined, or joined anew.
pub(super) fn log_joined(peer: Peer) {
    match peer {
        Peer::Udp(address) => log::info!("a host with the box's key listens at {address}"),
        Peer::Serial => log::info!("a host with the box's key listens on the serial line"),
    }
}

/// Logs that a listener has said that it leaves.
pub(super) fn log_left(peer: Peer) {
    match peer {
        Peer::Udp(address) => log::info!("the host at {address} has left"),
        Peer::Serial => log::info!("the host on the serial line has left"),
    }
}
