//! One socket for many boxes.
//!
//! Boxes announce themselves to one port of this computer, and answer whoever has their key from where
//! they are called. So one socket is enough for all: a datagram belongs to the box whose identity it
//! announces, and any other to the box that is known to be at its sender's address. Whether it really is
//! that box's, its own link finds out by its seal.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::net::SocketAddr;
use std::rc::Rc;
use std::time::{Duration, Instant};

use plumbline::seal::{Announcement, KeyId, OneWay, Peer};
use plumbline_files::BadInput;
use plumbline_stream::transport::{Arrived, Carrier, Udp, words_of_other};

/// The datagrams of one box that wait to be looked at: what comes beyond them is asked for again.
const WAITING_MAX: usize = 512;

/// An address at which a box was heard for certain is that box's for so long, whatever is announced there.
const SURE_FOR: Duration = Duration::from_secs(10);

/// The addresses that are remembered for each box.
const ADDRESSES_PER_BOX: usize = 4;

/// The strangers that are told of.
const STRANGERS_MAX: usize = 100;

/// Datagrams that wait for a box, and how many were dropped.
#[derive(Debug, Default)]
struct Waiting {
    datagrams: VecDeque<(SocketAddr, Vec<u8>)>,
    dropped: u64,
}

/// The box that is at an address.
#[derive(Debug, Clone, Copy)]
struct Owner {
    place: usize,
    /// When its link was last sure of that.
    sure: Option<Instant>,
    claimed: Instant,
}

/// The socket, and what waits for each box.
pub struct Post {
    udp: Rc<RefCell<Udp>>,
    boxes: Vec<Rc<RefCell<Waiting>>>,
    by_key: BTreeMap<KeyId, usize>,
    by_address: HashMap<SocketAddr, Owner>,
    /// The boxes for which something has come.
    touched: Vec<usize>,
    strangers: BTreeSet<String>,
    /// Datagrams of nobody that is known.
    unknown: u64,
    notices: Vec<String>,
}

/// The letterbox of one box.
pub struct Letterbox {
    udp: Rc<RefCell<Udp>>,
    waiting: Rc<RefCell<Waiting>>,
}

impl Post {
    /// For boxes with these keys, which are at these addresses as far as is known.
    #[must_use]
    pub fn new(udp: Udp, boxes: &[(KeyId, Option<SocketAddr>)]) -> Self {
        let now = Instant::now();
        let by_key = boxes.iter().enumerate().map(|(place, (id, _))| (*id, place)).collect();
        let at = |(place, (_, address)): (usize, &(KeyId, Option<SocketAddr>))| {
            address.map(|it| (it, Owner { place, sure: None, claimed: now }))
        };
        Self {
            udp: Rc::new(RefCell::new(udp)),
            boxes: boxes.iter().map(|_| Rc::default()).collect(),
            by_key,
            by_address: boxes.iter().enumerate().filter_map(at).collect(),
            touched: Vec::new(),
            strangers: BTreeSet::new(),
            unknown: 0,
            notices: Vec::new(),
        }
    }

    /// The letterbox of a box, by its place in the list.
    #[must_use]
    pub fn letterbox(&self, place: usize) -> Letterbox {
        Letterbox { udp: Rc::clone(&self.udp), waiting: Rc::clone(&self.boxes[place]) }
    }

    /// Waits for datagrams, at most this long, and sorts what has come; for which boxes something has.
    ///
    /// # Errors
    /// When the socket cannot be used any more.
    pub fn poll(&mut self, wait: Duration) -> Result<Vec<usize>, BadInput> {
        let udp = Rc::clone(&self.udp);
        let now = Instant::now();
        let polled = udp.borrow_mut().poll(wait, &mut |arrived| {
            if let Arrived::Packet { from: Peer::Udp(from), bytes } = arrived {
                self.sort(from, bytes, now);
            }
        });
        polled.map(|()| std::mem::take(&mut self.touched))
    }

    fn sort(&mut self, from: SocketAddr, bytes: &[u8], now: Instant) {
        let announcement = Announcement::parse(bytes);
        let named = match &announcement {
            Some(announcement) => announcement.key_id,
            None => OneWay::key_id(bytes),
        };
        let place = match named.map(|id| self.by_key.get(&id).copied()) {
            Some(Some(place)) => {
                self.claim(from, place, now);
                Some(place)
            }
            // It says that it is a box which is not known here.
            Some(None) => None,
            None if announcement.is_some() => None,
            None => self.by_address.get(&from).map(|owner| owner.place),
        };
        let Some(place) = place else {
            self.unknown += 1;
            if let Some(announcement) = announcement {
                self.stranger(from, &announcement);
            }
            return;
        };
        let mut waiting = self.boxes[place].borrow_mut();
        if waiting.datagrams.is_empty() {
            self.touched.push(place);
        }
        if waiting.datagrams.len() >= WAITING_MAX {
            waiting.dropped += 1;
        } else {
            waiting.datagrams.push_back((from, bytes.to_vec()));
        }
    }

    /// A box says that it is at this address. Anybody can say so: where another box was heard for certain
    /// lately, that one stays.
    fn claim(&mut self, from: SocketAddr, place: usize, now: Instant) {
        let is_sure = |owner: &Owner| owner.sure.is_some_and(|at| now - at < SURE_FOR);
        if let Some(owner) = self.by_address.get_mut(&from)
            && (owner.place == place || is_sure(owner))
        {
            if owner.place == place {
                owner.claimed = now;
            }
            return;
        }
        self.by_address.insert(from, Owner { place, sure: None, claimed: now });
        if self.by_address.len() > ADDRESSES_PER_BOX * self.boxes.len().max(1) {
            // The one that was claimed longest ago, of those about which nothing is sure.
            let unsure = self.by_address.iter().filter(|(_, owner)| !is_sure(owner));
            let oldest = unsure.min_by_key(|(_, owner)| owner.claimed).map(|(address, _)| *address);
            if let Some(oldest) = oldest {
                self.by_address.remove(&oldest);
            }
        }
    }

    /// A box with which there can be no session says that it is there.
    fn stranger(&mut self, from: SocketAddr, announcement: &Announcement) {
        if self.strangers.len() >= STRANGERS_MAX {
            return;
        }
        let (found, remedy) = words_of_other(None, announcement);
        if self.strangers.insert(format!("{}: {found}", from.ip())) {
            self.notices.push(format!("{from}: {found}; {remedy}"));
        }
    }

    /// A box was heard for certain, with its seal.
    pub fn heard(&mut self, place: usize, at: SocketAddr, now: Instant) {
        self.by_address.insert(at, Owner { place, sure: Some(now), claimed: now });
    }

    /// What there is to say since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// Datagrams of nobody that is known, and those of known boxes that were dropped because too many
    /// waited.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.unknown, self.boxes.iter().map(|it| it.borrow().dropped).sum())
    }

    /// Datagrams that this computer's own system has dropped, as far as it tells.
    #[must_use]
    pub fn dropped_here(&self) -> Option<u64> {
        self.udp.borrow().dropped_here()
    }
}

impl Carrier for Letterbox {
    /// Nothing waits here: whoever has the [`Post`] does.
    fn poll(&mut self, _: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        let datagrams = std::mem::take(&mut self.waiting.borrow_mut().datagrams);
        for (from, bytes) in datagrams {
            take(Arrived::Packet { from: Peer::Udp(from), bytes: &bytes });
        }
        Ok(())
    }

    fn send(&mut self, to: Peer, packet: &[u8]) {
        self.udp.borrow_mut().send(to, packet);
    }

    fn only_peer(&self) -> Option<Peer> {
        None
    }

    fn dropped_here(&self) -> Option<u64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::Start;
    use plumbline::seal::{BoxEnd, Key, SEALED_BYTES_MAX};

    use super::*;

    fn key(byte: u8) -> Key {
        Key::new([byte; 32]).unwrap()
    }

    fn announcement(key: Key) -> Vec<u8> {
        let end = BoxEnd::new(Some(key), Start::new(3).unwrap(), &[5; 32]);
        end.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec()
    }

    fn post() -> Post {
        let udp = Udp::bind("127.0.0.1:0".parse().unwrap()).unwrap();
        Post::new(udp, &[(key(1).id(), None), (key(2).id(), None)])
    }

    fn at(port: u16) -> SocketAddr {
        SocketAddr::from(([192, 0, 2, 1], port))
    }

    /// The number of datagrams that wait for each box.
    fn waiting(post: &Post) -> Vec<usize> {
        post.boxes.iter().map(|it| it.borrow().datagrams.len()).collect()
    }

    #[test]
    fn datagrams_come_to_the_box_that_announced_itself_there() {
        let (mut post, now) = (post(), Instant::now());
        // Before a box says who it is, nobody knows.
        post.sort(at(1), &[9; 60], now);
        post.sort(at(1), &announcement(key(1)), now);
        post.sort(at(2), &announcement(key(2)), now);
        post.sort(at(2), &[9; 60], now);
        post.sort(at(2), &[9; 60], now);
        assert_eq!((waiting(&post), post.counts()), (vec![1, 3], (1, 0)));
        assert_eq!(post.touched, [0, 1]);
    }

    #[test]
    fn an_address_at_which_a_box_is_for_certain_cannot_be_claimed() {
        let (mut post, now) = (post(), Instant::now());
        post.sort(at(1), &announcement(key(1)), now);
        post.heard(0, at(1), now);
        // A recorded announcement of the other box, under the address of the first.
        post.sort(at(1), &announcement(key(2)), now);
        post.sort(at(1), &[9; 60], now);
        assert_eq!(waiting(&post), [2, 1]);
        // After a while it may well be the other one that is there.
        let later = now + SURE_FOR;
        post.sort(at(1), &announcement(key(2)), later);
        post.sort(at(1), &[9; 60], later);
        assert_eq!(waiting(&post), [2, 3]);
    }

    #[test]
    fn floods_and_strangers_take_no_memory() {
        let (mut post, now) = (post(), Instant::now());
        for port in 1..2000 {
            post.sort(at(port), &announcement(key(1)), now);
            post.sort(at(port), &announcement(key(9)), now);
        }
        assert!(post.by_address.len() <= ADDRESSES_PER_BOX * 2, "{}", post.by_address.len());
        assert_eq!(waiting(&post), [WAITING_MAX, 0]);
        assert_eq!(post.counts(), (1999, 1999 - WAITING_MAX as u64));
        assert_eq!(post.take_notices().len(), 1);
    }
}
