//! When a modem line of a serial device is asserted: a switch, a stimulator or a treadmill pulls it.
//!
//! In: a device and one of its lines. Out: the time of each assertion, by this computer's clock, with
//! how uncertain it is.
//!
//! Where the driver tells of changes (TIOCMIWAIT, with TIOCGICOUNT to count them), a thread waits for
//! them; elsewhere it asks again and again, and does not see what is shorter than the time between two
//! questions. An adapter on USB is itself asked at times of its own, so that it tells late: that adds
//! to the uncertainty.
//!
//! ```text
//! calls     the kernel's calls                   follower  which changes are assertions, and when
//! adapter   how late an adapter tells of them
//! ```

mod adapter;
mod calls;
mod follower;

use std::fmt;
use std::fs::File;
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc::{O_NOCTTY, O_NONBLOCK};

use adapter::Adapter;
use follower::{Follower, Seen};

/// How often a driver is asked that does not tell of changes.
const ASK_EVERY: Duration = Duration::from_micros(500);

/// How often a line is looked at until nothing changes meanwhile.
const LOOKS_MAX: u32 = 8;

/// One of the lines by which a device tells its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// Clear to send.
    Cts,
    /// Data set ready.
    Dsr,
    /// Data carrier detect.
    Dcd,
    /// Ring indicator.
    Ri,
}

impl Line {
    const ALL: [Self; 4] = [Self::Cts, Self::Dsr, Self::Dcd, Self::Ri];

    /// Its usual abbreviation, in small letters.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Cts => "cts",
            Self::Dsr => "dsr",
            Self::Dcd => "dcd",
            Self::Ri => "ri",
        }
    }
}

/// A modem line of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModemLine {
    device: String,
    line: Line,
}

/// Why a line cannot be watched.
#[derive(Debug)]
pub enum Error {
    /// The device cannot be opened or set up.
    Device(io::Error),
    /// The device has no modem lines; the kernel's words for it.
    NoLines(&'static str),
    /// A modem on USB (of the class CDC ACM) does not tell of "clear to send".
    NoCts,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device(error) => write!(f, "{error}"),
            Self::NoLines(words) => write!(f, "it has no modem lines ({words})"),
            Self::NoCts => f.write_str("it is a modem on USB, which has no line cts"),
        }
    }
}

impl std::error::Error for Error {}

/// The line is asserted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asserted {
    /// When it was.
    pub at: Instant,
    /// It was at most this much earlier or later.
    pub uncertain: Duration,
}

/// A line that is being watched.
#[derive(Debug, Clone)]
pub struct Watch {
    port: Arc<File>,
    line: Line,
    missed: Arc<AtomicU64>,
}

impl Watch {
    /// The number of assertions that were not told of: another one came so soon after each that its
    /// time is not known.
    #[must_use]
    pub fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }

    /// Whether the device has gone, so that nothing more comes.
    #[must_use]
    pub fn is_gone(&self) -> bool {
        calls::is_on(&self.port, self.line).is_err()
    }
}

impl ModemLine {
    /// Parses `DEVICE[:LINE]`.
    ///
    /// # Errors
    /// The text says what to give instead.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wanted = || {
            "give DEVICE or DEVICE:LINE, such as /dev/ttyUSB0:dsr; the lines are cts, dsr, dcd and ri"
                .to_owned()
        };
        let (device, line) = match text.rsplit_once(':') {
            None => (text, Line::Cts),
            Some((device, word)) => {
                let named = |line: &Line| line.word().eq_ignore_ascii_case(word);
                (device, Line::ALL.into_iter().find(named).ok_or_else(wanted)?)
            }
        };
        if device.is_empty() {
            return Err(wanted());
        }
        Ok(Self { device: device.to_owned(), line })
    }

    /// The device's name in the file system.
    #[must_use]
    pub fn device(&self) -> &str {
        &self.device
    }

    /// The line.
    #[must_use]
    pub fn line(&self) -> Line {
        self.line
    }

    /// Calls `take` each time the line is asserted, until it answers false or the device has gone. A
    /// line that is asserted already counts from the next time on.
    ///
    /// The thread that waits for changes may outlast a device that has gone, where the driver wakes
    /// nobody; [`Watch::is_gone`] is right nevertheless.
    ///
    /// # Errors
    /// When the device cannot be opened, or has no such line.
    pub fn watch(
        &self,
        mut take: impl FnMut(Asserted) -> bool + Send + 'static,
    ) -> Result<Watch, Error> {
        let port = File::options()
            .read(true)
            .write(true)
            .custom_flags(O_NOCTTY | O_NONBLOCK)
            .open(&self.device)
            .map_err(Error::Device)?;
        let line = self.line;
        let is_on = calls::is_on(&port, line).map_err(|error| Error::NoLines(error.desc()))?;
        calls::stay_open(&port).map_err(|error| Error::Device(error.into()))?;
        let adapter = Adapter::of(&port);
        if adapter.is_cdc_acm && line == Line::Cts {
            return Err(Error::NoCts);
        }
        let watch = Watch { port: Arc::new(port), line, missed: Arc::default() };
        let (port, missed) = (Arc::clone(&watch.port), Arc::clone(&watch.missed));
        thread::spawn(move || {
            let mut tell = |seen: Seen| {
                missed.fetch_add(seen.missed, Ordering::Relaxed);
                take(Asserted { at: seen.at, uncertain: seen.uncertain + adapter.late })
            };
            match calls::changes(&port, line) {
                Ok(changes) => {
                    let follower = Follower::new(is_on, changes, Instant::now());
                    wait(&port, line, follower, adapter.late, &mut tell);
                }
                Err(_) => ask(&port, line, Follower::new(is_on, 0, Instant::now()), &mut tell),
            }
        });
        Ok(watch)
    }
}

/// Waits for changes; asks, if the driver cannot be waited for.
fn wait(
    port: &File,
    line: Line,
    mut follower: Follower,
    late: Duration,
    tell: &mut impl FnMut(Seen) -> bool,
) {
    let mut now = Instant::now();
    loop {
        // Until nothing has changed: a change before the next wait does not end that.
        loop {
            match calls::changes(port, line) {
                Err(_) => return,
                Ok(changes) if changes == follower.changes() => break,
                Ok(_) => {}
            }
            let Ok((is_on, changes)) = look(port, line, &follower, late) else { return };
            if follower.woken(is_on, changes, now).is_some_and(|seen| !tell(seen)) {
                return;
            }
            now = Instant::now();
        }
        match calls::wait(port, line) {
            Ok(()) | Err(Errno::EINTR) => now = Instant::now(),
            Err(Errno::EIO | Errno::ENODEV | Errno::ENXIO) => return,
            Err(_) => return ask(port, line, follower, tell),
        }
    }
}

/// How the line is, and how often it has changed until then.
fn look(port: &File, line: Line, follower: &Follower, late: Duration) -> nix::Result<(bool, u32)> {
    let mut has_settled = false;
    for _ in 0..LOOKS_MAX {
        let changes = calls::changes(port, line)?;
        let is_on = calls::is_on(port, line)?;
        if calls::changes(port, line)? != changes {
            continue;
        }
        if has_settled || follower.agrees(is_on, changes) {
            return Ok((is_on, changes));
        }
        // Some drivers ask the adapter how the line is, and count its change when it tells of it.
        thread::sleep(late + ASK_EVERY);
        has_settled = true;
    }
    // It changes all the time.
    Ok((calls::is_on(port, line)?, calls::changes(port, line)?))
}

fn ask(port: &File, line: Line, mut follower: Follower, tell: &mut impl FnMut(Seen) -> bool) {
    while let Ok(is_on) = calls::is_on(port, line) {
        if follower.asked(is_on, Instant::now()).is_some_and(|seen| !tell(seen)) {
            return;
        }
        thread::sleep(ASK_EVERY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_may_have_a_line() {
        let of = |text| ModemLine::parse(text).map(|it| (it.device, it.line));
        assert_eq!(of("/dev/ttyUSB1"), Ok(("/dev/ttyUSB1".to_owned(), Line::Cts)));
        assert_eq!(of("/dev/ttyUSB1:DCD"), Ok(("/dev/ttyUSB1".to_owned(), Line::Dcd)));
        for wrong in ["", ":ri", "/dev/ttyUSB1:9600", "/dev/ttyUSB1:"] {
            assert!(of(wrong).unwrap_err().contains("cts, dsr, dcd and ri"), "{wrong}");
        }
    }

    /// A pseudo-terminal has none, as the kernel itself says.
    #[test]
    fn a_device_without_modem_lines_is_refused() {
        let refused = |device: &str| ModemLine::parse(device).unwrap().watch(|_| true).unwrap_err();
        assert!(matches!(refused("/dev/no-such-port"), Error::Device(_)));
        for device in ["/dev/ptmx", "/dev/null"] {
            assert!(matches!(refused(device), Error::NoLines(_)), "{device}");
        }
    }
}
