//! One packet per UDP datagram, to one host.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};

use anyhow::{Context, Result, bail};
use plumbline::packet::{Message, PACKET_BYTES_MAX, Packet, decode_datagram};

use super::Counts;

/// A non-blocking socket on a port of the system's choice, in the address family of `to`.
pub(crate) fn socket_for(to: SocketAddr) -> std::io::Result<UdpSocket> {
    let any: SocketAddr = if to.is_ipv4() {
        (Ipv4Addr::UNSPECIFIED, 0).into()
    } else {
        (Ipv6Addr::UNSPECIFIED, 0).into()
    };
    let socket = UdpSocket::bind(any)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// A connected UDP socket.
///
/// Being connected, it learns on the next send that nobody listens
/// (ECONNREFUSED). That packet counts as dropped; sending goes on, because the
/// host may start at any time. It is connected as soon as there is a route to
/// the host: a box may get its own address only after its first frame.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    to: SocketAddr,
    connected: bool,
    counts: Counts,
}

impl UdpLink {
    /// A socket to `destination`, `HOST:PORT`.
    ///
    /// # Errors
    /// When the name cannot be resolved or its port is 0.
    pub fn open(destination: &str) -> Result<Self> {
        let to = destination
            .to_socket_addrs()
            .with_context(|| {
                format!(
                    "the UDP destination {destination} cannot be resolved: give HOST:PORT, \
                     for example 192.168.1.20:4210, and check the name or the network"
                )
            })?
            .next()
            .with_context(|| format!("the UDP destination {destination} has no address"))?;
        if to.port() == 0 {
            bail!("the UDP destination {destination} has port 0: give the port of the host");
        }
        Self::to(to)
    }

    /// A socket to an address, to which there need not be a route yet.
    ///
    /// # Errors
    /// When the system has no socket left.
    pub fn to(to: SocketAddr) -> Result<Self> {
        let socket = socket_for(to).context("no UDP socket can be opened")?;
        let mut link = Self { socket, to, connected: false, counts: Counts::default() };
        if let Err(error) = link.connect() {
            log::info!(
                "there is no route to {to} (UDP) yet: {error}; packets are dropped until there is"
            );
        }
        Ok(link)
    }

    fn connect(&mut self) -> std::io::Result<()> {
        if !self.connected {
            self.socket.connect(self.to)?;
            self.connected = true;
        }
        Ok(())
    }

    /// Sends one datagram.
    pub fn send(&mut self, datagram: &[u8]) {
        if self.connect().is_err() {
            self.counts.dropped += 1;
            return;
        }
        // A refusal that the socket reports here belongs to an EARLIER datagram,
        // and this one was not sent: try once more, now that the report is read.
        let refused = |error: &std::io::Error| error.kind() == ErrorKind::ConnectionRefused;
        let mut result = self.socket.send(datagram);
        if result.as_ref().is_err_and(refused) {
            self.counts.dropped += 1;
            self.counts.sent = self.counts.sent.saturating_sub(1);
            result = self.socket.send(datagram);
        }
        match result {
            Ok(count) if count == datagram.len() => self.counts.sent += 1,
            // A full queue, or a host that does not listen: the route is still right.
            Err(error) if refused(&error) || error.kind() == ErrorKind::WouldBlock => {
                self.counts.dropped += 1;
            }
            // The network or this box's own address has changed: look up the route again.
            _ => {
                self.counts.dropped += 1;
                self.connected = false;
            }
        }
    }

    /// Passes on the messages from the host; anything else is ignored.
    pub fn receive(&mut self, mut take: impl FnMut(Message)) {
        if !self.connected {
            // Unconnected, it would receive from anybody.
            return;
        }
        let mut datagram = [0; PACKET_BYTES_MAX];
        // A bound: a host that floods the box must not keep it from tracking.
        for _ in 0..super::RECEIVED_PER_TURN_MAX {
            match self.socket.recv(&mut datagram) {
                Ok(length) => {
                    if let Ok(Packet { start: None, message }) =
                        decode_datagram(&datagram[..length])
                    {
                        take(message);
                    }
                }
                Err(_) => return,
            }
        }
    }

    /// What became of the packets so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

impl std::fmt::Display for UdpLink {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "udp {}", self.to)
    }
}
