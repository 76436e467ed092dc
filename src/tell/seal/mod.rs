//! The link: packets that nobody but the box and its hosts can read or make.
//!
//! ```text
//! key          the key of a box, its name, and its text
//! aead         one cipher key, used with counters; keys that follow from others
//! window       which counters have come
//! wire         what packets look like from outside
//! handshake    Noise NNpsk0
//! channel      what box and one listener say to each other
//! stream       what a box sends to all, sealed once      one_way   the same without a way back
//! box_end      a box: who listens            cookie      hosts that receive where they send from
//! pending      handshakes that wait           listeners   programs that listen
//! ring         its latest packets             resends     which of them are to be sent again
//! host_end     a host of one box              obstacle    why there is no session
//! approach     which box, and where           attempts    handshakes that are not through
//! session      those that are through
//! reception    what has come of the stream    missing     what is asked for again
//! updater      the host that updates a box    update_end  that host's end of the link
//! ```
//!
//! Neither end reads a clock, draws a random number or sends anything: packets, times and random
//! bytes are arguments. `LINK.md` beside this file describes the format for those who want to write
//! another receiver, and what it protects from whom.

mod aead;
mod approach;
mod attempts;
mod box_end;
mod channel;
mod cookie;
mod handshake;
mod host_end;
mod key;
mod listeners;
mod missing;
mod obstacle;
mod one_way;
mod pairing;
mod pending;
mod reception;
mod resends;
mod ring;
mod session;
mod stream;
#[cfg(test)]
mod tests;
mod update_end;
mod updater;
mod window;
mod wire;

use core::net::SocketAddr;

pub use box_end::{BoxEnd, Heard};
pub use host_end::{HostEnd, OWN_COMMAND, Told};
pub use key::{KEY_FILE_NAME, KEY_TEXT_BYTES, Key, KeyError, KeyId, KeyText, NEW_KEY_FILE_NAME};
pub use listeners::{CALLER_NAME_BYTES_MAX, Caller, LISTENERS_MAX, ListenerId};
pub use obstacle::Obstacle;
pub use one_way::OneWay;
pub use pairing::{Paired, Pairing};
pub use ring::{Ring, StreamRing};
pub use stream::{EPOCH_PACKETS, Opened, StreamOpener, StreamSealer};
pub use update_end::{ToldOfUpdate, UpdateEnd};
pub use updater::UpdaterId;
pub use window::Window;
pub use wire::{
    Announcement, BoxState, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX, TOKEN_BYTES,
    WAITING_TEXT_BYTES_MAX, greeting,
};

/// Where a packet comes from or goes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Peer {
    /// An address and a port.
    Udp(SocketAddr),
    /// The other end of the serial line.
    Serial,
}
