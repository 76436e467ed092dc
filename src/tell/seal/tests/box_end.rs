//! What a box says of itself, whom it opens a session with, and whom it hears.

extern crate std;

use std::vec::Vec;

use super::super::handshake::Handshake;
use super::super::listeners::SILENT_NS;
use super::super::pending::PENDING_MAX;
use super::super::wire::{
    Answer, CALLER_BYTES, COOKIE_BYTES, Purpose, Terms, VERSIONS, Writer, greeting,
};
use super::super::*;
use super::world::{S, Weather, World, address, caller, key};
use crate::tell::packet::{PROTOCOL_VERSION, Start, UpdateRequest, UpdateStep};

#[test]
fn a_box_says_why_it_waits_in_clear_only_while_it_has_no_key() {
    let long = "x".repeat(WAITING_TEXT_BYTES_MAX + 1);
    for key in [None, Some(key(1))] {
        let mut bx = BoxEnd::new(key.clone(), Start::new(7).unwrap(), &[2; 32]);
        for (state, pairing_s, text) in
            [(BoxState::KeyUnreadable, 60, &long[..]), (BoxState::Refusing, 0, "why")]
        {
            bx.describe(state, pairing_s, text);
            let mut buffer = [0; SEALED_BYTES_MAX];
            let said = Announcement::parse(bx.announcement(&mut buffer)).unwrap();
            assert_eq!((said.state, said.pairing_s), (state, pairing_s));
            let shown = &text[..text.len().min(WAITING_TEXT_BYTES_MAX)];
            assert_eq!(said.text, if key.is_none() { shown } else { "" });
        }
    }
}

/// An authentic opening with these terms, whatever they are.
fn opening(purpose: Purpose, terms: &Terms, cookie: [u8; COOKIE_BYTES], secret: u8) -> Vec<u8> {
    let prologue = terms.prologue(purpose, &cookie);
    let mut handshake = Handshake::of_host(key(1).bytes(), &prologue, &[secret; 32]).unwrap();
    let mut payload = [0; CALLER_BYTES];
    postcard::to_slice(&caller(1, "a test"), &mut payload).unwrap();
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut writer = Writer::new(&mut buffer, purpose.opening());
    writer.put(cookie);
    writer.put(terms.bytes());
    let header_bytes = writer.length();
    let bytes = handshake.write(&payload, writer.room(0)).unwrap();
    writer.packet_of(header_bytes + bytes).to_vec()
}

/// As of a host that has the key and an answer, but of an earlier start, or of a changed one.
#[test]
fn a_box_accepts_no_terms_but_those_of_its_own_answer() {
    let start = Start::new(7).unwrap();
    let mut bx = BoxEnd::new(Some(key(1)), start, &[2; 32]);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let greeting = greeting([3; TOKEN_BYTES], &mut buffer).to_vec();
    let heard = bx.receive(address(1), &greeting, S, || unreachable!(), &mut buffer);
    let Heard::Answer(answer) = heard else { panic!("{heard:?}") };
    let cookie = Answer::read(answer).unwrap().cookie;
    let [later, earlier] = [PROTOCOL_VERSION + 1, PROTOCOL_VERSION - 1];
    let agreed =
        Terms { key_id: key(1).id(), host_versions: VERSIONS, box_versions: VERSIONS, start };
    // What a session of each purpose has of them.
    let cases = [
        (Terms { key_id: key(2).id(), ..agreed }, [false, false]),
        (Terms { start: Start::new(8).unwrap(), ..agreed }, [false, false]),
        (Terms { box_versions: [VERSIONS[0], later], ..agreed }, [false, false]),
        (Terms { host_versions: [later; 2], ..agreed }, [false, true]),
        (Terms { host_versions: [1, earlier], ..agreed }, [false, true]),
        (Terms { host_versions: [1, later], ..agreed }, [true, true]),
        (agreed, [true, true]),
    ];
    let mut secret = 0;
    for (terms, are_accepted) in cases {
        for (purpose, is_accepted) in
            [Purpose::Listening, Purpose::Updating].into_iter().zip(are_accepted)
        {
            secret += 1;
            let packet = opening(purpose, &terms, cookie, secret);
            let heard = bx.receive(address(1), &packet, S, || [secret; 32], &mut buffer);
            let accepts = matches!(heard, Heard::Answer(_));
            assert_eq!(accepts, is_accepted, "{purpose:?} {terms:?}");
        }
    }
}

/// A program that updates the box and has not yet said anything in its session.
fn opened(world: &mut World, process: u8) -> (Peer, UpdateEnd) {
    let (at, now_ns) = (world.at, world.now_ns);
    let peer = address(100 + usize::from(process));
    let mut end = UpdateEnd::new(key(1), caller(process.into(), "a test"), Some(at));
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut packet = end.due(now_ns, || [process; 32], &mut buffer).unwrap().1.to_vec();
    while end.peer().is_none() {
        let answers = world.box_receives(peer, &packet);
        let told = end.receive(at, &answers[0], now_ns, || [process; 32], &mut buffer);
        let ToldOfUpdate::Handshake(answer) = told else { panic!("{told:?}") };
        packet = answer.unwrap_or_default().to_vec();
    }
    assert_eq!(end.peer(), Some(at));
    (peer, end)
}

#[test]
fn a_full_box_still_has_a_number_for_another_session() {
    let mut world = World::new(40, Weather::default()).with_hosts(LISTENERS_MAX);
    world.run(S);
    let (peer, mut updater) = opened(&mut world, 1);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let request = UpdateRequest { id: 1, step: UpdateStep::Query };
    let packet = updater.seal(&request, &mut buffer).unwrap().unwrap().1.to_vec();
    let now_ns = world.now_ns;
    let heard = world.bx().end.receive(peer, &packet, now_ns, || unreachable!(), &mut buffer);
    assert!(matches!(heard, Heard::Update { .. }), "{heard:?}");
    for process in 2..2 + PENDING_MAX as u8 {
        opened(&mut world, process);
    }
    let end = &world.bx().end;
    assert_eq!((end.listeners().len(), end.pending().count()), (LISTENERS_MAX, PENDING_MAX));
    opened(&mut world, 200);
}

#[test]
fn a_listener_is_heard_until_it_is_silent_and_there_until_it_has_left() {
    let mut world = World::new(41, Weather::default()).with_hosts(2);
    world.run(S);
    let (peer, now_ns) = (world.hosts[0].peer, world.now_ns);
    let end = &mut world.bx().end;
    assert!(end.hears(peer, now_ns) && !end.hears(address(99), now_ns));
    assert!(!end.hears(peer, now_ns + SILENT_NS));
    let (id, _) = *end.listeners().iter().find(|it| it.1 == peer).unwrap();
    assert!(end.is_there(id));
    let host = world.hosts.remove(0);
    host.end.leave(|_, packet| assert!(world.box_receives(peer, packet).is_empty()));
    assert!(!world.bx().end.is_there(id) && !world.bx().end.hears(peer, now_ns));
}
