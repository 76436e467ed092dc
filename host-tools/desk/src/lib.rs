//! The desk: a page on this computer for the person who measures, and the server behind it.
//!
//! ```text
//!  boxes ─▶ porter: where are they? ─▶ station, a thread for each box ─▶ shared: its state, its frames
//!                                         ▲ orders                             │
//!  browsers ◀─▶ http: guard, api, socket ─┴────────────────────────────────────┘
//!                  │ studies: folders on the disk
//!                  │ prints: the targets on paper; cards: new boxes, their keys and configurations
//! ```
//!
//! [`wire`] is what page and server say to each other. [`desk::Desk`] holds the stations, which use the
//! same libraries as the command line; [`http::Server`] is the only part with tokio. Nothing that a page
//! does, or does not do, touches a recording: stations write to the disk themselves, and pages take what
//! is kept for them.

mod cards;
pub mod desk;
mod frames;
pub mod http;
mod hub;
pub mod marks;
mod memory;
mod porter;
mod prints;
mod settings;
mod station;
mod studies;
pub mod wire;
mod words;
