//! One module for each subcommand: its arguments, and `run`, which takes them.

pub mod aim;
pub mod analyze;
pub mod budget;
pub mod calibrate;
pub mod cohort;
pub mod demo;
pub mod desk;
pub mod doctor;
pub mod export;
pub mod figures;
pub mod keys;
pub mod optics;
pub mod pair;
pub mod prove;
pub mod provision;
pub mod receive;
pub mod replay;
pub mod report;
pub mod scene;
pub mod show;
pub mod simulate;
pub mod study;
pub mod target;
pub mod track;
pub mod validate;
