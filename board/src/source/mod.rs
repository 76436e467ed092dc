//! Where frames come from.
//!
//! A source hands out one frame at a time, borrowed, so that a camera's buffer
//! is used where it lies, and never keeps the caller waiting beyond the instant
//! it names: the main loop has a heartbeat to send while the source is silent.

pub mod camera;
pub mod chosen;
// Its pure parts are tested in every build.
#[cfg(any(feature = "libcamera", test))]
pub mod libcamera;
mod newest;
pub mod rate;
pub mod replay;
pub mod stamp;
pub mod v4l2;

use std::time::Instant;

use plumbline::image::GreyImage;
use plumbline::packet::{CameraState, MarkedInstant};

/// Gives frames, in the order of their capture.
pub trait FrameSource {
    /// Columns and rows of every frame.
    fn size_px(&self) -> (usize, usize);

    /// The next frame, or [`Next::Quiet`] when none is due by `until`.
    ///
    /// Allocates nothing once the first frame has been handed out.
    fn next(&mut self, until: Instant) -> Next<'_>;

    /// Takes frames with another exposure from now on; `None` is as configured. Whether it
    /// can: a recording cannot.
    fn expose(&mut self, exposure: Exposure) -> bool;

    /// How frames are exposed, as far as it was asked for.
    fn exposure(&self) -> Exposure;

    /// How the source is doing.
    fn condition(&self) -> Condition;
}

/// How a camera is to expose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exposure {
    /// Exposure time.
    pub exposure_us: Option<u32>,
    /// Gain, in the camera's own unit.
    pub gain: Option<f32>,
}

/// How a source is doing; counters run from the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condition {
    /// Whether frames come.
    pub camera: CameraState,
    /// Frames that came and were skipped, because newer ones were already there.
    pub frames_dropped: u64,
    /// Frames that never came, or came damaged.
    pub frames_missed: u64,
    /// How often frames stopped coming, so that the camera had to be reopened.
    pub camera_losses: u32,
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

/// The pixels of a frame, where they lie.
#[derive(Debug, Clone, Copy)]
pub enum Pixels<'a> {
    /// 8 bits each.
    Grey8(GreyImage<'a, u8>),
    /// Up to 16 bits each.
    Grey16(GreyImage<'a, u16>),
}

/// One frame.
#[derive(Debug)]
pub struct Frame<'a> {
    /// `size_px` pixels.
    pub pixels: Pixels<'a>,
    /// When it was captured: CLOCK_MONOTONIC for a camera, the time in the
    /// recording for a replay.
    pub capture_time_ns: u64,
    /// Which instant of the frame that is.
    pub instant: MarkedInstant,
    /// The same instant on this program's clock; a paced replay's is the one at
    /// which it owes the frame. Latency counts from here.
    pub ready_at: Instant,
    /// It was handed out when the frame after it was already due.
    pub late: bool,
}
