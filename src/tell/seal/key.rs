//! The key of a box: 32 random bytes that the box and its hosts know, and nobody else.
//!
//! A host draws it ([`Key::new`]), and the box's card or a cable brings it to the box. Nothing ever
//! gives it back: what is sent and shown is its [`KeyId`], from which it cannot be computed.
//!
//! # As text
//!
//! In files and QR codes a key is a line of [`KEY_TEXT_BYTES`] ASCII characters:
//!
//! ```text
//! PLUMBLINE-KEY-1:<64 hexadecimal digits>:<8 hexadecimal digits>
//! ```
//!
//! The last eight are the CRC-32 (ISO-HDLC) of all characters before the colon in front of them, as
//! capital letters, so that a slip of a person who types it is found. All characters are in the
//! alphanumeric set of QR codes, which makes such a code a third smaller than bytes would.
//!
//! # In memory
//!
//! A [`Key`] and a [`KeyText`] are overwritten when they are dropped, and `Debug` does not show
//! them. A value that is moved may leave a copy on the stack, which nothing overwrites.

use core::fmt;

use hmac::{Hmac, Mac};
use sha2::Sha256;
use zeroize::Zeroizing;

use crate::common::checksum::CRC32;

/// The file of a box's key, beside the configuration on its card.
pub const KEY_FILE_NAME: &str = "box.key";

/// The name that a new key has on the card until it has replaced the old one.
pub const NEW_KEY_FILE_NAME: &str = "box.new";

/// Bytes of a key.
const KEY_BYTES: usize = 32;

/// What each key's text begins with, before its version.
const PREFIX: &[u8] = b"PLUMBLINE-KEY-";

/// The version of the text and its colon.
const VERSION: &[u8] = b"1:";

/// Where the digits of the key begin and end; they are followed by a colon and the checksum.
const DIGITS_START: usize = PREFIX.len() + VERSION.len();
const DIGITS_END: usize = DIGITS_START + 2 * KEY_BYTES;
const CHECKSUM_START: usize = DIGITS_END + 1;

/// Characters of a key's text, each of one byte.
pub const KEY_TEXT_BYTES: usize = CHECKSUM_START + 8;

/// What a key's identity is computed from, besides the key.
const ID_CONTEXT: &[u8] = b"plumbline key id";

/// The key of a box. Comparing two takes no constant time, and is for those of one computer: nothing
/// that comes over a link is compared with a key.
#[derive(Clone, PartialEq, Eq)]
pub struct Key {
    bytes: Zeroizing<[u8; KEY_BYTES]>,
}

impl Key {
    /// The key of these bytes, which must be random.
    ///
    /// # Errors
    /// [`KeyError::Zero`] when all of them are zero, as in a buffer that nothing was written to.
    pub fn new(bytes: [u8; KEY_BYTES]) -> Result<Self, KeyError> {
        let bytes = Zeroizing::new(bytes);
        if bytes.iter().all(|&byte| byte == 0) {
            return Err(KeyError::Zero);
        }
        Ok(Self { bytes })
    }

    /// The key itself, for ciphers.
    #[must_use]
    pub fn bytes(&self) -> &[u8; KEY_BYTES] {
        &self.bytes
    }

    /// By which the key is known: the first 8 bytes of HMAC-SHA256(key, "plumbline key id").
    #[must_use]
    pub fn id(&self) -> KeyId {
        // HMAC takes keys of every length.
        let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(self.bytes.as_slice()) else {
            unreachable!("HMAC refuses no key")
        };
        mac.update(ID_CONTEXT);
        let code = mac.finalize().into_bytes();
        KeyId(core::array::from_fn(|at| code[at]))
    }

    /// The key as a line of text, without the line's end.
    #[must_use]
    pub fn text(&self) -> KeyText {
        let mut ascii = Zeroizing::new([b':'; KEY_TEXT_BYTES]);
        ascii[..PREFIX.len()].copy_from_slice(PREFIX);
        ascii[PREFIX.len()..DIGITS_START].copy_from_slice(VERSION);
        put_hex(&mut ascii[DIGITS_START..DIGITS_END], self.bytes.as_slice());
        let checksum = CRC32.checksum(&ascii[..DIGITS_END]);
        put_hex(&mut ascii[CHECKSUM_START..], &checksum.to_be_bytes());
        KeyText { ascii }
    }

    /// The key of a text. White space around it is ignored, and small letters are taken for
    /// capital ones.
    ///
    /// # Errors
    /// When it is not the whole, correct text of a key. The reason does not repeat any of it.
    pub fn from_text(text: &str) -> Result<Self, KeyError> {
        let text = text.trim();
        let is_prefixed =
            text.as_bytes().get(..PREFIX.len()).is_some_and(|it| it.eq_ignore_ascii_case(PREFIX));
        if !is_prefixed {
            return Err(KeyError::Prefix);
        }
        // It may have been cut off within the version and its colon.
        let version = text.as_bytes()[PREFIX.len()..].iter().zip(VERSION);
        if version.clone().any(|(is, expected)| is != expected) {
            return Err(KeyError::Version);
        }
        let found = text.chars().count();
        if found != KEY_TEXT_BYTES {
            return Err(KeyError::Length { found });
        }
        let mut bytes = Zeroizing::new([0; KEY_BYTES]);
        let mut checksum = 0_u32;
        for (index, letter) in text.chars().enumerate().skip(DIGITS_START) {
            let wrong = KeyError::Character { position: index + 1 };
            if index == DIGITS_END {
                if letter != ':' {
                    return Err(wrong);
                }
                continue;
            }
            let digit = letter.to_digit(16).ok_or(wrong)?;
            if index < DIGITS_END {
                let byte = &mut bytes[(index - DIGITS_START) / 2];
                *byte = (*byte << 4) | digit as u8;
            } else {
                checksum = (checksum << 4) | digit;
            }
        }
        let mut digest = CRC32.digest();
        for byte in text.bytes().take(DIGITS_END) {
            digest.update(&[byte.to_ascii_uppercase()]);
        }
        if digest.finalize() != checksum {
            return Err(KeyError::Checksum);
        }
        Self::new(*bytes)
    }
}

/// Shows by which key it is, and not the key.
impl fmt::Debug for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Key({})", self.id())
    }
}

/// Writes bytes as capital hexadecimal digits, two for each.
fn put_hex(digits: &mut [u8], bytes: &[u8]) {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    for (pair, byte) in digits.chunks_exact_mut(2).zip(bytes) {
        pair[0] = DIGITS[usize::from(byte >> 4)];
        pair[1] = DIGITS[usize::from(byte & 0x0f)];
    }
}

/// By which a key is known without being given away. On the link, all zeros stand for no key:
/// `None` here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyId([u8; 8]);

impl KeyId {
    /// The identity of these bytes; `None` if all are zero.
    #[must_use]
    pub fn new(bytes: [u8; 8]) -> Option<Self> {
        (bytes != [0; 8]).then_some(Self(bytes))
    }

    /// Its bytes, as on the link.
    #[must_use]
    pub fn bytes(self) -> [u8; 8] {
        self.0
    }
}

/// 16 small hexadecimal digits.
impl fmt::Display for KeyId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:016x}", u64::from_be_bytes(self.0))
    }
}

/// The text of a key, which is as secret as the key.
#[derive(Clone)]
pub struct KeyText {
    ascii: Zeroizing<[u8; KEY_TEXT_BYTES]>,
}

impl KeyText {
    /// The text itself.
    #[must_use]
    pub fn as_str(&self) -> &str {
        // It is ASCII.
        core::str::from_utf8(self.ascii.as_slice()).unwrap_or_default()
    }
}

impl fmt::Debug for KeyText {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("KeyText(hidden)")
    }
}

/// Why something is not a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyError {
    /// It does not begin as the text of a key does.
    Prefix,
    /// It is a key of another version.
    Version,
    /// It has this number of characters instead of [`KEY_TEXT_BYTES`].
    Length {
        /// The number of characters, without the white space around them.
        found: usize,
    },
    /// A character that cannot stand where it does.
    Character {
        /// Its place in the text, from 1.
        position: usize,
    },
    /// The text disagrees with its checksum.
    Checksum,
    /// Every byte of the key is zero.
    Zero,
}

impl fmt::Display for KeyError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Prefix => formatter.write_str("it does not begin with PLUMBLINE-KEY-1:"),
            Self::Version => formatter
                .write_str("it is a key of another version, where this program knows version 1"),
            Self::Length { found } => {
                write!(formatter, "it has {found} characters, where a key has {KEY_TEXT_BYTES}")
            }
            Self::Character { position } if *position == DIGITS_END + 1 => {
                write!(formatter, "its character {position} is not a colon")
            }
            Self::Character { position } => {
                write!(formatter, "its character {position} is not a digit, 0 to 9 or A to F")
            }
            Self::Checksum => {
                formatter.write_str("its checksum is wrong: a character is not as it was")
            }
            Self::Zero => formatter.write_str("all its digits are zero"),
        }
    }
}

impl core::error::Error for KeyError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::format;
    use std::string::String;

    use super::*;

    fn key() -> Key {
        Key::new(core::array::from_fn(|at| (at * 37 + 11) as u8)).unwrap()
    }

    fn with(text: &str, index: usize, letter: char) -> String {
        text.chars().enumerate().map(|(at, is)| if at == index { letter } else { is }).collect()
    }

    /// Both values were computed with Python's `hmac` and `zlib`.
    #[test]
    fn the_identity_and_the_text_are_those_of_another_implementation() {
        let key = Key::new(core::array::from_fn(|at| at as u8)).unwrap();
        assert_eq!(format!("{}", key.id()), "23d965de7c2e9261");
        assert_eq!(
            key.text().as_str(),
            "PLUMBLINE-KEY-1:000102030405060708090A0B0C0D0E0F101112131415161718191A1B1C1D1E1F:05ED0A9F"
        );
    }

    #[test]
    fn a_key_comes_back_from_its_text_whatever_is_around_it() {
        let text = key().text();
        let text = text.as_str();
        assert_eq!(text.len(), KEY_TEXT_BYTES);
        let alphanumeric = |it: u8| it.is_ascii_digit() || it.is_ascii_uppercase();
        assert!(text.bytes().all(|it| alphanumeric(it) || b"-:".contains(&it)), "{text}");
        for around in [String::from(text), format!("\n \t{text}\r\n"), text.to_ascii_lowercase()] {
            assert_eq!(Key::from_text(&around), Ok(key()));
        }
    }

    #[test]
    fn every_single_changed_character_is_refused() {
        let text = key().text();
        let text = text.as_str();
        let others = ('!'..='~').chain(['\u{e4}', '\u{ff10}']);
        for other in others {
            for (index, is) in text.chars().enumerate() {
                if !is.eq_ignore_ascii_case(&other) {
                    let changed = with(text, index, other);
                    assert!(Key::from_text(&changed).is_err(), "{changed}");
                }
            }
        }
    }

    #[test]
    fn two_digits_that_changed_places_are_refused() {
        let text = key().text();
        let digits: std::vec::Vec<char> = text.as_str().chars().collect();
        for index in DIGITS_START..DIGITS_END - 1 {
            let mut swapped = digits.clone();
            swapped.swap(index, index + 1);
            let expected = if swapped == digits { Ok(key()) } else { Err(KeyError::Checksum) };
            assert_eq!(Key::from_text(&String::from_iter(swapped)), expected);
        }
    }

    #[test]
    fn what_is_no_key_is_refused_for_its_reason() {
        let text = key().text();
        let text = text.as_str();
        let zeros = "0".repeat(64);
        let zeros = format!("PLUMBLINE-KEY-1:{zeros}");
        let zeros = format!("{zeros}:{:08X}", CRC32.checksum(zeros.as_bytes()));
        let cases = [
            ("", KeyError::Prefix),
            ("device = \"ward 3\"", KeyError::Prefix),
            ("PLUMBLINE-KEY", KeyError::Prefix),
            ("PLUMBLINE-KEY-", KeyError::Length { found: 14 }),
            (&text[..15], KeyError::Length { found: 15 }),
            (&text[..88], KeyError::Length { found: 88 }),
            (&format!("{text}0"), KeyError::Length { found: 90 }),
            (&text.replace("KEY-1", "KEY-2"), KeyError::Version),
            (&text.replace("KEY-1", "KEY-12"), KeyError::Version),
            (&with(text, 16, 'G'), KeyError::Character { position: 17 }),
            (&with(text, 80, '0'), KeyError::Character { position: 81 }),
            (&with(text, 88, ' '), KeyError::Length { found: 88 }),
            (&with(text, 88, '-'), KeyError::Character { position: 89 }),
            (&zeros, KeyError::Zero),
        ];
        for (text, reason) in cases {
            assert_eq!(Key::from_text(text), Err(reason), "{text}");
        }
        assert_eq!(Key::new([0; 32]), Err(KeyError::Zero));
    }

    #[test]
    fn what_is_shown_of_a_key_does_not_give_it_away() {
        let key = key();
        let text = key.text();
        let shown = format!("{key:?} {key:#?} {text:?} {text:#?}").to_ascii_uppercase();
        let digits = &text.as_str()[DIGITS_START..DIGITS_END];
        for start in 0..digits.len() - 8 {
            assert!(!shown.contains(&digits[start..start + 8]), "{shown}");
        }
        // Nor as a list of numbers.
        assert!(!shown.contains(&format!("{}, {}", key.bytes()[0], key.bytes()[1])), "{shown}");
        assert!(shown.contains(&format!("{}", key.id()).to_ascii_uppercase()), "{shown}");
    }

    #[test]
    fn an_identity_of_zeros_is_none() {
        assert_eq!(KeyId::new([0; 8]), None);
        let id = key().id();
        assert_eq!(KeyId::new(id.bytes()), Some(id));
    }
}
