//! Where packets physically go: a socket, a serial line, a file, in any combination.

use std::time::Duration;

use plumbline::packet::{LINKS_MAX, LinkKind};
use plumbline::seal::Peer;

use super::udp::BOX_PORT;
use super::{Counts, FileLink, SerialLink, UdpLink};

/// At most one of each kind. They are opened once, when a fault can still be reported to a person
/// as an error.
#[derive(Debug, Default)]
pub struct Ports {
    /// Datagrams.
    pub udp: Option<UdpLink>,
    /// Frames on a serial line.
    pub serial: Option<SerialLink>,
    /// Whether nothing comes back on that.
    pub is_one_way: bool,
    /// Frames appended to a file.
    pub file: Option<FileLink>,
}

impl Ports {
    /// Moves to the port on which hosts look for a box, if that is free.
    pub fn listen_where_hosts_look(&mut self) {
        if let Some(udp) = &mut self.udp
            && let Err(error) = udp.listen_on(BOX_PORT)
        {
            log::info!(
                "the UDP port {BOX_PORT} cannot be used: {error}; hosts find the box on another one \
                 by its announcements"
            );
        }
    }

    /// Whether packets have nowhere to go.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.udp.is_none() && self.serial.is_none() && self.file.is_none()
    }

    /// Whether hosts can be heard over the serial line.
    #[must_use]
    pub fn hears_serial(&self) -> bool {
        self.serial.is_some() && !self.is_one_way
    }

    /// Sends one sealed packet, or drops and counts it. Never waits.
    pub(super) fn send(&mut self, to: Peer, packet: &[u8]) {
        match (to, &mut self.udp, &mut self.serial) {
            (Peer::Udp(address), Some(udp), _) => udp.send(packet, address),
            (Peer::Serial, _, Some(serial)) => serial.send_packet(packet),
            _ => {}
        }
    }

    /// Whether one more packet leaves enough room for those that follow.
    pub(super) fn has_room(&self, to: Peer) -> bool {
        match to {
            Peer::Udp(_) => self.udp.is_some(),
            Peer::Serial => self.serial.as_ref().is_some_and(SerialLink::has_room),
        }
    }

    /// Sends waiting packets, as far as is possible without blocking.
    pub(super) fn service(&mut self) {
        if let Some(serial) = &mut self.serial {
            serial.service();
        }
    }

    /// Sends waiting packets for at most `limit`; those that are left count as dropped.
    pub(super) fn finish(&mut self, limit: Duration) {
        if let Some(serial) = &mut self.serial {
            serial.finish(limit);
        }
    }

    /// What became of the packets of each so far.
    pub(super) fn counts(&self) -> heapless::Vec<(LinkKind, Counts), LINKS_MAX> {
        let udp = self.udp.as_ref().map(|it| (LinkKind::Udp, it.counts()));
        let serial = self.serial.as_ref().map(|it| (LinkKind::Serial, it.counts()));
        let file = self.file.as_ref().map(|it| (LinkKind::File, it.counts()));
        [udp, serial, file].into_iter().flatten().collect()
    }

    /// The same, for people.
    pub(super) fn summary(&self) -> heapless::Vec<(String, Counts), LINKS_MAX> {
        let udp = self.udp.as_ref().map(|it| (it.to_string(), it.counts()));
        let serial = self.serial.as_ref().map(|it| (it.to_string(), it.counts()));
        let file = self.file.as_ref().map(|it| (it.to_string(), it.counts()));
        [udp, serial, file].into_iter().flatten().collect()
    }
}
