//! Marks from a modem line of a serial device: a switch, a stimulator or a treadmill pulls it.
//!
//! Where the driver tells of changes (TIOCMIWAIT, with TIOCGICOUNT to count them), a thread waits for
//! them; elsewhere it asks again and again. Either way a mark says how uncertain its time is.
//!
//! ```text
//! calls     the kernel's calls        follower   which changes are marks, and when
//! ```

mod calls;
mod follower;

use std::fs::File;
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc::{O_NOCTTY, O_NONBLOCK};
use plumbline_files::BadInput;
use plumbline_trial::mark::{Mark, MarkSender, Source};

use follower::{Follower, Seen};

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

/// What is to be told of a line at the end.
#[derive(Debug, Clone, Default)]
pub struct Watch(Arc<AtomicU64>);

impl Watch {
    /// Marks that came so soon after another one that their time is not known, and did not count.
    #[must_use]
    pub fn missed(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
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

    /// Sends a mark each time the line is asserted.
    ///
    /// # Errors
    /// When the device cannot be opened, or has no modem lines.
    pub fn watch(&self, sender: &MarkSender) -> Result<Watch, BadInput> {
        let place = || format!("--mark-line {}", self.device);
        let port = File::options()
            .read(true)
            .write(true)
            .custom_flags(O_NOCTTY | O_NONBLOCK)
            .open(&self.device)
            .map_err(|error| BadInput::io(place(), &error))?;
        let is_on = calls::is_on(&port, self.line).map_err(|error| {
            BadInput::whole(
                place(),
                format!("it has no modem lines ({})", error.desc()),
                "name a serial port, or an adapter that has them",
            )
        })?;
        let watch = Watch::default();
        let (sender, missed, line) = (sender.clone(), Arc::clone(&watch.0), self.line);
        thread::spawn(move || {
            let mut follower = Follower::new(line, is_on, Instant::now());
            let mark = |seen: Option<Seen>| {
                let Some(Seen { at, uncertain, missed: further }) = seen else { return true };
                missed.fetch_add(further, Ordering::Relaxed);
                let uncertain_us = u32::try_from(uncertain.as_micros()).unwrap_or(u32::MAX);
                sender.send(at, Mark::new(Source::Line, line.word()).uncertain_by(uncertain_us))
            };
            // Either ends with the recording, or when the device has gone.
            if calls::changes(&port, line).is_ok() {
                wait(&port, line, &mut follower, &mark);
            } else {
                ask(&port, line, &mut follower, &mark);
            }
        });
        Ok(watch)
    }
}

/// Waits for changes; asks, if the driver cannot be waited for.
fn wait(port: &File, line: Line, follower: &mut Follower, mark: &impl Fn(Option<Seen>) -> bool) {
    loop {
        match calls::wait(port, line) {
            Ok(()) | Err(Errno::EINTR) => {}
            Err(Errno::EIO | Errno::ENODEV | Errno::ENXIO) => return,
            Err(_) => return ask(port, line, follower, mark),
        }
        let now = Instant::now();
        let (Ok(changes), Ok(is_on)) = (calls::changes(port, line), calls::is_on(port, line))
        else {
            return;
        };
        if !mark(follower.woken(is_on, changes, now)) {
            return;
        }
    }
}

fn ask(port: &File, line: Line, follower: &mut Follower, mark: &impl Fn(Option<Seen>) -> bool) {
    while let Ok(is_on) = calls::is_on(port, line) {
        if !mark(follower.asked(is_on, Instant::now())) {
            return;
        }
        thread::sleep(ASK_EVERY);
    }
}

#[cfg(test)]
mod tests {
    use plumbline_trial::mark::channel;

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
    fn a_device_without_modem_lines_is_named() {
        let (sender, _marks) = channel();
        let refused = |device: &str| {
            let line = ModemLine { device: device.to_owned(), line: Line::Cts };
            line.watch(&sender).unwrap_err().to_string()
        };
        assert!(refused("/dev/no-such-port").contains("--mark-line /dev/no-such-port"));
        for device in ["/dev/ptmx", "/dev/null"] {
            let error = refused(device);
            assert!(error.contains("has no modem lines") && error.contains(device), "{error}");
        }
    }
}
