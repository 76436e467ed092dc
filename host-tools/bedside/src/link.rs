//! The link to a box whose key is known here.

use std::net::{Ipv4Addr, SocketAddr};

use plumbline::packet::LinkKind;
use plumbline::seal::KeyId;
use plumbline_files::BadInput;
use plumbline_stream::link::{BoxLink, PORT};
use plumbline_stream::transport::{Carrier, KnownBox, Link, Memory, Serial, Transport, Udp};
use plumbline_stream::update_link::UpdateLink;

use crate::keys::Store;

/// What carries the packets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carried {
    /// Datagrams to this address of this computer; `None`: to port 4210 of all its addresses.
    Udp(Option<SocketAddr>),
    /// A serial device of this computer.
    Serial {
        /// Its path.
        device: String,
        /// Bits per second.
        baud: u32,
    },
}

/// Which box is meant, and how it is reached: it announces itself to this computer, and answers
/// whoever has its key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Way {
    /// What carries the packets.
    pub carried: Carried,
    /// The box's name, its serial number or the first digits of its key's identity; `None`: the
    /// first that is heard of those whose keys are known here.
    pub called: Option<String>,
    /// Where the box announces itself, if somebody else listens for that; `None`: where it was heard
    /// last.
    pub at: Option<SocketAddr>,
}

/// What a program on this computer is called at boxes.
#[must_use]
pub fn called(program: &str) -> String {
    format!("{program} on {}", this_computer())
}

/// What this computer is called.
#[must_use]
pub fn this_computer() -> String {
    gethostname::gethostname().to_string_lossy().into_owned()
}

impl Way {
    /// Opens the socket or the line. `program` is what this program is called at the box; `past`
    /// wants what the box has kept of the last minute as well. `warn` is told, as long as the link
    /// lasts, which key cannot be used, and what cannot be noted of the box.
    ///
    /// # Errors
    /// When the socket or the line cannot be opened, or no key of the box is known here.
    pub fn open(
        &self,
        program: &str,
        past: bool,
        mut warn: impl FnMut(&str) + 'static,
    ) -> Result<BoxLink, BadInput> {
        let store = Store::open()?;
        let boxes = self.boxes(&store, &mut warn)?;
        let (carrier, place, kind) = self.carrier(&boxes)?;
        let memory = Box::new(Noted { store, warn });
        Ok(BoxLink::new(calling(carrier, boxes, program, memory, past), place, kind))
    }

    /// The same to update the box, of whatever release it is.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_for_update(
        &self,
        program: &str,
        mut warn: impl FnMut(&str) + 'static,
    ) -> Result<UpdateLink, BadInput> {
        let store = Store::open()?;
        let boxes = self.boxes(&store, &mut warn)?;
        let (carrier, place, kind) = self.carrier(&boxes)?;
        let memory = Box::new(Noted { store, warn });
        Ok(UpdateLink::new(carrier, place, kind, boxes, program, memory))
    }

    /// What carries the packets, its name in messages, and its kind.
    fn carrier(
        &self,
        boxes: &[KnownBox],
    ) -> Result<(Box<dyn Carrier>, String, LinkKind), BadInput> {
        Ok(match &self.carried {
            Carried::Serial { device, baud } => {
                (Box::new(Serial::open(device, *baud)?), device.clone(), LinkKind::Serial)
            }
            Carried::Udp(wanted) => {
                let address = wanted.unwrap_or((Ipv4Addr::UNSPECIFIED, PORT).into());
                let is_somewhere = boxes.iter().any(|it| it.address.is_some());
                let udp = match Udp::bind(address) {
                    // Another program listens there already: this one calls the box where it was last.
                    Err(_) if wanted.is_none() && is_somewhere && is_taken(address) => {
                        Udp::bind((address.ip(), 0).into())
                    }
                    udp => udp,
                }?;
                (Box::new(udp), format!("UDP {address}"), LinkKind::Udp)
            }
        })
    }

    /// The same through a socket that is open already, whatever carries the packets by itself.
    ///
    /// # Errors
    /// When no key of the box is known here.
    pub fn open_through(
        &self,
        udp: Udp,
        place: &str,
        program: &str,
        mut warn: impl FnMut(&str) + 'static,
    ) -> Result<BoxLink, BadInput> {
        let store = Store::open()?;
        let boxes = self.boxes(&store, &mut warn)?;
        let transport = calling(udp, boxes, program, Box::new(Noted { store, warn }), false);
        Ok(BoxLink::new(transport, place.to_owned(), LinkKind::Udp))
    }

    /// The boxes that may be meant.
    fn boxes(&self, store: &Store, warn: &mut impl FnMut(&str)) -> Result<Vec<KnownBox>, BadInput> {
        let known = match &self.called {
            Some(called) => vec![store.find(called)?],
            None => {
                let boxes = store.all()?;
                for refused in &boxes.refused {
                    warn(&refused.to_string());
                }
                boxes.known
            }
        };
        if known.is_empty() {
            return Err(BadInput::whole(
                store.folder().display(),
                "no key of a box is known here, and a box talks to nobody else",
                "make one for a new box with `plumb provision --new-key`, or bring it from another \
                 computer with `plumb keys import`",
            ));
        }
        let known = known.into_iter();
        Ok(known
            .map(|it| KnownBox { name: it.title(), address: self.at.or(it.address), key: it.key })
            .collect())
    }
}

/// A link to one of these boxes, of which the memory is told.
fn calling<C: Carrier + 'static>(
    carrier: C,
    boxes: Vec<KnownBox>,
    program: &str,
    memory: Box<dyn Memory>,
    past: bool,
) -> Box<dyn Transport> {
    let link = Link::new(carrier, boxes, program).remembering(memory);
    Box::new(if past { link.with_past() } else { link })
}

/// Whether another program has this port.
fn is_taken(address: SocketAddr) -> bool {
    let bound = std::net::UdpSocket::bind(address);
    bound.is_err_and(|error| error.kind() == std::io::ErrorKind::AddrInUse)
}

/// What the link notes of boxes, in their store. What cannot be noted is said, and the link goes
/// on.
struct Noted<W> {
    store: Store,
    warn: W,
}

impl<W: FnMut(&str)> Memory for Noted<W> {
    fn met_at(&mut self, key_id: KeyId, address: SocketAddr) {
        if let Err(error) = self.store.note_address(key_id, address) {
            (self.warn)(&format!("where the box is was not noted: {error}"));
        }
    }

    fn take_start(&mut self, key_id: KeyId, start_count: u32) -> bool {
        self.store.take_start_count(key_id, start_count).unwrap_or_else(|error| {
            (self.warn)(&format!("the start of the box was not noted, and is not taken: {error}"));
            false
        })
    }
}
