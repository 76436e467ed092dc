//! A port of Linux, whose driver may tell of changes.

use std::fs::File;
use std::os::unix::fs::OpenOptionsExt as _;
use std::thread;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc::{O_NOCTTY, O_NONBLOCK};

use super::adapter::Adapter;
use super::follower::{Follower, Seen};
use super::{ASK_EVERY, Error, Line, ask, calls};

/// How often a line is looked at until nothing changes meanwhile.
const LOOKS_MAX: u32 = 8;

/// An open device.
#[derive(Debug)]
pub(super) struct Port {
    file: File,
    adapter: Adapter,
}

impl Port {
    /// Opens a device; gives whether its line is asserted, too.
    pub(super) fn open(device: &str, line: Line) -> Result<(Self, bool), Error> {
        let file = File::options()
            .read(true)
            .write(true)
            .custom_flags(O_NOCTTY | O_NONBLOCK)
            .open(device)
            .map_err(Error::Device)?;
        let is_on = calls::is_on(&file, line).map_err(|error| Error::NoLines(error.desc()))?;
        calls::stay_open(&file).map_err(|error| Error::Device(error.into()))?;
        let adapter = Adapter::of(&file);
        if adapter.is_cdc_acm && line == Line::Cts {
            return Err(Error::NoCts);
        }
        Ok((Self { file, adapter }, is_on))
    }

    /// It tells of a change at most this much later.
    pub(super) fn late(&self) -> Duration {
        self.adapter.late
    }

    /// Whether the line is asserted.
    pub(super) fn is_on(&self, line: Line) -> nix::Result<bool> {
        calls::is_on(&self.file, line)
    }

    /// Tells of each assertion until the answer is false or the device has gone.
    pub(super) fn follow(&self, line: Line, is_on: bool, tell: &mut dyn FnMut(Seen) -> bool) {
        match calls::changes(&self.file, line) {
            Ok(changes) => wait(self, line, Follower::new(is_on, changes, Instant::now()), tell),
            Err(_) => ask(self, line, Follower::new(is_on, 0, Instant::now()), tell),
        }
    }
}

/// Waits for changes; asks, if the driver cannot be waited for.
fn wait(port: &Port, line: Line, mut follower: Follower, tell: &mut dyn FnMut(Seen) -> bool) {
    let file = &port.file;
    let mut now = Instant::now();
    loop {
        // Until nothing has changed: a change before the next wait does not end that.
        loop {
            match calls::changes(file, line) {
                Err(_) => return,
                Ok(changes) if changes == follower.changes() => break,
                Ok(_) => {}
            }
            let Ok((is_on, changes)) = look(port, line, &follower) else { return };
            if follower.woken(is_on, changes, now).is_some_and(|seen| !tell(seen)) {
                return;
            }
            now = Instant::now();
        }
        match calls::wait(file, line) {
            Ok(()) | Err(Errno::EINTR) => now = Instant::now(),
            Err(Errno::EIO | Errno::ENODEV | Errno::ENXIO) => return,
            Err(_) => return ask(port, line, follower, tell),
        }
    }
}

/// How the line is, and how often it has changed until then.
fn look(port: &Port, line: Line, follower: &Follower) -> nix::Result<(bool, u32)> {
    let file = &port.file;
    let mut has_settled = false;
    for _ in 0..LOOKS_MAX {
        let changes = calls::changes(file, line)?;
        let is_on = calls::is_on(file, line)?;
        if calls::changes(file, line)? != changes {
            continue;
        }
        if has_settled || follower.agrees(is_on, changes) {
            return Ok((is_on, changes));
        }
        // Some drivers ask the adapter how the line is, and count its change when it tells of it.
        thread::sleep(port.adapter.late + ASK_EVERY);
        has_settled = true;
    }
    // It changes all the time.
    Ok((calls::is_on(file, line)?, calls::changes(file, line)?))
}
