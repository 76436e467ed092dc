//! Finds the camera and negotiates format, size and rate with its driver.
//!
//! Input: the configuration and the size for which the lens was calibrated.
//! Output: a device that gives exactly that, or an error that names the setting,
//! what the camera offers instead, and the remedy. A device that captures a video
//! signal (HDMI) is first set to the timings of the signal, which determine its
//! size and rate.

use std::io;

use anyhow::{Context, Result, bail, ensure};
use plumbline::config::{Capture, PixelFormat};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::v4l_sys::{
    V4L2_CAP_STREAMING, V4L2_CAP_VIDEO_CAPTURE, V4L2_CAP_VIDEO_CAPTURE_MPLANE,
    v4l2_field_V4L2_FIELD_NONE as PROGRESSIVE, v4l2_pix_format,
};
use v4l::video::Capture as _;
use v4l::video::capture::Parameters;
use v4l::{FourCC, Fraction};

use super::driver::Driver;
use super::luma::{self, Luma};

/// The kernel's limit on the number of video devices.
const DEVICES_MAX: usize = 256;

/// The largest number of sizes or rates that a message lists.
const LISTED_MAX: usize = 16;

/// The relative difference up to which a rate is the one asked for: 29.97 is 30.
const RATE_ERROR_MAX: f64 = 0.005;

/// Every format that can be read here.
const FORMATS: [PixelFormat; 8] = [
    PixelFormat::Grey,
    PixelFormat::Y10,
    PixelFormat::Y16,
    PixelFormat::Yuyv,
    PixelFormat::Nv12,
    PixelFormat::Rgb24,
    PixelFormat::Bayer8,
    PixelFormat::Mjpeg,
];

/// A camera set up as configured, which does not run yet.
#[derive(Debug)]
pub struct Settled {
    /// The device.
    pub driver: Driver,
    /// Its path.
    pub path: String,
    /// How to read its frames.
    pub luma: Luma,
}

/// Opens the configured device, or the first that can be set up as configured.
///
/// # Errors
/// When there is none; the message gives the reason for each device.
pub fn settle(capture: &Capture, size_px: (usize, usize)) -> Result<Settled> {
    if !capture.device.is_empty() {
        let path = capture.device.as_str();
        let driver = Driver::open(path).with_context(|| {
            format!("capture.device: {path} cannot be opened: is the camera plugged in?")
        })?;
        return settle_driver(driver, path, capture, size_px);
    }
    let mut reasons = Vec::new();
    for number in 0..DEVICES_MAX {
        let path = format!("/dev/video{number}");
        let settled = match Driver::open(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            Err(error) => {
                Err(anyhow::Error::new(error).context(format!("{path}: cannot be opened")))
            }
            // Outputs, decoders, and the nodes of a camera that do not carry pictures.
            Ok(driver) if !captures(driver.capabilities().unwrap_or(0)) => continue,
            Ok(driver) => settle_driver(driver, &path, capture, size_px),
        };
        match settled {
            Ok(settled) => return Ok(settled),
            Err(error) => reasons.push(format!("{error:#}")),
        }
    }
    ensure!(!reasons.is_empty(), "no device captures video: is the camera plugged in?");
    bail!("no camera gives what is configured: {}", reasons.join("; "))
}

/// Whether a device with these capabilities is a camera of any kind.
fn captures(capabilities: u32) -> bool {
    capabilities & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0
}

fn settle_driver(
    driver: Driver,
    path: &str,
    capture: &Capture,
    size_px: (usize, usize),
) -> Result<Settled> {
    let luma = settle_stream(&driver, capture, size_px).with_context(|| path.to_string())?;
    Ok(Settled { driver, path: path.into(), luma })
}

fn settle_stream(driver: &Driver, capture: &Capture, size_px: (usize, usize)) -> Result<Luma> {
    let capabilities = driver.capabilities().context("it is not a video device")?;
    let can = |bit| capabilities & bit != 0;
    ensure!(captures(capabilities), "it does not capture video");
    ensure!(
        can(V4L2_CAP_VIDEO_CAPTURE),
        "it gives frames in several planes, which are not read here: use another camera, or \
         libcamera for a sensor on a ribbon cable"
    );
    ensure!(can(V4L2_CAP_STREAMING), "it does not stream into mapped memory");
    if driver.follows_signal() {
        let timings = driver.signal_timings().context(
            "there is no video signal at its input: check the cable, and that the camera is on",
        )?;
        driver.set_timings(timings).context(
            "it does not let its input be set to the signal: does another program use it?",
        )?;
        // Not every driver can; the size is checked again when the device is reopened.
        let _ = driver.watch_signal();
    }
    let code = settle_code(driver, capture.pixel_format)?;
    let stride_bytes = settle_size(driver, code, size_px)?;
    settle_rate(driver, code, size_px, capture.rate_hz)?;
    Luma::new(&code.repr, size_px, stride_bytes)
}

/// The code under which the camera offers the configured format.
fn settle_code(driver: &Driver, format: PixelFormat) -> Result<FourCC> {
    let offered = driver.formats();
    let codes = luma::codes(format).iter().map(|code| FourCC::new(code));
    codes.into_iter().find(|code| offered.contains(code)).with_context(|| {
        let read: Vec<String> = offered
            .iter()
            .filter(|code| FORMATS.iter().any(|&format| luma::codes(format).contains(&&code.repr)))
            .map(|code| code.repr.escape_ascii().to_string())
            .collect();
        format!(
            "capture.pixel_format: it does not give {format:?}; of the formats that are read \
             here it gives {}",
            if read.is_empty() { "none".into() } else { read.join(", ") }
        )
    })
}

/// Sets the size; returns the stride of the rows in bytes.
fn settle_size(driver: &Driver, code: FourCC, size_px: (usize, usize)) -> Result<usize> {
    let side = |px: usize| u32::try_from(px).context("the size of the lens is too large");
    let (width, height) = (side(size_px.0)?, side(size_px.1)?);
    let format = driver
        .set_format(v4l2_pix_format {
            width,
            height,
            pixelformat: code.into(),
            field: PROGRESSIVE,
            ..v4l::Format::new(width, height, code).into()
        })
        .context("it does not let its format be set: does another program use it?")?;
    if (format.width, format.height) != (width, height) {
        let sizes = driver.device().enum_framesizes(code).unwrap_or_default();
        let sizes = listed(sizes.into_iter().map(|size| match size.size {
            FrameSizeEnum::Discrete(size) => size.to_string(),
            FrameSizeEnum::Stepwise(range) => format!(
                "{}x{} to {}x{}",
                range.min_width, range.min_height, range.max_width, range.max_height
            ),
        }));
        bail!(
            "the lens is calibrated for {width}x{height} px, and it gives {}x{}{sizes}: calibrate \
             at a size that it gives",
            format.width,
            format.height
        );
    }
    ensure!(
        format.pixelformat == u32::from(code),
        "capture.pixel_format: it lists {} and gives {}",
        code.repr.escape_ascii(),
        format.pixelformat.to_le_bytes().escape_ascii()
    );
    ensure!(
        format.field == PROGRESSIVE,
        "it gives interlaced frames, whose halves are of different instants: set the camera to \
         progressive"
    );
    Ok(format.bytesperline as usize)
}

/// Sets the rate, if the camera allows it.
fn settle_rate(driver: &Driver, code: FourCC, size_px: (usize, usize), rate_hz: f32) -> Result<()> {
    let device = driver.device();
    let taken = device.set_params(&Parameters::new(interval(rate_hz))).map(|taken| taken.interval);
    let Some(taken) = taken.ok().filter(|taken| taken.numerator != 0 && taken.denominator != 0)
    else {
        log::warn!("camera: it does not let its rate be set: capture.rate_hz is not checked");
        return Ok(());
    };
    let hz = |interval: &Fraction| f64::from(interval.denominator) / f64::from(interval.numerator);
    let taken_hz = hz(&taken);
    if (taken_hz / f64::from(rate_hz) - 1.0).abs() <= RATE_ERROR_MAX {
        return Ok(());
    }
    let (width, height) = (size_px.0 as u32, size_px.1 as u32);
    let rates = device.enum_frameintervals(code, width, height).unwrap_or_default();
    let rates = listed(rates.into_iter().map(|rate| match &rate.interval {
        FrameIntervalEnum::Discrete(interval) => format!("{:.2}", hz(interval)),
        FrameIntervalEnum::Stepwise(range) => {
            format!("{:.2} to {:.2}", hz(&range.max), hz(&range.min))
        }
    }));
    bail!(
        "capture.rate_hz: asked {rate_hz}, and it gives {taken_hz:.2} Hz at {width}x{height}{rates}"
    )
}

/// The interval between frames, exact for integer and for broadcast rates.
fn interval(rate_hz: f32) -> Fraction {
    if rate_hz.fract() == 0.0 {
        Fraction::new(1, rate_hz as u32)
    } else {
        Fraction::new(1000, (f64::from(rate_hz) * 1000.0).round() as u32)
    }
}

/// A list of what the camera offers, as the end of a sentence.
fn listed(offered: impl ExactSizeIterator<Item = String>) -> String {
    let more = offered.len().saturating_sub(LISTED_MAX);
    let list: Vec<String> = offered.take(LISTED_MAX).collect();
    match (list.is_empty(), more) {
        (true, _) => String::new(),
        (false, 0) => format!(" (it offers {})", list.join(", ")),
        (false, _) => format!(" (it offers {} and {more} more)", list.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_exact_where_they_can_be() {
        let cases = [(60.0, (1, 60)), (1.0, (1, 1)), (29.97, (1000, 29970)), (7.5, (1000, 7500))];
        for (rate_hz, expected) in cases {
            let interval = interval(rate_hz);
            assert_eq!((interval.numerator, interval.denominator), expected, "{rate_hz}");
        }
    }

    #[test]
    fn lists_are_short() {
        let names = |count: usize| (0..count).map(|n| n.to_string());
        assert_eq!(listed(names(0)), "");
        assert_eq!(listed(names(2)), " (it offers 0, 1)");
        assert!(listed(names(18)).ends_with("14, 15 and 2 more)"));
    }
}
