//! The key of a trial, and the folder that it names.

use std::fmt;
use std::path::{Path, PathBuf};

use plumbline_files::BadInput;
use plumbline_session::{check_text, of_field};

use crate::names;

/// The most characters of a participant, session or condition.
const LETTERS_MAX: usize = 80;

/// The most bytes of a folder's name on every common file system.
const NAME_BYTES_MAX: usize = 255;

/// The greatest run.
pub const RUN_MAX: u32 = 9999;

/// Who was measured, when and under which condition: no two trials of a cohort have the same.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Key {
    /// The participant's code.
    pub participant: String,
    /// The session, such as `1`.
    pub session: String,
    /// The condition.
    pub condition: String,
    /// Which of the trials under this condition in this session, from 1.
    pub run: u32,
}

impl Key {
    /// Checks that it can be a key; `place` is the trial's.
    ///
    /// # Errors
    /// When a part is empty, too long, or has a character that cannot be seen.
    pub fn check(&self, place: &str) -> Result<(), BadInput> {
        let Self { participant, session, condition, run } = self;
        for (field, text) in
            [("participant", participant), ("session", session), ("condition", condition)]
        {
            of_field(place, field, check_text(text, LETTERS_MAX))?;
            if part(field, text).len() > NAME_BYTES_MAX {
                let found = format!("{text:?} is too long for the name of a folder");
                return Err(BadInput::new(place, field, found, "use a shorter one"));
            }
        }
        if (1..=RUN_MAX).contains(run) {
            return Ok(());
        }
        let remedy = format!("give a whole number, 1 to {RUN_MAX}");
        Err(BadInput::new(place, "run", run, remedy))
    }

    /// Its folder below `points/`: `participant=P/session=S/condition=C/run=R`.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        let Self { participant, session, condition, run } = self;
        [
            part("participant", participant),
            part("session", session),
            part("condition", condition),
            format!("run={run}"),
        ]
        .iter()
        .collect()
    }

    /// The file of its points, relative to the cohort.
    #[must_use]
    pub fn points_file(&self) -> PathBuf {
        Path::new(names::POINTS).join(self.folder()).join(names::POINTS_FILE)
    }
}

/// "P01, session 1, control, run 2".
impl fmt::Display for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { participant, session, condition, run } = self;
        write!(formatter, "{participant}, session {session}, {condition}, run {run}")
    }
}

/// A folder's name as Hive writes it: `NAME=VALUE`, in which characters that have a meaning in paths
/// are written as `%` and two hexadecimal digits. It escapes those that Apache Spark escapes, on
/// Windows too, so that both make the same name of a value.
fn part(name: &str, value: &str) -> String {
    let mut text = format!("{name}=");
    for letter in value.chars() {
        if letter.is_ascii_control() || "\"#%'*/:=?\\{[]^<>|".contains(letter) {
            text += &format!("%{:02X}", u32::from(letter));
        } else {
            text.push(letter);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> Key {
        let [participant, session, condition] = ["P01", "1", "eyes/open 50%"].map(str::to_owned);
        Key { participant, session, condition, run: 2 }
    }

    #[test]
    fn a_key_names_a_folder_whatever_its_parts_contain() {
        assert_eq!(key().check("t"), Ok(()));
        let folder = key().folder().display().to_string();
        assert_eq!(folder, "participant=P01/session=1/condition=eyes%2Fopen 50%25/run=2");
        let upwards = Key { participant: "../..".to_owned(), ..key() }.folder();
        assert_eq!(upwards.components().count(), 4);
        assert_eq!(key().to_string(), "P01, session 1, eyes/open 50%, run 2");
    }

    #[test]
    fn what_cannot_be_a_key_is_named() {
        for (key, part) in [
            (Key { participant: String::new(), ..key() }, "participant: it is empty"),
            (Key { session: "1\n".to_owned(), ..key() }, "session: it begins or ends"),
            (Key { condition: "a\u{200b}b".to_owned(), ..key() }, "condition: it has a character"),
            (Key { condition: "ä".repeat(81), ..key() }, "condition: it has 81 characters"),
            (Key { condition: "😀".repeat(80), ..key() }, "too long for the name of a folder"),
            (Key { run: 0, ..key() }, "run: 0"),
            (Key { run: 10_000, ..key() }, "run: 10000"),
        ] {
            let error = key.check("t").unwrap_err().to_string();
            assert!(error.contains(part), "no {part}: {error}");
        }
    }
}
