//! The kernel's calls for video devices (include/uapi/linux/videodev2.h), as far
//! as they are used here: structures with the fields that matter, and safe
//! functions around the calls; a device's registers; and a thread's priority.

#![allow(unsafe_code)] // none of these calls can be made otherwise; each use says why it is sound

use std::fs::File;
use std::io;
use std::num::NonZeroUsize;
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::ptr::NonNull;

use nix::sys::mman::{MapFlags, ProtFlags, mmap, munmap};

pub const BUFFER_TYPE_CAPTURE: u32 = 1;
pub const BUFFER_TYPE_OUTPUT: u32 = 2;
pub const FIELD_NONE: u32 = 1;
pub const MEMORY_MMAP: u32 = 1;
pub const NEXT_CONTROL: u32 = 0x8000_0000;
/// `V4L2_CID_GAIN`.
pub const GAIN: u32 = 0x0098_0913;

/// `struct v4l2_format` for pictures in one plane.
#[repr(C)]
pub struct Format {
    pub buffer_type: u32,
    pub padding: u32,
    pub width_px: u32,
    pub height_px: u32,
    pub fourcc: u32,
    pub field: u32,
    pub rest: [u32; 46],
}

/// `struct v4l2_dv_timings`: what an HDMI signal looks like.
#[repr(C, packed)]
pub struct Timings {
    pub kind: u32,
    pub width_px: u32,
    pub height_px: u32,
    pub interlaced: u32,
    pub polarities: u32,
    pub pixel_clock_hz: u64,
    pub horizontal_front_sync_back_px: [u32; 3],
    pub vertical_front_sync_back_px: [u32; 3],
    pub rest: [u32; 20],
}

/// `struct v4l2_queryctrl`.
#[repr(C)]
#[derive(Default)]
pub struct ControlQuery {
    pub id: u32,
    pub kind: u32,
    pub name: [u8; 32],
    pub minimum: i32,
    pub maximum: i32,
    pub step: i32,
    pub default: i32,
    pub flags: u32,
    pub reserved: [u32; 2],
}

/// `struct v4l2_control`.
#[repr(C)]
pub struct Control {
    pub id: u32,
    pub value: i32,
}

/// `struct v4l2_requestbuffers`.
#[repr(C)]
#[derive(Default)]
pub struct BufferRequest {
    pub count: u32,
    pub buffer_type: u32,
    pub memory: u32,
    pub rest: [u32; 2],
}

/// `struct v4l2_buffer`.
#[repr(C)]
#[derive(Default)]
pub struct Buffer {
    pub index: u32,
    pub buffer_type: u32,
    pub bytes_used: u32,
    pub flags: u32,
    pub field: u32,
    pub time: [u64; 2],
    pub time_code: [u32; 4],
    pub sequence: u32,
    pub memory: u32,
    pub offset: u64,
    pub length_bytes: u32,
    pub rest: [u32; 2],
}

// As on a 64-bit machine; the kernel refuses a call with another size.
const _: () = assert!(
    size_of::<Format>() == 208
        && size_of::<Timings>() == 132
        && size_of::<ControlQuery>() == 68
        && size_of::<Control>() == 8
        && size_of::<BufferRequest>() == 20
        && size_of::<Buffer>() == 88
);

mod calls {
    use super::{Buffer, BufferRequest, Control, ControlQuery, Format, Timings};

    nix::ioctl_readwrite!(set_format, b'V', 5, Format);
    nix::ioctl_readwrite!(request_buffers, b'V', 8, BufferRequest);
    nix::ioctl_readwrite!(query_buffer, b'V', 9, Buffer);
    nix::ioctl_readwrite!(queue_buffer, b'V', 15, Buffer);
    nix::ioctl_readwrite!(dequeue_buffer, b'V', 17, Buffer);
    nix::ioctl_write_ptr!(stream_on, b'V', 18, i32);
    nix::ioctl_readwrite!(get_control, b'V', 27, Control);
    nix::ioctl_readwrite!(set_control, b'V', 28, Control);
    nix::ioctl_readwrite!(query_control, b'V', 36, ControlQuery);
    nix::ioctl_readwrite!(set_timings, b'V', 87, Timings);
}

/// A safe function for each call that reads and writes one structure.
macro_rules! safe {
    ($($name:ident($structure:ty);)*) => {$(
        /// The call of this name.
        ///
        /// # Errors
        /// As the kernel reports them.
        pub fn $name(device: &File, argument: &mut $structure) -> io::Result<()> {
            // SAFETY: the kernel reads and writes one structure of this very type, whose size
            // is part of the call's number, and it is borrowed for that long. Every bit
            // pattern is a valid value: all its fields are integers.
            unsafe { calls::$name(device.as_raw_fd(), argument) }?;
            Ok(())
        }
    )*};
}

safe! {
    set_format(Format);
    request_buffers(BufferRequest);
    query_buffer(Buffer);
    queue_buffer(Buffer);
    dequeue_buffer(Buffer);
    get_control(Control);
    set_control(Control);
    query_control(ControlQuery);
    set_timings(Timings);
}

/// Starts a stream.
///
/// # Errors
/// As the kernel reports them.
pub fn stream_on(device: &File, buffer_type: u32) -> io::Result<()> {
    // SAFETY: the kernel reads one integer, which lives until the call is over.
    unsafe { calls::stream_on(device.as_raw_fd(), &(buffer_type as i32)) }?;
    Ok(())
}

/// Lets a thread have the processor before all others that have no real-time priority; 0 is the caller's.
///
/// # Errors
/// As the kernel reports them.
pub fn prefer(thread: u32) -> io::Result<()> {
    // SAFETY: the kernel takes three integers.
    let done = unsafe { nix::libc::setpriority(nix::libc::PRIO_PROCESS, thread, -20) };
    nix::errno::Errno::result(done)?;
    Ok(())
}

/// The registers of a device, a page of them, in this process's memory.
#[derive(Debug)]
pub struct Registers {
    start: NonNull<nix::libc::c_void>,
}

/// The number of bytes of a page.
const PAGE_BYTES: NonZeroUsize = NonZeroUsize::new(4096).expect("it is not 0");

impl Registers {
    /// Those at this physical address, the beginning of a page.
    ///
    /// # Errors
    /// As the kernel reports them: only root may do this, and only if the kernel's command line lets
    /// a program at what a driver uses.
    pub fn map(address: u64) -> io::Result<Self> {
        let memory = File::options()
            .read(true)
            .write(true)
            .custom_flags(nix::libc::O_SYNC)
            .open("/dev/mem")?;
        let access = ProtFlags::PROT_READ | ProtFlags::PROT_WRITE;
        // SAFETY: the kernel chooses the place, so that nothing of ours is replaced.
        let start = unsafe {
            mmap(None, PAGE_BYTES, access, MapFlags::MAP_SHARED, memory, address as i64)
        }?;
        Ok(Self { start })
    }

    /// Reads the byte at this offset.
    pub fn read(&self, offset: usize) -> u8 {
        assert!(offset < PAGE_BYTES.get());
        // SAFETY: the page is mapped for as long as `self` lives, and the byte lies in it.
        unsafe { self.start.as_ptr().cast::<u8>().add(offset).read_volatile() }
    }

    /// Writes the byte at this offset.
    pub fn write(&mut self, offset: usize, value: u8) {
        assert!(offset < PAGE_BYTES.get());
        // SAFETY: as above; what the device does with it is the point of the write.
        unsafe { self.start.as_ptr().cast::<u8>().add(offset).write_volatile(value) }
    }
}

impl Drop for Registers {
    fn drop(&mut self) {
        // SAFETY: this very page was mapped by `map`, and nothing refers to it any more.
        let _ = unsafe { munmap(self.start, PAGE_BYTES.get()) };
    }
}

/// A buffer of the driver's, in this process's memory.
#[derive(Debug)]
pub struct Mapping {
    start: NonNull<nix::libc::c_void>,
    length_bytes: usize,
}

impl Mapping {
    /// The buffer that [`query_buffer`] has described.
    ///
    /// # Errors
    /// As the kernel reports them; when the buffer has no bytes.
    pub fn new(device: &File, buffer: &Buffer) -> io::Result<Self> {
        let length_bytes = NonZeroUsize::new(buffer.length_bytes as usize)
            .ok_or_else(|| io::Error::other("a buffer of no bytes"))?;
        let access = ProtFlags::PROT_READ | ProtFlags::PROT_WRITE;
        // SAFETY: the kernel chooses the place, so that nothing of ours is replaced.
        let start = unsafe {
            mmap(None, length_bytes, access, MapFlags::MAP_SHARED, device, buffer.offset as i64)
        }?;
        Ok(Self { start, length_bytes: length_bytes.get() })
    }

    /// Its bytes.
    pub fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: the pages are mapped for as long as `self` lives, and `&mut self` makes this
        // the only reference. The driver reads them too, but only while the buffer is queued,
        // and a byte that it reads halfway through a change is a wrong pixel and no more.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr().cast(), self.length_bytes) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: these very pages were mapped by `new`, and no reference to them outlives self.
        let _ = unsafe { munmap(self.start, self.length_bytes) };
    }
}
