//! Where packets come from: datagrams, or a serial line that may vanish and
//! come back.

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use plumbline::packet::{
    Deframer, FRAME_BYTES_MAX, Message, PACKET_BYTES_MAX, PacketError, decode_datagram,
    encode_datagram, encode_frame,
};

use crate::error::BadInput;

/// A wait for bytes ends at least this often, so that Ctrl-C is heard.
pub const WAIT: Duration = Duration::from_millis(100);

/// Another sender is listened to when the one before has been silent for this long.
const SENDER_SILENCE: Duration = Duration::from_secs(3);

/// The first wait before a lost serial line is opened again; each further one
/// is twice as long.
const REOPEN_WAIT_MIN: Duration = Duration::from_millis(250);

/// The longest wait before a lost serial line is opened again.
const REOPEN_WAIT_MAX: Duration = Duration::from_secs(4);

/// What came in.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "it is handed on at once and never stored")]
pub enum Event {
    /// A message.
    Message(Message),
    /// Bytes that are none, and why.
    Bad(PacketError),
    /// A datagram of another box, while the first one is sending.
    OtherSender(IpAddr),
    /// The serial line is gone; it is being waited for.
    LineLost(String),
    /// The serial line is back.
    LineBack,
}

/// A source of packets.
pub trait Transport {
    /// Waits for at most [`WAIT`], and hands over what came.
    ///
    /// # Errors
    /// When the source cannot be used any more.
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput>;

    /// Sends a message to the box, if the way to it is known. One that does
    /// not get through is not worth an error: the box repeats what matters.
    fn send(&mut self, message: &Message);
}

/// Datagrams to one port.
pub struct Udp {
    socket: UdpSocket,
    sender: Option<(SocketAddr, Instant)>,
    buffer: Box<[u8; 65_536]>,
}

impl Udp {
    /// Listens at an address such as `0.0.0.0:4210`.
    ///
    /// # Errors
    /// When the address cannot be listened at.
    pub fn bind(address: SocketAddr) -> Result<Self, BadInput> {
        let place = format!("UDP {address}");
        let socket = UdpSocket::bind(address).map_err(|error| match error.kind() {
            ErrorKind::AddrInUse => BadInput::whole(
                &place,
                "another program listens there, perhaps another plumb receive",
                "stop that program, or choose another port here and on the box",
            ),
            ErrorKind::AddrNotAvailable => BadInput::whole(
                &place,
                "this computer does not have that address",
                format!("listen at all of its addresses: 0.0.0.0:{}", address.port()),
            ),
            ErrorKind::PermissionDenied => BadInput::whole(
                &place,
                "ports below 1024 are reserved",
                "choose a port of 1024 or above, here and on the box",
            ),
            _ => BadInput::io(&place, &error),
        })?;
        Self::new(socket).map_err(|error| BadInput::io(&place, &error))
    }

    /// Listens on a socket.
    ///
    /// # Errors
    /// When the socket takes no time-out.
    pub fn new(socket: UdpSocket) -> std::io::Result<Self> {
        socket.set_read_timeout(Some(WAIT))?;
        Ok(Self { socket, sender: None, buffer: Box::new([0; 65_536]) })
    }

    /// The address listened at.
    ///
    /// # Errors
    /// When the operating system does not tell.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// True when a packet from there counts. A box that starts anew keeps its
    /// address but not its port; two boxes must not be mixed into one recording.
    fn accepts(&mut self, from: SocketAddr, now: Instant) -> bool {
        if let Some((sender, last)) = self.sender
            && sender.ip() != from.ip()
            && now.duration_since(last) < SENDER_SILENCE
        {
            return false;
        }
        self.sender = Some((from, now));
        true
    }
}

impl Transport for Udp {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        let (length, from) = match self.socket.recv_from(&mut self.buffer[..]) {
            Ok(received) => received,
            // A time-out, or the echo of a command that nobody took.
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock
                        | ErrorKind::TimedOut
                        | ErrorKind::Interrupted
                        | ErrorKind::ConnectionRefused
                        | ErrorKind::ConnectionReset
                ) =>
            {
                return Ok(());
            }
            Err(error) => return Err(BadInput::io("UDP", &error)),
        };
        let outcome = decode_datagram(&self.buffer[..length]);
        // Only a box may claim the port: a stray datagram must not lock it out.
        let is_box = outcome.is_ok();
        let known = self.sender.is_some_and(|(sender, _)| sender.ip() == from.ip());
        if (is_box || known) && !self.accepts(from, Instant::now()) {
            take(Event::OtherSender(from.ip()));
            return Ok(());
        }
        take(match outcome {
            Ok(message) => Event::Message(message),
            Err(error) => Event::Bad(error),
        });
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        if let Some((sender, _)) = self.sender
            && let Ok(datagram) = encode_datagram(message, &mut [0; PACKET_BYTES_MAX])
        {
            let _ = self.socket.send_to(datagram, sender);
        }
    }
}

/// Both directions of a serial line.
pub trait Line: Read + Write + Send {}
impl<T: Read + Write + Send + ?Sized> Line for T {}

/// Opens a line; its reads end after [`WAIT`] with a time-out.
pub type Opener = Box<dyn FnMut() -> std::io::Result<Box<dyn Line>>>;

/// Frames on a serial line.
pub struct Serial {
    open: Opener,
    line: Option<Box<dyn Line>>,
    deframer: Deframer<FRAME_BYTES_MAX>,
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

    /// A line that `open` gives, at first and whenever it was lost.
    ///
    /// # Errors
    /// Those of `open`, the first time.
    pub fn new(mut open: Opener) -> std::io::Result<Self> {
        let line = Some(open()?);
        let reopen = (Instant::now(), REOPEN_WAIT_MIN);
        Ok(Self { open, line, deframer: Deframer::new(), reopen })
    }

    fn try_again(&mut self) -> Option<Event> {
        let (at, wait) = self.reopen;
        let remaining = at.saturating_duration_since(Instant::now());
        if !remaining.is_zero() {
            std::thread::sleep(remaining.min(WAIT));
            return None;
        }
        if let Ok(line) = (self.open)() {
            self.line = Some(line);
            self.deframer.restart();
            return Some(Event::LineBack);
        }
        self.reopen = (Instant::now() + wait, (2 * wait).min(REOPEN_WAIT_MAX));
        None
    }
}

impl Transport for Serial {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
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
                // Only bytes show that a line is good, not that it could be opened.
                self.reopen.1 = REOPEN_WAIT_MIN;
                self.deframer.push(&buffer[..length], |outcome| {
                    take(match outcome {
                        Ok(message) => Event::Message(message),
                        Err(error) => Event::Bad(error),
                    });
                });
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
        take(Event::LineLost(lost));
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        if let Some(line) = &mut self.line
            && let Ok(frame) = encode_frame(message, &mut [0; FRAME_BYTES_MAX])
        {
            let _ = line.write_all(frame);
        }
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
