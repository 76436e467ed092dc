//! Keys that come over a cable.

extern crate std;

use std::vec::Vec;

use super::super::wire::Kind;
use super::super::*;
use super::world::{address, key};
use crate::common::checksum::{CRC_BYTES, CRC32};
use crate::tell::packet::Start;

/// The packet with another checksum, after a change of what it covers.
fn changed(packet: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut packet = packet[..packet.len() - CRC_BYTES].to_vec();
    change(&mut packet);
    let checksum = CRC32.checksum(&packet).to_le_bytes();
    packet.extend(checksum);
    packet
}

/// Nothing else is read from either: another kind, more, less, or a damaged one.
fn unreadable(packet: &[u8], other: Kind) -> [Vec<u8>; 4] {
    let mut damaged = packet.to_vec();
    damaged[2] ^= 1;
    [
        changed(packet, |it| it[1] = other as u8),
        changed(packet, |it| it.push(0)),
        changed(packet, |it| it.truncate(it.len() - 1)),
        damaged,
    ]
}

#[test]
fn a_key_and_the_answer_to_it_are_read_as_they_were_sent_or_not_at_all() {
    let mut buffer = [0; SEALED_BYTES_MAX];
    let pairing = Pairing { key: key(1) };
    let packet = pairing.packet(&mut buffer).to_vec();
    assert_eq!(Pairing::read(&packet), Some(pairing));
    for packet in unreadable(&packet, Kind::Paired) {
        assert_eq!(Pairing::read(&packet), None, "{packet:?}");
    }
    assert_eq!(Pairing::read(&changed(&packet, |it| it[2..].fill(0))), None, "no key is zero");
    for is_stored in [false, true] {
        let paired = Paired { key_id: key(1).id(), is_stored };
        let packet = paired.packet(&mut buffer).to_vec();
        assert_eq!(Paired::read(&packet), Some(paired));
        for packet in unreadable(&packet, Kind::Pairing) {
            assert_eq!(Paired::read(&packet), None, "{packet:?}");
        }
    }
}

#[test]
fn a_key_comes_over_the_cable_alone_and_while_the_box_says_so() {
    // Its own key it is given again at any time.
    let cases = [
        (None, 0, false),
        (None, 1, true),
        (None, 255, true),
        (Some(key(2)), 0, false),
        (Some(key(2)), 60, true),
        (Some(key(1)), 0, true),
        (Some(key(1)), 60, true),
    ];
    let mut buffer = [0; SEALED_BYTES_MAX];
    let packet = Pairing { key: key(1) }.packet(&mut buffer).to_vec();
    for (of_box, pairing_s, is_taken) in cases {
        let mut bx = BoxEnd::new(of_box.clone(), Start::new(1).unwrap(), &[2; 32]);
        assert_eq!(bx.key(), of_box.as_ref());
        bx.describe(BoxState::Unpaired, pairing_s, "");
        for (from, is_cable) in [(Peer::Serial, true), (address(1), false)] {
            let heard = bx.receive(from, &packet, 0, || unreachable!(), &mut buffer);
            let taken = matches!(heard, Heard::Pairing(taken) if taken == key(1));
            assert_eq!(taken, is_taken && is_cable, "{of_box:?} {pairing_s} {from:?}");
        }
    }
}
