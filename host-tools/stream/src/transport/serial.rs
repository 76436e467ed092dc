//! Frames on a serial line, which may vanish and come back.

use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use plumbline::packet::{Deframer, PROTOCOL_VERSION, PacketError, frame_packet};
use plumbline::seal::{Peer, SEALED_FRAME_BYTES_MAX};
use plumbline_files::BadInput;

use super::{Arrived, Carrier, WAIT};

/// The first wait before a lost serial line is opened again; each further one
/// is twice as long.
const REOPEN_WAIT_MIN: Duration = Duration::from_millis(250);

/// The longest wait before a lost serial line is opened again.
const REOPEN_WAIT_MAX: Duration = Duration::from_secs(4);

/// Both directions of a serial line.
pub trait Line: Read + Write + Send {}
impl<T: Read + Write + Send + ?Sized> Line for T {}

/// Opens a line; its reads end after [`WAIT`] with a time-out.
pub type Opener = Box<dyn FnMut() -> std::io::Result<Box<dyn Line>>>;

/// Frames on a serial line.
pub struct Serial {
    open: Opener,
    line: Option<Box<dyn Line>>,
    deframer: Deframer<SEALED_FRAME_BYTES_MAX>,
    /// When to try the lost line again, and how long to wait after that.
    reopen: (Instant, Duration),
}

impl Serial {
    /// Opens a serial device.
    ///
    /// # Errors
    /// When there is no such device, or it cannot be used.
    pub fn open(path: &str, baud: u32) -> Result<Self, BadInput> {
        let builder = serialport::new(path, baud).timeout(WAIT);
        let opener: Opener = Box::new(move || {
            let port = builder.clone().open().map_err(std::io::Error::from)?;
            Ok(Box::new(port) as Box<dyn Line>)
        });
        Self::new(opener).map_err(|error| cannot_open(path, &error))
    }

    /// A line that `open` opens, at first and whenever it was lost.
    ///
    /// # Errors
    /// The errors of `open`, the first time.
    pub fn new(mut open: Opener) -> std::io::Result<Self> {
        let line = Some(open()?);
        let reopen = (Instant::now(), REOPEN_WAIT_MIN);
        Ok(Self { open, line, deframer: Deframer::new(), reopen })
    }

    fn try_again(&mut self) -> Option<Arrived<'static>> {
        let (at, wait) = self.reopen;
        let remaining = at.saturating_duration_since(Instant::now());
        if !remaining.is_zero() {
            std::thread::sleep(remaining.min(WAIT));
            return None;
        }
        if let Ok(line) = (self.open)() {
            self.line = Some(line);
            self.deframer.restart();
            return Some(Arrived::LineBack);
        }
        self.reopen = (Instant::now() + wait, (2 * wait).min(REOPEN_WAIT_MAX));
        None
    }
}

impl Carrier for Serial {
    /// The line's own time limit is the longest wait.
    fn poll(&mut self, _: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        let Some(line) = &mut self.line else {
            if let Some(event) = self.try_again() {
                take(event);
            }
            return Ok(());
        };
        let mut buffer = [0; 1024];
        let lost = match line.read(&mut buffer) {
            Ok(0) => "the device is gone".to_owned(),
            Ok(length) => {
                // Bytes show that a line works; that it could be opened does not.
                self.reopen.1 = REOPEN_WAIT_MIN;
                for &byte in &buffer[..length] {
                    let is_whole = self.deframer.is_synchronised();
                    match self.deframer.frame(byte) {
                        // The end of a frame may begin with any byte.
                        Some(Ok([first, ..])) if !is_whole && *first != PROTOCOL_VERSION => {
                            take(Arrived::Bad(PacketError::Fragment));
                        }
                        Some(Ok(bytes)) => take(Arrived::Packet { from: Peer::Serial, bytes }),
                        Some(Err(error)) => take(Arrived::Bad(error)),
                        None => {}
                    }
                }
                return Ok(());
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
                ) =>
            {
                return Ok(());
            }
            Err(error) => error.to_string(),
        };
        self.line = None;
        let (_, wait) = self.reopen;
        self.reopen = (Instant::now() + wait, (2 * wait).min(REOPEN_WAIT_MAX));
        take(Arrived::LineLost(lost));
        Ok(())
    }

    fn send(&mut self, _: Peer, packet: &[u8]) {
        if let Some(line) = &mut self.line
            && let Ok(frame) = frame_packet(packet, &mut [0; SEALED_FRAME_BYTES_MAX])
        {
            let _ = line.write_all(frame);
        }
    }

    fn only_peer(&self) -> Option<Peer> {
        Some(Peer::Serial)
    }

    fn dropped_here(&self) -> Option<u64> {
        None
    }
}

fn cannot_open(path: &str, error: &std::io::Error) -> BadInput {
    // serialport puts some causes into the text only.
    let text = error.to_string();
    if error.kind() == ErrorKind::PermissionDenied || text.contains("ermission denied") {
        return BadInput::whole(
            path,
            "permission denied",
            "join the group that may use serial devices (sudo usermod -aG dialout $USER) \
             and log in again",
        );
    }
    if text.contains("busy") {
        return BadInput::whole(
            path,
            "another program uses the device",
            "close that program, such as a terminal or another plumb receive",
        );
    }
    if error.kind() == ErrorKind::NotFound || text.contains("No such") {
        let ports: Vec<_> = serialport::available_ports()
            .unwrap_or_default()
            .into_iter()
            .map(|port| port.port_name)
            .collect();
        let remedy = if ports.is_empty() {
            "this computer has no serial device now: check the cable".to_owned()
        } else {
            format!("check the cable, or use one of {}", ports.join(", "))
        };
        return BadInput::whole(path, "there is no such device", remedy);
    }
    BadInput::whole(path, text.to_lowercase(), "give a serial device, such as /dev/ttyUSB0")
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    /// A line that says these bytes, and nothing more.
    struct Says(VecDeque<u8>);

    impl Read for Says {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            if self.0.is_empty() { Err(ErrorKind::TimedOut.into()) } else { self.0.read(buffer) }
        }
    }

    impl Write for Says {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// What comes of these bytes, from the beginning of listening.
    fn heard(bytes: &[u8]) -> Vec<Result<Vec<u8>, PacketError>> {
        let mut line = Some(Box::new(Says(bytes.iter().copied().collect())) as Box<dyn Line>);
        let open = Box::new(move || line.take().ok_or_else(|| ErrorKind::NotFound.into()));
        let mut serial = Serial::new(open).unwrap();
        let mut heard = Vec::new();
        let mut take = |arrived: Arrived<'_>| match arrived {
            Arrived::Packet { bytes, .. } => heard.push(Ok(bytes.to_vec())),
            Arrived::Bad(error) => heard.push(Err(error)),
            Arrived::LineLost(_) | Arrived::LineBack => unreachable!("it stays"),
        };
        serial.poll(WAIT, &mut take).unwrap();
        heard
    }

    #[test]
    fn the_end_of_a_frame_is_not_taken_for_a_packet_of_another_version() {
        let (ours, other) = ([PROTOCOL_VERSION, 7], [PROTOCOL_VERSION + 1, 7]);
        let frame = |packet: [u8; 2]| [3, packet[0], packet[1], 0];
        // What a frame's end decodes to if a byte in its middle says so, and a whole packet.
        let bytes = [frame(other), frame(ours), frame(other)].concat();
        let (ours, other) = (Ok(ours.to_vec()), Ok(other.to_vec()));
        assert_eq!(heard(&bytes), [Err(PacketError::Fragment), ours.clone(), other]);
        // A line on which nothing was said before is heard from its first packet.
        assert_eq!(heard(&bytes[4..8]), [ours]);
    }
}
