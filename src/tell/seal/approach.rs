//! A host's way to a session with its box: which box it looks for, where that was last, and the handshakes
//! that are under way.

use zeroize::Zeroizing;

use super::Peer;
use super::aead::KEY_BYTES;
use super::attempts::{Acceptance, Attempts, Opening};
use super::key::{Key, KeyId};
use super::listeners::Caller;
use super::wire::{Announcement, Answer, Purpose, SEALED_BYTES_MAX, VERSIONS};
use crate::tell::packet::Start;

/// A host's way to its box.
#[derive(Debug)]
pub(super) struct Approach {
    purpose: Purpose,
    key: Key,
    key_id: KeyId,
    /// The versions of the protocol that this program speaks.
    versions: [u8; 2],
    caller: Caller,
    /// Where the box was last.
    known: Option<Peer>,
    attempts: Attempts,
}

impl Approach {
    /// That of a program that wants sessions of this kind with the box with this key, and may know where it
    /// is.
    pub(super) fn new(purpose: Purpose, key: Key, caller: Caller, known: Option<Peer>) -> Self {
        Self {
            purpose,
            key_id: key.id(),
            key,
            versions: VERSIONS,
            caller,
            known,
            attempts: Attempts::default(),
        }
    }

    /// The box's key.
    pub(super) fn key(&self) -> &Key {
        &self.key
    }

    /// Tries the box where it was last.
    pub(super) fn try_known(&mut self, now_ns: u64, draw: &mut impl FnMut() -> [u8; KEY_BYTES]) {
        if let Some(known) = self.known {
            self.attempts.begin(known, true, now_ns, draw);
        }
    }

    /// Tries the box at this address, at which it is perhaps.
    pub(super) fn try_at(
        &mut self,
        peer: Peer,
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
    ) {
        self.attempts.begin(peer, false, now_ns, draw);
    }

    /// Writes the next message that is due; returns where to, and its length.
    pub(super) fn due(
        &mut self,
        now_ns: u64,
        buffer: &mut [u8; SEALED_BYTES_MAX],
    ) -> Option<(Peer, usize)> {
        self.attempts.due(now_ns, buffer)
    }

    /// The start of this box that a packet announces. It is not authentic, and may do no more than have this
    /// end greet an address.
    pub(super) fn announced(&self, packet: &[u8]) -> Option<Start> {
        let announcement = Announcement::parse(packet)?;
        (announcement.key_id == Some(self.key_id)).then_some(announcement.start)
    }

    /// The answer of this box to a greeting of this end.
    pub(super) fn answered(&self, from: Peer, packet: &[u8]) -> Option<Answer> {
        self.attempts.answer(from, packet, &self.key)
    }

    /// Sends nothing more to an address, and does not begin again there so soon.
    pub(super) fn end(&mut self, peer: Peer) {
        self.attempts.end(peer);
    }

    /// The opening that follows an answer from an address.
    pub(super) fn open<'a>(
        &mut self,
        peer: Peer,
        answer: &Answer,
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let secret = Zeroizing::new(draw());
        let Self { purpose, versions, key, caller, .. } = self;
        let opening = Opening::new(*purpose, *versions, key, answer, caller, &secret)?;
        self.attempts.open(peer, opening, now_ns, buffer)
    }

    /// What an acceptance of an opening of this end says; the box is there from now on.
    pub(super) fn accepted(&mut self, from: Peer, rest: &[u8]) -> Option<Acceptance> {
        let acceptance = self.attempts.accepted(from, rest)?;
        self.known = Some(from);
        Some(acceptance)
    }
}

/// What tests want to be otherwise.
#[cfg(test)]
impl Approach {
    /// Gives itself out for a program with another key.
    pub(super) fn pretend(&mut self, key_id: KeyId) {
        self.key_id = key_id;
    }

    /// Gives itself out for a program of another release.
    pub(super) fn speak(&mut self, versions: [u8; 2]) {
        self.versions = versions;
    }
}
