//! Where boxes announce themselves to this computer.
//!
//! A box sends its announcements to one port of this computer, and answers whoever has its key from
//! any other. So the porter listens at the port, and tells each box's station where it is; stations
//! have ports of their own, and no box disturbs another.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use plumbline::seal::{Announcement, KeyId, Peer};
use plumbline_files::BadInput;
use plumbline_stream::transport::{Arrived, Carrier as _, Udp, words_of_other};

use crate::hub::Hub;
use crate::station::Shared;
use crate::wire::{Problem, Stranger};

/// The most boxes that are shown and cannot be used.
const STRANGERS_MAX: usize = 16;

/// A box that has been silent for longer is not shown any more.
const SHOWN_FOR: Duration = Duration::from_secs(10);

/// The wait for datagrams.
const WAIT: Duration = Duration::from_millis(200);

/// Boxes that announce themselves and cannot be used.
#[derive(Debug, Default)]
pub struct Strangers {
    seen: Mutex<HashMap<SocketAddr, (Instant, Stranger)>>,
}

impl Strangers {
    /// Those that were heard lately, by their addresses.
    pub fn list(&self) -> Vec<Stranger> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.retain(|_, (at, _)| at.elapsed() < SHOWN_FOR);
        let mut list: Vec<Stranger> = seen.values().map(|(_, it)| it.clone()).collect();
        list.sort_by(|one, other| one.address.cmp(&other.address));
        list
    }

    /// Whether it is a new one.
    fn take(&self, from: SocketAddr, stranger: Stranger) -> bool {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let is_known = seen.get(&from).is_some_and(|(_, it)| *it == stranger);
        if is_known || seen.len() < STRANGERS_MAX {
            seen.insert(from, (Instant::now(), stranger));
        }
        !is_known
    }
}

/// The boxes whose keys are known here.
#[derive(Debug, Default)]
pub struct Known {
    stations: RwLock<HashMap<KeyId, Arc<Shared>>>,
}

impl Known {
    /// Another one is known from now on.
    pub fn add(&self, id: KeyId, shared: Arc<Shared>) {
        self.stations.write().unwrap_or_else(PoisonError::into_inner).insert(id, shared);
    }

    fn get(&self, id: KeyId) -> Option<Arc<Shared>> {
        self.stations.read().unwrap_or_else(PoisonError::into_inner).get(&id).cloned()
    }
}

/// A porter that listens at an address.
pub struct Porter {
    udp: Udp,
    known: Arc<Known>,
    strangers: Arc<Strangers>,
    hub: Arc<Hub>,
}

impl Porter {
    /// Listens at this address for these boxes.
    ///
    /// # Errors
    /// When nobody can listen there.
    pub fn bind(
        address: SocketAddr,
        known: Arc<Known>,
        strangers: Arc<Strangers>,
        hub: Arc<Hub>,
    ) -> Result<Self, BadInput> {
        Ok(Self { udp: Udp::bind(address)?, known, strangers, hub })
    }

    /// Listens until the desk ends.
    ///
    /// # Errors
    /// When the socket cannot be used any more.
    pub fn run(mut self) -> Result<(), BadInput> {
        while !self.hub.is_over() {
            let mut heard = Vec::new();
            self.udp.poll(WAIT, &mut |arrived| {
                if let Arrived::Packet { from: Peer::Udp(from), bytes } = arrived
                    && let Some(announcement) = Announcement::parse(bytes)
                {
                    heard.push((from, announcement, bytes.to_vec()));
                }
            })?;
            for (from, announcement, datagram) in heard {
                self.announced(from, &announcement, &datagram);
            }
        }
        Ok(())
    }

    fn announced(&self, from: SocketAddr, announcement: &Announcement, datagram: &[u8]) {
        // Anybody can say so: where a box is, is noted once there is a session with it.
        if let Some(shared) = announcement.key_id.and_then(|id| self.known.get(id)) {
            return shared.set_announced(from, datagram);
        }
        let (found, remedy) = words_of_other(None, announcement);
        let name = match announcement.key_id {
            Some(id) => format!("a box with the key {id}"),
            None => announcement.text.to_string(),
        };
        let address = from.to_string();
        let problem = Problem::new(&address, found, remedy);
        if self.strangers.take(from, Stranger { address, name, problem }) {
            self.hub.changed();
        }
    }
}
