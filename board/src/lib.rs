//! The Linux side of the Plumbline box.
//!
//! ```text
//! source ─▶ pipeline ─▶ packet ─▶ links
//! ```
//!
//! Everything that needs an operating system is here: where frames come from
//! ([`source`]), where packets go ([`link`]), time, signals, messages, and the
//! loop that ties them together ([`session`]). No geometry is: that is the core's.

pub mod allocation;
pub mod boot;
pub mod boot_count;
pub mod cli;
pub mod clock;
pub mod config_store;
pub mod equipment;
pub mod link;
pub mod logger;
pub mod measure;
pub mod power;
pub mod provisioning;
pub mod read_only_partition;
pub mod realtime;
pub mod session;
pub mod source;
pub mod status;
pub mod temperature;
pub mod watchdog;

#[cfg(test)]
mod test_config;
