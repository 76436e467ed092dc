//! The calls into the kernel's video driver, typed and checked.
//!
//! Input: requests as the kernel's own structs. Output: what the driver answered,
//! or the system's error.
//!
//! The crate `v4l` opens and closes the device, defines the structs and request
//! numbers, and handles rates, sizes and control values. But its layer above the
//! raw calls unwraps text and codes that come from the camera (names that are not
//! UTF-8, colour spaces and control types that are newer than the crate), so that
//! a camera could crash the box. Therefore capabilities, formats and control
//! ranges are queried here. So is the stream: the crate's own queues only one
//! buffer after a manual start, and after a timeout gives out a buffer that the
//! driver owns.

// Requests to a driver are untyped pointers; each is paired with its struct once.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::io;
use std::marker::PhantomData;
use std::os::fd::{AsRawFd, BorrowedFd, RawFd};
use std::time::Duration;

use v4l::v4l_sys::{
    V4L2_EVENT_SOURCE_CHANGE, V4L2_IN_CAP_DV_TIMINGS, v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE,
    v4l2_buffer, v4l2_capability, v4l2_dv_timings, v4l2_event_subscription, v4l2_fmtdesc,
    v4l2_format, v4l2_input, v4l2_memory_V4L2_MEMORY_MMAP, v4l2_pix_format, v4l2_query_ext_ctrl,
    v4l2_requestbuffers,
};
use v4l::v4l2::{self, vidioc};
use v4l::{Device, FourCC};

use super::super::stamp::Now;
use super::intake::{Dequeued, Queue, Wake};
use super::mapping::Mapping;

/// The largest number of formats that is read, in case a driver's list never ends.
const FORMATS_MAX: u32 = 256;

const CAPTURE: u32 = v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
const MAPPED: u32 = v4l2_memory_V4L2_MEMORY_MMAP;

/// The number of a request, and the struct that it reads and writes.
struct Request<T> {
    number: vidioc::_IOC_TYPE,
    argument: PhantomData<T>,
}

impl<T> Request<T> {
    const fn new(number: vidioc::_IOC_TYPE) -> Self {
        Self { number, argument: PhantomData }
    }

    /// The number of a request that the crate does not list, by the kernel's
    /// rule: direction, size of the struct, the letter V, serial number.
    const fn numbered(direction: u32, serial: u32) -> Self {
        let size = size_of::<T>() as u32;
        Self::new(((direction << 30) | (size << 16) | ((b'V' as u32) << 8) | serial) as _)
    }
}

const WRITE: u32 = 1;
const READ: u32 = 2;

const QUERYCAP: Request<v4l2_capability> = Request::new(vidioc::VIDIOC_QUERYCAP);
const ENUM_FMT: Request<v4l2_fmtdesc> = Request::new(vidioc::VIDIOC_ENUM_FMT);
const S_FMT: Request<v4l2_format> = Request::new(vidioc::VIDIOC_S_FMT);
const G_INPUT: Request<c_int> = Request::new(vidioc::VIDIOC_G_INPUT);
const ENUMINPUT: Request<v4l2_input> = Request::new(vidioc::VIDIOC_ENUMINPUT);
const QUERY_DV_TIMINGS: Request<v4l2_dv_timings> = Request::numbered(READ, 99);
const S_DV_TIMINGS: Request<v4l2_dv_timings> = Request::numbered(READ | WRITE, 87);
const SUBSCRIBE_EVENT: Request<v4l2_event_subscription> = Request::numbered(WRITE, 90);
const QUERY_EXT_CTRL: Request<v4l2_query_ext_ctrl> = Request::new(vidioc::VIDIOC_QUERY_EXT_CTRL);
const REQBUFS: Request<v4l2_requestbuffers> = Request::new(vidioc::VIDIOC_REQBUFS);
const QUERYBUF: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_QUERYBUF);
const QBUF: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_QBUF);
const DQBUF: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_DQBUF);
const STREAMON: Request<c_int> = Request::new(vidioc::VIDIOC_STREAMON);
const STREAMOFF: Request<c_int> = Request::new(vidioc::VIDIOC_STREAMOFF);

/// An argument with every field 0.
fn zeroed<T>(_: &Request<T>) -> T {
    // SAFETY: the requests above name C structs of integers, arrays, unions and
    // raw pointers only, for all of which zero is a value.
    unsafe { std::mem::zeroed() }
}

/// An open video device.
pub struct Driver {
    device: Device,
}

impl std::fmt::Debug for Driver {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Driver").field("fd", &self.device.handle().fd()).finish()
    }
}

impl AsRawFd for Driver {
    fn as_raw_fd(&self) -> RawFd {
        self.device.handle().fd()
    }
}

impl Driver {
    /// Opens the device in non-blocking mode.
    pub fn open(path: &str) -> io::Result<Self> {
        // The crate panics on a path with a NUL, which may come from the
        // configuration.
        if path.contains('\0') {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        Ok(Self { device: Device::with_path(path)? })
    }

    /// The crate's layer for rates, sizes and control values.
    pub fn device(&self) -> &Device {
        &self.device
    }

    fn call<T>(&self, request: &Request<T>, argument: &mut T) -> io::Result<()> {
        let argument = std::ptr::from_mut(argument).cast();
        // SAFETY: the number belongs to this struct (the constants above), and
        // the kernel reads and writes no more than that struct. The pointers
        // within (planes of a buffer) are followed only for kinds of buffers
        // that this module never asks for.
        unsafe { v4l2::ioctl(self.as_raw_fd(), request.number, argument) }
    }

    /// The device's capabilities: the bits `V4L2_CAP_*`.
    pub fn capabilities(&self) -> io::Result<u32> {
        let mut capability = zeroed(&QUERYCAP);
        self.call(&QUERYCAP, &mut capability)?;
        Ok(capability.device_caps)
    }

    /// The formats in which the device captures.
    pub fn formats(&self) -> Vec<FourCC> {
        let format = |index| {
            let mut description = v4l2_fmtdesc { index, type_: CAPTURE, ..zeroed(&ENUM_FMT) };
            self.call(&ENUM_FMT, &mut description).ok()?;
            Some(FourCC::from(description.pixelformat))
        };
        (0..FORMATS_MAX).map_while(format).collect()
    }

    /// Asks for a format; returns the one that the driver chose.
    pub fn set_format(&self, asked: v4l2_pix_format) -> io::Result<v4l2_pix_format> {
        let mut format = v4l2_format { type_: CAPTURE, ..zeroed(&S_FMT) };
        format.fmt.pix = asked;
        self.call(&S_FMT, &mut format)?;
        // SAFETY: for this type of buffer the driver fills in this field, and
        // any bytes are a value of it.
        Ok(unsafe { format.fmt.pix })
    }

    /// Whether the device takes its size and rate from a video signal (HDMI).
    pub fn follows_signal(&self) -> bool {
        let mut index = 0;
        if self.call(&G_INPUT, &mut index).is_err() {
            return false;
        }
        let mut input = v4l2_input { index: index.cast_unsigned(), ..zeroed(&ENUMINPUT) };
        self.call(&ENUMINPUT, &mut input).is_ok()
            && input.capabilities & V4L2_IN_CAP_DV_TIMINGS != 0
    }

    /// The timings of the signal at the input.
    pub fn signal_timings(&self) -> io::Result<v4l2_dv_timings> {
        let mut timings = zeroed(&QUERY_DV_TIMINGS);
        self.call(&QUERY_DV_TIMINGS, &mut timings)?;
        Ok(timings)
    }

    /// Sets the input to these timings.
    pub fn set_timings(&self, mut timings: v4l2_dv_timings) -> io::Result<()> {
        self.call(&S_DV_TIMINGS, &mut timings)
    }

    /// From now on a wait ends when the signal at the input changes.
    pub fn watch_signal(&self) -> io::Result<()> {
        let mut subscription =
            v4l2_event_subscription { type_: V4L2_EVENT_SOURCE_CHANGE, ..zeroed(&SUBSCRIBE_EVENT) };
        self.call(&SUBSCRIBE_EVENT, &mut subscription)
    }

    /// A control's range and flags.
    pub fn query_control(&self, id: u32) -> io::Result<v4l2_query_ext_ctrl> {
        let mut control = v4l2_query_ext_ctrl { id, ..zeroed(&QUERY_EXT_CTRL) };
        self.call(&QUERY_EXT_CTRL, &mut control)?;
        Ok(control)
    }

    /// Asks for `count` buffers, 0 to free them; returns how many there are.
    pub fn request_buffers(&self, count: u32) -> io::Result<u32> {
        let mut request =
            v4l2_requestbuffers { count, type_: CAPTURE, memory: MAPPED, ..zeroed(&REQBUFS) };
        self.call(&REQBUFS, &mut request)?;
        Ok(request.count)
    }

    /// Maps the memory of a buffer.
    pub fn map(&self, index: u32) -> io::Result<Mapping> {
        let mut buffer = self.buffer(index);
        self.call(&QUERYBUF, &mut buffer)?;
        // SAFETY: the driver has filled in this field for a buffer to be mapped,
        // and any bytes are a value of it.
        let offset = unsafe { buffer.m.offset };
        // SAFETY: the device stays open for as long as it is borrowed here.
        let device = unsafe { BorrowedFd::borrow_raw(self.as_raw_fd()) };
        Mapping::new(device, buffer.length as usize, offset)
    }

    fn buffer(&self, index: u32) -> v4l2_buffer {
        v4l2_buffer { index, type_: CAPTURE, memory: MAPPED, ..zeroed(&QBUF) }
    }

    /// Starts streaming.
    pub fn start(&self) -> io::Result<()> {
        self.call(&STREAMON, &mut CAPTURE.cast_signed())
    }

    /// Stops streaming; the driver then owns no buffer.
    pub fn stop(&self) -> io::Result<()> {
        self.call(&STREAMOFF, &mut CAPTURE.cast_signed())
    }
}

/// Stamps have 32 bits on some systems and 64 on others.
fn widened(value: impl Into<i64>) -> i64 {
    value.into()
}

impl Queue for Driver {
    fn queue(&self, index: u32) -> io::Result<()> {
        self.call(&QBUF, &mut self.buffer(index))
    }

    fn dequeue(&self) -> io::Result<Option<Dequeued>> {
        let mut buffer = self.buffer(0);
        match self.call(&DQBUF, &mut buffer) {
            Ok(()) => Ok(Some(Dequeued {
                index: buffer.index,
                bytes: buffer.bytesused as usize,
                flags: buffer.flags,
                sequence: buffer.sequence,
                stamp_s: widened(buffer.timestamp.tv_sec),
                stamp_us: widened(buffer.timestamp.tv_usec),
            })),
            Err(error) => match error.kind() {
                io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => Ok(None),
                _ => Err(error),
            },
        }
    }

    fn wait(&self, timeout: Duration) -> io::Result<Wake> {
        let timeout = libc::timespec {
            tv_sec: timeout.as_secs().try_into().unwrap_or(libc::time_t::MAX),
            tv_nsec: timeout.subsec_nanos() as _,
        };
        let mut poll =
            libc::pollfd { fd: self.as_raw_fd(), events: libc::POLLIN | libc::POLLPRI, revents: 0 };
        // SAFETY: one entry, and both pointers outlive the call.
        let ready = unsafe { libc::ppoll(&raw mut poll, 1, &raw const timeout, std::ptr::null()) };
        if ready < 0 {
            let error = io::Error::last_os_error();
            return match error.kind() {
                io::ErrorKind::Interrupted => Ok(Wake::Nothing),
                _ => Err(error),
            };
        }
        Ok(Wake::from_events(poll.revents))
    }

    fn now(&self) -> Now {
        Now::read()
    }
}
