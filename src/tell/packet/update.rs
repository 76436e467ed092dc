//! What a host and a box say to each other about an update of the box.
//!
//! These messages are the same in all releases: whichever programs a box and a host run, the one can
//! update the other. So nothing here may ever change, neither a type nor its order nor a capacity, and
//! none of it is part of the schema hash; the packets that a test of the link spells out hold it in
//! place. What a later release wants to say besides needs packets of another kind.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

/// Most bytes of an update in one packet.
pub const UPDATE_PART_BYTES_MAX: usize = 224;

/// Longest text that names a program's version, in bytes.
pub const UPDATE_VERSION_BYTES_MAX: usize = 40;

/// Longest text for people, in bytes.
pub const UPDATE_TEXT_BYTES_MAX: usize = 180;

/// What a host asks of a box.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UpdateRequest {
    /// Chosen by the host; the reply repeats it.
    pub id: u16,
    /// What is to be done.
    pub step: UpdateStep,
}

/// A step of an update.
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the bytes")]
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateStep {
    /// Say how far it is, and what became of the last one.
    Query,
    /// Forget what has come of an update, and take another.
    Begin {
        /// Even while somebody records a trial, which it disturbs.
        is_forced: bool,
    },
    /// Take these bytes of the update's file; there is no reply.
    Part {
        /// Where in the file they begin.
        offset: u32,
        /// The bytes.
        bytes: Vec<u8, UPDATE_PART_BYTES_MAX>,
    },
    /// Restart with the update that has come, once: it stays if it passes its own tests.
    Try {
        /// Even while somebody records a trial, which it ends.
        is_forced: bool,
    },
    /// This host leaves; there is no reply.
    Leave,
}

/// A box's reply to a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UpdateReply {
    /// The request's number.
    pub id: u16,
    /// Version and commit of the program that the box runs, as in its
    /// [`Hello`](super::Hello::firmware).
    pub version: String<UPDATE_VERSION_BYTES_MAX>,
    /// What came of it.
    pub outcome: UpdateOutcome,
}

/// What came of a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateOutcome {
    /// It is done, and this is how far the update is now.
    State {
        /// How far.
        state: UpdateState,
        /// The same in words, for people; may be empty.
        text: String<UPDATE_TEXT_BYTES_MAX>,
    },
    /// It is not done.
    Refused {
        /// Why.
        refusal: UpdateRefusal,
        /// The same in words, for people; may be empty.
        text: String<UPDATE_TEXT_BYTES_MAX>,
    },
}

/// How far the update of a box is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateState {
    /// None has come since the box's start, and none was tried before it.
    None,
    /// Its parts come.
    Receiving {
        /// Where in its file the first missing byte is.
        next: u32,
    },
    /// It is complete, and is read back from the card.
    Checking,
    /// It is on the card as it was signed, and can be tried.
    Ready,
    /// It cannot be used, or could not be stored; the text says why.
    Unusable,
    /// The box restarts with the update.
    Restarting,
    /// The box runs the update, and has yet to show that it works; the text says what is missing.
    OnTrial,
    /// The box runs the update from now on.
    Installed,
    /// The update was tried before this start and given up; the text says why.
    GivenUp,
}

/// Why a request was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateRefusal {
    /// This box is not updated over its link.
    NotSupported,
    /// Not now: try again.
    Busy,
    /// Somebody records a trial, which it would disturb.
    Recording,
    /// There is no update that could be tried.
    NotReady,
    /// Something could not be stored.
    NotStored,
}
