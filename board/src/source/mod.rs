//! Where frames come from.
//!
//! A source hands out one frame at a time, borrowed, so that a camera's buffer
//! is used where it lies, and never keeps the caller waiting beyond the instant
//! it names: the main loop has a heartbeat to send while the source is silent.

pub mod rate;
pub mod replay;

use std::time::Instant;

/// Gives frames, in the order of their capture.
pub trait FrameSource {
    /// Columns and rows of every frame.
    fn size_px(&self) -> (usize, usize);

    /// The next frame, or [`Next::Quiet`] when none is due by `until`.
    ///
    /// Allocates nothing once the first frame has been handed out.
    fn next(&mut self, until: Instant) -> Next<'_>;
}

/// What a source has to say.
#[derive(Debug)]
pub enum Next<'a> {
    /// A frame.
    Frame(Frame<'a>),
    /// No frame by the instant that was asked for; more may come.
    Quiet,
    /// The last frame has been handed out.
    End,
    /// The source broke; nothing more will come. The text names the source and the remedy.
    Broken(String),
}

/// One frame: 8-bit luma, row by row without gaps.
#[derive(Debug)]
pub struct Frame<'a> {
    /// `size_px` pixels.
    pub luma: &'a [u8],
    /// When it was captured, on the source's own clock.
    pub capture_time_ns: u64,
    /// When work on it could have begun: its arrival, or the instant at which
    /// a paced replay owes it. Latency counts from here.
    pub ready_at: Instant,
    /// It was handed out when the frame after it was already due.
    pub late: bool,
}
