//! How the box takes frames from its camera.

use heapless::String;
use serde::{Deserialize, Serialize};

use super::DEVICE_PATH_BYTES_MAX;

/// The interface through which the box reads its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum CaptureDriver {
    /// Video4Linux: USB and other cameras that give whole pictures.
    V4l2,
    /// libcamera: sensors on a ribbon cable.
    Libcamera,
}

/// How the camera lays out its grey values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PixelFormat {
    /// 8-bit grey.
    Grey,
    /// 10-bit grey, packed or in 16-bit words, as the camera delivers it.
    Y10,
    /// 16-bit grey.
    Y16,
    /// 4:2:2, luma in every second byte.
    Yuyv,
    /// 4:2:0, luma in a plane of its own.
    Nv12,
    /// Three bytes a pixel, of which the green one is used.
    Rgb24,
    /// A colour sensor's own 8-bit samples, of which the green ones are used.
    Bayer8,
    /// Each frame compressed as a JPEG file (Motion JPEG), of which the luma is used.
    Mjpeg,
}

/// The camera's settings. The frame size comes from the lens: a calibration holds for one size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Capture {
    /// The interface through which to read it.
    pub driver: CaptureDriver,
    /// A device such as `/dev/video0`, or libcamera's name for the camera; empty for the first
    /// camera that supports these settings.
    pub device: String<DEVICE_PATH_BYTES_MAX>,
    /// Layout of the grey values.
    pub pixel_format: PixelFormat,
    /// Frames per second.
    pub rate_hz: f32,
    /// Exposure time; `None` leaves the camera as it is.
    pub exposure_us: Option<u32>,
    /// Gain: in the driver's own steps (Video4Linux) or as a factor (libcamera);
    /// `None` leaves the camera as it is.
    pub gain: Option<f32>,
}

/// Which field of a [`Capture`] is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaptureError {
    /// Bayer samples and Motion JPEG are read through Video4Linux only.
    PixelFormat,
    /// The rate is not within 1 to 1,000 Hz.
    Rate,
    /// The exposure is 0, or longer than a frame lasts.
    Exposure,
    /// The gain is negative or not a number.
    Gain,
}

impl core::fmt::Display for CaptureError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::PixelFormat => {
                "pixel_format: bayer8 and mjpeg need the driver v4l2; with libcamera take nv12"
            }
            Self::Rate => "rate_hz: must be within 1 to 1,000",
            Self::Exposure => "exposure_us: must be above 0 and no longer than one frame",
            Self::Gain => "gain: must be 0 or more",
        })
    }
}

impl Capture {
    /// Checks every value.
    ///
    /// # Errors
    /// The first field that is out of range.
    pub fn check(&self) -> Result<(), CaptureError> {
        if self.driver == CaptureDriver::Libcamera
            && matches!(self.pixel_format, PixelFormat::Bayer8 | PixelFormat::Mjpeg)
        {
            return Err(CaptureError::PixelFormat);
        }
        if !(1.0..=1000.0).contains(&self.rate_hz) {
            return Err(CaptureError::Rate);
        }
        let frame_us = 1e6 / self.rate_hz;
        if self.exposure_us.is_some_and(|exposure| exposure == 0 || exposure as f32 > frame_us) {
            return Err(CaptureError::Exposure);
        }
        if self.gain.is_some_and(|gain| !gain.is_finite() || gain < 0.0) {
            return Err(CaptureError::Gain);
        }
        Ok(())
    }
}
