//! What a box sends to all of its listeners alike: each packet is sealed once, however many listen.
//!
//! A box draws the first key of its stream at random at each start. After [`EPOCH_PACKETS`] packets
//! the next key follows from the one before, which is then forgotten: a key that becomes known does
//! not open what was sent before it. A listener is given the key of the time at which it joins.

use super::aead::{CipherKey, KEY_BYTES};
use super::channel::{open_body, seal_body};
use super::key::Key;
use super::one_way::OneWay;
use super::window::Window;
use super::wire::{Kind, Reader, SEALED_BYTES_MAX, Writer, put_counter, take_counter};
use crate::tell::packet::{EncodeError, Message, Start};

/// Packets that are sealed with one key: an hour at 60 Hz and a little more.
pub const EPOCH_PACKETS: u64 = 1 << 18;

/// How many keys ahead of its own a listener looks for that of a packet: at 200 Hz three hours, in
/// which every listener has joined anew.
const EPOCHS_AHEAD_MAX: u64 = 8;

/// Most keys from the first one of a line without a way back: nine years at 60 Hz.
const EPOCHS_ONE_WAY_MAX: u64 = 1 << 16;

/// Words of the window of a listener: a minute at 200 Hz, and a third more.
const WINDOW_WORDS: usize = 256;

/// The key of an epoch.
#[derive(Debug, Clone)]
pub(super) struct StreamKey {
    epoch: u64,
    key: CipherKey,
}

impl StreamKey {
    pub(super) fn of_epoch(epoch: u64, key: CipherKey) -> Self {
        Self { epoch, key }
    }

    fn next(&self) -> Self {
        let key = CipherKey::derived(self.key.bytes(), "plumbline stream", &[]);
        Self { epoch: self.epoch + 1, key }
    }

    pub(super) fn epoch(&self) -> u64 {
        self.epoch
    }

    pub(super) fn bytes(&self) -> &[u8; KEY_BYTES] {
        self.key.bytes()
    }
}

/// The box's end of the stream.
#[derive(Debug)]
pub struct StreamSealer {
    key: StreamKey,
    next: u64,
}

impl StreamSealer {
    /// A stream whose first key nobody else has, and no other start had.
    pub(super) fn new(key: CipherKey) -> Self {
        Self { key: StreamKey::of_epoch(0, key), next: 0 }
    }

    /// The stream of a line without a way back.
    #[must_use]
    pub fn one_way(key: &Key, announcement: &OneWay) -> Self {
        Self::new(announcement.stream_key(key))
    }

    /// The counter of the next packet.
    #[must_use]
    pub fn next(&self) -> u64 {
        self.next
    }

    /// The key of the next packet.
    pub(super) fn key(&mut self) -> &StreamKey {
        while self.key.epoch < self.next / EPOCH_PACKETS {
            self.key = self.key.next();
        }
        &self.key
    }

    /// Seals a message for all listeners.
    ///
    /// # Errors
    /// [`EncodeError`] for a message larger than the largest.
    pub fn seal<'a>(
        &mut self,
        message: &Message,
        buffer: &'a mut [u8; SEALED_BYTES_MAX],
    ) -> Result<&'a [u8], EncodeError> {
        let counter = self.next;
        let mut writer = Writer::new(buffer, Kind::Stream);
        put_counter(&mut writer, counter);
        let packet = seal_body(writer, &self.key().key, counter, message)?;
        self.next += 1;
        Ok(packet)
    }
}

#[cfg(test)]
impl StreamSealer {
    /// As if all before this counter had been sent.
    pub(super) fn skip_to(&mut self, next: u64) {
        self.next = next;
    }
}

/// A packet of the stream that has been opened.
#[derive(Debug, Clone, PartialEq)]
pub struct Opened {
    /// Its place in the stream.
    pub counter: u64,
    /// What it says.
    pub message: Message,
}

/// A listener's end of the stream of one start of a box.
#[derive(Debug)]
pub struct StreamOpener {
    start: Start,
    key: StreamKey,
    before: Option<StreamKey>,
    window: Window<WINDOW_WORDS>,
}

impl StreamOpener {
    /// The stream of a start from this counter on, given the key of that time; and what that key
    /// opens of before, from `first` on, if it comes.
    pub(super) fn new(start: Start, first: u64, next: u64, key: StreamKey) -> Self {
        Self { start, key, before: None, window: Window::with_past(first, next) }
    }

    /// The stream of a line without a way back, from where it is now on; `None` where no box can be
    /// yet.
    #[must_use]
    pub fn one_way(key: &Key, announcement: &OneWay) -> Option<Self> {
        let mut stream = StreamKey::of_epoch(0, announcement.stream_key(key));
        let epoch = announcement.next / EPOCH_PACKETS;
        if epoch > EPOCHS_ONE_WAY_MAX {
            return None;
        }
        for _ in 0..epoch {
            stream = stream.next();
        }
        let next = announcement.next;
        Some(Self::new(announcement.start, next, next, stream))
    }

    /// The start whose stream it is.
    #[must_use]
    pub fn start(&self) -> Start {
        self.start
    }

    /// Which packets have come.
    #[must_use]
    pub fn window(&self) -> &Window<WINDOW_WORDS> {
        &self.window
    }

    /// Gives up what is missing before this counter.
    pub fn give_up_before(&mut self, counter: u64) {
        self.window.give_up_before(counter);
    }

    /// The box has sent all counters before this one.
    pub fn expect(&mut self, next: u64) {
        self.window.expect(next);
    }

    /// Joins the same stream again, with the key of this time.
    pub(super) fn join_again(&mut self, next: u64, key: StreamKey) {
        if key.epoch > self.key.epoch {
            self.before = Some(core::mem::replace(&mut self.key, key));
        }
        self.window.expect(next);
    }

    /// Opens a packet; `None` if it is not authentic, has come before or is too old, or holds no
    /// message.
    pub fn open(&mut self, packet: &[u8]) -> Option<Opened> {
        let (Kind::Stream, rest) = Kind::of(packet)? else { return None };
        let mut reader = Reader(rest);
        let counter = take_counter(&mut reader)?;
        if !self.window.is_new(counter) {
            return None;
        }
        let epoch = counter / EPOCH_PACKETS;
        let ahead = epoch.saturating_sub(self.key.epoch);
        if ahead > EPOCHS_AHEAD_MAX {
            return None;
        }
        let mut later: Option<[StreamKey; 2]> = None;
        for _ in 0..ahead {
            let last = later.as_ref().map_or(&self.key, |[_, last]| last).clone();
            let next = last.next();
            later = Some([last, next]);
        }
        let key = match (&later, &self.before) {
            (Some([_, key]), _) => key,
            (None, _) if epoch == self.key.epoch => &self.key,
            (None, Some(before)) if epoch == before.epoch => before,
            _ => return None,
        };
        let message = open_body(packet, reader.0, &key.key, counter)?;
        if let Some([before, key]) = later {
            (self.before, self.key) = (Some(before), key);
        }
        self.window.take(counter);
        Some(Opened { counter, message: message.ok()? })
    }

    /// Whether a packet that has not been opened is of this stream all the same, and has come before
    /// or is too old. A network may carry a packet twice, and one that was asked for again may have
    /// been on its way.
    #[must_use]
    pub fn is_repeated(&self, packet: &[u8]) -> bool {
        let Some((Kind::Stream, rest)) = Kind::of(packet) else { return false };
        let mut reader = Reader(rest);
        let Some(counter) = take_counter(&mut reader) else { return false };
        let keys = [Some(&self.key), self.before.as_ref()].into_iter().flatten();
        !self.window.is_new(counter)
            && keys
                .filter(|key| key.epoch == counter / EPOCH_PACKETS)
                .any(|key| open_body::<Message>(packet, reader.0, &key.key, counter).is_some())
    }
}
