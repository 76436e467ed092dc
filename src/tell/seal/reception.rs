//! What a host has of the stream of its box: what has come, what may still come, and what is lost.

use super::missing::Requests;
use super::stream::{EPOCH_PACKETS, Opened, StreamKey, StreamOpener};
use crate::tell::packet::Start;

/// Packets of which only some are wanted may be late by as many as these.
const OVERTAKEN_PACKETS: u64 = 1_024;

/// The stream of one start of a box, and of the starts before what is lost of theirs.
#[derive(Debug)]
pub(super) struct Reception {
    stream: Option<StreamOpener>,
    /// Whether the box has taken this end as a listener of that stream.
    pub(super) listens: bool,
    requests: Requests,
    /// Packets that were wanted and will not come.
    lost: u64,
    /// Which poses are wanted: every such one.
    every: u16,
    /// Whether what the box still has of before is wanted too.
    wants_past: bool,
}

impl Reception {
    /// Of nothing yet; all poses are wanted.
    pub(super) fn new() -> Self {
        Self {
            stream: None,
            listens: false,
            requests: Requests::default(),
            lost: 0,
            every: 1,
            wants_past: false,
        }
    }

    /// Wants what the box has kept of the time before as well.
    pub(super) fn want_past(&mut self) {
        self.wants_past = true;
    }

    /// Which poses are wanted: every such one.
    pub(super) fn every(&self) -> u16 {
        self.every
    }

    /// Wants every such pose only.
    pub(super) fn want_poses(&mut self, every: u16) {
        if self.every != 1
            && let Some(stream) = &mut self.stream
        {
            // All, from now on.
            stream.give_up_before(stream.window().next());
        }
        self.every = every;
    }

    /// The number of packets that are lost for good.
    pub(super) fn lost(&self) -> u64 {
        self.lost
    }

    /// Whether packets are missing that may still come.
    pub(super) fn is_missing(&self) -> bool {
        self.every == 1
            && self.stream.as_ref().is_some_and(|it| it.window().missing().next().is_some())
    }

    /// The lowest counter that may still come.
    pub(super) fn first_missing(&self) -> Option<u64> {
        let window = self.stream.as_ref()?.window();
        Some(window.missing().next().unwrap_or(window.next()))
    }

    /// The box has given the key of the stream of this start, which is at this counter.
    pub(super) fn join(&mut self, start: Start, next: u64, key: StreamKey) {
        match &mut self.stream {
            Some(stream) if stream.start() == start => stream.join_again(next, key),
            _ => {
                self.end();
                let first = if self.wants_past { next - next % EPOCH_PACKETS } else { next };
                self.stream = Some(StreamOpener::new(start, first, next, key));
            }
        }
    }

    /// What is to be asked for now: the first counter, and which of those from it on, the lowest bit
    /// first.
    pub(super) fn next_request(&mut self, now_ns: u64) -> Option<(u64, u64)> {
        let stream = self.stream.as_ref().filter(|_| self.every == 1)?;
        self.requests.next(stream, now_ns)
    }

    /// All packets before this counter have been sent.
    pub(super) fn expect(&mut self, start: Start, next: u64) {
        self.decide_of(start, |stream| stream.expect(next));
    }

    /// The box has no packet before this counter any more.
    pub(super) fn give_up_before(&mut self, start: Start, first: u64) {
        self.decide_of(start, |stream| stream.give_up_before(first));
    }

    /// Opens a packet; returns the start that it is of, and `None` beside it for one that has come
    /// before. `None` alone: it is not authentic.
    pub(super) fn open(&mut self, packet: &[u8], now_ns: u64) -> Option<(Start, Option<Opened>)> {
        let stream = self.stream.as_ref()?;
        let (start, before) = (stream.start(), stream.window().next());
        let Some(opened) = self.decide(|stream| stream.open(packet))? else {
            let is_repeated = self.stream.as_ref()?.is_repeated(packet);
            return is_repeated.then_some((start, None));
        };
        self.listens = true;
        if opened.counter < before {
            self.requests.moved(now_ns);
        }
        Some((start, Some(opened)))
    }

    /// What is still missing of this stream is gone with it.
    pub(super) fn end(&mut self) {
        let is_wanted = self.listens && self.every == 1;
        if let Some(stream) = self.stream.take().filter(|_| is_wanted) {
            self.lost = self.lost.saturating_add(stream.window().owed());
        }
        self.listens = false;
        self.requests = Requests::default();
    }

    fn decide_of(&mut self, start: Start, change: impl FnMut(&mut StreamOpener)) {
        if self.stream.as_ref().is_some_and(|it| it.start() == start) {
            self.decide(change);
        }
    }

    /// Takes note of what has come or will not come of the stream. What is given up is lost if all of
    /// it was wanted.
    fn decide<T>(&mut self, mut change: impl FnMut(&mut StreamOpener) -> T) -> Option<T> {
        let stream = self.stream.as_mut()?;
        let before = stream.window().given_up();
        let changed = change(stream);
        if self.every == 1 {
            let given_up = stream.window().given_up() - before;
            self.lost = self.lost.saturating_add(given_up);
        } else {
            stream.give_up_before(stream.window().next().saturating_sub(OVERTAKEN_PACKETS));
        }
        Some(changed)
    }
}
