//! The stream over a bad network: nothing is lost that can be had again, and nothing comes twice.

extern crate std;

use super::super::aead::CipherKey;
use super::super::stream::StreamKey;
use super::super::{EPOCH_PACKETS, LISTENERS_MAX, SEALED_BYTES_MAX, StreamOpener, StreamSealer};
use super::world::{MS, S, STEP_NS, Weather, World};
use crate::tell::packet::{Action, Command, Message, Start};
use crate::test_support::repetitions;

/// Packets of the stream in a second.
const RATE: u64 = S / STEP_NS;

/// A while in this weather, and then until all is through in good weather.
fn listen(seed: u64, weather: Weather, hosts: usize, bad_ns: u64) -> World {
    let mut world = World::new(seed, Weather::default()).with_hosts(hosts);
    let has_come = |world: &World| {
        world.hosts.iter().all(|it| it.end.peer().is_some() && !it.received.is_empty())
    };
    world.run_until(2 * S, has_come);
    world.weather = weather;
    let now_ns = world.now_ns;
    world.weather.cut.iter_mut().for_each(|cut| *cut = (cut.0 + now_ns, cut.1 + now_ns));
    world.run(bad_ns);
    world.weather = Weather { late: 0.0, ..Weather::default() };
    world.run(10 * S);
    world
}

/// Everything has come to every host.
fn check(world: &mut World, what: &str) {
    let (start, next) = (world.bx().start, world.bx().end.stream_next());
    assert_eq!(world.bx().end.listeners().len(), world.hosts.len(), "{what}");
    for host in &world.hosts {
        assert_eq!((host.holes(start), host.end.lost()), (0, 0), "{what}: {:?}", host.end);
        let (last, _) = host.received.last_key_value().unwrap();
        assert!(next - last.1 < 5, "{what}: {} of {next}", last.1);
        assert!(host.end.first_missing().unwrap() + 5 > next, "{what}");
    }
}

#[test]
fn nothing_is_missing_after_lost_doubled_and_late_packets() {
    for (seed, lost) in [(1, 0.05), (2, 0.2), (3, 0.4)] {
        let weather = Weather { lost, twice: 0.1, late: 0.1, ..Weather::default() };
        let mut world = listen(seed, weather, LISTENERS_MAX, 20 * S);
        check(&mut world, &std::format!("{lost}"));
    }
}

#[test]
fn nothing_is_missing_after_the_network_was_cut() {
    let weather = Weather {
        lost: 0.05,
        twice: 0.1,
        late: 0.1,
        cut: [(2 * S, 7 * S), (12 * S, 62 * S)].into(),
    };
    let mut world = listen(4, weather, LISTENERS_MAX, 66 * S);
    check(&mut world, "cut");
}

#[test]
fn the_loss_beyond_the_ring_is_exact() {
    let weather = Weather { cut: [(S, 81 * S)].into(), ..Weather::default() };
    let mut world = listen(5, weather, 2, 82 * S);
    let start = world.bx().start;
    for host in &world.hosts {
        let lost = host.end.lost();
        assert_eq!(host.holes(start), lost);
        // 80 seconds were cut, and the ring holds 12,288 packets.
        let expected = 80 * RATE - 12_288;
        assert!(lost.abs_diff(expected) < 2 * RATE, "{lost} instead of {expected}");
        assert!(!host.end.is_missing());
    }
}

/// One that joins late gets what is still kept, and misses nothing of what is not.
#[test]
fn the_past_is_handed_out_as_far_as_it_is_kept() {
    for (before_ns, expected) in [(10 * S, 10 * RATE), (100 * S, 12_288)] {
        let weather = Weather { lost: 0.1, ..Weather::default() };
        let mut world = World::new(7, weather).with_hosts(1);
        let late = world.hosts.remove(0);
        world.run(before_ns);
        world.hosts.push(late);
        world.hosts[0].end.want_past();
        let joined = world.bx().end.stream_next();
        world.run(20 * S);
        let (start, next) = (world.bx().start, world.bx().end.stream_next());
        let host = &world.hosts[0];
        let past = host.received.range(..(start, joined)).count() as u64;
        // Some are overwritten before they are sent.
        assert!(past <= expected && past + 2 * RATE > expected, "{past} instead of {expected}");
        assert_eq!(host.end.lost(), 0);
        let missing = (joined..next - RATE).filter(|it| !host.received.contains_key(&(start, *it)));
        assert_eq!(missing.count(), 0);
    }
}

#[test]
fn what_a_listener_leaves_out_is_neither_asked_for_nor_lost() {
    let weather = Weather { lost: 0.2, ..Weather::default() };
    let mut world = World::new(6, weather).with_hosts(1);
    world.run(3 * S);
    let start = world.bx().start;
    world.hosts[0].end.want_poses(4);
    world.run(S);
    let count = world.hosts[0].count(start);
    world.run(100 * S);
    let came = world.hosts[0].count(start) - count;
    let expected = 100 * RATE / 4 * 8 / 10;
    assert!(came.abs_diff(expected) < expected / 10, "{came} instead of {expected}");
    assert_eq!(world.hosts[0].end.lost(), 0);
    // All again, from now on.
    world.hosts[0].end.want_poses(1);
    world.run(S / 2);
    let from = world.bx().end.stream_next();
    world.weather = Weather::default();
    world.run(3 * S);
    let next = world.bx().end.stream_next();
    let host = &world.hosts[0];
    let missing =
        (from..next - 5).filter(|counter| !host.received.contains_key(&(start, *counter)));
    assert_eq!(missing.count(), 0);
    assert!(host.count(start) < count + came + 10 * RATE);
    assert_eq!(host.end.lost(), 0);
}

/// The first word of a new wish is as likely to be lost as any.
#[test]
fn a_wish_for_fewer_poses_is_repeated_until_it_is_heard() {
    for seed in 0..repetitions(20) as u64 {
        let mut world = World::new(seed, Weather::default()).with_hosts(1);
        world.run(S);
        let start = world.bx().start;
        world.hosts[0].end.want_poses(0);
        let now_ns = world.now_ns;
        world.weather = Weather { cut: [(now_ns, now_ns + 300 * MS)].into(), ..Weather::default() };
        world.run(S);
        let count = world.hosts[0].count(start);
        world.run(S);
        assert_eq!(world.hosts[0].count(start), count, "seed {seed}");
    }
}

/// A network may carry a packet twice, which is nobody's attack; also in the epoch before.
#[test]
fn a_packet_that_comes_again_is_told_from_a_forged_one() {
    let key = || CipherKey::new([9; 32]);
    let mut sealer = StreamSealer::new(key());
    sealer.skip_to(EPOCH_PACKETS - 2);
    let start = Start::new(1).unwrap();
    let first = EPOCH_PACKETS - 2;
    let mut opener = StreamOpener::new(start, first, first, StreamKey::of_epoch(0, key()));
    let mut buffer = [0; SEALED_BYTES_MAX];
    let packets: std::vec::Vec<std::vec::Vec<u8>> =
        (0..4).map(|_| sealer.seal(&message(), &mut buffer).unwrap().to_vec()).collect();
    for packet in &packets {
        assert!(!opener.is_repeated(packet), "it has not come yet");
        assert!(opener.open(packet).is_some());
    }
    for packet in &packets {
        assert!(opener.open(packet).is_none() && opener.is_repeated(packet));
        for bit in 0..8 * packet.len() {
            let mut forged = packet.clone();
            forged[bit / 8] ^= 1 << (bit % 8);
            assert!(opener.open(&forged).is_none() && !opener.is_repeated(&forged), "{bit}");
        }
    }
}

fn message() -> Message {
    let command = Command { id: 1, action: Action::SendHello, is_forced: false };
    Message::Command(command)
}
