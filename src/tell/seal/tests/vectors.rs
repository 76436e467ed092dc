//! What others have published.

extern crate std;

use std::vec::Vec;

use super::super::aead::{CipherKey, TAG_BYTES};
use super::super::handshake::Handshake;

fn bytes(hexadecimal: &str) -> Vec<u8> {
    let digits = hexadecimal.as_bytes().chunks_exact(2);
    digits.map(|it| u8::from_str_radix(str::from_utf8(it).unwrap(), 16).unwrap()).collect()
}

fn array(hexadecimal: &str) -> [u8; 32] {
    bytes(hexadecimal).try_into().unwrap()
}

// Noise_NNpsk0_25519_ChaChaPoly_SHA256 of cacophony, as in snow's tests/vectors/cacophony.txt,
// commit 62fbfae2c84b644a0432ce497a4a47e4fa139a2d.
const PROLOGUE: &str = "4a6f686e2047616c74";
const PSK: &str = "54686973206973206d7920417573747269616e20706572737065637469766521";
const HOST_EPHEMERAL: &str = "893e28b9dc6ca8d611ab664754b8ceb7bac5117349a4439a6b0569da977c464a";
const BOX_EPHEMERAL: &str = "bbdb4cdbd309f1a1f2e1456967fe288cadd6f712d65dc7b7793d5e63da6b375b";
/// Payload and message, in turn from the host and from the box.
const MESSAGES: [[&str; 2]; 6] = [
    [
        "4c756477696720766f6e204d69736573",
        "ca35def5ae56cec33dc2036731ab14896bc4c75dbb07a61f879f8e3afa4c794479b962b8aff8485742ac32f905ba45369e2465fb59e138a93d67a0d1266b6a54",
    ],
    [
        "4d757272617920526f746862617264",
        "95ebc60d2b1fa672c1f46a8aa265ef51bfe38e7ccb39ec5be34069f144808843d6062704d5a9c422a8e834423f8c1feada7e8d0d910a1a2cd030fb584221e3",
    ],
    ["462e20412e20486179656b", "e632c3763d7669067383433197a3baddf146e9e70ad4b4e9e59e0f"],
    ["4361726c204d656e676572", "64c6bee32ea91c8474bb4c21d7a700109ad45af77b29764ba5eb1e"],
    [
        "4a65616e2d426170746973746520536179",
        "e2fa0bed0603b62d3ccac2ecabbf3fe33f3e86514909b323361626266cb2471cc8",
    ],
    [
        "457567656e2042f6686d20766f6e2042617765726b",
        "0c01dc9cec1fe4ddd692e8dd32188aa351088dc91183639a53b57aa4692b5ebdef8b8ca111",
    ],
];

#[test]
fn the_handshake_and_what_follows_are_those_of_other_implementations() {
    let (prologue, psk) = (bytes(PROLOGUE), array(PSK));
    let mut host = Handshake::of_host(&psk, &prologue, &array(HOST_EPHEMERAL)).unwrap();
    let mut of_box = Handshake::of_box(&psk, &prologue, &array(BOX_EPHEMERAL)).unwrap();
    let (mut message, mut read) = ([0; 200], [0; 200]);

    let [payload, expected] = MESSAGES[0].map(bytes);
    Handshake::check(&psk, &prologue, &expected, &mut read).expect("an authentic message");
    let length = host.write(&payload, &mut message).unwrap();
    assert_eq!(message[..length], expected);
    let length = of_box.read(&expected, &mut read).unwrap();
    assert_eq!(read[..length], payload);

    let [payload, expected] = MESSAGES[1].map(bytes);
    let length = of_box.write(&payload, &mut message).unwrap();
    assert_eq!(message[..length], expected);
    let length = host.read(&expected, &mut read).unwrap();
    assert_eq!(read[..length], payload);

    let (host, of_box) = (host.keys().unwrap(), of_box.keys().unwrap());
    assert_eq!(host.to_box.bytes(), of_box.to_box.bytes());
    assert_eq!(host.to_host.bytes(), of_box.to_host.bytes());
    for (index, message) in MESSAGES[2..].iter().enumerate() {
        let [payload, expected] = message.map(bytes);
        let key = if index % 2 == 0 { &host.to_box } else { &host.to_host };
        let mut packet = payload.clone();
        packet.resize(payload.len() + TAG_BYTES, 0);
        let counter = index as u64 / 2;
        key.seal(counter, &mut packet, 0);
        assert_eq!(packet, expected);
        assert_eq!(key.open(counter, &[], &expected, &mut read), Some(&payload[..]));
        assert!(key.open(counter + 1, &[], &expected, &mut read).is_none());
    }
}

#[test]
fn every_changed_bit_of_a_handshake_is_noticed() {
    let (prologue, psk) = (bytes(PROLOGUE), array(PSK));
    let mut read = [0; 200];
    let [first, second] = [MESSAGES[0][1], MESSAGES[1][1]].map(bytes);
    let mut host = Handshake::of_host(&psk, &prologue, &array(HOST_EPHEMERAL)).unwrap();
    host.write(&bytes(MESSAGES[0][0]), &mut [0; 200]).unwrap();
    for bit in 0..first.len() * 8 {
        let mut changed = first.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(Handshake::check(&psk, &prologue, &changed, &mut read).is_none());
    }
    for bit in 0..second.len() * 8 {
        let mut changed = second.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        // Of the public key's last byte X25519 ignores the highest bit; the transcript does not.
        assert!(host.clone().read(&changed, &mut read).is_none());
    }
    for length in 0..first.len() {
        assert!(Handshake::check(&psk, &prologue, &first[..length], &mut read).is_none());
    }
    assert!(Handshake::check(&psk, b"another", &first, &mut read).is_none());
    assert!(Handshake::check(&[1; 32], &prologue, &first, &mut read).is_none());
}

/// RFC 8439, appendix A.5: its nonce begins with four zeros, as Noise's do.
#[test]
fn sealing_is_as_the_standard_has_it() {
    let key = array("1c9240a5eb55d38af333888604f6b5f0473917c1402b80099dca5cbc207075c0");
    let header = bytes("f33388860000000000004e91");
    let counter = u64::from_le_bytes([1, 2, 3, 4, 5, 6, 7, 8]);
    let body = "Internet-Drafts are draft documents valid for a maximum of six months and may be \
        updated, replaced, or obsoleted by other documents at any time. It is inappropriate to use \
        Internet-Drafts as reference material or to cite them other than as \
        /\u{201c}work in progress./\u{201d}";
    let expected = bytes(
        "64a0861575861af460f062c79be643bd5e805cfd345cf389f108670ac76c8cb24c6cfc18755d43ee\
        a09ee94e382d26b0bdb7b73c321b0100d4f03b7f355894cf332f830e710b97ce98c8a84abd0b9481\
        14ad176e008d33bd60f982b1ff37c8559797a06ef4f0ef61c186324e2b3506383606907b6a7c02b0\
        f9f6157b53c867e4b9166c767b804d46a59b5216cde7a4e99040c5a40433225ee282a1b0a06c523e\
        af4534d7f83fa1155b0047718cbc546a0d072b04b3564eea1b422273f548271a0bb2316053fa7699\
        1955ebd63159434ecebb4e466dae5a1073a6727627097a1049e617d91d361094fa68f0ff77987130\
        305beaba2eda04df997b714d6c6f2c29a6ad5cb4022b02709beead9d67890cbb22392336fea1851f\
        38",
    );
    let mut packet = [&header, body.as_bytes(), &[0; TAG_BYTES]].concat();
    CipherKey::new(key).seal(counter, &mut packet, header.len());
    assert_eq!(packet[header.len()..], expected);
    let mut opened = [0; 300];
    let opened = CipherKey::new(key).open(counter, &header, &expected, &mut opened);
    assert_eq!(opened, Some(body.as_bytes()));
}
