//! Whoever has not the key changes nothing, and learns nothing but that there is a box.

extern crate std;

use std::format;
use std::string::String;
use std::vec::Vec;

use super::super::cookie::COOKIE_PERIOD_NS;
use super::super::pending::PENDING_NS;
use super::super::wire::{Answer, HEAD_BYTES, Kind, greeting};
use super::super::{Announcement, BoxState, Peer, SEALED_BYTES_MAX};
use super::world::{BoxSide, HostSide, MS, S, Weather, World, address, key};
use crate::tell::packet::{Action, Command, Message, PROTOCOL_VERSION, SCHEMA_HASH, Start};
use crate::test_support::repetitions;

type Sent = (Peer, Peer, Vec<u8>);

fn state(world: &World) -> String {
    let hosts = world.hosts.iter().map(|it| format!("{:?}", it.end));
    format!("{:?}", world.bx.as_ref().unwrap().end) + &hosts.collect::<String>()
}

fn kind(packet: &[u8]) -> Option<Kind> {
    Kind::of(packet).map(|it| it.0)
}

/// All that was sent in some seconds of a box with two hosts.
fn recorded(world: &mut World, duration_ns: u64) -> Vec<Sent> {
    world.log = Some(Vec::new());
    world.run(duration_ns);
    world.log.take().unwrap()
}

/// Gives a packet to box and hosts, which must not care.
fn check_ignored(world: &mut World, from: Peer, to: Peer, packet: &[u8]) {
    let before = state(world);
    check_all_ignored(world, &before, &[(from, to, packet)]);
}

/// Gives several packets to box and hosts, after all of which they must be as `before`: to write that
/// down takes much longer than to refuse a packet.
fn check_all_ignored(world: &mut World, before: &str, packets: &[(Peer, Peer, &[u8])]) {
    for &(from, to, packet) in packets {
        check_unanswered(world, from, to, packet);
    }
    assert_eq!(state(world), before, "by one of {packets:?}");
}

/// Gives a packet to box and hosts, which must not answer.
fn check_unanswered(world: &mut World, from: Peer, to: Peer, packet: &[u8]) {
    if to == world.at {
        for answer in world.box_receives(from, packet) {
            let is_answer =
                (kind(packet), kind(&answer)) == (Some(Kind::Greeting), Some(Kind::Answer));
            assert!(is_answer, "{packet:?} is answered by {answer:?}");
            assert!(answer.len() <= packet.len());
        }
    } else {
        let index = world.hosts.iter().position(|it| it.peer == to).unwrap();
        let answer = world.host_receives(index, from, packet);
        assert!(answer.is_none(), "{packet:?} is answered");
    }
}

#[test]
fn what_is_not_authentic_changes_nothing() {
    // Another box with its own host, an earlier start of this one, and today's.
    let mut other = World::new(10, Weather::default());
    other.bx = Some(BoxSide::new(key(2), &mut other.random));
    other.hosts.push(HostSide::new(key(2), 1, address(1), Some(other.at)));
    let mut packets = recorded(&mut other, 2 * S);
    let mut world = World::new(11, Weather::default()).with_hosts(2);
    packets.extend(recorded(&mut world, 2 * S));
    world.bx = Some(BoxSide::new(key(1), &mut world.random));
    packets.extend(recorded(&mut world, 4 * S));
    // All that is under way arrives.
    world.streams = false;
    packets.extend(recorded(&mut world, 200 * MS));
    world.bx().announced_ns = world.now_ns;
    world.now_ns += 10 * MS;

    let (at, first, second) = (world.at, world.hosts[0].peer, world.hosts[1].peer);
    let mut kinds = std::collections::BTreeMap::<String, usize>::new();
    for _ in 0..repetitions(10_000) {
        let mut pick = |count: usize| (world.random.bits() % count as u64) as usize;
        let (from, to, mut packet) = packets[pick(packets.len())].clone();
        // Rare kinds as often as the stream.
        if kind(&packet) == Some(Kind::Stream) && pick(10) > 0 {
            continue;
        }
        let tampering = pick(8);
        let (mut from, mut to) = (from, if to == at { at } else { first });
        match tampering {
            0 => {} // Replayed as it was.
            1 => packet.truncate(pick(packet.len())),
            2..5 => {
                let bit = pick(packet.len() * 8);
                packet[bit / 8] ^= 1 << (bit % 8);
            }
            5 => (from, to) = (to, from), // Reflected.
            6 => from = address(1_000 + pick(1_000)),
            _ => packet.extend((0..pick(9)).map(|it| it as u8)),
        }
        if to != at && to != first && to != second {
            to = if from == at { first } else { at };
        }
        // Greetings are for everybody, and what a host hears in clear makes it greet: see below.
        if matches!(kind(&packet), Some(Kind::Announcement)) && to != at {
            continue;
        }
        *kinds.entry(format!("{:?} {tampering}", kind(&packet))).or_default() += 1;
        check_ignored(&mut world, from, to, &packet);
        if tampering == 6 && to == at {
            check_ignored(&mut world, if from == first { second } else { first }, to, &packet);
        }
    }
    // A tenth of the packets has about half of the kinds.
    let least = if repetitions(10) == 10 { 40 } else { 20 };
    assert!(kinds.len() > least, "{kinds:?}");
    // And both ends still understand each other.
    world.streams = true;
    let start = world.bx().start;
    let count = world.hosts[0].count(start);
    world.run(S);
    assert!(world.hosts[0].count(start) > count + 190);
    assert_eq!(world.hosts[0].end.lost(), 0);
}

#[test]
fn packets_made_up_at_random_change_nothing() {
    let mut world = World::new(12, Weather::default()).with_hosts(2);
    world.run(2 * S);
    let at = world.at;
    let before = state(&world);
    for _ in 0..repetitions(10_000) {
        let length = (world.random.bits() % 300) as usize;
        let mut packet: Vec<u8> = (0..length).map(|_| world.random.bits() as u8).collect();
        let kind = [1, 2, 3, 4, 5, 6, 6, 6, 7, 7, 7, 8, 9, 10, 11, 12, 13, 13]
            [(world.random.bits() % 18) as usize];
        packet.iter_mut().zip([PROTOCOL_VERSION, kind, 0, 0, 0]).for_each(|(is, new)| *is = new);
        let host = world.hosts[(world.random.bits() % 2) as usize].peer;
        let stranger = address(500);
        let ways = [(host, at), (stranger, at), (at, host), (stranger, host)];
        check_all_ignored(&mut world, &before, &ways.map(|(from, to)| (from, to, &packet[..])));
    }
}

/// A program with another key gets as far as the cookie.
#[test]
fn another_key_opens_nothing() {
    let mut world = World::new(13, Weather::default()).with_hosts(1);
    world.run(S);
    // It has learned the id, and pretends.
    let mut thief = HostSide::new(key(3), 9, address(9), Some(world.at));
    thief.end.pretend(key(1).id());
    world.hosts.push(thief);
    world.log = Some(Vec::new());
    world.run(5 * S);
    let log = world.log.take().unwrap();
    let of_thief = |of: Kind| {
        let is_it =
            |it: &&Sent| kind(&it.2) == Some(of) && (it.0 == address(9) || it.1 == address(9));
        log.iter().filter(is_it).count()
    };
    assert!(of_thief(Kind::Greeting) > 0 && of_thief(Kind::Answer) > 0);
    assert_eq!((of_thief(Kind::Acceptance), of_thief(Kind::Channel)), (0, 0));
    assert_eq!(world.bx().end.listeners().len(), 1);
    assert_eq!(world.hosts[1].end.peer(), None);
}

/// The openings of hosts in the last minutes, with which nobody else gets anything.
#[test]
fn a_replayed_opening_is_worth_nothing() {
    let mut world = World::new(14, Weather::default()).with_hosts(1);
    world.log = Some(Vec::new());
    // More handshakes than are remembered.
    for process in 10..400 {
        let peer = world.hosts[0].peer;
        world.hosts[0] = HostSide::new(key(1), process, peer, Some(world.at));
        world.streams = false;
        world.run(100 * MS);
    }
    let log = world.log.take().unwrap();
    let openings: Vec<Sent> =
        log.into_iter().filter(|it| kind(&it.2) == Some(Kind::Opening)).collect();
    assert!(openings.len() >= 390);
    world.run(PENDING_NS);
    let at = world.at;
    for after_ns in [0, COOKIE_PERIOD_NS, 2 * COOKIE_PERIOD_NS, 10 * COOKIE_PERIOD_NS] {
        world.now_ns += after_ns;
        let now_ns = world.now_ns;
        world.bx().end.pass(now_ns);
        // A cookie of the thief's own, fresh.
        let thief = address(99);
        let mut buffer = [0; SEALED_BYTES_MAX];
        let answers = {
            let hello = greeting([1; 8], &mut buffer).to_vec();
            world.box_receives(thief, &hello)
        };
        let cookie = Answer::read(&answers[0]).unwrap().cookie;
        let before = state(&world);
        for (from, _, packet) in &openings {
            let mut with_cookie = packet.clone();
            with_cookie[HEAD_BYTES..][..cookie.len()].copy_from_slice(&cookie);
            let packets =
                [(*from, at, &packet[..]), (thief, at, packet), (thief, at, &with_cookie)];
            check_all_ignored(&mut world, &before, &packets);
        }
    }
}

/// While a handshake is pending its opening may be repeated, but not by others, and not longer than
/// the box answers.
#[test]
fn a_pending_opening_is_answered_only_to_who_sent_it() {
    let mut world = World::new(15, Weather::default());
    let peer = address(1);
    world.hosts.push(HostSide::new(key(1), 1, peer, Some(world.at)));
    world.log = Some(Vec::new());
    let is_pending = |world: &World| world.bx.as_ref().unwrap().end.pending().next().is_some();
    world.run_until(S, is_pending);
    let log = world.log.take().unwrap();
    let opening = log.iter().find(|it| kind(&it.2) == Some(Kind::Opening)).unwrap().2.clone();
    let before = state(&world);
    let again = world.box_receives(peer, &opening);
    assert_eq!((again.len(), kind(&again[0])), (1, Some(Kind::Acceptance)));
    assert!(again[0].len() <= opening.len(), "{} for {}", again[0].len(), opening.len());
    assert_eq!(state(&world), before);
    let at = world.at;
    check_ignored(&mut world, address(2), at, &opening);
    for bit in 0..opening.len() * 8 {
        let mut changed = opening.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        check_ignored(&mut world, peer, at, &changed);
    }
    for length in 0..opening.len() {
        check_ignored(&mut world, peer, at, &opening[..length]);
    }
}

/// Somebody who sees the greetings answers them first.
#[test]
fn a_forged_answer_neither_keeps_a_host_away_nor_tells_it_anything() {
    for what in 0..3 {
        let mut world = World::new(16, Weather::default());
        world.hosts.push(HostSide::new(key(1), 1, address(1), Some(world.at)));
        let at = world.at;
        let began_ns = world.now_ns;
        while world.bx().end.listeners().is_empty() {
            assert!(world.now_ns < began_ns + 2 * S, "kept away by {what}");
            world.log = Some(Vec::new());
            world.step();
            for (_, _, packet) in world.log.take().unwrap() {
                if kind(&packet) == Some(Kind::Greeting) {
                    let mut announcement = forged(&mut world, 2);
                    match what {
                        0 => {}
                        1 => announcement.versions = [PROTOCOL_VERSION + 1; 2],
                        _ => announcement.schema_hash = SCHEMA_HASH ^ 1,
                    }
                    let mut token = [0; 8];
                    token.copy_from_slice(&packet[HEAD_BYTES..][..8]);
                    let answer = Answer { token, cookie: [7; 16], announcement };
                    let mut buffer = [0; SEALED_BYTES_MAX];
                    for key in [None, Some(&key(2))] {
                        let answer = answer.packet(key, &mut buffer).to_vec();
                        check_ignored(&mut world, at, address(1), &answer);
                    }
                }
            }
            assert_eq!(world.hosts[0].end.obstacle(), None);
        }
    }
}

fn forged(world: &mut World, of: u64) -> Announcement {
    Announcement {
        key_id: Some(key(1).id()),
        start: Start::new(world.random.bits() as u32 | of as u32).unwrap(),
        schema_hash: SCHEMA_HASH,
        versions: [PROTOCOL_VERSION; 2],
        state: BoxState::Ready,
        pairing_s: 0,
        text: heapless::String::new(),
    }
}

/// A box is met at the address where it was, and where it says that it is, whoever else says so.
#[test]
fn a_host_finds_its_box_among_forged_announcements() {
    for (is_known, per_step) in [(true, 1), (true, 50), (false, 1), (false, 5)] {
        let mut world = World::new(17, Weather::default());
        let known = is_known.then_some(world.at);
        world.hosts.push(HostSide::new(key(1), 1, address(1), known));
        let began_ns = world.now_ns;
        let within_ns = if is_known { 2 * S } else { 20 * S };
        let mut forged_bytes = 0;
        world.log = Some(Vec::new());
        while world.bx().end.listeners().is_empty() {
            assert!(world.now_ns < began_ns + within_ns, "kept away: {is_known} {per_step}");
            for _ in 0..per_step {
                let mut buffer = [0; SEALED_BYTES_MAX];
                let announcement = forged(&mut world, 1);
                let packet = announcement.packet(&mut buffer);
                forged_bytes += packet.len();
                let from = address(1_000 + (world.random.bits() % 1_000_000) as usize);
                let answer = world.host_receives(0, from, packet);
                assert!(answer.is_none());
            }
            world.step();
        }
        // Nobody gains much by having a host greet somebody else.
        let log = world.log.take().unwrap();
        let at = world.at;
        let to_others = log.iter().filter(|it| it.0 == address(1) && it.1 != at);
        let bytes: usize = to_others.map(|it| it.2.len()).sum();
        let duration_s = (world.now_ns - began_ns) as f64 / S as f64;
        assert!(bytes as f64 <= 50_000.0 * duration_s + 3_000.0, "{bytes} in {duration_s} s");
        let _ = forged_bytes;
    }
}

/// Announcements of another start, from the box's own address, as anybody can send them.
#[test]
fn forged_announcements_begin_no_handshake_where_there_is_a_session() {
    let mut world = World::new(18, Weather::default()).with_hosts(2);
    world.run(S);
    let before: Vec<_> = world.hosts.iter().map(|it| it.end.session_number()).collect();
    let at = world.at;
    world.log = Some(Vec::new());
    for _ in 0..1_000 {
        for index in 0..2 {
            let mut buffer = [0; SEALED_BYTES_MAX];
            let announcement = forged(&mut world, 1);
            let packet = announcement.packet(&mut buffer).to_vec();
            world.host_receives(index, at, &packet);
        }
        world.step();
    }
    let after: Vec<_> = world.hosts.iter().map(|it| it.end.session_number()).collect();
    assert_eq!(before, after);
    let log = world.log.take().unwrap();
    let openings = log.iter().filter(|it| kind(&it.2) == Some(Kind::Opening)).count();
    assert_eq!(openings, 0);
    let greetings = log.iter().filter(|it| kind(&it.2) == Some(Kind::Greeting)).count();
    assert!(greetings < 200, "{greetings}");
}

#[test]
fn an_acceptance_is_taken_once_and_only_of_the_handshake_that_asked() {
    let mut world = World::new(19, Weather::default()).with_hosts(1);
    let mut acceptances: Vec<Sent> = Vec::new();
    world.log = Some(Vec::new());
    for round in 0..5 {
        world.run(500 * MS);
        let log = world.log.replace(Vec::new()).unwrap();
        acceptances.extend(log.into_iter().filter(|it| kind(&it.2) == Some(Kind::Acceptance)));
        assert!(acceptances.len() > round);
        for (from, to, packet) in acceptances.clone() {
            check_ignored(&mut world, from, to, &packet);
        }
        // A new handshake, and the old acceptances in the midst of it.
        let peer = world.hosts[0].peer;
        world.hosts[0] = HostSide::new(key(1), 10 + round as u32, peer, Some(world.at));
        for _ in 0..10 {
            world.step();
            if world.hosts[0].end.peer().is_none() {
                for (from, to, packet) in acceptances.clone() {
                    check_ignored(&mut world, from, to, &packet);
                    let mut forged = packet.clone();
                    *forged.last_mut().unwrap() ^= 1;
                    check_ignored(&mut world, from, to, &forged);
                }
            }
        }
        world.run_until(2 * S, |world| world.hosts[0].end.peer().is_some());
    }
}

/// The versions that both speak are part of the handshake.
#[test]
fn a_changed_offer_of_versions_spoils_the_handshake() {
    let mut world = World::new(20, Weather::default());
    world.hosts.push(HostSide::new(key(1), 1, address(1), Some(world.at)));
    world.log = Some(Vec::new());
    let is_pending = |world: &World| world.bx.as_ref().unwrap().end.pending().next().is_some();
    world.run_until(S, is_pending);
    let log = world.log.take().unwrap();
    let opening = log.iter().find(|it| kind(&it.2) == Some(Kind::Opening)).unwrap().2.clone();
    // Behind the cookie and the key's id: the host's versions, the box's, and the start.
    let at = HEAD_BYTES + 16 + 8;
    assert_eq!(opening[at..at + 4], [PROTOCOL_VERSION; 4]);
    // A box that has not seen it yet, with the same secrets.
    let mut world = World::new(20, Weather::default());
    world.hosts.push(HostSide::new(key(1), 1, address(1), Some(world.at)));
    let to = world.at;
    world.run(10 * MS);
    for (place, version) in [(0, 1), (0, 0), (1, 5), (1, 255), (2, 3), (3, 5)] {
        let mut changed = opening.clone();
        changed[at + place] = version;
        check_ignored(&mut world, address(1), to, &changed);
    }
    let answers = world.box_receives(address(1), &opening);
    assert_eq!(kind(&answers[0]), Some(Kind::Acceptance), "as it was it is taken");
}

#[test]
fn nothing_secret_is_shown() {
    let mut world = World::new(22, Weather::default()).with_hosts(2);
    world.run(S);
    let shown = state(&world);
    let secret = &world.bx().end.stream;
    let bytes = format!("{secret:?}");
    assert!(bytes.contains("CipherKey(..)") && shown.contains("secret: CipherKey(..)"), "{shown}");
}

#[test]
fn a_command_under_another_seal_is_refused() {
    let mut world = World::new(23, Weather::default()).with_hosts(2);
    world.run(S);
    let mut other = World::new(24, Weather::default());
    other.bx = Some(BoxSide::new(key(2), &mut other.random));
    other.hosts.push(HostSide::new(key(2), 1, address(1), Some(other.at)));
    other.run(S);
    let command = Command { id: 5, action: Action::Reboot, is_forced: true };
    let at = world.at;
    for index in 0..20 {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let message = Message::Command(command);
        let sealed = other.hosts[0].end.seal(&message, &mut buffer).unwrap().unwrap().1.to_vec();
        let of_second = world.hosts[1].end.seal(&message, &mut buffer).unwrap().unwrap().1.to_vec();
        for session in 0..4 {
            let peers = [0, 1].map(|it: usize| world.hosts[it].peer);
            for (sealed, peer) in [(&sealed, peers[0]), (&sealed, peers[1]), (&of_second, peers[0])]
            {
                let mut packet = sealed.clone();
                packet[HEAD_BYTES] = session;
                check_ignored(&mut world, peer, at, &packet);
            }
        }
        let _ = index;
    }
    assert!(world.bx().heard.is_empty());
}
