//! Talks to hosts while there is no session: what is wrong goes out as Log packets, over UDP and
//! over a serial line if there is one, and hosts may send commands.
//!
//! The network may come up, and the line be plugged in, at any time. If no host's address is
//! known, the packets are broadcast.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use plumbline::config::Links;
use plumbline::packet::{
    FRAME_BYTES_MAX, Log, LogLevel, Message, PACKET_BYTES_MAX, Packet, Reply, Start,
    decode_datagram, encode_datagram, encode_frame,
};

use crate::link::udp::socket_for;
use crate::link::{RECEIVED_PER_TURN_MAX, SerialLink};
use crate::logger::pieces;

/// A text is repeated this often.
pub const AGAIN: Duration = Duration::from_secs(2);

/// The port on which hosts listen by default.
const HOST_PORT: u16 = 4210;

/// How long a serial line may take to send a packet.
const SERIAL_PATIENCE: Duration = Duration::from_secs(1);

/// The links to the hosts.
pub struct Announcer {
    started: Instant,
    start: Start,
    to: SocketAddr,
    socket: Option<UdpSocket>,
    line: Option<SerialLink>,
}

impl Announcer {
    /// Opens the links that are available.
    pub fn new(links: &Links) -> Self {
        let to = links.udp.unwrap_or((Ipv4Addr::BROADCAST, HOST_PORT).into());
        let line = links.serial.as_ref();
        Self {
            started: Instant::now(),
            start: crate::start::draw(),
            to,
            socket: open_udp(to).ok(),
            line: line.and_then(|line| SerialLink::absent(&line.path, line.baud).ok()),
        }
    }

    /// Sends `text` once to every host that can be reached.
    pub fn say(&mut self, text: &str) {
        if let Some(line) = &mut self.line {
            // Terminates a frame that was cut short.
            line.send(&[0]);
        }
        for piece in pieces(text) {
            let message = Message::Log(Log {
                uptime_ms: self.started.elapsed().as_millis() as u64,
                level: LogLevel::Error,
                target: "plumbline_board::boot".try_into().unwrap_or_default(),
                text: piece.try_into().unwrap_or_default(),
                cut: 0,
            });
            self.send_udp(&message, self.to);
            self.send_serial(&message);
        }
    }

    /// Passes what hosts have sent since the last call to `answer`, and sends back the replies.
    pub fn answer(&mut self, mut answer: impl FnMut(&Message) -> Option<Reply>) {
        let mut datagram = [0; PACKET_BYTES_MAX];
        for _ in 0..RECEIVED_PER_TURN_MAX {
            let Some(Ok((length, from))) =
                self.socket.as_ref().map(|socket| socket.recv_from(&mut datagram))
            else {
                break;
            };
            if (is_broadcast(self.to.ip()) || from.ip() == self.to.ip())
                && let Ok(Packet { start: None, message }) = decode_datagram(&datagram[..length])
                && let Some(reply) = answer(&message)
            {
                self.send_udp(&Message::Reply(reply), from);
            }
        }
        let mut replies = heapless::Vec::<Reply, RECEIVED_PER_TURN_MAX>::new();
        if let Some(line) = &mut self.line {
            line.service();
            line.receive(|message| {
                if let Some(reply) = answer(&message) {
                    // More at once than there is room for are a flood; the host asks again.
                    let _ = replies.push(reply);
                }
            });
        }
        for reply in replies {
            self.send_serial(&Message::Reply(reply));
        }
    }

    fn send_udp(&self, message: &Message, to: SocketAddr) {
        if let (Some(socket), Ok(datagram)) =
            (&self.socket, encode_datagram(Some(self.start), message, &mut [0; PACKET_BYTES_MAX]))
        {
            // Until the network is up this fails; the next attempt may succeed.
            let _ = socket.send_to(datagram, to);
        }
    }

    fn send_serial(&mut self, message: &Message) {
        if let (Some(line), Ok(frame)) =
            (&mut self.line, encode_frame(Some(self.start), message, &mut [0; FRAME_BYTES_MAX]))
        {
            line.send(frame);
            line.finish(SERIAL_PATIENCE);
        }
    }
}

fn is_broadcast(address: IpAddr) -> bool {
    address == Ipv4Addr::BROADCAST
}

fn open_udp(to: SocketAddr) -> std::io::Result<UdpSocket> {
    let socket = socket_for(to)?;
    socket.set_broadcast(true)?;
    Ok(socket)
}
