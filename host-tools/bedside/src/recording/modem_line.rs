//! Marks from a modem line of a serial device.

use plumbline_files::BadInput;
use plumbline_modem_line::{Asserted, Error};
use plumbline_trial::mark::{Mark, MarkSender, Source};

pub use plumbline_modem_line::{ModemLine, Watch};

/// Sends a mark, named after the line, each time the line is asserted, until the recording has ended
/// or the device has gone.
///
/// # Errors
/// When the device cannot be opened, or has no such line.
pub fn watch(line: &ModemLine, sender: &MarkSender) -> Result<Watch, BadInput> {
    let (sender, word) = (sender.clone(), line.line().word());
    let mark = move |Asserted { at, uncertain }: Asserted| {
        let uncertain_us = u32::try_from(uncertain.as_nanos().div_ceil(1000)).unwrap_or(u32::MAX);
        sender.send(at, Mark::new(Source::Line, word).uncertain_by(uncertain_us))
    };
    line.watch(mark).map_err(|error| {
        let place = format!("--mark-line {}", line.device());
        let remedy = match &error {
            Error::Device(error) => return BadInput::io(place, error),
            Error::NoLines(_) => "name a serial port, or an adapter that has them",
            Error::NoCts => "wire the device to another line, and give DEVICE:dsr, :dcd or :ri",
        };
        BadInput::whole(place, error, remedy)
    })
}

#[cfg(test)]
mod tests {
    use plumbline_trial::mark::channel;

    use super::*;

    /// A pseudo-terminal has no modem lines, as the kernel itself says.
    #[test]
    fn a_device_without_modem_lines_is_named() {
        let (sender, _marks) = channel();
        let refused = |device: &str| {
            watch(&ModemLine::parse(device).unwrap(), &sender).unwrap_err().to_string()
        };
        assert!(refused("/dev/no-such-port").contains("--mark-line /dev/no-such-port"));
        for device in ["/dev/ptmx", "/dev/null"] {
            let error = refused(device);
            assert!(error.contains("has no modem lines") && error.contains(device), "{error}");
        }
    }
}
