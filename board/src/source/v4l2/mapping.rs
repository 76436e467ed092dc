//! The memory of one of the driver's buffers, mapped into this process.

// Mapped memory is a raw pointer; this type bounds it and unmaps it.
#![allow(unsafe_code)]

use std::io;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::ptr::NonNull;
use std::slice;

use super::buffers::Ours;

/// One buffer's memory, read-only, unmapped when dropped.
#[derive(Debug)]
pub struct Mapping {
    start: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the memory belongs to this value alone and is not tied to a thread.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps `bytes` of a device's memory at `offset`.
    pub fn new(device: BorrowedFd<'_>, bytes: usize, offset: u32) -> io::Result<Self> {
        let offset = offset as libc::off_t;
        // SAFETY: a new mapping at an address of the kernel's choice touches no
        // memory that is in use.
        let start = unsafe {
            let fd = device.as_raw_fd();
            libc::mmap(std::ptr::null_mut(), bytes, libc::PROT_READ, libc::MAP_SHARED, fd, offset)
        };
        if start == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let start = NonNull::new(start.cast()).ok_or(io::ErrorKind::InvalidData)?;
        Ok(Self { start, bytes })
    }

    /// Its length.
    pub fn len_bytes(&self) -> usize {
        self.bytes
    }

    /// Its content. `_ours` must be the proof for this very buffer that it is ours,
    /// and therefore not written to by the driver.
    pub fn bytes<'a>(&'a self, _ours: &'a Ours) -> &'a [u8] {
        // SAFETY: mapped for this long, readable, unmapped only on drop, and
        // not written to while the buffer is ours.
        unsafe { slice::from_raw_parts(self.start.as_ptr(), self.bytes) }
    }

    /// The same as 16-bit words; an odd byte at the end is left out.
    pub fn words<'a>(&'a self, _ours: &'a Ours) -> &'a [u16] {
        // SAFETY: as above; a mapping starts at a page, which is aligned for
        // words, and any two bytes are a word.
        unsafe { slice::from_raw_parts(self.start.cast::<u16>().as_ptr(), self.bytes / 2) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new` with this length, and no borrow is left.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.bytes) };
    }
}
