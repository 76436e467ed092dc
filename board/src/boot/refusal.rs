//! What a box does without a usable configuration: it reports the reason instead of tracking,
//! once on the console and repeatedly to the hosts that have its key. A box that has no key either
//! says so, and why it waits, in what it announces.
//!
//! A host may send another configuration. Otherwise the box stays in this state until the power
//! is switched off: a restart would find the same file. That is also why no watchdog runs.

use std::time::{Duration, Instant};

use anyhow::Error;
use plumbline::config::Links;
use plumbline::packet::{Action, Command, Message, Refusal, Reply, ReplyOutcome, ResetReason};
use plumbline::seal::{ListenerId, StreamRing};

use super::announce::Announcer;
use super::card::Card;
use super::partition::Absent;
use crate::link::Identity;
use crate::provisioning::{Provisioning, refused};
use crate::random;
use crate::status::{self, Status};

/// How often messages from hosts are read.
const TURN: Duration = Duration::from_millis(20);

/// The reason is repeated this often.
const AGAIN: Duration = Duration::from_secs(2);

/// Repeats the reason until a host asks for a restart, having sent another configuration.
pub fn stay(
    links: &Links,
    card: Card,
    reset_reason: ResetReason,
    ring: &'static mut StreamRing,
    why: &Error,
) {
    let status = status_for(why);
    status::set(status);
    let text = format!("{}: {why:#}", status.words());
    log::error!("{text}");
    log::info!(
        "nothing is tracked; send another configuration, or correct it on the card and switch \
         the box off and on again"
    );
    let identity = Identity {
        start: random::start(),
        // Where there is one, the configuration that is refused may have any name.
        name: String::new(),
        key: card.key,
        store: card.key_store,
        reset_reason,
        start_count: None,
        refusal: Some(text.clone()),
    };
    let mut announcer = Announcer::new(links, identity, Some(ring));
    let mut provisioning = Provisioning::new(card.config_store);
    let mut restart = false;
    while !restart {
        announcer.say(&text);
        let again_at = Instant::now() + AGAIN;
        while Instant::now() < again_at && !restart {
            let has_joined = announcer.answer(|listener, message| match message {
                Message::Part(part) => {
                    provisioning.take(listener, part);
                    None
                }
                Message::Command(command) => {
                    restart |= command.action == Action::Reboot;
                    Some(reply(&mut provisioning, listener, command, &text))
                }
                _ => None,
            });
            if has_joined {
                announcer.say(&text);
            }
            std::thread::sleep(TURN);
        }
    }
    announcer.finish();
}

fn status_for(why: &Error) -> Status {
    if why.is::<Absent>() { Status::NoConfiguration } else { Status::Refused }
}

fn reply(
    provisioning: &mut Provisioning,
    listener: ListenerId,
    command: &Command,
    why: &str,
) -> Reply {
    let outcome = match command.action {
        Action::StoreConfig { bytes, crc } => provisioning.keep(listener, bytes, crc),
        Action::Reboot => ReplyOutcome::Accepted,
        _ => refused(Refusal::NotSupported, why),
    };
    Reply { id: command.id, outcome }
}
