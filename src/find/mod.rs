//! Finding the targets in a frame of which nothing is known.
//!
//! In: a frame. Out: each target's [`grid`], numbered, with its corners accurate to a quarter of a
//! pixel, or why there is none. [`search`] works through the frame in slices; in each slice
//! [`corner`] finds the corners of checkerboards, and at the end [`grid`] joins them.

pub mod corner;
pub mod grid;
pub mod search;
