//! The core, on every processor that it ships on: how much memory and stack it needs, and what it
//! makes of a rendered person and of frames that no camera should deliver.
//!
//! `cargo xtask test arm` runs these in an emulator. The frames are rendered on this machine.

mod hostile_frames;
mod memory;
mod stack;
mod tracking;
