//! The desk: a page on this computer for the person who measures, and the server behind it.
//!
//! [`wire`] is what both say to each other.

pub mod wire;
