//! Chooses the camera and sets it up. All of this happens when a camera is opened.

use anyhow::{Context, Result, bail, ensure};
use libcamera::camera::{Camera, CameraConfiguration};
use libcamera::camera_manager::CameraManager;
use libcamera::control::ControlList;
use libcamera::controls::{AeEnable, AnalogueGain, ControlId, ExposureTime, FrameDurationLimits};
use libcamera::geometry::Size;
use libcamera::pixel_format::PixelFormat;
use libcamera::properties;
use libcamera::stream::{StreamConfigurationRef, StreamRole};
use plumbline::config::{self, Capture};

/// A camera that can be set up as configured, and the configuration for it.
pub struct Choice {
    pub camera: Camera<'static>,
    pub configuration: CameraConfiguration,
}

/// Processed pictures first: the raw ones of a colour sensor are not grey values.
const ROLES: [StreamRole; 2] = [StreamRole::VideoRecording, StreamRole::Raw];

// The crate's own table of formats is empty with libcamera 0.4's headers.
const R8: PixelFormat = linear(b"R8  ");
const R10: PixelFormat = linear(b"R10 ");
const R16: PixelFormat = linear(b"R16 ");
const YUYV: PixelFormat = linear(b"YUYV");
const NV12: PixelFormat = linear(b"NV12");
const RGB888: PixelFormat = linear(b"RG24");
const BGR888: PixelFormat = linear(b"BG24");
const YUV420: PixelFormat = linear(b"YU12");

/// The format with this code, neither packed nor compressed.
const fn linear(code: &[u8; 4]) -> PixelFormat {
    PixelFormat::new(u32::from_le_bytes(*code), 0)
}

/// libcamera's formats that hold grey values in the same way as a configured format.
fn formats_of(format: config::PixelFormat) -> &'static [PixelFormat] {
    match format {
        config::PixelFormat::Grey => &[R8],
        config::PixelFormat::Y10 => &[R10],
        config::PixelFormat::Y16 => &[R16],
        config::PixelFormat::Yuyv => &[YUYV],
        config::PixelFormat::Nv12 => &[NV12, YUV420],
        config::PixelFormat::Rgb24 => &[RGB888, BGR888],
        config::PixelFormat::Bayer8 | config::PixelFormat::Mjpeg => &[],
    }
}

/// The first camera that the configuration names and that can be set up as it says,
/// with one stream and `buffers` buffers, or as many as the camera insists on.
///
/// # Errors
/// When there is none; the message lists what each camera offers instead.
pub fn choose(
    manager: &CameraManager,
    capture: &Capture,
    size_px: (usize, usize),
    buffers: usize,
) -> Result<Choice> {
    let cameras = manager.cameras();
    let mut refusals = Vec::new();
    for camera in (0..cameras.len()).filter_map(|index| cameras.get(index)) {
        let model = camera.properties().get::<properties::Model>().map(|model| model.0);
        let model = model.unwrap_or_default();
        if !capture.device.is_empty() && capture.device != camera.id() && *capture.device != *model
        {
            refusals.push(format!("{} ({model}) is another camera", camera.id()));
            continue;
        }
        match configuration(&camera, capture, size_px, buffers) {
            Ok(configuration) => return Ok(Choice { camera, configuration }),
            Err(offers) => refusals.push(format!("{} ({model}) {offers}", camera.id())),
        }
    }
    let (width, height) = size_px;
    let wanted = format!("{} of {width}x{height}", names(formats_of(capture.pixel_format)));
    let device = capture.device.as_str();
    if refusals.is_empty() {
        bail!("libcamera finds no camera: connect one, and check that its driver is loaded");
    }
    bail!(
        "capture.device {device:?}: no such camera gives {wanted}: {}: change capture.device or \
         capture.pixel_format, or calibrate at a size that is offered",
        refusals.join("; ")
    )
}

/// One stream of exactly the size and one of the formats asked for; otherwise
/// what the camera offers.
fn configuration(
    camera: &Camera<'_>,
    capture: &Capture,
    size_px: (usize, usize),
    buffers: usize,
) -> Result<CameraConfiguration, String> {
    // Sizes are at most `FRAME_SIDE_PX_MAX`.
    let size = Size::new(size_px.0 as u32, size_px.1 as u32);
    let mut offers = Vec::new();
    for role in ROLES {
        for &format in formats_of(capture.pixel_format) {
            let Some(mut configuration) = camera.generate_configuration(&[role]) else { continue };
            let Some(mut stream) = configuration.get_mut(0) else { continue };
            let offered = offer(&stream);
            stream.set_pixel_format(format);
            stream.set_size(size);
            stream.set_buffer_count(buffers as u32);
            // Adjustments of anything but size and format are accepted.
            let valid = !configuration.validate().is_invalid();
            let found = configuration.get(0).map(|stream| {
                let Size { width, height } = stream.get_size();
                (stream.get_pixel_format(), width, height)
            });
            if valid && found == Some((format, size.width, size.height)) {
                return Ok(configuration);
            }
            if !offers.contains(&offered) {
                offers.push(offered);
            }
        }
    }
    if offers.is_empty() {
        return Err("gives no pictures".into());
    }
    Err(format!("offers {}", offers.join(", ")))
}

/// Every format of a stream and its sizes.
fn offer(stream: &StreamConfigurationRef<'_>) -> String {
    let offered = stream.formats();
    let formats = offered.pixel_formats();
    let described = formats.value().into_iter().map(|format| {
        let sizes = offered.sizes(format);
        let sizes = sizes.iter().map(|size| format!("{}x{}", size.width, size.height));
        let range = offered.range(format);
        let sizes = sizes.collect::<Vec<_>>().join(" or ");
        if sizes.is_empty() {
            let Size { width, height } = range.min;
            format!("{format} of {width}x{height} to {}x{}", range.max.width, range.max.height)
        } else {
            format!("{format} of {sizes}")
        }
    });
    described.collect::<Vec<_>>().join(", ")
}

fn names(formats: &[PixelFormat]) -> String {
    formats.iter().map(PixelFormat::to_string).collect::<Vec<_>>().join(" or ")
}

/// Sets rate, exposure and gain.
///
/// A fixed exposure or gain switches the automatic control off; the other one then
/// stays as it is. As with other cameras, a configured value for which the camera
/// has no control is refused, and a rate that cannot be set is a warning.
///
/// # Errors
/// When the camera has no such control, or libcamera refuses a value.
pub fn set_controls(
    camera: &Camera<'_>,
    capture: &Capture,
    controls: &mut ControlList,
) -> Result<()> {
    // One by one: the count that libcamera 0.4 gives includes controls that it does not list.
    let knows =
        |control: ControlId| camera.controls().into_iter().any(|(id, _)| id == control as u32);
    let name = camera.id();
    let frame_us = (1e6 / f64::from(capture.rate_hz)).round() as i64;
    if knows(ControlId::FrameDurationLimits) {
        controls.set(FrameDurationLimits([frame_us; 2])).context("capture.rate_hz")?;
    } else {
        log::warn!(
            "camera {name}: it does not let its rate be set: capture.rate_hz is not checked"
        );
    }
    let fixed = capture.exposure_us.is_some() || capture.gain.is_some();
    if fixed && knows(ControlId::AeEnable) {
        controls.set(AeEnable(false)).context("automatic exposure")?;
    }
    let remedy = "leave it out to let the camera choose";
    if let Some(exposure_us) = capture.exposure_us {
        ensure!(
            knows(ControlId::ExposureTime),
            "capture.exposure_us: {exposure_us} cannot be set, the camera {name} has no control of \
             the exposure; {remedy}"
        );
        // No longer than a frame, which is a second at most.
        controls.set(ExposureTime(exposure_us as i32)).context("capture.exposure_us")?;
    }
    if let Some(gain) = capture.gain {
        ensure!(
            knows(ControlId::AnalogueGain),
            "capture.gain: {gain} cannot be set, the camera {name} has no control of the gain; \
             {remedy}"
        );
        controls.set(AnalogueGain(gain)).context("capture.gain")?;
    }
    Ok(())
}
