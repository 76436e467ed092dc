//! Messages that are kept on the disk until the broker has them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};

/// The most messages that are kept: the verdicts and summaries of a hundred boxes over a hundred trials.
pub const KEPT_MAX: usize = 20_000;

/// A message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Message {
    /// Where it is published.
    pub topic: String,
    /// What.
    pub payload: String,
}

/// A folder with one file for each message; its name is the message's number.
#[derive(Debug)]
pub struct Kept {
    folder: PathBuf,
    /// The numbers of those that are here.
    here: BTreeSet<u64>,
    next: u64,
    dropped: u64,
}

impl Kept {
    /// Opens the folder; what an earlier run has left in it is kept on.
    ///
    /// # Errors
    /// When it cannot be made or read.
    pub fn open(folder: PathBuf) -> Result<Self, BadInput> {
        plumbline_files::make_directory(&folder)?;
        let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
        let mut here = BTreeSet::new();
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            let number: Option<u64> =
                name.to_str().and_then(|it| it.strip_suffix(".json")?.parse().ok());
            here.extend(number);
        }
        let next = here.last().map_or(1, |last| last + 1);
        Ok(Self { folder, here, next, dropped: 0 })
    }

    /// Keeps a message; its number. Where there are too many, the oldest is dropped and counted.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add(&mut self, message: &Message) -> Result<u64, BadInput> {
        let number = self.next;
        let path = self.path(number);
        let text = serde_json::to_vec(message)
            .map_err(|error| BadInput::whole(path.display(), error, "report it: texts are JSON"))?;
        plumbline_files::replace(&path, &text)?;
        self.next += 1;
        self.here.insert(number);
        if self.here.len() > KEPT_MAX
            && let Some(oldest) = self.here.pop_first()
        {
            self.dropped += 1;
            let _ = std::fs::remove_file(self.path(oldest));
        }
        Ok(number)
    }

    /// The first message after this number.
    ///
    /// # Errors
    /// When a file cannot be understood; it is put aside under another name.
    pub fn after(&mut self, number: u64) -> Result<Option<(u64, Message)>, BadInput> {
        let Some(&next) = self.here.range(number + 1..).next() else { return Ok(None) };
        let path = self.path(next);
        let read = plumbline_files::read_text(&path).and_then(|text| {
            serde_json::from_str(&text).map_err(|error| {
                BadInput::whole(
                    path.display(),
                    error,
                    "it is put aside, and its trial is still there",
                )
            })
        });
        match read {
            Ok(message) => Ok(Some((next, message))),
            Err(error) => {
                self.here.remove(&next);
                self.dropped += 1;
                let _ = std::fs::rename(&path, path.with_extension("damaged"));
                Err(error)
            }
        }
    }

    /// The broker has this one.
    pub fn delivered(&mut self, number: u64) {
        if self.here.remove(&number) {
            // One that stays is published once more after the next start, which does no harm.
            let _ = std::fs::remove_file(self.path(number));
        }
    }

    /// How many are here.
    #[must_use]
    pub fn count(&self) -> usize {
        self.here.len()
    }

    /// How many had to be dropped.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    fn path(&self, number: u64) -> PathBuf {
        path(&self.folder, number)
    }
}

fn path(folder: &Path, number: u64) -> PathBuf {
    folder.join(format!("{number:012}.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(number: u64) -> Message {
        Message { topic: format!("t/{number}"), payload: format!("{{\"number\":{number}}}") }
    }

    #[test]
    fn what_is_not_delivered_is_there_after_another_start_in_its_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("outbox");
        let mut kept = Kept::open(path.clone()).unwrap();
        for number in 1..=12 {
            assert_eq!(kept.add(&message(number)).unwrap(), number);
        }
        kept.delivered(1);
        kept.delivered(3);
        kept.delivered(3);
        std::fs::write(super::path(&path, 5), "{").unwrap();
        std::fs::write(path.join("a note.txt"), "of somebody").unwrap();
        let mut kept = Kept::open(path.clone()).unwrap();
        assert_eq!(kept.count(), 10);
        let (mut at, mut seen, mut refused) = (0, Vec::new(), 0);
        loop {
            match kept.after(at) {
                Ok(Some((number, found))) => {
                    assert_eq!(found, message(number));
                    at = number;
                    seen.push(number);
                }
                Ok(None) => break,
                Err(_) => refused += 1,
            }
        }
        assert_eq!(seen, [2, 4, 6, 7, 8, 9, 10, 11, 12]);
        assert_eq!((refused, kept.dropped()), (1, 1));
        assert_eq!(kept.add(&message(13)).unwrap(), 13);
        assert!(path.join("000000000005.damaged").exists());
    }
}
