//! Datagrams.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use plumbline::seal::Peer;
use plumbline_files::BadInput;

use super::{Arrived, Carrier};

/// The datagrams that are handed over at once at most, so that a flood does not keep this program
/// from everything else.
const AT_ONCE_MAX: usize = 512;

/// The buffer that the system is asked for: some 10,000 packets.
const BUFFER_BYTES: usize = 4 << 20;

/// The longest datagram that is looked at whole; the rest of a longer one is no packet.
const DATAGRAM_BYTES_MAX: usize = 2048;

/// A datagram that came to another socket of this program: from where, and its bytes.
pub type HeardElsewhere = (SocketAddr, Vec<u8>);

/// Datagrams to one port.
pub struct Udp {
    socket: UdpSocket,
    wait: Duration,
    elsewhere: Option<Receiver<HeardElsewhere>>,
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
        // The system gives less if it must; what it drops then is asked for again.
        let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(BUFFER_BYTES);
        let wait = super::WAIT;
        socket.set_read_timeout(Some(wait))?;
        Ok(Self { socket, wait, elsewhere: None })
    }

    /// With what comes to another socket of this program and is handed on: the announcements of a box
    /// that starts anew, at another port than before.
    #[must_use]
    pub fn hearing(self, elsewhere: Receiver<HeardElsewhere>) -> Self {
        Self { elsewhere: Some(elsewhere), ..self }
    }

    /// The address listened at.
    ///
    /// # Errors
    /// When the operating system cannot say.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }
}

impl Carrier for Udp {
    fn poll(&mut self, wait: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        let failed = |error: &std::io::Error| BadInput::io("UDP", error);
        if self.wait != wait {
            self.socket.set_read_timeout(Some(wait)).map_err(|error| failed(&error))?;
            self.wait = wait;
        }
        for (from, bytes) in self.elsewhere.iter().flat_map(Receiver::try_iter).take(AT_ONCE_MAX) {
            take(Arrived::Packet { from: Peer::Udp(from), bytes: &bytes });
        }
        let mut buffer = [0; DATAGRAM_BYTES_MAX];
        for index in 0..AT_ONCE_MAX {
            if index == 1 {
                self.socket.set_nonblocking(true).map_err(|error| failed(&error))?;
            }
            match self.socket.recv_from(&mut buffer) {
                Ok((length, from)) => {
                    take(Arrived::Packet { from: Peer::Udp(from), bytes: &buffer[..length] });
                }
                // The echo of a packet that nobody took.
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset
                    ) => {}
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) =>
                {
                    break;
                }
                Err(error) => return Err(failed(&error)),
            }
        }
        self.socket.set_nonblocking(false).map_err(|error| failed(&error))
    }

    fn send(&mut self, to: Peer, packet: &[u8]) {
        if let Peer::Udp(to) = to {
            let _ = self.socket.send_to(packet, to);
        }
    }

    fn only_peer(&self) -> Option<Peer> {
        None
    }

    #[cfg(target_os = "linux")]
    fn dropped_here(&self) -> Option<u64> {
        use std::os::fd::AsRawFd;
        let link = std::fs::read_link(format!("/proc/self/fd/{}", self.socket.as_raw_fd())).ok()?;
        let inode = link.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned();
        ["/proc/self/net/udp", "/proc/self/net/udp6"].into_iter().find_map(|table| {
            let table = std::fs::read_to_string(table).ok()?;
            // The tenth column is the socket's inode, the last one what was dropped.
            let mut rows = table.lines().map(|row| row.split_whitespace().collect::<Vec<_>>());
            let row = rows.find(|row| row.get(9) == Some(&inode.as_str()))?;
            row.last()?.parse().ok()
        })
    }

    #[cfg(not(target_os = "linux"))]
    fn dropped_here(&self) -> Option<u64> {
        None
    }
}
