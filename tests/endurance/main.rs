//! The box's program for as long as a hospital uses it, in minutes: frames as fast as they can be
//! tracked, and whatever happens in front of a camera and to it, again and again.
//!
//! | what is done | what must come of it | where |
//! |---|---|---|
//! | frames by the million into the released program; lens caps, strangers, dropouts, a relit room, a camera that is silent | every frame answered, poses where they are, none where nobody is, no heap, constant memory | [`replayed`] |
//! | the same with a camera that is lost by the thousand | the same, and every loss counted to one | [`lost`] |
//!
//! [`show`] is what the camera sees, [`script`] in which order, and [`judge`] holds each packet of the
//! box against it. The tests of every day do a thousandth of it; `cargo xtask test endurance` does
//! all, and has further parts in the tests of the link and of the booted box.

mod judge;
mod lost;
mod replayed;
mod script;
mod show;
mod watched;

use plumbline_board::allocation::CountingAllocator;

/// As the box's program has it: in [`lost`] this program is the box.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
