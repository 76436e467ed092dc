//! The kernel's calls for modem lines.

#![allow(unsafe_code)] // ioctl cannot be called otherwise; each use says why it is sound

use std::ffi::c_int;
use std::fs::File;
use std::os::fd::AsRawFd as _;

use nix::Result;
use nix::libc;
use nix::sys::termios::{ControlFlags, LocalFlags, SetArg, tcgetattr, tcsetattr};

use super::Line;

/// `struct serial_icounter_struct`: how often each line has changed, then what this needs no more.
#[repr(C)]
#[derive(Default)]
struct Counts {
    cts: c_int,
    dsr: c_int,
    ri: c_int,
    dcd: c_int,
    rest: [c_int; 16],
}

nix::ioctl_read_bad!(get_lines, libc::TIOCMGET, c_int);
nix::ioctl_read_bad!(get_counts, libc::TIOCGICOUNT, Counts);
nix::ioctl_write_int_bad!(wait_for_change, libc::TIOCMIWAIT);

fn bit(line: Line) -> c_int {
    match line {
        Line::Cts => libc::TIOCM_CTS,
        Line::Dsr => libc::TIOCM_DSR,
        Line::Dcd => libc::TIOCM_CAR,
        Line::Ri => libc::TIOCM_RNG,
    }
}

/// Whether a line is asserted.
///
/// # Errors
/// When the device has no modem lines, or has gone.
pub(super) fn is_on(port: &File, line: Line) -> Result<bool> {
    let mut lines = 0;
    // SAFETY: the kernel writes one integer, which is borrowed for that long.
    unsafe { get_lines(port.as_raw_fd(), &raw mut lines) }?;
    Ok(lines & bit(line) != 0)
}

/// Lets the device stay open whatever its lines do: without CLOCAL the kernel hangs up when "data
/// carrier detect" is released. What the device says is not sent back to it.
///
/// # Errors
/// When the device is no terminal, or has gone.
pub(super) fn stay_open(port: &File) -> Result<()> {
    let mut settings = tcgetattr(port)?;
    if settings.control_flags.contains(ControlFlags::CLOCAL)
        && !settings.local_flags.contains(LocalFlags::ECHO)
    {
        return Ok(());
    }
    settings.control_flags.insert(ControlFlags::CLOCAL);
    settings.local_flags.remove(LocalFlags::ECHO);
    tcsetattr(port, SetArg::TCSANOW, &settings)
}

/// How often a line has changed, since some time before; it begins anew after the largest number.
///
/// # Errors
/// When the driver does not count, or the device has gone.
pub(super) fn changes(port: &File, line: Line) -> Result<u32> {
    let mut counts = Counts::default();
    // SAFETY: the kernel writes one structure of this very type, 20 integers, any of which is valid.
    unsafe { get_counts(port.as_raw_fd(), &raw mut counts) }?;
    let count = match line {
        Line::Cts => counts.cts,
        Line::Dsr => counts.dsr,
        Line::Dcd => counts.dcd,
        Line::Ri => counts.ri,
    };
    Ok(count.cast_unsigned())
}

/// Waits until a line changes.
///
/// # Errors
/// When the driver does not tell of changes, the device has gone, or a signal came.
pub(super) fn wait(port: &File, line: Line) -> Result<()> {
    // SAFETY: the kernel takes an integer, and writes nothing.
    unsafe { wait_for_change(port.as_raw_fd(), bit(line)) }.map(drop)
}
