//! A frame buffer, mapped into this program's memory.
//!
//! The `libcamera` crate's own mapping allocates a list of planes at each access,
//! so this one is used instead: made once per buffer, when the camera is opened,
//! of the first plane only. It holds its own reference to the
//! memory and outlives libcamera's.

// Mapping memory that a device writes to, and synchronising its caches with the
// device, takes system calls that the compiler cannot check.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, BorrowedFd, RawFd};

use memmap2::{Mmap, MmapOptions};

/// How often an interrupted system call is tried, at most.
const ATTEMPTS_MAX: usize = 8;

/// Flags of the kernel's `struct dma_buf_sync`, whose only field they are.
const READ: u64 = 1;
const END: u64 = 1 << 2;

/// One plane of a buffer, mapped for reading.
pub struct Mapping {
    memory: Mmap,
    buffer: File,
}

impl Mapping {
    /// Maps `length_bytes` of a buffer.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn new(fd: RawFd, offset_bytes: usize, length_bytes: usize) -> io::Result<Self> {
        // SAFETY: the descriptor belongs to a frame buffer that the caller holds,
        // and is borrowed only for being duplicated.
        let buffer = File::from(unsafe { BorrowedFd::borrow_raw(fd) }.try_clone_to_owned()?);
        // SAFETY: the memory keeps its size, and the device writes to it only
        // while its request is queued; `bytes` is read only in between.
        let memory = unsafe {
            MmapOptions::new().offset(offset_bytes as u64).len(length_bytes).map(&buffer)?
        };
        Ok(Self { memory, buffer })
    }

    /// The bytes, valid between [`begin_read`](Self::begin_read) and
    /// [`end_read`](Self::end_read).
    pub fn bytes(&self) -> &[u8] {
        &self.memory
    }

    /// Makes what the device has written visible to the processor.
    pub fn begin_read(&self) {
        self.sync(READ);
    }

    /// Gives the memory back to the device.
    pub fn end_read(&self) {
        self.sync(READ | END);
    }

    /// Memory that is not a DMA buffer refuses this, and does not need it.
    fn sync(&self, flags: u64) {
        let request = libc::_IOW::<u64>(u32::from(b'b'), 0);
        for _ in 0..ATTEMPTS_MAX {
            // SAFETY: the descriptor is open, and the argument is what this
            // request reads: one 64-bit word of flags.
            let result = unsafe { libc::ioctl(self.buffer.as_raw_fd(), request, &raw const flags) };
            if result == 0 || io::Error::last_os_error().kind() != io::ErrorKind::Interrupted {
                return;
            }
        }
    }
}
