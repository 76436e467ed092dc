//! The host side of Plumbline: one program, `plumb`, with subcommands.
//!
//! The host tracks nothing of its own: it calls the pipeline of the crate
//! `plumbline`, the one that runs on the box. What is here reads and writes
//! files ([`files`]), renders people whose motion is known ([`simulate`]), shows
//! progress, and explains what went wrong ([`error`]).

pub mod aim;
pub mod analyze;
mod box_settings;
pub mod calibrate;
pub mod cli;
pub mod delivery;
pub mod demo;
pub mod doctor;
mod draw;
mod drawing;
pub mod export;
pub mod link_arguments;
mod missing;
mod palette;
pub mod provision;
pub mod receive;
pub mod replay;
pub mod report;
pub mod scene;
pub mod setup;
pub mod show;
pub mod simulate;
pub mod study;
pub mod target;
pub mod track;
pub mod validate;
mod waiting;
