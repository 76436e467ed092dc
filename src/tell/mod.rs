//! What goes out.
//!
//! In: what the other groups found in a frame. Out: the [`report`] on the frame's poses, the
//! [`view`] of its brightness and sharpness, and [`packet`]s that carry both, and everything else
//! that box and host exchange, as bytes; and [`seal`]s them.

pub mod packet;
pub mod report;
pub mod seal;
pub mod view;

#[cfg(test)]
mod tests;
