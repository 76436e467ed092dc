//! The target from frame to frame.
//!
//! In: its pose in each frame, or that there was none. Out: where to expect it in the next frame
//! ([`crate::model::motion`]), whether to look for it there or everywhere ([`track::State`]), and the
//! [`region`] of the frame that is searched for a target just lost.

pub mod region;
pub mod track;
