//! A box's poses for other programs, while they come.
//!
//! ```text
//! reception ─▶ publisher: which frames, when they were captured ─┬─ queue ─▶ lsl:  outlets of the Lab Streaming Layer
//!                                                                ├─ queue ─▶ json: lines over TCP, a queue for each client
//! marks of the recording ─▶                                      └─ queue ─▶ osc:  datagrams
//!
//! lsl::markers: markers of another program ─▶ whoever takes marks
//! ```
//!
//! [`Publisher`] is a [`Tap`](plumbline_stream::reception::Tap) of a reception. It judges packets as
//! the recording does, so that both have the same frames. With [`Tapped`] it follows a link whatever is
//! done with that. Each way out has a thread of its own and a
//! queue of bounded length before it; where a queue is full, something is dropped and counted, and
//! the reception goes on: no program that listens, however slow, touches a recording.
//!
//! # Times
//!
//! The time of a frame is its capture time, which marks the middle of the exposure where the box
//! knows it, moved from the box's clock to this computer's by [`timing`]. With a rolling shutter a
//! target is exposed later than its frame is marked, by its `delay_s`; frame and targets keep one
//! common time, and the delay is beside each pose.
//!
//! # What is missing
//!
//! A frame that has not come in its place is a gap, and is published as one when the next frame
//! comes, 0.3 s later at most. If it comes later all the same, it is *late*: see each way out for
//! what becomes of it.

mod feed;
pub mod item;
pub mod json;
pub mod lsl;
pub mod osc;
pub mod publisher;
mod tapped;
pub mod timing;
mod ways;

pub use publisher::{MarkFeed, Publisher};
pub use tapped::Tapped;
pub use ways::Ways;
