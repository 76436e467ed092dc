//! The Linux side of the Plumbline box.
//!
//! ```text
//! source ─▶ pipeline ─▶ packet ─▶ links
//! ```
//!
//! Everything that needs an operating system is here: where frames come from
//! ([`source`]), where packets go ([`link`]), time, signals and messages. No
//! geometry is: that is the core's.

pub mod allocation;
pub mod cli;
pub mod link;
pub mod source;
