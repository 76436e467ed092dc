//! A host's end of the link to a box that it updates, of whatever release that is.
//!
//! It sends and receives nothing itself, as [`HostEnd`](super::HostEnd). It has no part in the stream
//! and sends nothing by itself once there is a session: who updates a box asks it all the time.
//!
//! ```text
//!            Announcement ─┐
//! no session, or silent ───┴▶ Greeting ─▶ Answer ─▶ UpdateOpening ─▶ UpdateAcceptance ─▶ session
//! ```

use super::Peer;
use super::aead::KEY_BYTES;
use super::approach::Approach;
use super::attempts::Acceptance;
use super::channel::{Channel, session_of};
use super::key::Key;
use super::listeners::Caller;
use super::wire::{Kind, Purpose, SEALED_BYTES_MAX};
use crate::tell::packet::{EncodeError, Start, UpdateReply, UpdateRequest};

/// A session in which nothing has come for this long is tried again from the beginning.
const SILENT_NS: u64 = 3_000_000_000;

/// What a packet has turned out to be.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap on which to put the reply")]
pub enum ToldOfUpdate<'a> {
    /// Not authentic, or of no use here.
    Nothing,
    /// Part of a handshake: send this to where it came from, if there is something to send.
    Handshake(Option<&'a [u8]>),
    /// The box says this.
    Reply {
        /// The start of the box.
        start: Start,
        /// What it says.
        reply: UpdateReply,
    },
}

/// The session with one start of a box.
#[derive(Debug)]
struct Session {
    peer: Peer,
    start: Start,
    channel: Channel,
    heard_ns: u64,
}

/// A host's end of the link to a box that it updates.
#[derive(Debug)]
pub struct UpdateEnd {
    approach: Approach,
    session: Option<Session>,
}

impl UpdateEnd {
    /// The end of a program that wants to update the box with this key, and may know where it is.
    #[must_use]
    pub fn new(key: Key, caller: Caller, known: Option<Peer>) -> Self {
        Self { approach: Approach::new(Purpose::Updating, key, caller, known), session: None }
    }

    /// The box's key.
    #[must_use]
    pub fn key(&self) -> &Key {
        self.approach.key()
    }

    /// Where the box is with which there is a session.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.session.as_ref().map(|it| it.peer)
    }

    /// The next packet that is due, and where to; to be asked until there is none.
    pub fn due<'a>(
        &mut self,
        now_ns: u64,
        mut draw: impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<(Peer, &'a [u8])> {
        let is_silent = |it: &Session| now_ns.saturating_sub(it.heard_ns) >= SILENT_NS;
        if self.session.as_ref().is_none_or(is_silent) {
            self.approach.try_known(now_ns, &mut draw);
        }
        let (peer, bytes) = self.approach.due(now_ns, buffer)?;
        Some((peer, &buffer[..bytes]))
    }

    /// Seals a request for the box; `None` without a session.
    ///
    /// # Errors
    /// [`EncodeError`] for a request larger than the largest.
    pub fn seal<'a>(
        &mut self,
        request: &UpdateRequest,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Option<Result<(Peer, &'a [u8]), EncodeError>> {
        let session = self.session.as_mut()?;
        let packet = session.channel.seal(request, buffer);
        Some(packet.map(|packet| (session.peer, packet)))
    }

    /// Takes a packet.
    pub fn receive<'a>(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        mut draw: impl FnMut() -> [u8; KEY_BYTES],
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> ToldOfUpdate<'a> {
        let Some((kind, rest)) = Kind::of(packet) else { return ToldOfUpdate::Nothing };
        let told = match kind {
            Kind::Announcement => self
                .announced(from, packet, now_ns, &mut draw)
                .map(|()| ToldOfUpdate::Handshake(None)),
            Kind::Answer => self
                .approach
                .answered(from, packet)
                .and_then(|it| self.approach.open(from, &it, now_ns, &mut draw, buffer))
                .map(|packet| ToldOfUpdate::Handshake(Some(packet))),
            Kind::UpdateAcceptance => {
                self.accepted(from, rest, now_ns).map(|()| ToldOfUpdate::Handshake(None))
            }
            Kind::UpdateChannel => self.replied(from, packet, now_ns),
            _ => None,
        };
        told.unwrap_or(ToldOfUpdate::Nothing)
    }

    /// Whether there is a session with this start of the box.
    fn has_met(&self, start: Start) -> bool {
        self.session.as_ref().is_some_and(|it| it.start == start)
    }

    /// Takes note of an announcement of this box: another start of it is met at once.
    fn announced(
        &mut self,
        from: Peer,
        packet: &[u8],
        now_ns: u64,
        draw: &mut impl FnMut() -> [u8; KEY_BYTES],
    ) -> Option<()> {
        if !self.has_met(self.approach.announced(packet)?) {
            self.approach.try_at(from, now_ns, draw);
        }
        Some(())
    }

    /// The session that follows an acceptance of an opening of this end.
    fn accepted(&mut self, from: Peer, rest: &[u8], now_ns: u64) -> Option<()> {
        let Acceptance { start, channel, .. } = self.approach.accepted(from, rest)?;
        self.session = Some(Session { peer: from, start, channel, heard_ns: now_ns });
        Some(())
    }

    fn replied(&mut self, from: Peer, packet: &[u8], now_ns: u64) -> Option<ToldOfUpdate<'static>> {
        let session = self.session.as_mut()?;
        if session.peer != from || session_of(packet)? != session.channel.session() {
            return None;
        }
        let reply = session.channel.open(packet)?;
        session.heard_ns = now_ns;
        Some(ToldOfUpdate::Reply { start: session.start, reply })
    }
}

/// What tests want to be otherwise.
#[cfg(test)]
impl UpdateEnd {
    /// Gives itself out for a program of another release.
    pub(super) fn speak(&mut self, versions: [u8; 2]) {
        self.approach.speak(versions);
    }
}
