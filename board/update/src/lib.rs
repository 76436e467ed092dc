//! Updates of a box's program and kernel: what an update is, and what a card is that can take one.
//!
//! | module | holds |
//! |---|---|
//! | [`release`] | versions, and which of them a box may go to |
//! | [`header`] | the head of an update's file: what it is for, and its Ed25519 signature |
//! | [`card`] | the partitions of a card: the chooser, two slots, the settings |
//! | [`chooser`] | the one sector that says which slot starts |
//! | [`firmware`] | what the Raspberry Pi's boot firmware makes of that sector |
//! | `sign` | how an update's file is made (feature `sign`) |
//!
//! A box never writes to the slot that it runs from. It writes the other one, reads it back, has the
//! firmware try it once, and only a program that has tested itself there makes it the one that
//! starts from then on, by rewriting one sector:
//!
//! ```text
//!            receives            reads back            one start           its own tests pass
//! slot A runs ───────▶ slot B written ───────▶ B ready ─────────▶ B on trial ───────────▶ B starts
//!     ▲                     │                    │                   │
//!     └─────────────────────┴────────────────────┴───────────────────┘
//!              cut off, refused, damaged, hung, without power, failed
//! ```
//!
//! Nothing here reads a disk or a network; the box (`plumbline-board`), its hosts and what makes the
//! cards do.

pub mod card;
pub mod chooser;
pub mod firmware;
pub mod header;
pub mod release;
#[cfg(feature = "sign")]
pub mod sign;
