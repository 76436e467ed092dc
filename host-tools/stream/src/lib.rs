//! A box's packets on this computer.
//!
//! ```text
//! socket, serial line ─▶ transport ─▶ sessions: which start of which box; what is left out
//!                            │            ├▶ accounting: new, late, repeated, lost, implausible
//!                            │            └▶ receiver: what is known of the box now ─▶ recorder: rows
//!                            ▼
//!                          link: questions, answers, documents in parts
//! ```
//!
//! A box that is updated has a link of its own, which is the same in all releases: [`update_link`].
//!
//! [`reception`] runs the upper path until a limit is reached; [`link`] is the lower one.
//! [`clock`] relates the box's clock to this computer's. Apart from what waits for packets,
//! nothing here reads a clock: the time is an argument.

pub mod accounting;
pub mod bad_packets;
pub mod clock;
pub mod complaints;
mod deadline;
#[cfg(any(test, feature = "fixture"))]
pub mod fixture;
pub mod link;
pub mod others;
pub mod power;
pub mod questions;
pub mod receiver;
pub mod reception;
pub mod recorder;
pub mod sealed_box;
pub mod sessions;
mod text;
pub mod transport;
pub mod update_link;
