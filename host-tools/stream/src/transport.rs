//! Where packets come from: datagrams, or a serial line that may vanish and
//! come back.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use plumbline::packet::{
    DELIMITER, Deframer, FRAME_BYTES_MAX, Hello, Message, PACKET_BYTES_MAX, Packet, PacketError,
    decode_datagram, encode_datagram, encode_frame,
};
use plumbline_files::BadInput;

use crate::others::is_same_box;
use crate::text;

/// The longest wait for bytes, so that Ctrl-C is noticed.
pub const WAIT: Duration = Duration::from_millis(100);

/// Another sender is listened to when the one before has been silent for this long.
const SENDER_SILENCE: Duration = Duration::from_secs(3);

/// The first wait before a lost serial line is opened again; each further one
/// is twice as long.
const REOPEN_WAIT_MIN: Duration = Duration::from_millis(250);

/// The longest wait before a lost serial line is opened again.
const REOPEN_WAIT_MAX: Duration = Duration::from_secs(4);

/// Bytes as they came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Raw {
    /// A datagram.
    Datagram(Vec<u8>),
    /// What a serial line brought up to and with a delimiter; of a longer run than any frame, its
    /// beginning.
    Frame(Vec<u8>),
}

impl Raw {
    /// The packet in it. The deframer has to see all frames of the line, in their order.
    ///
    /// # Errors
    /// When there is none.
    pub fn decode(&self, deframer: &mut Deframer) -> Result<Packet, PacketError> {
        let outcome = match self {
            Self::Datagram(bytes) => decode_datagram(bytes),
            Self::Frame(bytes) => {
                let outcome = bytes.iter().filter_map(|byte| deframer.feed(*byte)).last();
                outcome.unwrap_or(Err(PacketError::Fragment))
            }
        };
        outcome.map(text::printable)
    }
}

/// What came in.
#[derive(Debug)]
pub enum Event {
    /// The bytes as they came; the next event says what they hold.
    Raw(Raw),
    /// A packet.
    Packet(Packet),
    /// Bytes that are no packet, and why.
    Bad(PacketError),
    /// A packet from another address, while the first one is sending: of another box, or of the
    /// same one after another start.
    OtherSender {
        /// Where it comes from.
        from: SocketAddr,
        /// What came.
        packet: Packet,
    },
    /// The serial line is lost, and is waited for.
    LineLost(String),
    /// The serial line is back.
    LineBack,
}

impl Event {
    /// The event for decoded bytes.
    #[must_use]
    pub fn of(outcome: Result<Packet, PacketError>) -> Self {
        match outcome {
            Ok(packet) => Self::Packet(packet),
            Err(error) => Self::Bad(error),
        }
    }
}

/// A source of packets.
pub trait Transport {
    /// Waits for at most [`WAIT`], and hands over what came.
    ///
    /// # Errors
    /// When the source cannot be used any more.
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput>;

    /// Sends a message to the box, if its address is known. One that does
    /// not get through is not worth an error: the box repeats what matters.
    fn send(&mut self, message: &Message);

    /// While held, no other box takes the place of the one that is listened to, however
    /// long that is silent.
    fn hold(&mut self, is_held: bool);
}

/// The box that is listened to.
struct Sender {
    address: SocketAddr,
    heard: Instant,
    /// Its latest Hello.
    hello: Option<Hello>,
}

impl Sender {
    /// Whether this is the same box after another start: it keeps its name and its address, and
    /// its port is another one.
    fn is_anew(&self, from: SocketAddr, message: Option<&Message>) -> bool {
        let (Some(Message::Hello(hello)), Some(known)) = (message, &self.hello) else {
            return false;
        };
        from.ip() == self.address.ip()
            && is_same_box(known, hello)
            && known.boot_id != hello.boot_id
    }
}

/// Datagrams to one port.
pub struct Udp {
    socket: UdpSocket,
    sender: Option<Sender>,
    /// The sender's address before it restarted: what still comes from there is another box
    /// of the same name.
    former: Option<SocketAddr>,
    is_held: bool,
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
        Ok(Self {
            socket,
            sender: None,
            former: None,
            is_held: false,
            buffer: Box::new([0; 65_536]),
        })
    }

    /// The address listened at.
    ///
    /// # Errors
    /// When the operating system cannot say.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// True when a packet from this address counts: two boxes must not be mixed into one recording,
    /// even if both are programs of one computer.
    fn accepts(&mut self, from: SocketAddr, message: Option<&Message>, now: Instant) -> bool {
        let hello = match message {
            Some(Message::Hello(hello)) => Some(hello),
            _ => None,
        };
        match &mut self.sender {
            Some(sender) if sender.address == from => {
                sender.heard = now;
                if let Some(hello) = hello {
                    sender.hello = Some(hello.clone());
                }
                return true;
            }
            Some(sender) => {
                let is_silent = now.duration_since(sender.heard) >= SENDER_SILENCE;
                let is_anew = self.former != Some(from) && sender.is_anew(from, message);
                if self.is_held || !(is_silent || is_anew) {
                    return false;
                }
                self.former = is_anew.then_some(sender.address);
            }
            None => {}
        }
        self.sender = Some(Sender { address: from, heard: now, hello: hello.cloned() });
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
        let outcome = decode_datagram(&self.buffer[..length]).map(text::printable);
        // Only a box may claim the port: a stray datagram must not lock it out.
        let is_box = outcome.as_ref().is_ok_and(|packet| packet.start.is_some());
        let is_known = self.sender.as_ref().is_some_and(|sender| sender.address == from);
        let message = outcome.as_ref().ok().map(|packet| &packet.message);
        let is_followed = !(is_box || is_known) || self.accepts(from, message, Instant::now());
        take(Event::Raw(Raw::Datagram(self.buffer[..length].to_vec())));
        take(match outcome {
            Ok(packet) if !is_followed => Event::OtherSender { from, packet },
            outcome => Event::of(outcome),
        });
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        if let Some(sender) = &self.sender
            && let Ok(datagram) = encode_datagram(None, message, &mut [0; PACKET_BYTES_MAX])
        {
            let _ = self.socket.send_to(datagram, sender.address);
        }
    }

    fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
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
    /// The bytes since the last delimiter.
    raw: Vec<u8>,
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
        Ok(Self { open, line, deframer: Deframer::new(), raw: Vec::new(), reopen })
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
            self.raw.clear();
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
                // Bytes show that a line works; that it could be opened does not.
                self.reopen.1 = REOPEN_WAIT_MIN;
                for &byte in &buffer[..length] {
                    // One byte more than a frame has shows that this is none, and without
                    // its delimiter it would spoil the next.
                    if byte == DELIMITER || self.raw.len() <= FRAME_BYTES_MAX {
                        self.raw.push(byte);
                    }
                    let outcome = self.deframer.feed(byte);
                    if byte == DELIMITER {
                        let raw = std::mem::take(&mut self.raw);
                        // An idle line carries only delimiters.
                        if let Some(outcome) = outcome {
                            take(Event::Raw(Raw::Frame(raw)));
                            take(Event::of(outcome.map(text::printable)));
                        }
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
        take(Event::LineLost(lost));
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        if let Some(line) = &mut self.line
            && let Ok(frame) = encode_frame(None, message, &mut [0; FRAME_BYTES_MAX])
        {
            let _ = line.write_all(frame);
        }
    }

    /// A line has one box at its other end.
    fn hold(&mut self, _is_held: bool) {}
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
