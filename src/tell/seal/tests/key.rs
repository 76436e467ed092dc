//! What people are told of a key's text.

extern crate std;

use std::format;
use std::string::{String, ToString};

use super::super::{KEY_TEXT_BYTES, Key, KeyError};

/// Its checksum was computed with Python's `zlib`.
const TEXT: &str =
    "PLUMBLINE-KEY-1:000102030405060708090A0B0C0D0E0F101112131415161718191A1B1C1D1E1F:05ED0A9F";

/// The text with another character at this position, counted from 1.
fn with(position: usize, letter: char) -> String {
    let letters = TEXT.chars().zip(1..);
    letters.map(|(is, at)| if at == position { letter } else { is }).collect()
}

#[test]
fn a_text_of_another_implementation_is_its_key() {
    let key = Key::new(core::array::from_fn(|at| at as u8)).unwrap();
    assert_eq!(Key::from_text(TEXT), Ok(key.clone()));
    assert_eq!((key.text().as_str(), TEXT.len()), (TEXT, KEY_TEXT_BYTES));
    assert_eq!(format!("{:?}", key.text()), "KeyText(hidden)");
}

#[test]
fn people_are_told_what_is_wrong_with_a_key_and_where() {
    let of = |text: &str| Key::from_text(text).unwrap_err().to_string();
    let told = [
        (of("device = 3"), "it does not begin with PLUMBLINE-KEY-1:"),
        (
            of("PLUMBLINE-KEY-2:"),
            "it is a key of another version, where this program knows version 1",
        ),
        (of(&TEXT[..16]), "it has 16 characters, where a key has 89"),
        (of(&with(17, 'G')), "its character 17 is not a digit, 0 to 9 or A to F"),
        (of(&with(79, ':')), "its character 79 is not a digit, 0 to 9 or A to F"),
        (of(&with(80, ':')), "its character 80 is not a digit, 0 to 9 or A to F"),
        (of(&with(81, '0')), "its character 81 is not a colon"),
        (of(&with(82, ':')), "its character 82 is not a digit, 0 to 9 or A to F"),
        (of(&with(89, '0')), "its checksum is wrong: a character is not as it was"),
        (KeyError::Zero.to_string(), "all its digits are zero"),
    ];
    for (told, expected) in told {
        assert_eq!(told, expected);
    }
}
