//! What a host asks for once more: the packets of the stream that it misses, until they come or are
//! gone.

use heapless::Vec;

use super::stream::StreamOpener;

/// A gap may be closed by packets that were overtaken, for this long.
const OVERTAKEN_NS: u64 = 30_000_000;

/// What was asked for comes without pauses as long as this.
const QUIET_NS: u64 = 120_000_000;

/// Requests, of up to 64 packets each, that are sent at once.
const REQUESTS_MAX: usize = 8;

/// What has been asked for.
#[derive(Debug, Default)]
pub(super) struct Requests {
    /// When something was first seen to be missing.
    noticed_ns: Option<u64>,
    /// First counter and mask.
    asked: Vec<(u64, u64), REQUESTS_MAX>,
    /// The number of them that have been sent.
    sent: usize,
    /// When one was sent, or some of it came.
    moved_ns: u64,
}

impl Requests {
    /// Something that was missing has come.
    pub(super) fn moved(&mut self, now_ns: u64) {
        self.moved_ns = now_ns;
    }

    /// The next request that is due: the first counter, and which of those from it on, the lowest
    /// bit first.
    pub(super) fn next(&mut self, stream: &StreamOpener, now_ns: u64) -> Option<(u64, u64)> {
        let mut missing = stream.window().missing().peekable();
        if missing.peek().is_none() {
            *self = Self::default();
            return None;
        }
        let noticed_ns = *self.noticed_ns.get_or_insert(now_ns);
        if self.sent == self.asked.len() {
            let is_missing = |&(first, mask): &(u64, u64)| {
                let mut bits = (0..64).filter(|bit| mask & (1 << bit) != 0);
                bits.any(|bit| stream.window().is_new(first + bit))
            };
            let awaits = self.asked.iter().any(is_missing);
            let quiet_ns = now_ns.saturating_sub(self.moved_ns);
            let is_early = now_ns.saturating_sub(noticed_ns) < OVERTAKEN_NS;
            if is_early || (awaits && quiet_ns < QUIET_NS) {
                return None;
            }
            self.asked.clear();
            self.sent = 0;
            while let Some(first) = missing.next() {
                let mut mask = 1;
                while let Some(counter) = missing.next_if(|counter| counter - first < 64) {
                    mask |= 1 << (counter - first);
                }
                if self.asked.push((first, mask)).is_err() {
                    break;
                }
            }
        }
        let request = *self.asked.get(self.sent)?;
        self.sent += 1;
        self.moved_ns = now_ns;
        Some(request)
    }
}
