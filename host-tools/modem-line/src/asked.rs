//! A port of a system that does not tell of changes.

use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::follower::{Follower, Seen};
use super::{Error, Line, ask};

/// An adapter on USB tells at most this much later: these systems do not say how often it is asked,
/// and this is what the slowest of the usual ones, FTDI's, is set to.
const LATE: Duration = Duration::from_millis(16);

/// Any speed will do: no byte is read or written.
const BAUD: u32 = 9600;

/// An open device.
pub(super) struct Port(Mutex<Box<dyn SerialPort>>);

impl std::fmt::Debug for Port {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Port")
    }
}

impl Port {
    /// Opens a device; gives whether its line is asserted, too.
    pub(super) fn open(device: &str, line: Line) -> Result<(Self, bool), Error> {
        let port = serialport::new(device, BAUD).open();
        let port = Self(Mutex::new(port.map_err(|error| Error::Device(error.into()))?));
        let is_on = port.is_on(line).map_err(Error::Device)?;
        Ok((port, is_on))
    }

    /// It tells of a change at most this much later.
    pub(super) fn late(&self) -> Duration {
        LATE
    }

    /// Whether the line is asserted.
    pub(super) fn is_on(&self, line: Line) -> io::Result<bool> {
        let mut port = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_on = match line {
            Line::Cts => port.read_clear_to_send(),
            Line::Dsr => port.read_data_set_ready(),
            Line::Dcd => port.read_carrier_detect(),
            Line::Ri => port.read_ring_indicator(),
        };
        Ok(is_on?)
    }

    /// Tells of each assertion until the answer is false or the device has gone.
    pub(super) fn follow(&self, line: Line, is_on: bool, tell: &mut dyn FnMut(Seen) -> bool) {
        ask(self, line, Follower::new(is_on, 0, Instant::now()), tell);
    }
}
