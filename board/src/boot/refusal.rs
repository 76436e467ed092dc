//! What a box does without a usable configuration: it reports the reason instead of tracking,
//! once on the console and repeatedly to the hosts.
//!
//! A host may send another configuration. Otherwise the box stays in this state until the power
//! is switched off: a restart would find the same file. That is also why no watchdog runs.

use std::time::{Duration, Instant};

use anyhow::Error;
use plumbline::config::Links;
use plumbline::packet::{Action, Command, Message, Refusal, Reply, ReplyOutcome};

use super::announce::{AGAIN, Announcer};
use super::partition::Absent;
use crate::config_store::ConfigStore;
use crate::provisioning::{Provisioning, refused};
use crate::status::{self, Status};

/// How often messages from hosts are read.
const TURN: Duration = Duration::from_millis(20);

/// Repeats the reason until a host asks for a restart, having sent another configuration.
pub fn stay(links: &Links, store: Option<ConfigStore>, why: &Error) {
    let status = status_for(why);
    status::set(status);
    let text = format!("{}: {why:#}", status.words());
    log::error!("{text}");
    log::info!(
        "nothing is tracked; send another configuration, or correct it on the card and switch \
         the box off and on again"
    );
    let mut announcer = Announcer::new(links);
    let mut provisioning = Provisioning::new(store);
    let mut restart = false;
    while !restart {
        announcer.say(&text);
        let again_at = Instant::now() + AGAIN;
        while Instant::now() < again_at && !restart {
            announcer.answer(|message| match message {
                Message::Part(part) => {
                    provisioning.take(part);
                    None
                }
                Message::Command(command) => {
                    restart |= command.action == Action::Reboot;
                    Some(reply(&mut provisioning, command, &text))
                }
                _ => None,
            });
            std::thread::sleep(TURN);
        }
    }
}

fn status_for(why: &Error) -> Status {
    if why.is::<Absent>() { Status::NoConfiguration } else { Status::Refused }
}

fn reply(provisioning: &mut Provisioning, command: &Command, why: &str) -> Reply {
    let outcome = match command.action {
        Action::StoreConfig { bytes, crc } => provisioning.keep(bytes, crc),
        Action::Reboot => ReplyOutcome::Accepted,
        _ => refused(Refusal::NotSupported, why),
    };
    Reply { id: command.id, outcome }
}
