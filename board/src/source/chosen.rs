//! The source in use, chosen at the start: a recording, or the camera of the
//! configuration.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use plumbline::config::{CaptureDriver, Config};

use super::camera::Camera;
use super::replay::Replay;
use super::{Condition, FrameSource, Next};

/// One of the sources that there are.
#[derive(Debug)]
pub enum Source {
    /// A recording.
    Replay(Box<Replay>),
    /// A camera that Video4Linux drives.
    V4l2(Box<Camera<V4l2>>),
}

impl Source {
    /// The camera that the configuration names. It is opened when the first
    /// frame is asked for, so that it need not be there yet.
    ///
    /// # Errors
    /// When it names none, or one that this program was not built for.
    pub fn camera(config: &Config) -> Result<Self> {
        let capture = config.capture.clone().context(
            "capture: the configuration names no camera; provision the box again with its camera",
        )?;
        let size_px = (usize::from(config.lens.width_px), usize::from(config.lens.height_px));
        match capture.driver {
            CaptureDriver::V4l2 => Ok(Self::V4l2(Camera::new(capture, size_px).into())),
            CaptureDriver::Libcamera => bail!(
                "capture.driver: libcamera, without which this program was built; use the Debian \
                 package of plumbline-board, or provision the box for V4l2"
            ),
        }
    }
}

impl FrameSource for Source {
    fn size_px(&self) -> (usize, usize) {
        match self {
            Self::Replay(source) => source.size_px(),
            Self::V4l2(source) => source.size_px(),
        }
    }

    fn next(&mut self, until: Instant) -> Next<'_> {
        match self {
            Self::Replay(source) => source.next(until),
            Self::V4l2(source) => source.next(until),
        }
    }

    fn condition(&self) -> Condition {
        match self {
            Self::Replay(source) => source.condition(),
            Self::V4l2(source) => source.condition(),
        }
    }
}

/// Stands in for the real one.
#[derive(Debug)]
pub struct V4l2;

impl super::camera::Device for V4l2 {
    fn open(_: &plumbline::config::Capture, _: (usize, usize)) -> Result<Self> {
        bail!("this program cannot open V4L2 cameras yet")
    }

    fn wait(&mut self, _: Instant) -> super::camera::Waited {
        super::camera::Waited::Quiet
    }

    fn frame(&self) -> super::Frame<'_> {
        unreachable!()
    }

    fn counts(&self) -> super::camera::Counts {
        super::camera::Counts::default()
    }
}
