//! Texts and numbers that persons enter: what they may be, and how a wrong one is reported.

use plumbline::config::is_visible;
use plumbline_files::BadInput;

/// The most characters of a name: of a protocol, a study, whoever measures.
pub const NAME_LETTERS_MAX: usize = 80;

/// The most characters of a condition's short name, which is a part of folders' names.
pub const SHORT_LETTERS_MAX: usize = 32;

/// The most characters of a longer text: an instruction, a note on a protocol.
pub const TEXT_LETTERS_MAX: usize = 1000;

/// The most characters of a reason.
pub const REASON_LETTERS_MAX: usize = 200;

/// Checks a text: not empty, not too long, and without characters that cannot be seen.
///
/// # Errors
/// What was found, and the remedy.
pub fn check_text(text: &str, letters_max: usize) -> Result<(), (String, String)> {
    if text.trim().is_empty() {
        return Err(("it is empty".to_owned(), "write it down".to_owned()));
    }
    if text.trim() != text {
        let found = "it begins or ends with a space".to_owned();
        return Err((found, "remove the space".to_owned()));
    }
    let letters = text.chars().count();
    if letters > letters_max {
        let remedy = format!("use at most {letters_max}");
        return Err((format!("it has {letters} characters"), remedy));
    }
    match text.chars().find(|letter| !is_visible(*letter)) {
        Some(letter) => Err((
            format!("it has a character that cannot be seen, U+{:04X}", u32::from(letter)),
            "write it in one line, with visible characters only".to_owned(),
        )),
        None => Ok(()),
    }
}

/// Checks a short name: small letters, digits and single hyphens between them.
pub fn check_short(text: &str) -> Result<(), (String, String)> {
    check_text(text, SHORT_LETTERS_MAX)?;
    let is_word = |word: &str| {
        !word.is_empty() && word.chars().all(|it| it.is_ascii_lowercase() || it.is_ascii_digit())
    };
    if text.split('-').all(is_word) {
        return Ok(());
    }
    Err((
        format!("{text:?} is not a short name"),
        "use small letters a to z, digits and hyphens between them, as in eyes-open-firm"
            .to_owned(),
    ))
}

/// Checks that a number is within its bounds.
pub fn check_number(value: f64, from: f64, to: f64, unit: &str) -> Result<(), (String, String)> {
    if (from..=to).contains(&value) {
        return Ok(());
    }
    Err((format!("{value} {unit}"), format!("give a number from {from} to {to}")))
}

/// A check's outcome as an error about a field of a file.
///
/// # Errors
/// When there is one.
pub fn of_field(
    place: &str,
    field: &str,
    checked: Result<(), (String, String)>,
) -> Result<(), BadInput> {
    checked.map_err(|(found, remedy)| BadInput::new(place, field, found, remedy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_can_be_seen_in_one_line_is_a_text() {
        for (text, part) in [
            ("", "empty"),
            (" \u{a0}", "empty"),
            (" a", "begins or ends"),
            ("a\n", "begins or ends"),
            ("a\nb", "U+000A"),
            ("a\u{202e}b", "U+202E"),
            ("a\u{200b}b", "U+200B"),
            ("a\u{1b}[2Jb", "U+001B"),
            ("äöüäöüäöüäö", "11 characters"),
        ] {
            let (found, _) = check_text(text, 10).unwrap_err();
            assert!(found.contains(part), "{text:?}: {found}");
        }
        for text in ["äöüäöüäöüä", "Rücken µm", "目を閉じて", "a"] {
            assert_eq!(check_text(text, 10), Ok(()));
        }
    }

    #[test]
    fn a_short_name_can_be_a_part_of_a_folders_name() {
        for text in ["control", "eyes-open-firm", "2", "a-1"] {
            assert_eq!(check_short(text), Ok(()), "{text}");
        }
        for text in ["", "-", "a-", "-a", "a--b", "A", "a b", "a/b", "..", "a.b", "ä", "a_b"] {
            assert!(check_short(text).is_err(), "{text}");
        }
        assert!(check_short(&"a".repeat(SHORT_LETTERS_MAX + 1)).is_err());
    }

    #[test]
    fn what_is_no_number_is_in_no_bounds() {
        assert_eq!(check_number(1.0, 1.0, 2.0, "s"), Ok(()));
        for value in [0.999, 2.001, f64::NAN, f64::INFINITY, -f64::INFINITY] {
            assert!(check_number(value, 1.0, 2.0, "s").is_err(), "{value}");
        }
    }
}
