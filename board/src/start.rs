//! The number of a start, by which hosts tell this box's packets from those of another start, and of
//! another box.

use std::hash::BuildHasher;

use plumbline::packet::Start;

/// A number that very probably differs from that of every other start.
pub(crate) fn draw() -> Start {
    // The keys of the standard hasher are drawn at random by the operating system.
    let drawn = std::collections::hash_map::RandomState::new().hash_one(0_u8) as u32;
    Start::new(drawn).unwrap_or(Start::MIN)
}
