//! A host's way to its box: where it sends greetings, how often and for how long, and which answers it
//! takes.

extern crate std;

use std::format;
use std::vec::Vec;

use super::super::approach::Approach;
use super::super::wire::{Answer, HEAD_BYTES, Kind, Purpose, VERSIONS};
use super::super::{Announcement, BoxState, Peer, SEALED_BYTES_MAX, TOKEN_BYTES};
use super::world::{MS, S, address, caller, key};
use crate::tell::packet::{SCHEMA_HASH, Start};

/// Addresses at which a session is tried at the same time.
const PLACES: usize = 8;

/// When everything begins.
const BEGIN: u64 = 100 * S;

/// What is sent: where to, and the packet.
type Sent = (Peer, Vec<u8>);

fn approach(known: Option<Peer>) -> Approach {
    Approach::new(Purpose::Listening, key(1), caller(1, "a test"), known)
}

/// Tries this address, with random bytes that are all the same.
fn try_at(approach: &mut Approach, index: usize, now_ns: u64, byte: u8) {
    approach.try_at(address(index), now_ns, &mut || [byte; 32]);
}

/// All that is due.
fn due(approach: &mut Approach, now_ns: u64) -> Vec<Sent> {
    let mut buffer = [0; SEALED_BYTES_MAX];
    core::iter::from_fn(|| {
        let (peer, bytes) = approach.due(now_ns, &mut buffer)?;
        Some((peer, buffer[..bytes].to_vec()))
    })
    .collect()
}

/// Where to something is due.
fn peers(approach: &mut Approach, now_ns: u64) -> Vec<Peer> {
    due(approach, now_ns).into_iter().map(|it| it.0).collect()
}

/// The authentic answer of the box to a greeting with this token.
fn answer(token: [u8; TOKEN_BYTES]) -> Vec<u8> {
    let announcement = Announcement {
        key_id: Some(key(1).id()),
        start: Start::new(5).unwrap(),
        schema_hash: SCHEMA_HASH,
        versions: VERSIONS,
        state: BoxState::Ready,
        pairing_s: 0,
        text: heapless::String::new(),
    };
    let answer = Answer { token, cookie: [7; 16], announcement };
    answer.packet(Some(&key(1)), &mut [0; SEALED_BYTES_MAX]).to_vec()
}

/// The token of the greeting to an address.
fn token(sent: &[Sent], peer: Peer) -> [u8; TOKEN_BYTES] {
    let (_, packet) = sent.iter().find(|it| it.0 == peer).unwrap();
    packet[HEAD_BYTES..][..TOKEN_BYTES].try_into().unwrap()
}

/// Opens a handshake at an address that has been greeted.
fn open(approach: &mut Approach, sent: &[Sent], peer: Peer, now_ns: u64) {
    let answer = approach.answered(peer, &answer(token(sent, peer))).unwrap();
    let mut buffer = [0; SEALED_BYTES_MAX];
    let packet = approach.open(peer, &answer, now_ns, &mut || [9; 32], &mut buffer).unwrap();
    assert_eq!(Kind::of(packet).unwrap().0, Kind::Opening);
}

#[test]
fn a_greeting_is_repeated_for_a_second_and_then_begun_anew() {
    let mut approach = approach(None);
    try_at(&mut approach, 1, BEGIN, 0);
    let before = format!("{approach:?}");
    let sent = due(&mut approach, BEGIN);
    assert_eq!(sent.len(), 1);
    assert_ne!(format!("{approach:?}"), before, "tests compare what is under way by this text");
    for (after_ns, count) in [(200 * MS - 1, 0), (200 * MS, 1), (800 * MS, 1), (S, 0)] {
        assert_eq!(due(&mut approach, BEGIN + after_ns).len(), count, "{after_ns}");
    }
    try_at(&mut approach, 1, BEGIN + S - 1, 1);
    assert_eq!(peers(&mut approach, BEGIN + S), [], "one was under way");
    try_at(&mut approach, 1, BEGIN + S, 1);
    let again = due(&mut approach, BEGIN + S);
    assert_ne!(token(&again, address(1)), token(&sent, address(1)));
}

/// Whoever announces itself at such an address all the time does not have it greeted more often.
#[test]
fn an_address_that_is_of_no_use_is_left_alone_for_a_second() {
    let mut approach = approach(None);
    let all = [1, 2, 3].map(address);
    (1..=3).for_each(|index| try_at(&mut approach, index, BEGIN, 0));
    assert_eq!(peers(&mut approach, BEGIN), all);
    approach.end(address(2));
    let now_ns = BEGIN + 300 * MS;
    try_at(&mut approach, 2, now_ns, 1);
    assert_eq!(peers(&mut approach, now_ns), [all[0], all[2]]);
    try_at(&mut approach, 2, BEGIN + S, 1);
    assert_eq!(peers(&mut approach, BEGIN + S), [all[1]]);
}

#[test]
fn an_answer_is_taken_of_the_address_that_was_greeted_and_with_its_token() {
    let mut approach = approach(None);
    try_at(&mut approach, 1, BEGIN, 1);
    try_at(&mut approach, 2, BEGIN, 2);
    let sent = due(&mut approach, BEGIN);
    let tokens = [1, 2].map(|index| token(&sent, address(index)));
    for (from, token, is_taken) in [
        (1, tokens[0], true),
        (2, tokens[1], true),
        (1, tokens[1], false),
        (2, tokens[0], false),
        (3, tokens[0], false),
        (1, [9; TOKEN_BYTES], false),
    ] {
        let answered = approach.answered(address(from), &answer(token));
        assert_eq!(answered.is_some(), is_taken, "{from} {token:?}");
    }
    // Once it has been opened there the answer comes too late; elsewhere nothing has changed.
    open(&mut approach, &sent, address(1), BEGIN);
    assert!(approach.answered(address(1), &answer(tokens[0])).is_none());
    assert!(approach.answered(address(2), &answer(tokens[1])).is_some());
}

/// The time in which an unknown address may answer while others want its place is drawn at random.
#[test]
fn an_unanswered_greeting_gives_way_after_fifty_to_a_hundred_milliseconds() {
    for (byte, after_ns) in [(0, 50 * MS), (64, 62_500_000), (128, 75 * MS), (255, 99_804_687)] {
        let mut approach = approach(None);
        for index in 1..=PLACES {
            // The first one gives way first.
            try_at(&mut approach, index, BEGIN + index as u64 - 1, byte);
        }
        assert_eq!(peers(&mut approach, BEGIN).len(), PLACES);
        try_at(&mut approach, 20, BEGIN + after_ns - 1, byte);
        assert_eq!(peers(&mut approach, BEGIN + after_ns), [], "{byte}");
        try_at(&mut approach, 20, BEGIN + after_ns, byte);
        assert_eq!(peers(&mut approach, BEGIN + after_ns), [address(20)], "{byte}");
        let all = peers(&mut approach, BEGIN + 300 * MS);
        assert!(all.len() == PLACES && !all.contains(&address(1)), "{byte}: {all:?}");
    }
}

/// Announcements are not authentic: anybody can send thousands, from any address.
#[test]
fn the_known_address_and_those_that_have_answered_keep_their_places() {
    for is_announced_first in [true, false] {
        let mut approach = approach(Some(address(1)));
        for is_announced in [is_announced_first, !is_announced_first] {
            if is_announced {
                try_at(&mut approach, 1, BEGIN, 0);
            } else {
                approach.try_known(BEGIN, &mut || [0; 32]);
            }
        }
        (2..=PLACES).for_each(|index| try_at(&mut approach, index, BEGIN, index as u8));
        let sent = due(&mut approach, BEGIN);
        open(&mut approach, &sent, address(2), BEGIN);
        for round in 1..5 {
            for index in 100..200 {
                try_at(&mut approach, index, BEGIN + round * 200 * MS, 0);
            }
            let peers = peers(&mut approach, BEGIN + round * 200 * MS);
            assert!(peers.contains(&address(1)), "{is_announced_first} {round}");
            assert!(peers.contains(&address(2)), "{is_announced_first} {round}");
        }
    }
}
