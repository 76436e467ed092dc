//! What other programs must count and read alike.

extern crate std;

use super::super::handshake::NOISE_BYTES;
use super::super::wire::{
    ACCEPTANCE_BYTES, ACCEPTED_BYTES, ADMISSION_BYTES, CALLER_BYTES, COOKIE_BYTES, GREETING_BYTES,
    HEAD_BYTES, Kind, Purpose, Reader, TERMS_BYTES, Terms, Writer, put_counter, take_counter,
};
use super::super::{SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX};
use super::world::key;
use crate::tell::packet::{PROTOCOL_VERSION, SCHEMA_HASH, Start, frame_packet};

/// As `LINK.md` gives them, field by field.
#[test]
fn the_sizes_are_those_of_the_description() {
    let head = 1 + 1;
    let noise = 32 + 16;
    let admission = 8 + 8 + 32;
    let sizes = [
        ("a greeting", GREETING_BYTES, 227),
        ("terms: key id, both versions, start", TERMS_BYTES, 8 + 2 + 2 + 4),
        ("a caller: process, length of the name, name", CALLER_BYTES, 5 + 1 + 32),
        ("what Noise adds: public key and tag", NOISE_BYTES, noise),
        ("an admission: next counter, epoch, key", ADMISSION_BYTES, admission),
        ("what an acceptance says: session, admission", ACCEPTED_BYTES, 2 + admission),
        ("an acceptance", ACCEPTANCE_BYTES, head + noise + 2 + admission),
        // Message, session, counter, tag.
        ("the longest packet", SEALED_BYTES_MAX, head + 241 + 2 + 10 + 16),
    ];
    for (what, bytes, described) in sizes {
        assert_eq!(bytes, described, "{what}");
    }
    // Without zeros COBS adds the most.
    let mut buffer = [0; 2 * SEALED_BYTES_MAX];
    let frame = frame_packet(&[1; SEALED_BYTES_MAX], &mut buffer).unwrap();
    assert_eq!(frame.len(), SEALED_FRAME_BYTES_MAX);
}

#[test]
fn the_longest_prologue_fills_its_room() {
    let start = Start::new(0x0403_0201).unwrap();
    let terms = Terms { key_id: key(1).id(), host_versions: [5, 6], box_versions: [7, 8], start };
    let (version, hash) = ([PROTOCOL_VERSION], SCHEMA_HASH.to_le_bytes());
    let id = key(1).id().bytes();
    let agreed: [&[u8]; 5] = [b"plumbline link", &version, &hash, &id, &[5, 6, 7, 8, 1, 2, 3, 4]];
    let expected = [&agreed.concat()[..], &[9; COOKIE_BYTES]].concat();
    let prologue = terms.prologue(Purpose::Listening, &[9; COOKIE_BYTES]);
    assert_eq!(prologue[..], expected);
    assert_eq!(prologue.capacity(), expected.len());
}

#[test]
fn a_counter_has_one_form_only() {
    for counter in [0, 1, 0x7F, 0x80, 0x3FFF, 0x4000, u64::MAX >> 1, 1 << 63, u64::MAX] {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let mut writer = Writer::new(&mut buffer, Kind::Stream);
        put_counter(&mut writer, counter);
        let bytes = &writer.written()[HEAD_BYTES..];
        let mut reader = Reader(bytes);
        assert_eq!((take_counter(&mut reader), reader.0), (Some(counter), &[][..]));
        // The same number with a group of zeros more.
        let mut longer = bytes.to_vec();
        *longer.last_mut().unwrap() |= 0x80;
        longer.push(0);
        assert_eq!(take_counter(&mut Reader(&longer)), None, "{longer:?}");
        assert_eq!(take_counter(&mut Reader(&longer[..bytes.len()])), None, "{counter} cut off");
    }
    // More than 64 bits.
    let mut beyond = [0xFF; 10];
    for last in [2, 0x7F, 0x80, 0xFF] {
        beyond[9] = last;
        assert_eq!(take_counter(&mut Reader(&beyond)), None, "{beyond:?}");
    }
}
