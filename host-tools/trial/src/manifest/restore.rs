//! A manifest that is lost is made again: `packets.bin` is told what no packet tells.

use std::path::{Path, PathBuf};

use plumbline_files::BadInput;

use super::{CheckSeen, FORMAT, Manifest, UNKNOWN, Zero, format_of};
use crate::journal::{CONTENT_BYTES_MAX, Content, Reader};
use crate::names;

impl Manifest {
    /// What `packets.bin` is told of a trial that begins.
    pub(crate) fn said(&self) -> impl Iterator<Item = Content> {
        let checks = self.checks.iter().filter_map(CheckSeen::said);
        self.about().map(Content::About).into_iter().chain(checks)
    }

    /// The text for `packets.bin` from which [`restore`](Self::restore) makes it again: what
    /// persons have said, and how far the recording came. `None` where that is too long for an
    /// entry.
    #[must_use]
    pub(crate) fn about(&self) -> Option<String> {
        let about = |note: Option<String>| {
            let Self { started, participant, condition, zero, .. } = self.clone();
            let about = Self {
                state: self.state,
                criteria: self.criteria.clone(),
                ..Self::begin(started, participant, condition, note, zero)
            };
            toml::to_string(&about).ok().filter(|text| text.len() <= CONTENT_BYTES_MAX)
        };
        // A long note is the first that can be missed.
        about(self.note.clone()).or_else(|| about(None))
    }

    /// Reads the manifest of a trial's folder; one that is absent is made again as far as the
    /// packets tell, and so is one that cannot be understood, which is kept under another name.
    /// Also returns what a user should know.
    ///
    /// # Errors
    /// When it is of another format, or there are no packets.
    pub fn restore(folder: &Path) -> Result<(Self, Vec<String>), BadInput> {
        let path = folder.join(names::MANIFEST);
        let read = match std::fs::read(&path) {
            Ok(bytes) => Some(String::from_utf8_lossy(&bytes).into_owned()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(BadInput::io(path.display(), &error)),
        };
        let mut warnings = Vec::new();
        let (told, checks) = if let Some(text) = read {
            let error = match Self::parse(&text, &path.display().to_string()) {
                Ok(manifest) => return Ok((manifest, warnings)),
                Err(error) if format_of(&text).is_some_and(|it| it != FORMAT) => return Err(error),
                Err(error) => error,
            };
            let told = told(folder)?;
            let kept = free_name(&path);
            std::fs::rename(&path, &kept).map_err(|error| BadInput::io(path.display(), &error))?;
            warnings.push(format!("{error}; the file is now {}", kept.display()));
            told
        } else {
            told(folder)?
        };
        let place = path.display();
        let manifest = if let Some(manifest) = told {
            warnings.push(format!(
                "{place} was made again from the packets; what was corrected in it later is lost"
            ));
            manifest
        } else {
            warnings.push(format!(
                "{place} was made again, and the packets do not tell participant, condition, note \
                 and the time of day: write them into it"
            ));
            Self::begin(UNKNOWN.to_owned(), None, None, None, Zero::default())
        };
        Ok((Self { checks, ..manifest }, warnings))
    }
}

impl CheckSeen {
    /// It as an entry of `packets.bin`; `None` where it is too long for one.
    pub(crate) fn said(&self) -> Option<Content> {
        let text = toml::to_string(self).ok().filter(|text| text.len() <= CONTENT_BYTES_MAX);
        text.map(Content::Check)
    }
}

/// The latest manifest in a trial's packets, and all checks that were not passed.
fn told(folder: &Path) -> Result<(Option<Manifest>, Vec<CheckSeen>), BadInput> {
    let mut reader = Reader::open(&folder.join(names::JOURNAL))?;
    let (mut told, mut checks) = (None, Vec::new());
    while let Some(entry) = reader.next_entry()? {
        match entry.content {
            Content::About(text) => told = Manifest::parse(&text, names::JOURNAL).ok().or(told),
            Content::Check(text) => checks.extend(toml::from_str::<CheckSeen>(&text)),
            Content::Raw(_) | Content::Mark(_) | Content::NotAuthentic(_) => {}
        }
    }
    Ok((told, checks))
}

/// A name beside a file that no other has: `trial.toml.bad`, `trial.toml.bad2` and so on.
fn free_name(path: &Path) -> PathBuf {
    let name = |at: u32| {
        let number = if at == 1 { String::new() } else { at.to_string() };
        PathBuf::from(format!("{}.bad{number}", path.display()))
    };
    let mut names = (1..).map(name);
    names.find(|name| !name.exists()).unwrap_or_else(|| name(1))
}

#[cfg(test)]
mod tests {
    use super::super::CheckVerdict;
    use super::*;
    use crate::Trial;
    use crate::derived::{Changes, remake};
    use crate::test_trial::Made;

    fn lost() -> (tempfile::TempDir, PathBuf) {
        let mut made = Made::good();
        let check = |subject: &str, verdict| CheckSeen {
            subject: subject.to_owned(),
            verdict,
            seen: format!("the {subject}, \"as it was\": 3 (at most 2)"),
        };
        made.manifest.checks =
            vec![check("rate", CheckVerdict::Warn), check("light", CheckVerdict::Fail)];
        let (folder, trial) = made.trial();
        (folder, trial.folder)
    }

    #[test]
    fn a_manifest_that_is_lost_is_made_again_with_what_persons_have_said() {
        let (_folder, path) = lost();
        let before = Trial::open(&path).unwrap();
        std::fs::remove_file(path.join(names::MANIFEST)).unwrap();
        let after = remake(&path, &Changes::default()).unwrap();
        assert_eq!(after.manifest, before.manifest);
        assert_eq!(after.manifest.participant.as_deref(), Some("P01"));
        assert_eq!(after.manifest.checks.len(), 2);
        let said = after.warnings.join("; ");
        assert!(said.contains("made again from the packets"), "{said}");
        assert_eq!(Trial::open(&path).unwrap().manifest, before.manifest);
    }

    #[test]
    fn a_manifest_that_cannot_be_read_is_kept_beside_the_new_one() {
        let (_folder, path) = lost();
        for (at, spoiled) in ["{", "", "format = 2\nstate = \"asleep\"\n"].iter().enumerate() {
            std::fs::write(path.join(names::MANIFEST), spoiled).unwrap();
            assert!(Trial::open(&path).unwrap_err().to_string().contains("replay TRIAL --tables"));
            let after = remake(&path, &Changes::default()).unwrap();
            assert_eq!(after.manifest.participant.as_deref(), Some("P01"));
            let name =
                if at == 0 { "trial.toml.bad".into() } else { format!("trial.toml.bad{}", at + 1) };
            assert_eq!(std::fs::read_to_string(path.join(&name)).unwrap(), *spoiled);
            let said = after.warnings.join("; ");
            assert!(said.contains(&name), "{said}");
        }
    }

    #[test]
    fn a_manifest_of_another_format_is_refused_and_stays() {
        let (_folder, path) = lost();
        let text = "format = 1\nstate = \"finished\"\n";
        std::fs::write(path.join(names::MANIFEST), text).unwrap();
        for error in
            [Trial::open(&path).unwrap_err(), remake(&path, &Changes::default()).unwrap_err()]
        {
            assert_eq!((&*error.field, &*error.found), ("format", "1, and this program knows 2"));
        }
        assert_eq!(std::fs::read_to_string(path.join(names::MANIFEST)).unwrap(), text);
    }

    #[test]
    fn where_nobody_told_who_it_was_that_is_said() {
        let (_folder, path) = lost();
        let journal = path.join(names::JOURNAL);
        // The first entry is damaged: what was said of the trial is gone.
        let mut bytes = std::fs::read(&journal).unwrap();
        bytes[60] ^= 1;
        std::fs::write(&journal, bytes).unwrap();
        std::fs::remove_file(path.join(names::MANIFEST)).unwrap();
        let after = remake(&path, &Changes::default()).unwrap();
        assert_eq!((after.manifest.participant, &*after.manifest.started), (None, "unknown"));
        assert_eq!(after.first_frame_utc_s, None);
        assert_eq!(after.manifest.checks.len(), 2);
        let said = after.warnings.join("; ");
        assert!(said.contains("do not tell participant, condition"), "{said}");
        assert_eq!(after.frames.len(), 1800);
    }

    #[test]
    fn a_note_that_is_too_long_for_the_packets_is_the_only_thing_missed() {
        let mut made = Made::good();
        made.manifest.note = Some("n".repeat(3000));
        let about = made.manifest.about().unwrap();
        let told = Manifest::parse(&about, "").unwrap();
        assert_eq!((told.participant.as_deref(), told.note), (Some("P01"), None));
    }
}
