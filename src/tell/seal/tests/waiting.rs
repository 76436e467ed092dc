//! Handshakes, sessions and listeners by themselves: which of them a packet is of, and how long each is
//! kept.

extern crate std;

use std::vec::Vec;

use super::super::aead::CipherKey;
use super::super::channel::Channel;
use super::super::listeners::{Listeners, SILENT_NS};
use super::super::pending::{Handshakes, PENDING_NS, Pending};
use super::super::session::{RENEW_NS, Session, Sessions};
use super::super::wire::Purpose;
use super::super::{LISTENERS_MAX, Peer, SEALED_BYTES_MAX};
use super::world::{S, address, caller};
use crate::tell::packet::{Action, Command, Message, Start};

/// When everything begins.
const BEGIN: u64 = 10_000 * S;

/// One end of a session; the keys follow from its number, so that both ends are the same.
fn channel(session: u16) -> Channel {
    let key = || CipherKey::new([session as u8 + 1; 32]);
    Channel::new(Purpose::Listening, session, key(), key())
}

/// A packet of a session.
fn packet(session: u16) -> Vec<u8> {
    let command = Command { id: 1, action: Action::SendHello, is_forced: false };
    let message = Message::Command(command);
    channel(session).seal(&message, &mut [0; SEALED_BYTES_MAX]).unwrap().to_vec()
}

fn pending(session: u16, process: u32, peer: Peer, begun_ns: u64) -> Pending {
    let (seen, acceptance) = ([0; 8], heapless::Vec::new());
    let (caller, channel) = (caller(process, "a test"), channel(session));
    Pending { peer, caller, channel, seen, acceptance, begun_ns }
}

/// The numbers of the handshakes that wait, in order.
fn waiting(handshakes: &Handshakes) -> Vec<u16> {
    let mut all: Vec<u16> = handshakes.iter().map(|it| it.channel.session()).collect();
    all.sort_unstable();
    all
}

fn begin(handshakes: &mut Handshakes, purpose: Purpose, from: Peer, packet: &[u8]) -> Option<u16> {
    let begun = handshakes.begin(purpose, from, packet, |_: &Message| true);
    begun.map(|(pending, _)| pending.channel.session())
}

#[test]
fn two_handshakes_of_each_listener_wait_and_another_takes_the_place_of_the_oldest() {
    let mut handshakes = Handshakes::new();
    let count = 2 * LISTENERS_MAX as u16;
    for session in 0..count {
        // The oldest is neither the first nor the last.
        let begun_ns = BEGIN + u64::from((session + 5) % count);
        handshakes.add(pending(session, session.into(), address(1), begun_ns));
    }
    assert!(waiting(&handshakes).into_iter().eq(0..count));
    handshakes.add(pending(count, count.into(), address(1), BEGIN + S));
    assert!(waiting(&handshakes).into_iter().eq((0..=count).filter(|it| *it != 3)));
}

#[test]
fn a_packet_begins_the_session_of_its_number_and_address_alone() {
    let full = || {
        let mut handshakes = Handshakes::new();
        for (session, peer) in [(1, 1), (2, 1), (3, 2), (4, 1)] {
            handshakes.add(pending(session, session.into(), address(peer), BEGIN));
        }
        handshakes
    };
    for (from, number, is_begun) in [
        (1, 1, true),
        (1, 2, true),
        (2, 3, true),
        (1, 4, true),
        (2, 1, false),
        (2, 2, false),
        (1, 3, false),
        (3, 4, false),
        (1, 5, false),
    ] {
        let (mut handshakes, packet) = (full(), packet(number));
        let of_update = begin(&mut handshakes, Purpose::Updating, address(from), &packet);
        assert_eq!((of_update, waiting(&handshakes).len()), (None, 4), "{number} from {from}");
        let begun = begin(&mut handshakes, Purpose::Listening, address(from), &packet);
        assert_eq!(begun, is_begun.then_some(number), "{number} from {from}");
        let left = (1..5).filter(|it| !is_begun || *it != number);
        assert!(waiting(&handshakes).into_iter().eq(left), "{number} from {from}");
    }
}

#[test]
fn what_a_program_began_later_waits_on_when_another_of_its_sessions_begins() {
    let mut handshakes = Handshakes::new();
    // Before, at once, and after; and of another program.
    for (session, process, begun_ns) in
        [(1, 7, BEGIN - 1), (2, 7, BEGIN), (3, 7, BEGIN), (4, 7, BEGIN + 1), (5, 8, BEGIN - 1)]
    {
        handshakes.add(pending(session, process, address(1), begun_ns));
    }
    let begun = begin(&mut handshakes, Purpose::Listening, address(1), &packet(2));
    assert_eq!((begun, waiting(&handshakes)), (Some(2), [4, 5].into()));
}

#[test]
fn a_handshake_waits_for_its_time_and_no_longer() {
    let mut handshakes = Handshakes::new();
    handshakes.add(pending(1, 1, address(1), BEGIN));
    handshakes.add(pending(2, 2, address(1), BEGIN + 1));
    for (after_ns, left) in
        [(PENDING_NS - 1, &[1, 2][..]), (PENDING_NS, &[2][..]), (PENDING_NS + 1, &[][..])]
    {
        handshakes.pass(BEGIN + after_ns);
        assert_eq!(waiting(&handshakes), left, "{after_ns}");
    }
}

#[test]
fn a_listener_is_heard_for_three_seconds_where_it_is() {
    let mut listeners = Listeners::new();
    listeners.join(address(1), &caller(1, "a test"), &channel(1), BEGIN).unwrap();
    for (at, after_ns, is_heard) in [
        (1, 0, true),
        (1, SILENT_NS - 1, true),
        (1, SILENT_NS, false),
        (1, 2 * SILENT_NS, false),
        (2, 0, false),
        (2, SILENT_NS, false),
    ] {
        let hears = listeners.hears(address(at), BEGIN + after_ns);
        assert_eq!(hears, is_heard, "{at} after {after_ns}");
    }
}

#[test]
fn a_silent_listener_yields_after_three_seconds_and_has_left_after_two_minutes() {
    let mut listeners = Listeners::new();
    for process in 1..=LISTENERS_MAX as u32 {
        // The third has been silent for longest.
        let heard_ns = BEGIN + u64::from(process != 3);
        let peer = address(process as usize);
        listeners.join(peer, &caller(process, "a test"), &channel(1), heard_ns).unwrap();
    }
    let mut join = |now_ns| listeners.join(address(9), &caller(9, "a test"), &channel(1), now_ns);
    assert_eq!(join(BEGIN + SILENT_NS - 1), None);
    assert_eq!(join(BEGIN + SILENT_NS).unwrap().place, 2);
    let left_ns = BEGIN + 1 + 120 * S;
    for (now_ns, left) in [(left_ns - 1, LISTENERS_MAX), (left_ns, 1)] {
        listeners.pass(now_ns);
        assert_eq!(listeners.iter().count(), left);
    }
}

fn session(number: u16, peer: usize, start: u32, begun_ns: u64) -> Session {
    Session::new(address(peer), Start::new(start).unwrap(), channel(number), begun_ns)
}

/// Something comes every second, an answer every other one, and new keys every hour.
#[test]
fn a_session_is_settled_until_one_of_its_three_times_is_over() {
    // When it was last heard and answered, and until when it is settled.
    for (heard_ns, answered_ns, until_ns) in [
        (0, None, S),
        (S / 2, None, S + S / 2),
        (10 * S, None, 2 * S),
        (10 * S, Some(3 * S), 5 * S),
        (RENEW_NS, Some(RENEW_NS), RENEW_NS),
    ] {
        let mut session = session(1, 1, 1, BEGIN);
        session.heard_ns = BEGIN + heard_ns;
        session.answered_ns = answered_ns.map(|it| BEGIN + it);
        let settled = [until_ns - 1, until_ns].map(|it| session.is_settled(BEGIN + it));
        assert_eq!(settled, [true, false], "{heard_ns} {answered_ns:?}");
    }
}

#[test]
fn a_session_is_found_by_its_number_and_address() {
    let mut sessions = Sessions::default();
    sessions.begin(session(1, 1, 1, BEGIN));
    sessions.begin(session(2, 1, 1, BEGIN));
    for (from, number, is_found) in
        [(1, 1, true), (1, 2, true), (1, 3, false), (2, 1, false), (2, 2, false)]
    {
        let found = sessions.of_channel(address(from), &packet(number));
        let found = found.map(|it| it.channel.session());
        assert_eq!(found, is_found.then_some(number), "{number} from {from}");
    }
}

/// The stream is of all sessions with this start of the box.
#[test]
fn a_session_is_heard_by_what_comes_of_its_start_from_its_address() {
    for (from, start, is_heard) in [(1, 1, true), (1, 2, false), (2, 1, false), (2, 2, false)] {
        let mut sessions = Sessions::default();
        sessions.begin(session(1, 1, 1, BEGIN));
        sessions.begin(session(2, 1, 1, BEGIN));
        sessions.heard(address(from), Start::new(start).unwrap(), BEGIN + S);
        let heard_ns: Vec<u64> = sessions.iter_mut().map(|it| it.heard_ns).collect();
        assert_eq!(heard_ns, [BEGIN + if is_heard { S } else { 0 }; 2], "{from} {start}");
    }
}

#[test]
fn the_session_before_is_kept_until_it_is_silent_for_a_second() {
    let mut sessions = Sessions::default();
    sessions.begin(session(1, 1, 1, BEGIN));
    sessions.begin(session(2, 1, 1, BEGIN));
    for (after_ns, kept) in [(S - 1, &[2, 1][..]), (S, &[2][..]), (10 * S, &[2][..])] {
        sessions.pass(BEGIN + after_ns);
        let numbers: Vec<u16> = sessions.iter_mut().map(|it| it.channel.session()).collect();
        assert_eq!(numbers, kept, "{after_ns}");
    }
}
