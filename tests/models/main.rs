//! Laws and state machines, against what is obviously right.
//!
//! | module | law |
//! |---|---|
//! | `accounting` | every frame that is lost, repeated or late is told once, and no other |
//! | `sessions` | so it is over the starts of a box; and whatever comes is counted once |
//! | `journal` | a journal that was cut reads as what was written before the cut |
//! | `solver` | a pose follows a turn of the scene, and any choice of the frames |
//! | `clock` | time never runs backwards, and is as certain as it is said to be |
//! | `published` | so it is for frames that are published while the clocks become better known |
//!
//! | module | state machine, in everything that it can do up to a number of steps |
//! |---|---|
//! | `track` | a target's state from frame to frame |
//! | `window` | which counters have come |
//! | `handshake` | a box and a program on a network that loses, reorders and replays |
//!
//! Each has a test for every day, and one for `cargo xtask test endurance`, which does far more of the
//! same. The state machine of an update is tried beside it, in `board/src/update`.

mod accounting;
mod clock;
mod handshake;
mod journal;
mod laws;
mod published;
mod sessions;
mod solver;
mod track;
mod window;
