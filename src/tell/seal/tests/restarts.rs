//! Sessions: their beginning, their end, their renewal, and who has one.

extern crate std;

use std::format;
use std::vec::Vec;

use super::super::listeners::{LISTENERS_MAX, SILENT_NS};
use super::super::session::RENEW_NS;
use super::super::{Obstacle, Peer};
use super::world::{BoxSide, HostSide, MS, S, STEP_NS, Weather, World, address, key};
use crate::tell::packet::{Action, Command, Message};
use crate::test_support::repetitions;

fn all_listen(world: &World) -> bool {
    let Some(bx) = &world.bx else { return false };
    let listens = |host: &HostSide| {
        let is_there = bx.end.listeners().iter().any(|(_, peer)| *peer == host.peer);
        is_there && host.end.start() == Some(bx.start)
    };
    world.hosts.iter().all(listens)
}

/// The channels of both ends are the same: a command comes through.
fn check_channels(world: &mut World) {
    for index in 0..world.hosts.len() {
        let action = Action::SendHello;
        let command = Message::Command(Command { id: 9, action, is_forced: false });
        let mut buffer = [0; super::super::SEALED_BYTES_MAX];
        let (to, packet) = world.hosts[index].end.seal(&command, &mut buffer).unwrap().unwrap();
        let (from, packet) = (world.hosts[index].peer, packet.to_vec());
        let heard = world.bx().heard.len();
        world.send(from, to, &packet);
        world.run(100 * MS);
        assert_eq!(world.bx().heard.len(), heard + 1, "host {index}");
    }
}

#[test]
fn a_session_is_back_within_two_seconds_of_any_restart() {
    let mut world = World::new(1, Weather { twice: 0.1, ..Weather::default() }).with_hosts(2);
    let mut process = 100;
    for round in 0..repetitions(100) {
        world.run_until(2 * S, all_listen);
        let duration_ns = world.random.bits() % (3 * S);
        world.run(duration_ns);
        check_channels(&mut world);
        let which = world.random.bits() % 7 + 1;
        if which & 1 != 0 {
            // Its packets that are under way still arrive.
            world.bx = None;
            let off_ns = world.random.bits() % (6 * S);
            world.run(off_ns);
            world.bx = Some(BoxSide::new(key(1), &mut world.random));
        }
        for index in 0..2 {
            if which & (2 << index) != 0 {
                process += 1;
                let (peer, known) = (world.hosts[index].peer, (round % 2 == 0).then_some(world.at));
                // From another port every third time.
                let peer = if round % 3 > 0 { peer } else { address(process as usize) };
                world.hosts[index] = HostSide::new(key(1), process, peer, known);
            }
        }
    }
}

#[test]
fn sessions_begin_and_hold_while_two_packets_of_five_are_lost() {
    for seed in 0..repetitions(20) as u64 {
        let weather = Weather { lost: 0.4, twice: 0.1, late: 0.1, ..Weather::default() };
        let mut world = World::new(seed, weather).with_hosts(LISTENERS_MAX);
        // Two of them hear of the box only by its announcements, of which half come in time.
        world.run_until(30 * S, all_listen);
        for _ in 0..10 {
            world.run(S);
            world.run_until(10 * S, all_listen);
        }
        world.weather = Weather::default();
        world.run(5 * S);
        check_channels(&mut world);
        let start = world.bx().start;
        world
            .hosts
            .iter()
            .for_each(|host| assert_eq!((host.holes(start), host.end.lost()), (0, 0)));
    }
}

/// What the host says is lost until the box has forgotten the new session, while the stream goes on
/// through the old one.
#[test]
fn a_session_that_the_box_does_not_know_is_not_kept_alive_by_the_stream() {
    let mut world = World::new(3, Weather::default()).with_hosts(1);
    world.run(3 * S);
    world.hosts[0].end.age(RENEW_NS);
    // The renewal goes through as far as the acceptance.
    let host = world.hosts[0].peer;
    world.run_until(10 * S, |world| {
        world.bx.as_ref().unwrap().end.pending().any(|it| it.peer == host)
    });
    world.deaf_box = true;
    world.run(4 * S);
    world.deaf_box = false;
    world.run(6 * S);
    check_channels(&mut world);
}

/// A packet of an earlier handshake of the same program comes late.
#[test]
fn a_late_packet_does_not_bring_an_older_session_back() {
    for seed in 0..repetitions(50) as u64 {
        let weather = Weather { lost: 0.5, late: 0.3, ..Weather::default() };
        let mut world = World::new(seed, weather).with_hosts(1);
        world.run(8 * S);
        world.weather = Weather::default();
        world.run(8 * S);
        check_channels(&mut world);
    }
}

#[test]
fn renewed_keys_keep_the_listener_and_what_it_asked_for() {
    let mut world = World::new(4, Weather { lost: 0.1, ..Weather::default() }).with_hosts(2);
    world.run_until(5 * S, all_listen);
    world.hosts[0].end.want_poses(3);
    world.run(S);
    let before = world.bx().end.listeners();
    let recorder = before.iter().find(|it| it.1 == world.hosts[1].peer).unwrap().0;
    world.bx().end.record(recorder, true);
    let sessions = |world: &World| -> Vec<_> {
        world.hosts.iter().map(|it| it.end.session_number()).collect()
    };
    let old = sessions(&world);
    world.hosts.iter_mut().for_each(|it| it.end.age(RENEW_NS));
    world.run(5 * S);
    world.weather = Weather::default();
    world.run(5 * S);
    assert!(sessions(&world).iter().zip(&old).all(|(new, old)| new != old));
    assert_eq!(world.bx().end.listeners(), before);
    assert_eq!(world.bx().end.recorder().unwrap().process, 2);
    let start = world.bx().start;
    let counts = [0, 1].map(|index: usize| world.hosts[index].count(start));
    world.run(3 * S);
    let now = [0, 1].map(|index: usize| world.hosts[index].count(start));
    let came = [now[0] - counts[0], now[1] - counts[1]];
    let expected = [S / STEP_NS, 3 * S / STEP_NS];
    assert!(came.iter().zip(expected).all(|(came, it)| came.abs_diff(it) < 3), "{came:?}");
    assert_eq!((world.hosts[1].holes(start), world.hosts[1].end.lost()), (0, 0));
    check_channels(&mut world);
}

#[test]
fn the_fifth_is_told_who_listens_and_comes_in_when_one_has_left() {
    let mut world = World::new(5, Weather::default()).with_hosts(LISTENERS_MAX);
    world.run(2 * S);
    assert!(all_listen(&world));
    world.hosts.push(HostSide::new(key(1), 50, address(50), Some(world.at)));
    let mut told = 0;
    let began_ns = world.now_ns;
    while world.now_ns < began_ns + 20 * S {
        world.step();
        let fifth = &world.hosts[LISTENERS_MAX].end;
        match fifth.obstacle() {
            Some(Obstacle::Busy { reason }) => {
                let names = "a test, a test, a test, a test";
                let expected = format!("as many programs listen as it has room for: {names}");
                assert_eq!(reason.as_str(), expected);
                assert_eq!(fifth.peer(), None);
                told += 1;
            }
            // Once it is told it stays told.
            obstacle => assert!(obstacle.is_none() && told == 0, "{obstacle:?}"),
        }
    }
    assert!(told > 3_000);
    assert_eq!(world.bx().end.listeners().len(), LISTENERS_MAX);
    // One goes away without a word.
    world.hosts.remove(1);
    world.run_until(SILENT_NS + 7 * S, all_listen);
    world.run(S);
    let start = world.bx().start;
    let fifth = world.hosts.last().unwrap();
    assert_eq!((fifth.end.obstacle(), fifth.end.lost(), fifth.holes(start)), (None, 0, 0));
    // It has not asked for what was sent while it did not listen.
    assert!(fifth.count(start) < 12 * S / STEP_NS, "{}", fifth.count(start));
}

#[test]
fn two_hosts_in_turn_at_one_address_are_two_listeners() {
    let mut world = World::new(6, Weather::default()).with_hosts(1);
    world.run(S);
    let first = world.bx().end.listeners();
    world.bx().end.record(first[0].0, true);
    let peer = world.hosts[0].peer;
    world.hosts[0] = HostSide::new(key(1), 77, peer, Some(world.at));
    world.run(S);
    let second = world.bx().end.listeners();
    assert_eq!((first.len(), second.len()), (1, 1));
    assert!(first[0].0 != second[0].0 && !world.bx().end.is_there(first[0].0));
    assert!(world.bx().end.recorder().is_none());
    // The first program goes on at another address, where somebody else was.
    world.hosts.push(HostSide::new(key(1), 78, address(60), Some(world.at)));
    world.run(S);
    let other = world.hosts.pop().unwrap().peer;
    world.hosts[0].peer = other;
    world.run(4 * S);
    let peers: Vec<Peer> = world.bx().end.listeners().iter().map(|it| it.1).collect();
    assert_eq!(peers, [other]);
}

/// 65,536 handshakes later a number comes again, but not one that is in use.
#[test]
fn a_session_in_use_keeps_its_number_to_itself() {
    let mut world = World::new(7, Weather::default()).with_hosts(2);
    world.run(S);
    let used = world.hosts[1].end.session_number().unwrap();
    for process in 10..13 {
        // What was sealed with the first sessions of these numbers had other keys.
        world.sealed.clear();
        world.bx().end.sessions = used;
        let peer = world.hosts[0].peer;
        world.hosts[0] = HostSide::new(key(1), process, peer, Some(world.at));
        world.run(S);
        assert_ne!(world.hosts[0].end.session_number(), Some(used));
        assert_eq!(world.hosts[1].end.session_number(), Some(used));
        check_channels(&mut world);
    }
    world.bx().end.sessions = u16::MAX;
    world.hosts.push(HostSide::new(key(1), 50, address(50), Some(world.at)));
    world.hosts.push(HostSide::new(key(1), 51, address(51), Some(world.at)));
    world.run(S);
    check_channels(&mut world);
}

#[test]
fn listeners_that_have_left_are_forgotten() {
    let mut world = World::new(8, Weather::default()).with_hosts(3);
    world.run(S);
    world.hosts.clear();
    world.run(121 * S);
    let end = &world.bx().end;
    assert!(end.pending().next().is_none() && end.listeners().is_empty());
}
