//! vivid as a camera that sees what it is given: how its output device is
//! looped into its capture device, and how frames are played into it.

use std::fs::{self, File};
use std::io;
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::errno::Errno;

use crate::kernel::{self, Buffer, BufferRequest, Control, ControlQuery, Format, Mapping, Timings};

pub const WIDTH_PX: u32 = 1280;
pub const HEIGHT_PX: u32 = 720;

/// Bytes of a frame, one per pixel.
pub const FRAME_BYTES: usize = WIDTH_PX as usize * HEIGHT_PX as usize;

/// Two are with the driver, one being shown and one waiting. One is being filled. And one
/// rests: the capture side may still be copying what the output side has just handed back.
const BUFFERS: u32 = 4;

/// From one look for vivid's threads to the next: they start with the streams.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// 1280 x 720 as HDMI has it (CEA-861): at 24 frames per second (code 60), the slowest rate of this size,
/// so that an emulated machine keeps up, or at 60 (code 4).
fn timings(is_fast: bool) -> Timings {
    let (pixel_clock_hz, front_px) = if is_fast { (74_250_000, 110) } else { (59_400_000, 1760) };
    Timings {
        kind: 0,
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        interlaced: 0,
        polarities: 3,
        pixel_clock_hz,
        horizontal_front_sync_back_px: [front_px, 40, 220],
        vertical_front_sync_back_px: [5, 5, 20],
        rest: [0; 20],
    }
}

fn grey(buffer_type: u32) -> Format {
    Format {
        buffer_type,
        padding: 0,
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        fourcc: u32::from_le_bytes(*b"GREY"),
        field: kernel::FIELD_NONE,
        rest: [0; 46],
    }
}

/// Lets the calling thread, which plays the frames, have the processor before the programs that never rest.
///
/// # Errors
/// When the kernel refuses.
pub fn prefer_player() -> Result<()> {
    kernel::prefer(0).context("the player's priority")
}

/// The same for vivid's threads, for ever. A sensor needs no processor; what stands for it here does.
///
/// # Errors
/// When the kernel refuses.
pub fn prefer_vivid() -> Result<()> {
    loop {
        for process in fs::read_dir("/proc").context("/proc")?.flatten() {
            // What is not a process, or has ended meanwhile, has no name.
            let name = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
            if !name.starts_with("vivid-") {
                continue;
            }
            let number = process.file_name().to_string_lossy().parse().context("a process")?;
            match kernel::prefer(number) {
                Err(error) if error.raw_os_error() == Some(Errno::ESRCH as i32) => {}
                done => done.with_context(|| name.trim().to_owned())?,
            }
        }
        sleep(LOOK_EVERY);
    }
}

/// Makes the capture device see what is written to the output device, unchanged, 24 times a second, or 60
/// times.
///
/// # Errors
/// When vivid is not there, or not what it was.
pub fn connect(capture: &str, output: &str, is_fast: bool) -> Result<()> {
    for (path, buffer_type) in
        [(output, kernel::BUFFER_TYPE_OUTPUT), (capture, kernel::BUFFER_TYPE_CAPTURE)]
    {
        let device = open(path)?;
        kernel::set_timings(&device, &mut timings(is_fast))
            .with_context(|| format!("{path}: timings"))?;
        kernel::set_format(&device, &mut grey(buffer_type))
            .with_context(|| format!("{path}: format"))?;
    }
    let capture = open(capture)?;
    // The cable's other end: the test pattern, nothing, and last the output device.
    set(&capture, "HDMI 000-0 Is Connected To", |control| control.maximum)?;
    // Otherwise the driver writes the time into the picture.
    set(&capture, "OSD Text Mode", |control| control.maximum)
}

/// Presses vivid's button that pulls the plug.
///
/// # Errors
/// When there is no such button.
pub fn press_disconnect(capture: &str) -> Result<()> {
    set(&open(capture)?, "Disconnect", |_| 0)
}

fn open(path: &str) -> Result<File> {
    File::options().read(true).write(true).open(path).with_context(|| path.to_owned())
}

/// The gain that the camera has been set to, in hundredths. vivid has the control, and lets
/// it change nothing.
///
/// # Errors
/// When the camera is not there.
pub fn gain(capture: &str) -> Result<u32> {
    let mut control = Control { id: kernel::GAIN, value: 0 };
    kernel::get_control(&open(capture)?, &mut control).context("the gain")?;
    Ok(control.value.try_into()?)
}

/// Sets the control of this name; vivid's numbers are its own affair.
fn set(device: &File, name: &str, value: impl Fn(&ControlQuery) -> i32) -> Result<()> {
    let mut id = 0;
    // A device has a few dozen controls.
    for _ in 0..1000 {
        let mut query = ControlQuery { id: id | kernel::NEXT_CONTROL, ..ControlQuery::default() };
        if kernel::query_control(device, &mut query).is_err() {
            break;
        }
        if query.name.split(|byte| *byte == 0).next() == Some(name.as_bytes()) {
            let mut control = Control { id: query.id, value: value(&query) };
            return kernel::set_control(device, &mut control).context(name.to_owned());
        }
        id = query.id;
    }
    bail!("the camera has no control {name:?}")
}

/// Plays frames into the output device, each for as long as the signal's timings say.
pub struct Player {
    device: File,
    buffers: Vec<Mapping>,
    /// Frames played since the stream began.
    played: u32,
}

impl Player {
    /// Sets up the stream; the first frame starts it.
    ///
    /// # Errors
    /// As the kernel reports them.
    pub fn open(path: &str) -> io::Result<Self> {
        let device = File::options().read(true).write(true).open(path)?;
        let mut request = BufferRequest {
            count: BUFFERS,
            buffer_type: kernel::BUFFER_TYPE_OUTPUT,
            memory: kernel::MEMORY_MMAP,
            ..BufferRequest::default()
        };
        kernel::request_buffers(&device, &mut request)?;
        let mapping = |index| {
            let mut buffer = buffer(index);
            kernel::query_buffer(&device, &mut buffer)?;
            Mapping::new(&device, &buffer)
        };
        let buffers = (0..BUFFERS).map(mapping).collect::<io::Result<_>>()?;
        Ok(Self { device, buffers, played: 0 })
    }

    /// Fills a buffer and hands it to the driver; waits until fewer than two frames are
    /// before it.
    ///
    /// # Errors
    /// As the kernel or `fill` report them; `ENODEV` when the plug has been pulled.
    pub fn play(&mut self, fill: impl FnOnce(&mut [u8]) -> io::Result<()>) -> io::Result<()> {
        // The driver hands buffers back in the order in which it got them.
        if self.played >= 2 {
            kernel::dequeue_buffer(&self.device, &mut buffer(0))?;
        }
        let index = self.played % BUFFERS;
        fill(self.buffers[index as usize].bytes())?;
        let mut queued =
            Buffer { bytes_used: FRAME_BYTES as u32, field: kernel::FIELD_NONE, ..buffer(index) };
        kernel::queue_buffer(&self.device, &mut queued)?;
        if self.played == 0 {
            kernel::stream_on(&self.device, kernel::BUFFER_TYPE_OUTPUT)?;
        }
        self.played += 1;
        Ok(())
    }
}

fn buffer(index: u32) -> Buffer {
    Buffer {
        index,
        buffer_type: kernel::BUFFER_TYPE_OUTPUT,
        memory: kernel::MEMORY_MMAP,
        ..Buffer::default()
    }
}
