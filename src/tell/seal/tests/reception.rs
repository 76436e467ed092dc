//! What a host has of the stream and asks for, and what a box keeps of it, without a network between
//! them.

extern crate std;

use std::vec::Vec;

use super::super::reception::Reception;
use super::super::{EPOCH_PACKETS, Ring, Window};
use super::epochs::{key_of, sealed, sealer};
use super::world::{MS, S};
use crate::tell::packet::Start;

/// When everything begins.
const BEGIN: u64 = 10_000 * S;

fn start() -> Start {
    Start::new(1).unwrap()
}

/// A host that has just joined, and all that the box has sent since.
struct Joined {
    reception: Reception,
    packets: Vec<Vec<u8>>,
}

impl Joined {
    fn new(count: usize) -> Self {
        let mut sealer = sealer(0);
        let mut reception = Reception::new();
        reception.join(start(), 0, key_of(&mut sealer));
        let packets = (0..count).map(|_| sealed(&mut sealer)).collect();
        Self { reception, packets }
    }

    fn come(&mut self, counters: impl IntoIterator<Item = usize>, now_ns: u64) {
        for counter in counters {
            let (_, opened) = self.reception.open(&self.packets[counter], now_ns).unwrap();
            assert_eq!(opened.unwrap().counter, counter as u64);
        }
    }

    fn asked(&mut self, after_ns: u64) -> Option<(u64, u64)> {
        self.reception.next_request(BEGIN + after_ns)
    }
}

#[test]
fn a_gap_is_asked_for_after_thirty_milliseconds_and_again_after_a_pause_of_120() {
    let mut host = Joined::new(80);
    host.come([0, 2, 3, 70], BEGIN);
    // The second request follows the first at once.
    let requests = [(1, u64::MAX ^ 0b110), (65, 0b1_1111)];
    for (after_ns, asked) in [
        (0, None),
        (30 * MS - 1, None),
        (30 * MS, Some(requests[0])),
        (30 * MS, Some(requests[1])),
        (30 * MS, None),
        (150 * MS - 1, None),
        (150 * MS, Some(requests[0])),
        (150 * MS, Some(requests[1])),
    ] {
        assert_eq!(host.asked(after_ns), asked, "{after_ns}");
    }
    // What comes of it prolongs the time.
    host.come([1], BEGIN + 200 * MS);
    assert_eq!(host.asked(320 * MS - 1), None);
    assert_eq!(host.asked(320 * MS), Some((4, u64::MAX)));
}

/// Only what has been asked for is waited for: neither what the box has not sent yet, nor another gap.
#[test]
fn the_next_request_waits_for_all_of_the_last_one_and_for_nothing_else() {
    let mut host = Joined::new(60);
    host.come([0, 2, 4, 5], BEGIN);
    assert_eq!(host.asked(0), None);
    assert_eq!(host.asked(40 * MS), Some((1, 0b101)));
    host.come([50], BEGIN + 50 * MS);
    host.come([1], BEGIN + 50 * MS);
    assert_eq!(host.asked(60 * MS), None, "3 is under way");
    host.come([3], BEGIN + 70 * MS);
    assert_eq!(host.asked(70 * MS), Some((6, (1 << 44) - 1)));
}

#[test]
fn a_gap_is_missing_as_long_as_all_packets_are_wanted() {
    let mut host = Joined::new(10);
    assert!(!host.reception.is_missing());
    host.come([0, 2, 5], BEGIN);
    let state = |it: &Reception| (it.is_missing(), it.first_missing(), it.lost());
    assert_eq!(state(&host.reception), (true, Some(1), 0));
    // Wanted as before: it is still missed.
    host.reception.want_poses(1);
    assert_eq!(state(&host.reception), (true, Some(1), 0));
    host.reception.want_poses(2);
    assert_eq!((host.reception.is_missing(), host.asked(S)), (false, None));
    // All, from now on: what was left out is not missed afterwards.
    host.reception.want_poses(1);
    assert_eq!(state(&host.reception), (false, Some(6), 0));
    host.come([8], BEGIN);
    assert_eq!(state(&host.reception), (true, Some(6), 0));
    host.reception.give_up_before(start(), 7);
    assert_eq!(state(&host.reception), (true, Some(7), 1));
}

#[test]
fn what_the_box_says_it_has_sent_of_this_start_is_expected() {
    let mut host = Joined::new(3);
    host.come([0, 1, 2], BEGIN);
    for (of, next, is_missing) in [(2, 5, false), (1, 3, false), (1, 4, true)] {
        host.reception.expect(Start::new(of).unwrap(), next);
        assert_eq!(host.reception.is_missing(), is_missing, "{next} of {of}");
    }
}

#[test]
fn a_stream_that_ends_leaves_losses_to_who_listened_and_wanted_all_of_it() {
    for (listens, every, lost) in [(true, 1, 2), (true, 2, 0), (false, 1, 0), (false, 2, 0)] {
        let mut host = Joined::new(4);
        host.come([0, 3], BEGIN);
        host.reception.want_poses(every);
        host.reception.listens = listens;
        host.reception.end();
        assert_eq!(host.reception.lost(), lost, "{listens} {every}");
        assert!(!host.reception.listens);
    }
}

#[test]
fn the_past_that_is_wanted_begins_with_the_key_that_opens_it() {
    for (next, first) in [
        (0, 0),
        (100, 0),
        (EPOCH_PACKETS, EPOCH_PACKETS),
        (3 * EPOCH_PACKETS + 7, 3 * EPOCH_PACKETS),
    ] {
        for wants_past in [false, true] {
            let mut reception = Reception::new();
            if wants_past {
                reception.want_past();
            }
            reception.join(start(), next, key_of(&mut sealer(next)));
            let expected = if wants_past { first } else { next };
            assert_eq!(reception.first_missing(), Some(expected), "{next} {wants_past}");
        }
    }
}

#[test]
fn a_window_holds_64_counters_in_each_word() {
    assert_eq!((Window::<1>::SPAN, Window::<2>::SPAN, Window::<256>::SPAN), (64, 128, 16_384));
    let mut window = Window::<2>::starting_at(7);
    window.expect(7 + 128);
    assert_eq!((window.missing().count(), window.given_up()), (128, 0));
    window.expect(7 + 129);
    assert_eq!((window.missing().next(), window.given_up()), (Some(8), 1));
}

/// A packet takes two bytes more than it has.
#[test]
fn packets_that_fill_a_ring_to_its_last_byte_are_all_kept() {
    let mut ring = Ring::<100, 10>::new();
    (0..5).for_each(|counter| ring.push(counter, &[counter as u8; 18]));
    assert_eq!(ring.kept(), 0..5);
    ring.push(5, &[5; 18]);
    assert_eq!((ring.kept(), ring.get(0), ring.get(5)), (1..6, None, Some(&[5; 18][..])));
}
