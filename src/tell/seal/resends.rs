//! What one listener has asked to be sent once more.

use heapless::Deque;

/// Requests that wait, of up to 64 packets each: twice as many as a host makes at once.
const REQUESTS_MAX: usize = 16;

#[derive(Debug)]
struct Request {
    /// The number of the command.
    id: u16,
    /// The counter of the lowest bit.
    first: u64,
    mask: u64,
}

/// What to send next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Again {
    /// The packet with this counter.
    Packet(u64),
    /// To the command with this number, that some of it is no longer there.
    Gone(u16),
}

/// The requests of a listener, in their order.
#[derive(Debug, Default)]
pub(super) struct Resends {
    requests: Deque<Request, REQUESTS_MAX>,
}

impl Resends {
    /// Takes a request. One for which there is no room is dropped: whoever still misses something
    /// asks again.
    pub(super) fn ask(&mut self, id: u16, first: u64, mask: u64) {
        if let Some(asked) = self.requests.iter_mut().find(|it| it.first == first) {
            asked.mask |= mask;
        } else {
            let _ = self.requests.push_back(Request { id, first, mask });
        }
    }

    /// What to send next, when the packets with these counters are kept; those after them have not
    /// been sent a first time, and are left out.
    pub(super) fn next(&mut self, kept: core::ops::Range<u64>) -> Option<Again> {
        while let Some(request) = self.requests.front_mut() {
            let lowest = request.mask.trailing_zeros();
            let counter = request.first.checked_add(lowest.into()).filter(|_| request.mask != 0);
            let Some(counter) = counter.filter(|&counter| counter < kept.end) else {
                self.requests.pop_front();
                continue;
            };
            if counter < kept.start {
                let gone = kept.start - request.first;
                request.mask &= u64::MAX.checked_shl(gone.min(64) as u32).unwrap_or(0);
                return Some(Again::Gone(request.id));
            }
            request.mask &= request.mask - 1;
            return Some(Again::Packet(counter));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    fn all(resends: &mut Resends, kept: core::ops::Range<u64>) -> Vec<Again> {
        core::iter::from_fn(|| resends.next(kept.clone())).collect()
    }

    #[test]
    fn what_is_kept_comes_in_order_and_what_is_gone_is_said_once_for_each_request() {
        use Again::{Gone, Packet};
        let mut resends = Resends::default();
        resends.ask(7, 10, 0b1011);
        resends.ask(8, 100, 1 << 63 | 1);
        resends.ask(7, 10, 0b100);
        let expected = [Packet(10), Packet(11), Packet(12), Packet(13), Packet(100), Packet(163)];
        assert_eq!(all(&mut resends, 0..1_000), expected);
        resends.ask(7, 10, 0b1011);
        resends.ask(8, 12, u64::MAX);
        resends.ask(9, 500, u64::MAX);
        assert_eq!(all(&mut resends, 13..14), [Gone(7), Packet(13), Gone(8), Packet(13)]);
        resends.ask(1, 10, u64::MAX);
        assert_eq!(all(&mut resends, 5_000..6_000), [Gone(1)]);
    }

    #[test]
    fn nonsense_is_left_out() {
        let mut resends = Resends::default();
        resends.ask(1, u64::MAX, u64::MAX);
        resends.ask(1, u64::MAX - 3, u64::MAX);
        resends.ask(1, 5, 0);
        assert_eq!(all(&mut resends, 0..1_000), []);
        assert_eq!(all(&mut resends, 0..u64::MAX), []);
    }

    #[test]
    fn more_requests_than_there_is_room_for_are_dropped() {
        let mut resends = Resends::default();
        (0..1_000).for_each(|index| resends.ask(1, index * 64, 1));
        assert_eq!(all(&mut resends, 0..100_000).len(), REQUESTS_MAX);
        assert_eq!(all(&mut resends, 0..100_000), []);
    }
}
