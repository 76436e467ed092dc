//! A box's handshakes that wait for the host's first message, and those that have been.
//!
//! Whoever has recorded an opening can send it again. While its handshake waits it is answered with
//! the acceptance that it had before; afterwards, for as long as its cookie is valid, it is recognised
//! and ignored.

use heapless::Vec;

use super::Peer;
use super::channel::{Channel, session_of};
use super::listeners::{Caller, LISTENERS_MAX};
use super::wire::{ACCEPTANCE_BYTES, Purpose};
use crate::tell::packet::Body;

/// Most handshakes that wait: two of each listener.
pub(super) const PENDING_MAX: usize = 2 * LISTENERS_MAX;

/// They wait no longer than this.
pub(super) const PENDING_NS: u64 = 3_000_000_000;

/// Handshakes that are recognised when they are repeated: more than hosts begin within the life of a
/// cookie, after which nobody can repeat them.
const SEEN_MAX: usize = 256;

/// Bytes by which a public key is recognised; whoever has not the box's key cannot choose them.
pub(super) const SEEN_BYTES: usize = 8;

/// A session whose host has not yet shown that it has the key.
#[derive(Debug)]
pub(super) struct Pending {
    pub(super) peer: Peer,
    pub(super) caller: Caller,
    pub(super) channel: Channel,
    /// The beginning of the host's public key.
    pub(super) seen: [u8; SEEN_BYTES],
    /// Sent again if the host asks again.
    pub(super) acceptance: Vec<u8, ACCEPTANCE_BYTES>,
    pub(super) begun_ns: u64,
}

/// The handshakes of a box.
#[derive(Debug)]
pub(super) struct Handshakes {
    pending: [Option<Pending>; PENDING_MAX],
    /// By what the public keys of the latest ones are recognised.
    seen: Vec<[u8; SEEN_BYTES], SEEN_MAX>,
    /// Which of them is the oldest, once all places are taken.
    oldest_seen: usize,
}

impl Handshakes {
    pub(super) fn new() -> Self {
        Self { pending: [const { None }; PENDING_MAX], seen: Vec::new(), oldest_seen: 0 }
    }

    /// Those that wait.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Pending> {
        self.pending.iter().flatten()
    }

    /// Whether there has been one with this public key.
    pub(super) fn has_seen(&self, seen: &[u8; SEEN_BYTES]) -> bool {
        self.seen.contains(seen)
    }

    /// Remembers that there has been one with this public key.
    pub(super) fn see(&mut self, seen: [u8; SEEN_BYTES]) {
        if self.seen.push(seen).is_err() {
            self.seen[self.oldest_seen] = seen;
            self.oldest_seen = (self.oldest_seen + 1) % SEEN_MAX;
        }
    }

    /// Has another one wait, in a free place or in that of the oldest.
    pub(super) fn add(&mut self, pending: Pending) {
        let begun_ns = |place: &&mut Option<Pending>| place.as_ref().map(|it| it.begun_ns);
        if let Some(place) = self.pending.iter_mut().min_by_key(begun_ns) {
            *place = Some(pending);
        }
    }

    /// The session for this purpose that begins with this packet, and its message, which must be one
    /// that a host sends.
    pub(super) fn begin<B: Body>(
        &mut self,
        purpose: Purpose,
        from: Peer,
        packet: &[u8],
        is_of_host: impl FnOnce(&B) -> bool,
    ) -> Option<(Pending, B)> {
        let session = session_of(packet)?;
        let is_it = |it: &Pending| {
            let channel = &it.channel;
            it.peer == from && channel.purpose() == purpose && channel.session() == session
        };
        let place = self.pending.iter_mut().find(|it| it.as_ref().is_some_and(is_it))?;
        let message = place.as_mut()?.channel.open(packet).filter(is_of_host)?;
        let begun = place.take()?;
        // What the same program began before, and did not go on with, must not come back late.
        let process = begun.caller.process;
        self.retain(|it| it.caller.process != process || it.begun_ns > begun.begun_ns);
        Some((begun, message))
    }

    /// Forgets those that nobody has finished in time.
    pub(super) fn pass(&mut self, now_ns: u64) {
        self.retain(|it| now_ns.saturating_sub(it.begun_ns) < PENDING_NS);
    }

    fn retain(&mut self, mut is_kept: impl FnMut(&Pending) -> bool) {
        for place in &mut self.pending {
            if place.as_ref().is_some_and(|it| !is_kept(it)) {
                *place = None;
            }
        }
    }
}
