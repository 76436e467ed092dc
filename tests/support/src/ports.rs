//! Ports for programs that a test starts.
//!
//! The test must know a port before the program listens at it. A port that the kernel has chosen, and
//! that is free again until then, can go to any other socket in the meantime: each that wants no
//! port in particular is given one. These lie below the kernel's, and a process gives each away once.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// Above those of well-known services; Linux gives away 32,768 and above.
const FIRST: u16 = 12_000;

/// How many there are.
const PORTS: u16 = 20_000;

/// How far apart two processes begin that have started one after the other.
const APART: u32 = 64;

/// A port of this computer that nobody listens at, for UDP or TCP.
///
/// # Panics
/// When none is free.
pub fn free_port() -> u16 {
    free_ports(1)
}

/// The same at this computer's own address.
///
/// # Panics
/// As [`free_port`].
pub fn free_address() -> SocketAddr {
    (Ipv4Addr::LOCALHOST, free_port()).into()
}

/// The first of so many free ports in a row.
///
/// # Panics
/// As [`free_port`].
pub fn free_ports(count: u16) -> u16 {
    static GIVEN: AtomicU16 = AtomicU16::new(0);
    let is_free = |port: u16| {
        let everywhere = (Ipv4Addr::UNSPECIFIED, port);
        UdpSocket::bind(everywhere).is_ok() && TcpListener::bind(everywhere).is_ok()
    };
    let begin = std::process::id().wrapping_mul(APART) % u32::from(PORTS);
    for _ in 0..PORTS {
        let given = u32::from(GIVEN.fetch_add(count, Ordering::Relaxed));
        let place = (begin + given) % u32::from(PORTS);
        let first = FIRST + u16::try_from(place).expect("it is less than the number of ports");
        if (first..first + count).all(is_free) {
            return first;
        }
    }
    panic!("no {count} ports in a row are free from {FIRST} on");
}

/// Whether somebody in this thread's network listens at this port for UDP, by Linux's list of sockets. To
/// try the port instead would take it for a moment, and perhaps from the program that is waited for.
///
/// # Panics
/// Where there is no such list.
pub fn listens_at(port: u16) -> bool {
    // A thread may have a network of its own.
    let sockets = fs::read_to_string("/proc/thread-self/net/udp").expect("Linux's list of sockets");
    let ending = format!(":{port:04X}");
    let mut own = sockets.lines().skip(1).filter_map(|line| line.split_whitespace().nth(1));
    own.any(|address| address.ends_with(&ending))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_seen_at_its_port_and_the_port_stays_free_until_then() {
        let port = free_port();
        assert!(!listens_at(port));
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
        assert!(listens_at(port));
        // What it has sent to somebody else is no sign of anybody there.
        let other = free_port();
        socket.connect((Ipv4Addr::LOCALHOST, other)).unwrap();
        assert!(!listens_at(other));
        drop(socket);
        assert!(!listens_at(port));
    }

    #[test]
    fn no_port_is_given_twice_or_is_one_of_the_kernels() {
        let mut given: Vec<u16> = (0..40).map(|_| free_port()).collect();
        for _ in 0..3 {
            let first = free_ports(5);
            given.extend(first..first + 5);
        }
        assert!(given.iter().all(|port| (FIRST..32_768).contains(port)), "{given:?}");
        let count = given.len();
        given.sort_unstable();
        given.dedup();
        assert_eq!(given.len(), count);
    }
}
