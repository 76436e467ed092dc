//! One packet per UDP datagram, to and from any address.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};

use anyhow::{Context, Result, bail};
use nix::sys::socket::{setsockopt, sockopt};
use plumbline::seal::SEALED_BYTES_MAX;

use super::Counts;

/// On which hosts find a box that chooses its port itself, unless another program has it.
pub const BOX_PORT: u16 = 4211;

/// Datagrams that come between two turns wait here: some thousand, of which the kernel counts a
/// kilobyte each and more.
const RECEIVE_BUFFER_BYTES: usize = 4 << 20;

/// A byte more than the longest packet, to notice longer ones.
pub const DATAGRAM_BYTES_MAX: usize = SEALED_BYTES_MAX + 1;

/// A non-blocking socket that is heard by whoever knows its port, and the address to which the box
/// announces itself.
///
/// There need not be a route to that address yet: a box may get its own address only after its first
/// frame. Until there is one, packets count as dropped.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    to: SocketAddr,
    /// That there is no route is logged once, until there is one.
    has_route: bool,
    counts: Counts,
}

impl UdpLink {
    /// A socket on any free port, announced to `destination`, `HOST:PORT`.
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

    /// A socket on any free port, of the family of the address to which it is announced.
    ///
    /// # Errors
    /// When the system has no socket left.
    pub fn to(to: SocketAddr) -> Result<Self> {
        let socket = bound(to, 0).context("no UDP socket can be opened")?;
        Ok(Self { socket, to, has_route: true, counts: Counts::default() })
    }

    /// Moves to this port.
    ///
    /// # Errors
    /// When another program has it; the port is then still the one before.
    pub fn listen_on(&mut self, port: u16) -> std::io::Result<()> {
        self.socket = bound(self.to, port)?;
        Ok(())
    }

    /// Where the box announces itself.
    #[must_use]
    pub fn destination(&self) -> SocketAddr {
        self.to
    }

    /// Sends one datagram.
    pub fn send(&mut self, packet: &[u8], to: SocketAddr) {
        match self.socket.send_to(packet, to) {
            Ok(_) => {
                self.counts.sent += 1;
                self.has_route |= to == self.to;
            }
            Err(error) => {
                self.counts.dropped += 1;
                // The network or this box's own address may come later, or change: the route is
                // looked up again each time.
                if to == self.to && error.kind() != ErrorKind::WouldBlock && self.has_route {
                    self.has_route = false;
                    log::info!(
                        "there is no route to {to} (UDP) yet: {error}; the box announces itself \
                         there again and again"
                    );
                }
            }
        }
    }

    /// The next datagram, of `buffer`'s first bytes, and who has sent it.
    pub fn receive(
        &mut self,
        buffer: &mut [u8; DATAGRAM_BYTES_MAX],
    ) -> Option<(usize, SocketAddr)> {
        self.socket.recv_from(buffer).ok()
    }

    /// What became of the packets so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

fn bound(to: SocketAddr, port: u16) -> std::io::Result<UdpSocket> {
    let any: SocketAddr = if to.is_ipv4() {
        (Ipv4Addr::UNSPECIFIED, port).into()
    } else {
        (Ipv6Addr::UNSPECIFIED, port).into()
    };
    let socket = UdpSocket::bind(any)?;
    socket.set_nonblocking(true)?;
    // The destination may be all hosts of the network.
    socket.set_broadcast(true)?;
    // The administrator may have more than the system's limit. A smaller one only loses datagrams
    // sooner, when somebody sends floods of them.
    if setsockopt(&socket, sockopt::RcvBufForce, &RECEIVE_BUFFER_BYTES).is_err() {
        let _ = setsockopt(&socket, sockopt::RcvBuf, &RECEIVE_BUFFER_BYTES);
    }
    Ok(socket)
}

impl std::fmt::Display for UdpLink {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "udp {}", self.to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_taken_leaves_the_one_before() {
        let taken = UdpSocket::bind("0.0.0.0:0").unwrap();
        let port = taken.local_addr().unwrap().port();
        let mut link = UdpLink::open("127.0.0.1:4210").unwrap();
        let before = link.socket.local_addr().unwrap();
        assert!(link.listen_on(port).is_err());
        assert_eq!(link.socket.local_addr().unwrap(), before);
        drop(taken);
        link.listen_on(port).unwrap();
        assert_eq!(link.socket.local_addr().unwrap().port(), port);
    }

    #[test]
    fn both_families_are_heard() {
        for (address, port) in [("127.0.0.1", 4210), ("::1", 4210)] {
            let to = SocketAddr::new(address.parse().unwrap(), port);
            let Ok(mut link) = UdpLink::to(to) else {
                // A computer without IPv6.
                assert!(to.is_ipv6());
                continue;
            };
            let own = SocketAddr::new(to.ip(), link.socket.local_addr().unwrap().port());
            let Ok(host) = UdpSocket::bind(SocketAddr::new(to.ip(), 0)) else { continue };
            host.send_to(&[7; 300], own).unwrap();
            let from = host.local_addr().unwrap();
            let heard = link.receive(&mut [0; DATAGRAM_BYTES_MAX]);
            assert_eq!(heard, Some((DATAGRAM_BYTES_MAX, from)));
            link.send(&[1], from);
            let mut answer = [0; 9];
            assert_eq!(host.recv_from(&mut answer).unwrap().0, 1);
            assert_eq!(link.counts(), Counts { sent: 1, dropped: 0, waiting: 0 });
        }
    }
}
