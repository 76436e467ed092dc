//! What vivid must be told, by way of the kernel's calls for video devices.
//!
//! The structures are the kernel's own (include/uapi/linux/videodev2.h), with
//! only those fields named that are used here.

#![allow(unsafe_code)] // ioctl is unsafe by nature: see `ioctl`

use std::fs::File;
use std::os::fd::AsRawFd;

use anyhow::{Context, Result, bail};

/// Width of the frames.
pub const WIDTH_PX: u32 = 1280;

/// Height of the frames.
pub const HEIGHT_PX: u32 = 720;

const GREY: u32 = u32::from_le_bytes(*b"GREY");
const BUFFER_TYPE_VIDEO_CAPTURE: u32 = 1;
const BUFFER_TYPE_VIDEO_OUTPUT: u32 = 2;
const FIELD_NONE: u32 = 1;
const NEXT_CONTROL: u32 = 0x8000_0000;

/// `struct v4l2_format` for a video device with one plane.
#[repr(C)]
struct Format {
    buffer_type: u32,
    padding: u32,
    width_px: u32,
    height_px: u32,
    fourcc: u32,
    field: u32,
    rest: [u32; 46],
}

/// `struct v4l2_dv_timings`: what an HDMI signal looks like.
#[repr(C, packed)]
struct Timings {
    kind: u32,
    width_px: u32,
    height_px: u32,
    interlaced: u32,
    polarities: u32,
    pixel_clock_hz: u64,
    horizontal_front_sync_back: [u32; 3],
    vertical_front_sync_back: [u32; 3],
    rest: [u32; 20],
}

/// `struct v4l2_queryctrl`.
#[repr(C)]
#[derive(Default)]
struct ControlQuery {
    id: u32,
    kind: u32,
    name: [u8; 32],
    minimum: i32,
    maximum: i32,
    step: i32,
    default: i32,
    flags: u32,
    reserved: [u32; 2],
}

/// `struct v4l2_control`.
#[repr(C)]
struct Control {
    id: u32,
    value: i32,
}

// As the kernel has them on a 64-bit machine; a request with another size is refused.
const _: () = assert!(
    size_of::<Format>() == 208
        && size_of::<Timings>() == 132
        && size_of::<ControlQuery>() == 68
        && size_of::<Control>() == 8
);

/// A call that reads and writes a `T`.
struct Call<T> {
    number: u8,
    name: &'static str,
    argument: std::marker::PhantomData<T>,
}

impl<T> Call<T> {
    const fn new(number: u8, name: &'static str) -> Self {
        Self { number, name, argument: std::marker::PhantomData }
    }
}

const S_FMT: Call<Format> = Call::new(5, "VIDIOC_S_FMT");
const S_CTRL: Call<Control> = Call::new(28, "VIDIOC_S_CTRL");
const QUERYCTRL: Call<ControlQuery> = Call::new(36, "VIDIOC_QUERYCTRL");
const S_DV_TIMINGS: Call<Timings> = Call::new(87, "VIDIOC_S_DV_TIMINGS");

fn ioctl<T>(device: &File, call: &Call<T>, argument: &mut T) -> Result<()> {
    // As _IOWR('V', number, T): both directions, size, type, number.
    let request =
        (3_u32 << 30) | ((size_of::<T>() as u32) << 16) | (0x56 << 8) | u32::from(call.number);
    // SAFETY: the request says how many bytes the kernel reads and writes: those of a `T`, which
    // is borrowed for as long as the call lasts. Every bit pattern is a valid `T`: only integers.
    let result =
        unsafe { libc::ioctl(device.as_raw_fd(), request as _, std::ptr::from_mut(argument)) };
    if result < 0 {
        return Err(std::io::Error::last_os_error()).context(call.name);
    }
    Ok(())
}

/// 1280 x 720 at 24 frames per second, as HDMI has it (CEA-861, code 60): the slowest rate
/// of this size, so that an emulated machine keeps up.
fn timings() -> Timings {
    Timings {
        kind: 0,
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        interlaced: 0,
        polarities: 3,
        pixel_clock_hz: 59_400_000,
        horizontal_front_sync_back: [1760, 40, 220],
        vertical_front_sync_back: [5, 5, 20],
        rest: [0; 20],
    }
}

fn grey(buffer_type: u32) -> Format {
    Format {
        buffer_type,
        padding: 0,
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        fourcc: GREY,
        field: FIELD_NONE,
        rest: [0; 46],
    }
}

/// Makes the capture device see what is written to the output device, unchanged.
///
/// # Errors
/// When vivid is not there, or not what it was.
pub fn connect(capture: &str, output: &str) -> Result<()> {
    for (path, buffer_type) in
        [(output, BUFFER_TYPE_VIDEO_OUTPUT), (capture, BUFFER_TYPE_VIDEO_CAPTURE)]
    {
        let device = open(path)?;
        ioctl(&device, &S_DV_TIMINGS, &mut timings()).context(path.to_owned())?;
        ioctl(&device, &S_FMT, &mut grey(buffer_type)).context(path.to_owned())?;
    }
    let capture = open(capture)?;
    // The cable: none, the test pattern, and last the output device.
    let cable = control(&capture, "HDMI 000-0 Is Connected To")?;
    set(&capture, cable.id, cable.maximum)?;
    // Otherwise the driver writes the time of day into the picture.
    let overlay = control(&capture, "OSD Text Mode")?;
    set(&capture, overlay.id, overlay.maximum)
}

/// Presses vivid's button that pulls the plug.
///
/// # Errors
/// When there is no such button.
pub fn press_disconnect(capture: &str) -> Result<()> {
    let capture = open(capture)?;
    let button = control(&capture, "Disconnect")?;
    set(&capture, button.id, 0)
}

fn open(path: &str) -> Result<File> {
    File::options().read(true).write(true).open(path).with_context(|| path.to_owned())
}

fn set(device: &File, id: u32, value: i32) -> Result<()> {
    ioctl(device, &S_CTRL, &mut Control { id, value })
}

/// The control of this name; vivid's numbers are its own affair.
fn control(device: &File, name: &str) -> Result<ControlQuery> {
    let mut id = 0;
    // A device has a few dozen controls.
    for _ in 0..1000 {
        let mut query = ControlQuery { id: id | NEXT_CONTROL, ..ControlQuery::default() };
        if ioctl(device, &QUERYCTRL, &mut query).is_err() {
            break;
        }
        if query.name.split(|byte| *byte == 0).next() == Some(name.as_bytes()) {
            return Ok(query);
        }
        id = query.id;
    }
    bail!("the camera has no control {name:?}")
}
