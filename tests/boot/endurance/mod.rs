//! What happens to a box, a hundred times each. Hours, which nobody waits for every day: `cargo xtask
//! test endurance` runs them, with the programs as people have them.
//!
//! | what happens | what must come of it | where |
//! |---|---|---|
//! | the camera's plug is pulled | frames within a second of its return; each loss counted | [`unplugged`] |
//! | the power is cut while something is stored | the old or the new, whole; the box starts with it | [`cuts`] |
//! | programs that never rest beside the box's | from frame to packet it takes no longer | [`load`] |
//! | the computer's clock is set again and again | nothing | [`clock`] |
//! | the card is full, or slow | what was stored is there, and the box goes on | [`card`] |
//!
//! Times are the guest's, whose clock counts instructions: they are those of the emulator, and do not
//! depend on how busy this computer is.

mod card;
mod clock;
mod cuts;
mod load;
mod unplugged;

use plumbline::packet::{Message, PosePacket};

use crate::machine::{in_order, poses};

/// The poses in the order of their frames, each of them once and none missing.
fn whole(messages: &[Message]) -> Vec<PosePacket> {
    let messages = in_order(messages);
    let poses: Vec<PosePacket> = poses(&messages).cloned().collect();
    for pair in poses.windows(2) {
        assert_eq!(pair[0].sequence + 1, pair[1].sequence, "a pose is missing, or came twice");
        assert!(pair[0].capture_time_ns < pair[1].capture_time_ns, "{pair:?}");
    }
    poses
}

/// The middle one of some numbers.
fn median(mut numbers: Vec<u64>) -> u64 {
    numbers.sort_unstable();
    numbers[numbers.len() / 2]
}

/// A number of microseconds, for people.
fn ms(us: u64) -> String {
    format!("{:.2} ms", us as f64 * 1e-3)
}
