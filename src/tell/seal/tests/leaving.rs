//! Hosts that say that they leave: their place is free at once, and nobody else can say so, nor they
//! themselves of a session that has begun since.

extern crate std;

use std::format;
use std::vec::Vec;

use super::super::listeners::LISTENERS_MAX;
use super::super::{Obstacle, Peer};
use super::world::{HostSide, MS, S, Weather, World, key};

/// A packet, and where it comes from.
type Sent = (Peer, Vec<u8>);

/// What a host says last; it is gone then.
fn goodbye(world: &mut World, index: usize) -> Vec<Sent> {
    let host = world.hosts.remove(index);
    let mut sent = Vec::new();
    host.end.leave(|_, packet| sent.push((host.peer, packet.to_vec())));
    sent
}

fn come(world: &mut World, packets: &[Sent]) {
    for (from, packet) in packets {
        assert!(world.box_receives(*from, packet).is_empty(), "nobody is there to be answered");
    }
}

fn state(world: &World) -> std::string::String {
    format!("{:?}", world.bx.as_ref().unwrap().end)
}

fn processes(world: &mut World) -> Vec<u32> {
    let mut all: Vec<u32> = world.bx().end.listening().map(|it| it.process).collect();
    all.sort_unstable();
    all
}

/// Whether a handshake waits for its host's first message.
fn is_pending(world: &World) -> bool {
    world.bx.as_ref().unwrap().end.pending().next().is_some()
}

#[test]
fn a_place_is_free_at_once_and_the_recording_over() {
    let mut world = World::new(30, Weather::default()).with_hosts(LISTENERS_MAX);
    world.run(2 * S);
    let peer = world.hosts[1].peer;
    let recorder = world.bx().end.listeners().iter().find(|it| it.1 == peer).unwrap().0;
    world.bx().end.record(recorder, true);
    let packets = goodbye(&mut world, 1);
    come(&mut world, &packets);
    assert_eq!(processes(&mut world), [1, 3, 4]);
    assert!(world.bx().end.recorder().is_none() && !world.bx().end.is_there(recorder));
    // Another gets the place without waiting, and without being refused first.
    world.hosts.push(HostSide::new(key(1), 50, peer, Some(world.at)));
    world.run(100 * MS);
    assert_eq!(world.hosts[3].end.obstacle(), None::<&Obstacle>);
    assert_eq!(processes(&mut world).len(), LISTENERS_MAX);
    // The others have noticed nothing.
    let start = world.bx().start;
    let others = world.hosts[..3].iter();
    assert!(others.clone().all(|it| it.holes(start) == 0 && it.count(start) > 380));
}

#[test]
fn a_goodbye_that_is_replayed_or_forged_changes_nothing() {
    let mut world = World::new(31, Weather::default()).with_hosts(2);
    world.run(2 * S);
    world.streams = false;
    let stranger = world.hosts[1].peer;
    let packets = goodbye(&mut world, 0);
    let before = state(&world);
    for (from, packet) in &packets {
        for bit in 0..packet.len() * 8 {
            let mut changed = packet.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(world.box_receives(*from, &changed).is_empty());
        }
        assert!(world.box_receives(stranger, packet).is_empty());
    }
    assert_eq!(state(&world), before);
    come(&mut world, &packets);
    let after = state(&world);
    assert_ne!(after, before);
    come(&mut world, &packets);
    assert_eq!(state(&world), after);
    // The next program there has another session.
    let from = packets[0].0;
    world.hosts.push(HostSide::new(key(1), 1, from, Some(world.at)));
    world.run(S);
    assert_eq!(processes(&mut world).len(), 2);
    let after = state(&world);
    come(&mut world, &packets);
    assert_eq!(state(&world), after);
}

#[test]
fn a_late_goodbye_does_not_end_a_newer_session_of_the_same_program() {
    for waits in [false, true] {
        let mut world = World::new(32, Weather::default()).with_hosts(1);
        world.run(S);
        let late = goodbye(&mut world, 0);
        world.hosts.push(HostSide::new(key(1), 1, late[0].0, Some(world.at)));
        if waits {
            // The new session has not begun for the box.
            world.run_until(S, is_pending);
            come(&mut world, &late);
            assert!(processes(&mut world).is_empty());
            world.run(100 * MS);
        } else {
            world.run(S);
            come(&mut world, &late);
        }
        assert_eq!(processes(&mut world), [1]);
        let (start, received) = (world.bx().start, world.hosts[0].received.len());
        world.run(500 * MS);
        assert!(world.hosts[0].received.len() > received + 95);
        assert_eq!((world.hosts[0].holes(start), world.hosts[0].end.lost()), (0, 0));
    }
}

/// All that was said before it in its session is lost, or comes later.
#[test]
fn a_goodbye_that_comes_first_ends_what_it_would_have_begun() {
    for is_renewal in [false, true] {
        let mut world = World::new(33, Weather::default()).with_hosts(1);
        if is_renewal {
            world.run(S);
            world.hosts[0].end.age(super::super::session::RENEW_NS);
        }
        world.run_until(S, is_pending);
        let before = world.hosts[0].end.session_number();
        world.deaf_box = true;
        world.log = Some(Vec::new());
        world.run_until(S, |world| world.hosts[0].end.session_number() != before);
        world.step();
        let (log, peer) = (world.log.take().unwrap(), world.hosts[0].peer);
        world.deaf_box = false;
        let packets = goodbye(&mut world, 0);
        come(&mut world, &packets);
        assert!(processes(&mut world).is_empty() && !is_pending(&world), "{is_renewal}");
        let late: Vec<Sent> =
            log.into_iter().filter(|it| it.0 == peer).map(|it| (peer, it.2)).collect();
        assert!(!late.is_empty());
        let after = state(&world);
        come(&mut world, &late);
        assert_eq!(state(&world), after);
    }
}

/// The box has never heard anything of the new session, and has forgotten its handshake.
#[test]
fn the_session_before_is_left_as_well() {
    let mut world = World::new(34, Weather::default()).with_hosts(1);
    world.run(S);
    world.hosts[0].end.age(super::super::session::RENEW_NS);
    let before = world.hosts[0].end.session_number();
    world.run_until(S, is_pending);
    world.deaf_box = true;
    world.run_until(S, |world| world.hosts[0].end.session_number() != before);
    world.bx().end.forget_pending();
    let packets = goodbye(&mut world, 0);
    assert_eq!(processes(&mut world), [1]);
    come(&mut world, &packets);
    assert!(processes(&mut world).is_empty());
}

#[test]
fn without_a_session_there_is_nothing_to_say() {
    let mut world = World::new(35, Weather::default()).with_hosts(1);
    assert!(goodbye(&mut world, 0).is_empty());
}

/// A program that is killed says nothing: its recording is protected for as long as it might be cut
/// off and come back.
#[test]
fn a_recording_without_a_goodbye_holds_the_box_for_two_minutes() {
    let mut world = World::new(36, Weather::default()).with_hosts(1);
    world.streams = false;
    world.run(S);
    let listener = world.bx().end.listeners()[0].0;
    world.bx().end.record(listener, true);
    world.hosts.clear();
    world.run(119 * S);
    assert!(world.bx().end.recorder().is_some());
    world.run(2 * S);
    assert!(world.bx().end.recorder().is_none());
}
