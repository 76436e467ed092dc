//! The hardware watchdog: restarts the computer when no frame is processed,
//! unless the camera is known to be lost.
//!
//! ```text
//!            a frame              the camera is lost
//!   Stopped ─────────▶ Running ──────────────────────▶ Stopped
//!                      │     ▲
//!                      └─────┘ a frame feeds it, or a write that the card has finished
//! ```
//!
//! While something is stored no frames are processed, and a slow card may take longer for all of it
//! than the longest time without a frame. Each write that the card has finished therefore feeds the
//! watchdog, too; a card that finishes none restarts the computer. Nothing else feeds it: a loop that
//! runs without measuring is as bad as one that hangs. A lost camera is no fault of the computer, and a restart would not bring it
//! back, so the watchdog is then stopped.
//!
//! It is also stopped when the program ends normally. When the program ends in a panic
//! it keeps running, and restarts the computer.

// The kernel's ioctls are unsafe functions; each gets a pointer to an integer
// that lives through the call.
#![allow(unsafe_code)]

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::{AsRawFd, RawFd};
use std::path::Path;
use std::sync::atomic::{AtomicI32, Ordering};

use anyhow::{Context, Result};
use nix::libc::c_int;
use plumbline::config::Machine;
use plumbline::packet::ResetReason;

/// The computer's first watchdog.
const DEVICE: &str = "/dev/watchdog0";

/// From linux/watchdog.h: the watchdog has restarted the computer.
const WDIOF_CARDRESET: c_int = 0x20;
const WDIOS_DISABLECARD: c_int = 1;
const WDIOS_ENABLECARD: c_int = 2;

/// The kernel's calls, as linux/watchdog.h declares them.
mod ioctl {
    #![allow(missing_docs, reason = "the macros make the functions")]
    use nix::libc::c_int;

    nix::ioctl_read!(boot_status, b'W', 2, c_int);
    // Declared as a read, although it takes the options.
    nix::ioctl_read!(set_options, b'W', 4, c_int);
    nix::ioctl_read!(keep_alive, b'W', 5, c_int);
    nix::ioctl_readwrite!(set_timeout, b'W', 6, c_int);
}

/// No file.
const NONE: RawFd = -1;

/// The open device of the watchdog that is running, for [`written`].
static RUNNING: AtomicI32 = AtomicI32::new(NONE);

/// The card has finished a write: what is being stored comes along. Does nothing while no watchdog
/// is running.
pub fn written() {
    let device = RUNNING.load(Ordering::Relaxed);
    if device != NONE {
        keep_alive(device);
    }
}

fn keep_alive(device: RawFd) {
    let mut unused = 0;
    // SAFETY: `unused` outlives the call, which touches at most one integer.
    // A failure shows as a restart, which is the best that can be done about it.
    let _ = unsafe { ioctl::keep_alive(device, &raw mut unused) };
}

/// The computer's watchdog.
#[derive(Debug)]
pub struct Watchdog {
    device: File,
    reset_reason: ResetReason,
    running: bool,
}

impl Watchdog {
    /// The watchdog, if the configuration asks for it. A watchdog that cannot be opened is
    /// logged, and the measurement runs without it.
    #[must_use]
    pub fn of(machine: &Machine) -> Option<Self> {
        let opened = Self::open(machine.watchdog_s?);
        opened.inspect_err(|error| log::error!("machine.watchdog_s: {error:#}")).ok()
    }

    /// Opens the watchdog, sets the longest time without a frame, and leaves it stopped
    /// until the first one.
    ///
    /// # Errors
    /// When there is none, another program uses it, or it does not accept the time.
    pub fn open(seconds: u16) -> Result<Self> {
        Self::open_device(Path::new(DEVICE), seconds)
    }

    fn open_device(path: &Path, seconds: u16) -> Result<Self> {
        // Opening starts it; it is stopped below.
        let device = OpenOptions::new().write(true).open(path).with_context(|| {
            format!(
                "the watchdog {} cannot be opened: check that the computer has one, that its \
                 driver is loaded and that no other program uses it",
                path.display()
            )
        })?;
        let fd = device.as_raw_fd();
        let mut status = 0;
        // SAFETY: `status` outlives the call, which writes one integer.
        let reset_reason = match unsafe { ioctl::boot_status(fd, &raw mut status) } {
            Ok(_) if status & WDIOF_CARDRESET != 0 => ResetReason::Watchdog,
            Ok(_) => ResetReason::PowerOn,
            Err(_) => ResetReason::Unknown,
        };
        let mut watchdog = Self { device, reset_reason, running: true };
        let set = watchdog.set_timeout(seconds);
        watchdog.stop();
        set.with_context(|| path.display().to_string())?;
        if watchdog.running {
            log::warn!(
                "{} cannot be stopped, and will restart the computer whenever the camera is \
                 lost: load its driver without nowayout",
                path.display()
            );
        }
        Ok(watchdog)
    }

    /// The same watchdog for a session, stopped until the first frame, if the configuration asks for
    /// one; otherwise it is closed. One that does not accept the time is logged, and the measurement
    /// runs without it.
    #[must_use]
    pub fn kept_for(mut self, machine: &Machine) -> Option<Self> {
        let set = self.set_timeout(machine.watchdog_s?);
        self.stop();
        set.inspect_err(|error| log::error!("{error:#}")).ok().map(|()| self)
    }

    fn set_timeout(&mut self, seconds: u16) -> Result<()> {
        let mut granted = c_int::from(seconds);
        // SAFETY: `granted` outlives the call, which reads and writes one integer.
        unsafe { ioctl::set_timeout(self.device.as_raw_fd(), &raw mut granted) }.with_context(
            || format!("machine.watchdog_s: it does not accept {seconds} s: ask for less"),
        )?;
        if granted != c_int::from(seconds) {
            // Some hardware rounds; a much longer time is not what was asked for.
            log::warn!("the watchdog's timeout is {granted} s instead of {seconds} s");
        }
        Ok(())
    }

    /// Why the computer started.
    #[must_use]
    pub fn reset_reason(&self) -> ResetReason {
        self.reset_reason
    }

    /// A frame has been processed.
    pub fn feed(&mut self) {
        if !self.running {
            self.running = self.set(WDIOS_ENABLECARD);
            RUNNING.store(self.device.as_raw_fd(), Ordering::Relaxed);
        }
        keep_alive(self.device.as_raw_fd());
    }

    /// The camera is lost, so that there will be no frames for a while.
    pub fn stop(&mut self) {
        RUNNING.store(NONE, Ordering::Relaxed);
        if self.running {
            self.running = !self.set(WDIOS_DISABLECARD);
        }
    }

    fn set(&mut self, mut options: c_int) -> bool {
        // SAFETY: `options` outlives the call, which reads one integer.
        unsafe { ioctl::set_options(self.device.as_raw_fd(), &raw mut options) }.is_ok()
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        // The device is closed, and its number may become another file's.
        RUNNING.store(NONE, Ordering::Relaxed);
        if !std::thread::panicking() {
            self.stop();
            // This letter permits the kernel to stop it when the device is closed.
            let _ = self.device.write_all(b"V");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_is_not_a_watchdog_is_refused_by_name() {
        let absent = Watchdog::open_device(Path::new("/no/such/watchdog"), 10).unwrap_err();
        assert!(format!("{absent:#}").contains("/no/such/watchdog"), "{absent:#}");
        let other = Watchdog::open_device(Path::new("/dev/null"), 10).unwrap_err();
        assert!(format!("{other:#}").contains("machine.watchdog_s"), "{other:#}");
    }
}
