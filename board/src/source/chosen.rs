//! The source in use, chosen at the start: a recording, or the camera of the
//! configuration.

use std::time::Instant;

use anyhow::{Context, Result};
use plumbline::config::{CaptureDriver, Config};

use super::camera::Camera;
#[cfg(feature = "libcamera")]
use super::libcamera::Libcamera;
use super::replay::Replay;
use super::v4l2::V4l2;
use super::{Condition, Exposure, FrameSource, Next};

/// One of the kinds of sources.
#[derive(Debug)]
pub enum Source {
    /// A recording.
    Replay(Box<Replay>),
    /// A camera driven by Video4Linux.
    V4l2(Box<Camera<V4l2>>),
    /// A camera driven by libcamera.
    #[cfg(feature = "libcamera")]
    Libcamera(Box<Camera<Libcamera>>),
}

impl Source {
    /// The camera that the configuration names. It is opened when the first
    /// frame is asked for, so that it need not be there yet.
    ///
    /// # Errors
    /// When it names no camera, or one that this program was built without.
    pub fn camera(config: &Config) -> Result<Self> {
        let capture = config.capture.clone().context(
            "capture: the configuration names no camera; provision the box again with its camera",
        )?;
        let size_px = (usize::from(config.lens.width_px), usize::from(config.lens.height_px));
        match capture.driver {
            CaptureDriver::V4l2 => {
                Ok(Self::V4l2(Camera::new(capture, size_px, config.readout_ns).into()))
            }
            #[cfg(feature = "libcamera")]
            CaptureDriver::Libcamera => {
                Ok(Self::Libcamera(Camera::new(capture, size_px, config.readout_ns).into()))
            }
            #[cfg(not(feature = "libcamera"))]
            CaptureDriver::Libcamera => anyhow::bail!(
                "capture.driver: libcamera, without which this program was built; use the Debian \
                 package of plumbline-board, or provision the box with driver = \"v4l2\""
            ),
        }
    }
}

impl FrameSource for Source {
    fn size_px(&self) -> (usize, usize) {
        match self {
            Self::Replay(source) => source.size_px(),
            Self::V4l2(source) => source.size_px(),
            #[cfg(feature = "libcamera")]
            Self::Libcamera(source) => source.size_px(),
        }
    }

    fn next(&mut self, until: Instant) -> Next<'_> {
        match self {
            Self::Replay(source) => source.next(until),
            Self::V4l2(source) => source.next(until),
            #[cfg(feature = "libcamera")]
            Self::Libcamera(source) => source.next(until),
        }
    }

    fn expose(&mut self, exposure: Exposure) -> bool {
        match self {
            Self::Replay(source) => source.expose(exposure),
            Self::V4l2(source) => source.expose(exposure),
            #[cfg(feature = "libcamera")]
            Self::Libcamera(source) => source.expose(exposure),
        }
    }

    fn exposure(&self) -> Exposure {
        match self {
            Self::Replay(source) => source.exposure(),
            Self::V4l2(source) => source.exposure(),
            #[cfg(feature = "libcamera")]
            Self::Libcamera(source) => source.exposure(),
        }
    }

    fn condition(&self) -> Condition {
        match self {
            Self::Replay(source) => source.condition(),
            Self::V4l2(source) => source.condition(),
            #[cfg(feature = "libcamera")]
            Self::Libcamera(source) => source.condition(),
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::config::Capture;

    use super::*;

    fn config(driver: Option<CaptureDriver>) -> Config {
        let mut config = crate::test_config::config();
        config.capture =
            config.capture.zip(driver).map(|(capture, driver)| Capture { driver, ..capture });
        config
    }

    #[test]
    fn the_camera_has_the_calibrated_size() {
        let source = Source::camera(&config(Some(CaptureDriver::V4l2))).unwrap();
        assert_eq!(source.size_px(), (640, 480));
    }

    #[test]
    fn a_configuration_without_a_camera_is_refused_by_name() {
        let error = Source::camera(&config(None)).unwrap_err().to_string();
        assert!(error.starts_with("capture: "), "{error}");
    }

    #[cfg(not(feature = "libcamera"))]
    #[test]
    fn a_camera_that_was_not_built_in_is_refused_by_name() {
        let error = Source::camera(&config(Some(CaptureDriver::Libcamera))).unwrap_err();
        assert!(error.to_string().starts_with("capture.driver: "), "{error}");
    }
}
