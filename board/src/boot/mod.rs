//! The program as the first process of its computer: from the kernel's start to the first
//! pose, without a login and without a writable disk.
//!
//! ```text
//!                    ╭───────────────── the guard ──────────────────╮
//!  mounts ─▶ modules ─▶ partition ─▶ configuration ─▶ network ─▶ self-test ─▶ session
//!                           │              │          (a process    │            │
//!                           │ none in 10 s │ refused    of its own) │ fails      │ asked to,
//!                           ▼              ▼                        ▼            ▼ panics
//!                        refusal: repeats the reason            failure       restart
//!                                         gives the reason, and the watchdog restarts
//! ```
//!
//! From the watchdog's driver on, a start that takes too long is a failure as well: see [`guard`].
//!
//! A *refusal* is about the configuration: a restart would read the same one,
//! so the box stays up and repeats what is wrong, until a host sends another one.
//! A *failure* is about the program or the machine: the box reports what failed and
//! where, stops feeding the watchdog, and restarts.
//!
//! The kernel has opened the console as standard input, output and error before
//! this starts. Measuring does not wait for the network; packets leave as soon
//! as there is a route. Only a configuration or a key that a host sends, the mark of an
//! orderly restart, and the count of starts that a line without a way back needs are written to a disk, in such a way that the power may be
//! pulled at any time.
//!
//! The same program has three smaller roles besides, told apart by the name under
//! which it is run: see [`Role`].

mod announce;
mod card;
mod children;
mod failure;
mod gate;
mod guard;
mod kernel_command_line;
mod modules;
mod mounts;
pub mod network;
pub mod panel;
mod partition;
mod refusal;
mod restart;
mod self_test;

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use plumbline::config::{Config, FILE_NAME, Network};
use plumbline::pipeline::Pipeline;
use plumbline::seal::StreamRing;

use crate::boot_count::count_start_on;
use crate::equipment::Equipment;
use crate::link::{Identity, Links, Ports};
use crate::logger;
use crate::machine::read_only_partition::ReadOnlyPartition;
use crate::machine::watchdog::Watchdog;
use crate::machine::{clock, realtime};
use crate::random;
use crate::session::{self, Setup};
use crate::source::chosen::Source;
use crate::trigger::Triggers;
use crate::update::{Leave, Updates};
use card::Card;
use gate::Gate;
use guard::Guard;

/// What this process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The first process of a box.
    Box,
    /// The process that brings up the box's network.
    Network,
    /// The program that the DHCP client runs with what a server has told it.
    Lease,
    /// A program with a command line.
    Program,
}

impl Role {
    /// The role of the process with this ID that was run under this name.
    #[must_use]
    pub fn of(process: u32, called: &str) -> Self {
        match Path::new(called).file_name().and_then(|name| name.to_str()) {
            Some(network::lease::NAME) => Self::Lease,
            Some(network::NAME) => Self::Network,
            _ if process == 1 => Self::Box,
            _ => Self::Program,
        }
    }
}

/// Kernel modules to load, in this order.
const MODULES: &str = "/etc/plumbline/modules";

/// The time that a start has from the watchdog's driver to the session. It takes a second or two, and
/// ten more where the card is looked for in vain.
const START_WITHIN: Duration = Duration::from_secs(60);

/// Boots the box, and measures until the computer restarts.
pub fn run(pipeline: &'static mut Pipeline, ring: &'static mut StreamRing) -> ! {
    logger::install(log::LevelFilter::Info);
    failure::take_panics();
    if let Err(error) = mounts::mount_all() {
        failure::end(&format!("{error:#}"));
    }
    mounts::restart_on_kernel_panic();
    panel::start();
    step("started");
    let options = kernel_command_line::read();
    failure::tell(&options.links, None, None);
    let modules = modules::load_all(Path::new(MODULES));
    step(&modules.to_string());
    let guard = Guard::start(failure::WATCHDOG_S, Instant::now() + options.start_within());
    #[cfg(feature = "fault-injection")]
    if options.hang_at_start.is_some() {
        failure::stand_still();
    }

    let partition::Found { partition, config } = partition::find();
    let (partition, device) = partition.unzip();
    let card = Card::read(partition.as_ref());
    let mut updates = Updates::of_box(partition.as_ref().zip(device.as_deref()));
    let (config, Equipment { ports, source }) = match config.and_then(configuration) {
        Ok(usable) => usable,
        Err(error) if updates.is_on_trial() => {
            updates.give_up(&format!("it refuses the configuration: {error:#}"));
            restart::in_good_order(partition.as_ref())
        }
        Err(error) => {
            failure::tell(&options.links, card.usable_key(), None);
            children::look_after(Network::Dhcp);
            // Nothing here is waited for any longer: the watchdog is stopped.
            let reason = restart::reason(guard.map(Guard::hand_over).as_ref(), card.is_marked);
            refusal::stay(&options.links, card, reason, ring, &error);
            restart::in_good_order(partition.as_ref())
        }
    };
    failure::tell(&config.links, card.usable_key(), config.machine.watchdog_s);
    children::look_after(config.machine.network);
    let start_count = partition.as_ref().and_then(|it| start_count(&config, it));
    let links = Prepared { ports, card, start_count, ring };
    let source = Gate::new(source, &options);
    let ended = measure(pipeline, &config, links, source, guard, &mut updates);
    if let Err(error) = &ended {
        updates.give_up(&format!("{error:#}"));
    }
    match (ended, updates.leave()) {
        (_, Some(Leave::ToTry)) => restart::to_try(partition.as_ref()),
        (_, Some(Leave::ToGiveUp)) | (Ok(()), None) => restart::in_good_order(partition.as_ref()),
        (Err(error), None) => failure::end(&format!("{error:#}")),
    }
}

/// The configuration of a settings partition with its equipment, once all of it has been found
/// usable.
fn configuration((blob, device): (Vec<u8>, String)) -> Result<(Config, Equipment)> {
    let config = Config::decode(&blob).with_context(|| in_config(&device))?;
    panel::name(&config);
    let mut equipment = Equipment::of(&config).with_context(|| in_config(&device))?;
    equipment.ports.listen_where_hosts_look();
    step(&format!("configuration {:08x} on {device}", config.crc()));
    Ok((config, equipment))
}

fn in_config(device: &str) -> String {
    format!("{FILE_NAME} on {device}")
}

/// Counts this start, where hosts need the count: otherwise the card is left alone.
fn start_count(config: &Config, partition: &ReadOnlyPartition) -> Option<u32> {
    let is_needed = config.links.serial.as_ref().is_some_and(|line| line.one_way);
    if !is_needed {
        return None;
    }
    let count = count_start_on(partition);
    count.inspect_err(|error| log::error!("this start is not counted: {error:#}")).ok()
}

/// What the links of a session are made of.
struct Prepared {
    ports: Ports,
    card: Card,
    start_count: Option<u32>,
    ring: &'static mut StreamRing,
}

/// Measures until a host asks for a restart.
fn measure(
    pipeline: &mut Pipeline,
    config: &Config,
    Prepared { ports, card, start_count, ring }: Prepared,
    mut source: Gate<Source>,
    guard: Option<Guard>,
    updates: &mut Updates,
) -> Result<()> {
    self_test::run(pipeline).context("self-test")?;
    pipeline.configure(config).context("the configuration")?;
    step("self-test passed");
    let watchdog = guard.map(Guard::hand_over);
    let reset_reason = restart::reason(watchdog.as_ref(), card.is_marked);
    let watchdog = match watchdog {
        // On trial it runs whatever the configuration asks for: a system that hangs must not stay.
        Some(watchdog) if updates.is_on_trial() => Some(watchdog),
        Some(watchdog) => watchdog.kept_for(&config.machine),
        None => Watchdog::of(&config.machine),
    };
    updates.begin_session(card.usable_key().is_some());
    let identity = Identity {
        start: random::start(),
        name: Identity::name_of(config),
        key: card.key,
        store: card.key_store,
        reset_reason,
        start_count,
        refusal: None,
    };
    let setup = Setup {
        links: Links::new(ports, identity, Some(ring)),
        boot_count: start_count,
        reset_reason,
        watchdog,
        triggers: Triggers::of(config.trigger.as_ref(), config.capture.as_ref()),
        store: card.config_store,
        may_reboot: true,
        updates,
    };
    realtime::set_up(&config.machine);
    let never = AtomicBool::new(false);
    let ended = session::run(pipeline, config, &mut source, setup, &never);
    ended.broken.map_or(Ok(()), |message| bail!(message))
}

/// Logs what has been done, and the time since the kernel's start.
fn step(what: &str) {
    log::info!("boot: {what} at {:.2} s", clock::monotonic_ns() as f64 * 1e-9);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_and_the_number_of_a_process_tell_its_role() {
        let table = [
            (1, "/init", Role::Box),
            (1, "init", Role::Box),
            (1, "", Role::Box),
            (50, "/sbin/network-lease", Role::Lease),
            (50, "plumbline-network", Role::Network),
            (50, "/init", Role::Program),
            (50, "target/release/plumbline-board", Role::Program),
            (50, "/network-lease/plumbline-board", Role::Program),
        ];
        for (process, called, role) in table {
            assert_eq!(Role::of(process, called), role, "{process} {called}");
        }
    }
}
