//! The latest packets of the stream, as they were sealed, for listeners that have missed some.

use crate::limits::{RING_BYTES, RING_PACKETS};

/// The ring of a box.
pub type StreamRing = Ring<RING_BYTES, RING_PACKETS>;

/// The latest packets: as many as fit into `BYTES`, with two bytes more for each, and no more than
/// `PACKETS`.
#[derive(Debug)]
pub struct Ring<const BYTES: usize, const PACKETS: usize> {
    bytes: [u8; BYTES],
    /// Where each packet begins, by the remainder of its counter.
    places: [u32; PACKETS],
    /// The counters that are kept.
    first: u64,
    next: u64,
    /// Where the next packet begins, unless it does not fit before the end.
    end: usize,
}

/// Bytes of a packet's length.
const LENGTH_BYTES: usize = 2;

impl<const BYTES: usize, const PACKETS: usize> Ring<BYTES, PACKETS> {
    /// With nothing in it.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [0; BYTES], places: [0; PACKETS], first: 0, next: 0, end: 0 }
    }

    /// The counters of the packets that are kept.
    #[must_use]
    pub fn kept(&self) -> core::ops::Range<u64> {
        self.first..self.next
    }

    /// Keeps a packet, in place of the oldest ones. A counter that does not follow the one before
    /// begins anew.
    ///
    /// # Panics
    /// When the packet is larger than the ring: a caller's bug.
    pub fn push(&mut self, counter: u64, packet: &[u8]) {
        let bytes = LENGTH_BYTES + packet.len();
        assert!(bytes <= BYTES && packet.len() <= usize::from(u16::MAX), "a packet that fits");
        if counter != self.next {
            (self.first, self.next, self.end) = (counter, counter, 0);
        }
        if BYTES - self.end < bytes {
            // What lies beyond the end of the last round is the oldest.
            self.drop_within(self.end..BYTES);
            self.end = 0;
        }
        self.drop_within(self.end..self.end + bytes);
        if self.next - self.first == PACKETS as u64 {
            self.first += 1;
        }
        let place = &mut self.bytes[self.end..][..bytes];
        place[..LENGTH_BYTES].copy_from_slice(&(packet.len() as u16).to_le_bytes());
        place[LENGTH_BYTES..].copy_from_slice(packet);
        self.places[Self::slot(counter)] = self.end as u32;
        self.end += bytes;
        self.next = counter + 1;
    }

    /// The packet with this counter, if it is still kept.
    #[must_use]
    pub fn get(&self, counter: u64) -> Option<&[u8]> {
        if !(self.first..self.next).contains(&counter) {
            return None;
        }
        let from = self.bytes.get(self.places[Self::slot(counter)] as usize..)?;
        let (length, rest) = from.split_first_chunk::<LENGTH_BYTES>()?;
        rest.get(..usize::from(u16::from_le_bytes(*length)))
    }

    /// Drops the oldest packets that begin within these bytes.
    fn drop_within(&mut self, room: core::ops::Range<usize>) {
        while self.first < self.next
            && room.contains(&(self.places[Self::slot(self.first)] as usize))
        {
            self.first += 1;
        }
    }

    fn slot(counter: u64) -> usize {
        (counter % PACKETS as u64) as usize
    }
}

impl<const BYTES: usize, const PACKETS: usize> Default for Ring<BYTES, PACKETS> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::VecDeque;
    use std::vec::Vec;

    use super::*;
    use crate::test_support::Random;

    #[test]
    fn the_latest_packets_come_back_as_they_were() {
        for seed in 0..10 {
            let mut random = Random::new(seed);
            let mut ring = Ring::<1_000, 40>::new();
            let mut kept: VecDeque<Vec<u8>> = VecDeque::new();
            for counter in 0..2_000_u64 {
                let length = (random.bits() % if seed % 2 == 0 { 20 } else { 200 }) as usize;
                let packet: Vec<u8> = (0..length).map(|_| random.bits() as u8).collect();
                ring.push(counter, &packet);
                kept.push_back(packet);
                let first = ring.kept().start;
                while (counter + 1 - first) < kept.len() as u64 {
                    kept.pop_front();
                }
                for (index, packet) in kept.iter().enumerate() {
                    assert_eq!(ring.get(first + index as u64), Some(&packet[..]), "seed {seed}");
                }
                assert!(ring.get(counter + 1).is_none());
                assert!(first.checked_sub(1).is_none_or(|before| ring.get(before).is_none()));
                // Either is used up but for what one packet of the largest size may leave unused.
                let bytes: usize = kept.iter().map(|packet| packet.len() + LENGTH_BYTES).sum();
                let is_full = kept.len() == 40 || bytes >= 1_000 - 2 * 202;
                assert!(counter < 40 || is_full, "seed {seed}: {bytes} bytes in {}", kept.len());
            }
        }
    }

    #[test]
    fn a_counter_that_does_not_follow_begins_anew() {
        let mut ring = Ring::<100, 10>::new();
        ring.push(3, &[1; 10]);
        ring.push(4, &[2; 10]);
        assert_eq!((ring.kept(), ring.get(3)), (3..5, Some(&[1; 10][..])));
        ring.push(9, &[3; 10]);
        assert_eq!((ring.kept(), ring.get(4), ring.get(9)), (9..10, None, Some(&[3; 10][..])));
    }
}
