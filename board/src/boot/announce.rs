//! Saying what is wrong when there is no session to say it: as Log packets, by
//! UDP and on a serial line, as far as there are any.
//!
//! Each time everything is opened anew: the network may have come up meanwhile.
//! Where no host is known by UDP, all of the box's network is told.

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use plumbline::config::Links;
use plumbline::packet::{
    FRAME_BYTES_MAX, Log, LogLevel, Message, PACKET_BYTES_MAX, encode_datagram, encode_frame,
};

use crate::link::SerialLink;
use crate::logger::pieces;

/// A text is repeated this often.
pub const AGAIN: Duration = Duration::from_secs(2);

/// Where hosts listen, unless they were told otherwise.
const HOST_PORT: u16 = 4210;

/// A serial line gets this long to take what it is given.
const SERIAL_PATIENCE: Duration = Duration::from_secs(1);

/// Says `text` once to everyone who can be reached.
pub fn say(links: &Links, started: Instant, text: &str) {
    let to = links.udp.unwrap_or((Ipv4Addr::BROADCAST, HOST_PORT).into());
    let socket = open_udp(to);
    let mut line = links.serial.as_ref().and_then(|line| {
        let mut link = SerialLink::open(&line.path, line.baud).ok()?;
        // Ends a frame that was cut short.
        link.send(&[0]);
        Some(link)
    });
    for piece in pieces(text) {
        let message = Message::Log(Log {
            uptime_ms: started.elapsed().as_millis() as u64,
            level: LogLevel::Error,
            target: "plumbline_board::boot".try_into().unwrap_or_default(),
            text: piece.try_into().unwrap_or_default(),
            cut: 0,
        });
        let mut datagram = [0; PACKET_BYTES_MAX];
        let mut frame = [0; FRAME_BYTES_MAX];
        if let (Ok(socket), Ok(datagram)) = (&socket, encode_datagram(&message, &mut datagram)) {
            // Until the network is up there is no way, and next time there may be.
            let _ = socket.send_to(datagram, to);
        }
        if let (Some(line), Ok(frame)) = (&mut line, encode_frame(&message, &mut frame)) {
            line.send(frame);
        }
    }
    if let Some(mut line) = line {
        line.finish(SERIAL_PATIENCE);
    }
}

fn open_udp(to: SocketAddr) -> std::io::Result<UdpSocket> {
    let socket = if to.is_ipv4() {
        UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))
    } else {
        UdpSocket::bind((Ipv6Addr::UNSPECIFIED, 0))
    }?;
    socket.set_broadcast(true)?;
    // A full buffer must not hold up the rest.
    socket.set_nonblocking(true)?;
    Ok(socket)
}
