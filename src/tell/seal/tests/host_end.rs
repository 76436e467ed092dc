//! When a host greets a box, and when it knows that something is missing.

extern crate std;

use std::vec::Vec;

use super::super::wire::Kind;
use super::super::*;
use super::world::{HostSide, MS, S, Weather, World, address, key};
use crate::tell::packet::Start;

/// Where a host sends greetings now.
fn greeted(end: &mut HostEnd, now_ns: u64) -> Vec<Peer> {
    let mut greeted = Vec::new();
    let mut buffer = [0; SEALED_BYTES_MAX];
    while let Some((peer, packet)) = end.due(now_ns, || [9; 32], &mut buffer) {
        if Kind::of(packet).unwrap().0 == Kind::Greeting {
            greeted.push(peer);
        }
    }
    greeted
}

/// What a box of the first key announces in this start.
fn announcement(start: Start) -> Vec<u8> {
    let bx = BoxEnd::new(Some(key(1)), start, &[2; 32]);
    bx.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec()
}

#[test]
fn a_host_greets_where_it_is_told_to_try() {
    let mut host = HostSide::new(key(1), 1, address(1), None);
    assert!(greeted(&mut host.end, S).is_empty());
    host.end.try_at(address(5), S, || [8; 32]);
    assert_eq!(greeted(&mut host.end, S), [address(5)]);
}

#[test]
fn a_host_with_a_session_greets_where_another_start_is_announced_alone() {
    let mut world = World::new(50, Weather::default()).with_hosts(1);
    world.run(S);
    let (start, now_ns) = (world.bx().start, world.now_ns);
    let other = Start::new(start.get() ^ 2).unwrap();
    for (start, expected) in [(start, &[][..]), (other, &[address(7)])] {
        assert!(world.host_receives(0, address(7), &announcement(start)).is_none());
        assert_eq!(greeted(&mut world.hosts[0].end, now_ns), expected);
    }
}

#[test]
fn a_box_without_room_is_asked_again_after_five_seconds() {
    let mut world = World::new(51, Weather::default()).with_hosts(LISTENERS_MAX);
    world.run(S);
    world.hosts.push(HostSide::new(key(1), 50, address(50), Some(world.at)));
    world.run_until(S, |world| world.hosts[LISTENERS_MAX].end.obstacle().is_some());
    let (at, start, refused_ns) = (world.at, world.bx().start, world.now_ns);
    for (after_ns, expected) in [(0, &[][..]), (MS, &[]), (5 * S - 1, &[]), (5 * S, &[at])] {
        world.now_ns = refused_ns + after_ns;
        world.host_receives(LISTENERS_MAX, at, &announcement(start));
        let end = &mut world.hosts[LISTENERS_MAX].end;
        assert_eq!(greeted(end, refused_ns + after_ns), expected, "after {after_ns} ns");
    }
}

/// No later packet shows that it is missing: the box says how far its stream is.
#[test]
fn the_end_of_the_stream_is_missed_after_the_next_ping_and_comes_again() {
    let mut world = World::new(52, Weather::default()).with_hosts(1);
    world.run(S);
    world.weather.lost = 1.0;
    world.run(100 * MS);
    (world.weather.lost, world.streams) = (0.0, false);
    assert!(!world.hosts[0].end.is_missing());
    world.run_until(S, |world| world.hosts[0].end.is_missing());
    world.run_until(S, |world| !world.hosts[0].end.is_missing());
    let (start, next) = (world.bx().start, world.bx().end.stream_next());
    let host = &world.hosts[0];
    assert!(host.received.contains_key(&(start, next - 1)));
    assert_eq!((host.holes(start), host.end.lost()), (0, 0));
}
