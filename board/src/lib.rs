//! The Linux side of the Plumbline box: where frames come from, where packets go, and the
//! computer in between. The geometry is the core's.
//!
//! ```text
//!  main: a program with a command line     boot: the first process of a box
//!    cli, boot_count                         partition, network, panel, refusal, failure
//!                    └─────────────┬─────────────┘
//!                                  │ configuration, equipment
//!                                  ▼
//!         source ── frames ──▶ session ── packets ──▶ link ──▶ hosts
//!                              │   ▲                    │
//!                              │   └───── commands ─────┘
//!                              │ parts of a configuration
//!                              ▼
//!                         provisioning ──▶ config_store ──▶ the next start
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | [`source`] | gives frames: a camera that may vanish and come back, or a recording |
//! | [`session`] | the loop: a frame, the pipeline, a packet; a heartbeat; what hosts ask for |
//! | [`trigger`] | the wires to other devices: edges that become packets, a line that marks frames |
//! | [`link`] | seals packets for whoever listens, and hands over what hosts send |
//! | [`random`] | random bytes |
//! | [`equipment`] | the links and the camera of a configuration, if a box can use it |
//! | [`provisioning`], [`config_store`] | a new configuration from a host, and where it is kept |
//! | [`update`] | a new system from a host: the idle slot, its trial, and the way back |
//! | [`key_store`] | the key of the box, and where it is kept |
//! | [`stored_file`] | how either takes the place of the old one, whatever happens to the power |
//! | [`boot`] | everything that a box does before its session, beside it, and when it fails |
//! | [`cli`], [`boot_count`] | the same session as a program among others |
//! | [`status`], [`logger`] | what the box is doing, and what it logs, for hosts and the panel |
//! | [`machine`] | the computer: clocks, watchdog, priority, power supply, temperature |
//! | [`allocation`] | counts heap allocations, of which the session makes none while it tracks |

pub mod allocation;
pub mod boot;
pub mod boot_count;
pub mod cli;
pub mod config_store;
pub mod equipment;
pub mod key_store;
pub mod link;
pub mod logger;
pub mod machine;
pub mod provisioning;
pub mod random;
pub mod session;
pub mod source;
pub mod status;
pub mod stored_file;
pub mod trigger;
pub mod update;

/// Which program this is, as hosts are told it: its version and the commit that it was built from.
pub const VERSION: &str = plumbline::program_version!();

#[cfg(test)]
mod test_config;
#[cfg(test)]
mod test_listeners;
