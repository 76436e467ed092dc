//! Where frames come from.
//!
//! A source gives one frame at a time. The frame is borrowed, so that a camera's buffer is used
//! in place. A source never keeps the caller waiting beyond the instant that it names: the main
//! loop has a heartbeat to send while the source is silent.

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

use std::time::{Duration, Instant};

use plumbline::image::GreyImage;
use plumbline::packet::{CameraState, MarkedInstant};

/// Gives frames in the order of their capture.
pub trait FrameSource {
    /// Columns and rows of every frame.
    fn size_px(&self) -> (usize, usize);

    /// The next frame, or [`Next::Quiet`] if there is none by `until`.
    ///
    /// Does not allocate once the first frame has been given, except to decode a compressed frame
    /// (see [`allocation::apart`](crate::allocation::apart)).
    fn next(&mut self, until: Instant) -> Next<'_>;

    /// Changes the exposure from now on; `None` means as configured. Returns false if that is
    /// impossible, as for a recording.
    fn expose(&mut self, exposure: Exposure) -> bool;

    /// The exposure asked for, by a host or by the configuration.
    fn exposure(&self) -> Exposure;

    /// How the source is doing.
    fn condition(&self) -> Condition;
}

/// The exposure asked of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exposure {
    /// Exposure time.
    pub exposure_us: Option<u32>,
    /// Gain, in the camera's own unit.
    pub gain: Option<f32>,
}

/// How a source is doing; counters run from its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condition {
    /// Whether frames arrive.
    pub camera: CameraState,
    /// Frames that arrived and were skipped, because newer ones were already there.
    pub frames_dropped: u64,
    /// Frames that never arrived, or arrived damaged.
    pub frames_missed: u64,
    /// How often frames stopped, so that the camera had to be reopened.
    pub camera_losses: u32,
}

/// What a source answers when it is asked for a frame.
#[derive(Debug)]
pub enum Next<'a> {
    /// A frame.
    Frame(Frame<'a>),
    /// No frame by the instant named; more may come.
    Quiet,
    /// The last frame has been given.
    End,
    /// The source failed; no more frames will come. The text names the source and the remedy.
    Broken(String),
}

/// The pixels of a frame, borrowed.
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
    /// The image, of [`FrameSource::size_px`].
    pub pixels: Pixels<'a>,
    /// When it was captured: CLOCK_MONOTONIC for a camera, the time in the
    /// recording for a replay.
    pub capture_time_ns: u64,
    /// Which instant of the frame that is, for the row that is read first. A camera whose exposure
    /// time is known gives the middle of the exposure.
    pub instant: MarkedInstant,
    /// The same instant on this program's clock; for a paced replay, the instant at which the
    /// frame is due. Latency is counted from here.
    pub ready_at: Instant,
    /// Whether the frame was given when the next one was already due.
    pub late: bool,
}

impl Frame<'_> {
    /// The same frame at the middle of the exposure of the row that is read first, where that is
    /// known.
    fn at_mid_exposure(mut self, exposure_us: Option<u32>, readout_ns: i32) -> Self {
        let moved =
            stamp::to_mid_exposure_ns(self.instant, exposure_us, readout_ns).and_then(|shift_ns| {
                let shift = Duration::from_nanos(shift_ns.unsigned_abs());
                let ready_at = if shift_ns < 0 {
                    self.ready_at.checked_sub(shift)
                } else {
                    self.ready_at.checked_add(shift)
                };
                Some((self.capture_time_ns.checked_add_signed(shift_ns)?, ready_at?))
            });
        if let Some((capture_time_ns, ready_at)) = moved {
            self.instant = MarkedInstant::ExposureMiddle;
            (self.capture_time_ns, self.ready_at) = (capture_time_ns, ready_at);
        }
        self
    }
}
