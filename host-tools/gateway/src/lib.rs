//! A ward's gateway: it receives from many boxes over the sealed link, records those that it is told to,
//! and publishes how they are, what their trials are worth and what is in them to an MQTT 5 broker.
//!
//! ```text
//!  boxes ─▶ post: one socket ─▶ bed: link, receiver, trial ─▶ judge: verdict, summary ─┐
//!             ▲                  │ state, health, examination                          │
//!             │ commands         ▼                                                     ▼
//!          broker ◀──────────── outbox: the newest state of each topic; verdicts on the disk
//! ```
//!
//! What it does with a box is what `plumb receive` does, by the same libraries: [`plumbline_stream`] for
//! the link, [`plumbline_trial`] for the trial's folder and its verdict, [`plumbline_bedside`] for the
//! doctor. [`topics`] lists what is published where, [`commands`] what may be asked of it. No pose leaves
//! it, no name of a person and no code of a participant.

mod bed;
pub mod broker;
pub mod commands;
mod gateway;
mod judge;
mod kept;
pub mod list;
mod notices;
mod outbox;
pub mod overview;
mod payload;
mod post;
mod settings;
mod teller;
pub mod topics;
mod ward;

pub use gateway::Gateway;
pub use outbox::{Counts, Standing};
pub use settings::{Recorded, Settings};
