//! Boxes and hosts of other releases: each learns what the other speaks.

extern crate std;

use std::vec::Vec;

use super::super::wire::{Answer, HEAD_BYTES, Kind, greeting};
use super::super::{Announcement, BoxState, Obstacle, SEALED_BYTES_MAX};
use super::world::{S, Weather, World, address};
use crate::common::checksum::CRC32;
use crate::tell::packet::{PROTOCOL_VERSION, SCHEMA_HASH};

/// Where the state stands in an announcement: behind the key's id, start, schema hash and versions.
const STATE_AT: usize = HEAD_BYTES + 8 + 4 + 4 + 2;

/// A box with these versions and messages, and two hosts: one knows its address, the other hears its
/// announcements.
fn met(versions: [u8; 2], schema_hash: u32) -> World {
    let mut world = World::new(21, Weather::default()).with_hosts(2);
    let announcement = &mut world.bx().end.announcement;
    (announcement.versions, announcement.schema_hash) = (versions, schema_hash);
    world.log = Some(Vec::new());
    world.run(3 * S);
    world
}

#[test]
fn hosts_are_told_of_a_box_of_other_versions_alone() {
    let ours = PROTOCOL_VERSION;
    for versions in [[ours + 1, ours + 3], [255, 255], [1, ours - 1], [0, 0]] {
        let mut world = met(versions, SCHEMA_HASH);
        for host in &world.hosts {
            assert_eq!(host.end.obstacle(), Some(&Obstacle::OtherVersions { versions }));
        }
        assert!(world.bx().end.listeners().is_empty());
        // As such a box sends them: its own highest version comes first.
        let (at, log) = (world.at, world.log.take().unwrap());
        assert!(log.iter().all(|it| it.0 != at || it.2[0] == versions[1]));
    }
}

#[test]
fn hosts_are_told_of_a_box_with_other_messages() {
    let hash = SCHEMA_HASH ^ 1;
    let mut world = met([PROTOCOL_VERSION; 2], hash);
    for host in &world.hosts {
        assert_eq!(host.end.obstacle(), Some(&Obstacle::OtherSchema { hash }));
    }
    assert!(world.bx().end.listeners().is_empty());
}

#[test]
fn a_box_that_speaks_other_versions_too_is_spoken_to_in_the_common_one() {
    let versions = [PROTOCOL_VERSION, PROTOCOL_VERSION + 2];
    let mut world = met(versions, SCHEMA_HASH);
    assert_eq!(world.bx().end.listeners().len(), 2);
    for (from, to, packet) in world.log.take().unwrap() {
        let is_of_meeting = matches!(packet[1], 1..=3);
        let expected =
            if from == world.at && is_of_meeting { versions[1] } else { PROTOCOL_VERSION };
        assert_eq!(packet[0], expected, "{from:?} {to:?} {packet:?}");
    }
}

#[test]
fn a_host_of_any_version_is_answered() {
    let mut world = World::new(22, Weather::default());
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut packet = greeting([5; 8], &mut buffer).to_vec();
    let expected = world.box_receives(address(1), &packet);
    assert_eq!(Answer::read(&expected[0]).unwrap().token, [5; 8]);
    for version in 0..=255 {
        packet[0] = version;
        assert_eq!(world.box_receives(address(1), &packet), expected, "version {version}");
        let announcement = Announcement::parse(&expected[0]).unwrap();
        assert_eq!(announcement.versions, [PROTOCOL_VERSION; 2]);
    }
}

/// All but the packets of meeting and of updates are of one version.
#[test]
fn what_follows_the_meeting_is_of_one_version() {
    for kind in 0..=255 {
        for version in [PROTOCOL_VERSION - 1, PROTOCOL_VERSION + 1, 0, 255] {
            let is_of_all = matches!(kind, 1..=3 | 11..=13);
            assert_eq!(Kind::of(&[version, kind, 7]).is_some(), is_of_all, "{version} {kind}");
        }
        let is_known = (1..=13).contains(&kind);
        assert_eq!(Kind::of(&[PROTOCOL_VERSION, kind]).is_some(), is_known, "{kind}");
    }
}

/// A later version may have other states, and say more behind the text.
#[test]
fn what_a_later_version_adds_to_an_announcement_is_left_out() {
    let mut world = World::new(23, Weather::default());
    let mut buffer = [0; SEALED_BYTES_MAX];
    let packet = world.bx().end.announcement(&mut buffer);
    let expected = Announcement { state: BoxState::Later, ..Announcement::parse(packet).unwrap() };
    let mut later = packet[..packet.len() - 4].to_vec();
    (later[0], later[STATE_AT]) = (PROTOCOL_VERSION + 1, 9);
    later.extend([1, 2, 3]);
    let checksum = CRC32.checksum(&later).to_le_bytes();
    later.extend(checksum);
    assert_eq!(Announcement::parse(&later), Some(expected));
}
