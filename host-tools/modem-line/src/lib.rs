//! When a modem line of a serial device is asserted: a switch, a stimulator or a treadmill pulls it.
//!
//! In: a device and one of its lines. Out: the time of each assertion, by this computer's clock, with
//! how uncertain it is.
//!
//! Where the driver tells of changes (TIOCMIWAIT, with TIOCGICOUNT to count them), a thread waits for
//! them; elsewhere it asks again and again, and does not see what is shorter than the time between two
//! questions. An adapter on USB is itself asked at times of its own, so that it tells late: that adds
//! to the uncertainty. All of this is Linux; on other systems every line is asked again and again.
//!
//! ```text
//! linux     waits for changes, or asks           follower  which changes are assertions, and when
//! calls     the kernel's calls                   asked     ports of other systems, which are asked
//! adapter   how late an adapter tells of them
//! ```

#[cfg(target_os = "linux")]
mod adapter;
#[cfg(not(target_os = "linux"))]
mod asked;
#[cfg(target_os = "linux")]
mod calls;
// What counts changes is for Linux alone.
#[cfg_attr(not(target_os = "linux"), allow(dead_code))]
mod follower;
#[cfg(target_os = "linux")]
mod linux;

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

#[cfg(not(target_os = "linux"))]
use asked::Port;
use follower::{Follower, Seen};
#[cfg(target_os = "linux")]
use linux::Port;

/// How often a driver is asked that does not tell of changes.
const ASK_EVERY: Duration = Duration::from_micros(500);

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
    port: Arc<Port>,
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
        self.port.is_on(self.line).is_err()
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
        let line = self.line;
        let (port, is_on) = Port::open(&self.device, line)?;
        let watch = Watch { port: Arc::new(port), line, missed: Arc::default() };
        let (port, missed) = (Arc::clone(&watch.port), Arc::clone(&watch.missed));
        thread::spawn(move || {
            let late = port.late();
            port.follow(line, is_on, &mut |seen: Seen| {
                missed.fetch_add(seen.missed, Ordering::Relaxed);
                take(Asserted { at: seen.at, uncertain: seen.uncertain + late })
            });
        });
        Ok(watch)
    }
}

/// Asks again and again, until nobody wants to be told any more or the device has gone.
fn ask(port: &Port, line: Line, mut follower: Follower, tell: &mut dyn FnMut(Seen) -> bool) {
    while let Ok(is_on) = port.is_on(line) {
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
