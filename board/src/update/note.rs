//! What a box remembers of the last update that it was given, on its settings' partition: so that the
//! program that is back can say why, and whoever comes later can read it on the card.
//!
//! A line of words, and a checksum. The first word says what became of it:
//!
//! | line | meaning |
//! |---|---|
//! | `trying SLOT VERSION COMMIT` | it was about to be started; whatever came then could not be written |
//! | `installed SLOT VERSION COMMIT` | it has passed its own tests |
//! | `failed SLOT VERSION COMMIT WORDS` | it has not; the words say why |

use std::str::FromStr as _;

use anyhow::{Context, Result};
use plumbline::packet::document_crc;
use plumbline_update::card::Slot;
use plumbline_update::header::{COMMIT_BYTES, Header, Text};
use plumbline_update::release::Version;

use crate::machine::read_only_partition::ReadOnlyPartition;
use crate::stored_file::{Kind, StoredFile, is_absent};

/// The file's name on the settings' partition.
const FILE_NAME: &str = "update.txt";

/// Longer words are cut.
const WORDS_BYTES_MAX: usize = 300;

static NOTE: Kind =
    Kind { bytes_max: 512, mode: 0o644, is_whole: |bytes| decoded(bytes).is_some() };

/// Which update.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Update {
    /// The slot that it was written to.
    pub slot: Slot,
    /// Its version.
    pub version: Version,
    /// Its commit.
    pub commit: Text<COMMIT_BYTES>,
}

impl Update {
    /// The update with this head, in this slot.
    pub fn of(header: &Header, slot: Slot) -> Self {
        Self { slot, version: header.version, commit: header.commit }
    }
}

impl std::fmt::Display for Update {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "version {} ({})", self.version, self.commit.as_str())
    }
}

/// What became of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fate {
    /// It was about to be started.
    Trying,
    /// It has passed its own tests.
    Installed,
    /// It has not.
    Failed(String),
}

/// An update, and what became of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Which.
    pub update: Update,
    /// What became of it.
    pub fate: Fate,
}

/// Where notes are kept.
#[derive(Debug, Clone)]
pub struct NoteStore(StoredFile);

impl NoteStore {
    /// A file of the settings' partition.
    pub fn on_partition(partition: &ReadOnlyPartition) -> Self {
        Self(StoredFile::on_partition(&NOTE, partition, FILE_NAME))
    }

    /// A file that can be written at any time.
    #[cfg(test)]
    pub fn file(path: &std::path::Path) -> Self {
        Self(StoredFile::file(&NOTE, path))
    }

    /// The note; `None` if there is none that can be read.
    pub fn read(&self) -> Option<Note> {
        match self.0.read() {
            Ok(bytes) => {
                let note = decoded(&bytes);
                if note.is_none() {
                    log::warn!("{}: what became of the last update is lost", FILE_NAME);
                }
                note
            }
            Err(error) if is_absent(&error) => None,
            Err(error) => {
                log::warn!("{FILE_NAME} cannot be read: {error}");
                None
            }
        }
    }

    /// Keeps a note; on return it is on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written. The last note is then still there.
    pub fn keep(&self, note: &Note) -> Result<()> {
        self.0.store(encoded(note).as_bytes()).context("what becomes of the update")
    }
}

fn encoded(Note { update, fate }: &Note) -> String {
    let (word, words) = match fate {
        Fate::Trying => ("trying", ""),
        Fate::Installed => ("installed", ""),
        Fate::Failed(words) => ("failed", cut(words)),
    };
    let Update { slot, version, commit } = update;
    let slot = if *slot == Slot::A { 'A' } else { 'B' };
    let words = words.replace(char::is_control, " ");
    let line = format!("{word} {slot} {version} {} {words}", commit.as_str());
    let line = line.trim_end();
    format!("{line}\n{:08x}\n", checksum(line))
}

/// As much of a text as there is room for.
fn cut(text: &str) -> &str {
    let end = (0..=WORDS_BYTES_MAX.min(text.len())).rev().find(|end| text.is_char_boundary(*end));
    &text[..end.unwrap_or(0)]
}

fn decoded(bytes: &[u8]) -> Option<Note> {
    let mut lines = std::str::from_utf8(bytes).ok()?.lines();
    let (line, sum) = (lines.next()?, lines.next()?);
    if u32::from_str_radix(sum, 16).ok()? != checksum(line) {
        return None;
    }
    let mut words = line.splitn(5, ' ');
    let word = words.next()?;
    let slot = match words.next()? {
        "A" => Slot::A,
        "B" => Slot::B,
        _ => return None,
    };
    let version = Version::from_str(words.next()?).ok()?;
    let commit = Text::new(words.next()?)?;
    let fate = match word {
        "trying" => Fate::Trying,
        "installed" => Fate::Installed,
        "failed" => Fate::Failed(words.next().unwrap_or_default().to_owned()),
        _ => return None,
    };
    Some(Note { update: Update { slot, version, commit }, fate })
}

fn checksum(line: &str) -> u32 {
    document_crc(line.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(fate: Fate) -> Note {
        let commit = Text::new("0123456789ab").unwrap();
        let version = "0.2.0".parse().unwrap();
        Note { update: Update { slot: Slot::B, version, commit }, fate }
    }

    #[test]
    fn a_note_is_read_as_it_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let store = NoteStore::file(&folder.path().join(FILE_NAME));
        assert_eq!(store.read(), None);
        let words = "no frame came from the camera in 60 s".to_owned();
        for fate in
            [Fate::Trying, Fate::Failed(words), Fate::Failed(String::new()), Fate::Installed]
        {
            store.keep(&note(fate.clone())).unwrap();
            assert_eq!(store.read(), Some(note(fate)));
        }
    }

    #[test]
    fn words_of_any_kind_leave_a_note_that_can_be_read() {
        let long = "ä".repeat(1000);
        let Fate::Failed(kept) =
            decoded(encoded(&note(Fate::Failed(long))).as_bytes()).unwrap().fate
        else {
            panic!("another fate")
        };
        assert_eq!(kept, "ä".repeat(150));
        let lines = Fate::Failed("one\ntwo\x1b[31m".into());
        let Note { fate, .. } = decoded(encoded(&note(lines)).as_bytes()).unwrap();
        assert_eq!(fate, Fate::Failed("one two [31m".into()));
    }

    #[test]
    fn a_damaged_note_is_none() {
        let sound = encoded(&note(Fate::Failed("why".into())));
        for index in 0..sound.len() - 1 {
            let mut damaged = sound.clone().into_bytes();
            damaged[index] ^= 1;
            assert_eq!(decoded(&damaged), None, "byte {index}");
        }
        assert_eq!(decoded(b""), None);
    }
}
