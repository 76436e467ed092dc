//! The keys of the stream, from one to the next; and lines without a way back.

extern crate std;

use std::vec::Vec;

use super::super::aead::CipherKey;
use super::super::channel::seal_body;
use super::super::stream::StreamKey;
use super::super::wire::{Kind, Writer, put_counter};
use super::super::{EPOCH_PACKETS, OneWay, SEALED_BYTES_MAX, StreamOpener, StreamSealer};
use super::world::{S, Weather, World, draw, key, numbered};
use crate::tell::packet::{PROTOCOL_VERSION, SCHEMA_HASH, Start};
use crate::test_support::Random;

const KEY: [u8; 32] = [5; 32];

pub fn sealer(next: u64) -> StreamSealer {
    let mut sealer = StreamSealer::new(CipherKey::new(KEY));
    sealer.skip_to(next);
    sealer
}

/// The key that a listener is given now.
pub fn key_of(sealer: &mut StreamSealer) -> StreamKey {
    let key = sealer.key();
    StreamKey::of_epoch(key.epoch(), CipherKey::new(*key.bytes()))
}

/// A listener that joins now.
fn opener(sealer: &mut StreamSealer) -> StreamOpener {
    let key = key_of(sealer);
    StreamOpener::new(Start::new(1).unwrap(), sealer.next(), sealer.next(), key)
}

pub fn sealed(sealer: &mut StreamSealer) -> Vec<u8> {
    let message = numbered(sealer.next());
    sealer.seal(&message, &mut [0; SEALED_BYTES_MAX]).unwrap().to_vec()
}

/// Whether a packet is opened, and is the one with this counter.
fn opens(opener: &mut StreamOpener, packet: &[u8], counter: u64) -> bool {
    let opened = opener.open(packet);
    let is_it =
        |it: &super::super::Opened| it.counter == counter && it.message == numbered(counter);
    assert!(opened.as_ref().is_none_or(is_it), "{opened:?}");
    opened.is_some()
}

#[test]
fn packets_around_a_border_are_opened_in_any_order() {
    for epoch in [1, 2, 9] {
        let border = epoch * EPOCH_PACKETS;
        let mut sealer = sealer(border - 50);
        let mut opener = opener(&mut sealer);
        let mut packets: Vec<_> =
            (0..100).map(|index| (border - 50 + index, sealed(&mut sealer))).collect();
        let mut random = Random::new(epoch);
        for index in (1..packets.len()).rev() {
            packets.swap(index, (random.bits() % (index as u64 + 1)) as usize);
        }
        for (counter, packet) in &packets {
            assert!(opens(&mut opener, packet, *counter), "{counter}");
            assert!(!opens(&mut opener, packet, *counter), "{counter} again");
        }
        assert_eq!(opener.window().missing().count(), 0);
    }
}

#[test]
fn who_joins_after_a_border_opens_nothing_before_it() {
    let mut sealer = sealer(EPOCH_PACKETS - 1);
    let before = sealed(&mut sealer);
    let mut opener = opener(&mut sealer);
    assert!(!opens(&mut opener, &before, EPOCH_PACKETS - 1));
    // Nor with a window that would take it.
    let key = StreamKey::of_epoch(1, CipherKey::new(*sealer.key().bytes()));
    let mut opener = StreamOpener::new(Start::new(1).unwrap(), 0, 0, key);
    assert!(!opens(&mut opener, &before, EPOCH_PACKETS - 1));
    let after = sealed(&mut sealer);
    assert!(opens(&mut opener, &after, EPOCH_PACKETS));
}

#[test]
fn a_jump_is_followed_over_some_borders_and_a_forged_one_over_none() {
    let mut start = sealer(10);
    let mut opener = opener(&mut start);
    for (counter, is_opened) in [(11, true), (3 * EPOCH_PACKETS, true), (12 * EPOCH_PACKETS, false)]
    {
        let packet = sealed(&mut sealer(counter));
        assert_eq!(opens(&mut opener, &packet, counter), is_opened, "{counter}");
    }
    for lowest in [0xFE, 0xFF] {
        let counter = [lowest, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1];
        let forged = [&[PROTOCOL_VERSION, 7][..], &counter, &[3; 30]].concat();
        assert_eq!(opener.open(&forged), None);
    }
    // A forged packet of a later epoch leaves key and window as they are.
    let before = std::format!("{opener:?}");
    let mut forged = sealed(&mut sealer(5 * EPOCH_PACKETS));
    *forged.last_mut().unwrap() ^= 1;
    assert!(!opens(&mut opener, &forged, 5 * EPOCH_PACKETS));
    assert_eq!(std::format!("{opener:?}"), before);
}

#[test]
fn a_key_is_looked_for_eight_borders_ahead() {
    for (epoch, is_opened) in [(7, true), (8, true), (9, false)] {
        let mut opener = opener(&mut sealer(10));
        let counter = epoch * EPOCH_PACKETS;
        let packet = sealed(&mut sealer(counter));
        assert_eq!(opens(&mut opener, &packet, counter), is_opened, "{epoch}");
    }
}

/// A listener whose session begins anew is given the key of that time, in whatever order these come.
#[test]
fn who_joins_again_opens_what_is_late_and_what_is_far_ahead() {
    let mut before = sealer(EPOCH_PACKETS - 20);
    let mut opener = opener(&mut before);
    let late = sealed(&mut before);
    // In the next epoch, once more in it, and with a key of before.
    for next in [EPOCH_PACKETS + 5, EPOCH_PACKETS + 6, EPOCH_PACKETS - 10] {
        opener.join_again(next, key_of(&mut sealer(next)));
    }
    assert_eq!(opener.window().next(), EPOCH_PACKETS + 6);
    assert!(opens(&mut opener, &late, EPOCH_PACKETS - 20));
    let far = 20 * EPOCH_PACKETS + 3;
    opener.join_again(far, key_of(&mut sealer(far)));
    assert!(opens(&mut opener, &sealed(&mut sealer(far)), far));
}

/// Whoever has learned an old key makes nothing of a later epoch with it.
#[test]
fn a_key_opens_nothing_of_another_epoch() {
    let mut opener = opener(&mut sealer(EPOCH_PACKETS));
    let next = 5 * EPOCH_PACKETS + 10;
    opener.join_again(next, key_of(&mut sealer(next)));
    for (of, counter, is_opened) in [
        (EPOCH_PACKETS, next - 11, false),
        (EPOCH_PACKETS, next, false),
        (next, next - 11, false),
        (next, next, true),
    ] {
        let key = CipherKey::new(*key_of(&mut sealer(of)).bytes());
        let mut buffer = [0; SEALED_BYTES_MAX];
        let mut writer = Writer::new(&mut buffer, Kind::Stream);
        put_counter(&mut writer, counter);
        let packet = seal_body(writer, &key, counter, &numbered(counter)).unwrap();
        assert_eq!(opens(&mut opener, packet, counter), is_opened, "{counter} with {of}");
    }
}

#[test]
fn sessions_cross_a_border_without_loss() {
    let weather = Weather { lost: 0.2, twice: 0.1, late: 0.1, ..Weather::default() };
    let mut world = World::new(1, weather).with_hosts(3);
    world.bx().end.stream.skip_to(EPOCH_PACKETS - 2_000);
    world.run(8 * S);
    // One that joins at the border, and one that is cut off across it.
    let late = world.hosts.pop().unwrap();
    world.run(S);
    world.hosts.push(late);
    world.run(4 * S);
    world.weather = Weather::default();
    world.run(5 * S);
    let (start, next) = (world.bx().start, world.bx().end.stream_next());
    assert!(next > EPOCH_PACKETS + 500);
    for host in &world.hosts {
        assert_eq!((host.holes(start), host.end.lost()), (0, 0));
        assert!(next - host.received.last_key_value().unwrap().0.1 < 5);
    }
}

#[test]
fn a_line_without_a_way_back_is_opened_from_its_announcements() {
    let mut random = Random::new(2);
    let announcement = OneWay {
        key_id: key(1).id(),
        start: Start::new(77).unwrap(),
        start_count: 3,
        schema_hash: SCHEMA_HASH,
        salt: core::array::from_fn(|index| draw(&mut random)[index]),
        next: 0,
    };
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut sealer = StreamSealer::one_way(&key(1), &announcement);
    for next in [0, 5, EPOCH_PACKETS - 3, 7 * EPOCH_PACKETS] {
        sealer.skip_to(next);
        let packet = OneWay { next, ..announcement }.packet(&key(1), &mut buffer).to_vec();
        assert_eq!(OneWay::key_id(&packet), Some(key(1).id()));
        let read = OneWay::read(&key(1), &packet).unwrap();
        assert_eq!(read, OneWay { next, ..announcement });
        for bit in 0..packet.len() * 8 {
            let mut changed = packet.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(OneWay::read(&key(1), &changed), None);
        }
        for length in 0..packet.len() {
            assert_eq!(OneWay::read(&key(1), &packet[..length]), None);
        }
        assert_eq!(OneWay::read(&key(2), &packet), None);
        let mut opener = StreamOpener::one_way(&key(1), &read).unwrap();
        let mut of_other = StreamOpener::one_way(&key(2), &read).unwrap();
        let salt = [1; 16];
        let mut of_salt = StreamOpener::one_way(&key(1), &OneWay { salt, ..read }).unwrap();
        let start_count = 4;
        let mut of_start = StreamOpener::one_way(&key(1), &OneWay { start_count, ..read }).unwrap();
        for counter in next..next + 10 {
            let packet = sealed(&mut sealer);
            assert!(!opens(&mut of_other, &packet, counter));
            assert!(!opens(&mut of_salt, &packet, counter));
            assert!(!opens(&mut of_start, &packet, counter));
            assert!(opens(&mut opener, &packet, counter));
        }
    }
    let far = OneWay { next: u64::MAX, ..announcement };
    assert!(StreamOpener::one_way(&key(1), &far).is_none());
}

#[test]
fn a_line_without_a_way_back_is_followed_over_65_536_borders() {
    let salt = [3; 16];
    let (key_id, start) = (key(1).id(), Start::new(77).unwrap());
    for (epoch, is_followed) in [(1 << 16, true), ((1 << 16) + 1, false)] {
        let next = epoch * EPOCH_PACKETS;
        let read = OneWay { key_id, start, start_count: 3, schema_hash: SCHEMA_HASH, salt, next };
        let opener = StreamOpener::one_way(&key(1), &read);
        assert_eq!(opener.map(|it| it.window().next()), is_followed.then_some(next));
    }
}
