//! Text from outside, made safe to show and to put into tables.
//!
//! [`printable`] is applied once, where text enters: messages of a box, labels of marks. The texts of
//! a configuration need it not: one with a character that cannot be seen is refused where it is made
//! and where it is read.
//! [`cell`] is applied where a text becomes a cell of a table, and [`from_cell`] is its inverse.

use std::borrow::Cow;

use plumbline::config::is_visible;

/// What stands for a character that cannot be seen. It has one byte, so that no text grows.
const HIDDEN: char = '?';

/// A text as it can be shown: white space is a space, and each character that a reader cannot see
/// is a question mark: see [`is_visible`].
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.chars().all(|letter| shown(letter) == letter) {
        return Cow::Borrowed(text);
    }
    Cow::Owned(text.chars().map(shown).collect())
}

/// The character in its place; never longer in UTF-8.
#[must_use]
pub fn shown(letter: char) -> char {
    match letter {
        '\t'..='\r' | '\u{85}' | '\u{2028}' | '\u{2029}' => ' ',
        _ if !is_visible(letter) => HIDDEN,
        _ => letter,
    }
}

/// A text as a cell of a table. Spreadsheets compute a cell that begins as a formula, and a formula
/// can send the table elsewhere: such a text gets an apostrophe before it, as OWASP advises, and so
/// does one that has apostrophes there already, so that [`from_cell`] gives it back. Numbers are not
/// texts: they are written without this.
#[must_use]
pub fn cell(text: &str) -> Cow<'_, str> {
    if is_quoted(text) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
}

/// The text of a [`cell`].
#[must_use]
pub fn from_cell(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| is_quoted(text)).unwrap_or(cell)
}

fn is_quoted(text: &str) -> bool {
    // The last four are the wide forms of =, +, - and @.
    text.trim_start_matches('\'').starts_with([
        '=', '+', '-', '@', '\t', '\r', '\n', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
    ])
}

/// Texts of a serialised row as [`cell`]s: `#[serde(with = "plumbline_files::text::as_cell")]`.
pub mod as_cell {
    use serde::{Deserialize as _, Deserializer, Serializer};

    /// Writes a cell.
    ///
    /// # Errors
    /// Those of the format.
    pub fn serialize<S: Serializer>(text: &str, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&super::cell(text))
    }

    /// Reads a cell.
    ///
    /// # Errors
    /// Those of the format.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
        String::deserialize(deserializer).map(|cell| super::from_cell(&cell).to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_seen_is_seen() {
        let cases = [
            ("ward 3, Rücken µm 上", "ward 3, Rücken µm 上"),
            ("\u{1b}[2J\u{1b}]0;gone\u{7}", "?[2J?]0;gone?"),
            // The one-byte form of ESC [.
            ("a\u{9b}31mred", "a?31mred"),
            ("first\r\nsecond\tthird\u{2028}", "first  second third "),
            // Shown as "lanigiro" where the direction is obeyed.
            ("\u{202e}original\u{202c}", "?original?"),
            ("lum\u{200b}bar\u{feff}", "lum?bar?"),
            ("\u{2066}\u{61c}\u{e0041}\u{fe0f}\0\u{7f}", "??????"),
            // Default-ignorable marks of shorthand and of music.
            ("\u{1bca0}\u{1bca3}\u{1d173}\u{1d17a}", "????"),
        ];
        for (text, wanted) in cases {
            assert_eq!(printable(text), wanted);
            assert_eq!(printable(wanted), wanted);
        }
        let longer = |it: &char| shown(*it).len_utf8() > it.len_utf8();
        assert_eq!((char::MIN..=char::MAX).find(longer), None);
    }

    #[test]
    fn no_cell_begins_a_formula_and_every_text_comes_back() {
        for text in ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx", "\nx", "'=1", "''@", "＝1"] {
            let cell = cell(text);
            assert_eq!(cell, format!("'{text}"));
            assert_eq!(from_cell(&cell), text);
        }
        for text in ["", "lumbar", "1+1", "a=b", " =1", "don't", "'turns'", "'"] {
            assert_eq!((cell(text).as_ref(), from_cell(text)), (text, text));
        }
        // Of another program: an apostrophe that protects nothing is a character.
        assert_eq!(from_cell("'s-Hertogenbosch"), "'s-Hertogenbosch");
    }
}
