//! Where the box's key is kept: a [`StoredFile`] beside the configuration, in whose place a new one
//! comes so that a power cut leaves either.
//!
//! A key that is absent leaves the box unpaired. One that is there and cannot be used is another
//! matter: somebody meant the box to be closed, and it must not open because a card is worn out.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use plumbline::seal::{KEY_FILE_NAME, KEY_TEXT_BYTES, Key};
use zeroize::Zeroizing;

use crate::machine::read_only_partition::ReadOnlyPartition;
use crate::stored_file::{Kind, StoredFile, is_absent};

/// A person may have written blank lines around the text.
static KEY: Kind =
    Kind { bytes_max: KEY_TEXT_BYTES + 100, mode: 0o600, is_whole: |bytes| key_of(bytes).is_ok() };

/// The file of the key beside a configuration.
#[must_use]
pub fn beside(config: &Path) -> PathBuf {
    config.with_file_name(KEY_FILE_NAME)
}

/// Where the key is kept.
#[derive(Debug, Clone)]
pub struct KeyStore(StoredFile);

impl KeyStore {
    /// A file that can be written at any time.
    #[must_use]
    pub fn file(path: &Path) -> Self {
        Self(StoredFile::file(&KEY, path))
    }

    /// The file of a box's settings partition.
    #[must_use]
    pub fn on_partition(partition: &ReadOnlyPartition) -> Self {
        Self(StoredFile::on_partition(&KEY, partition, KEY_FILE_NAME))
    }

    /// The key; `None` if there is none.
    ///
    /// # Errors
    /// When there is one that cannot be read, or is damaged.
    pub fn read(&self) -> Result<Option<Key>> {
        let place = self.0.path().display();
        let bytes = match self.0.read() {
            Ok(bytes) => Zeroizing::new(bytes),
            Err(error) if is_absent(&error) => return Ok(None),
            Err(error) => return Err(error).with_context(|| format!("{place} cannot be read")),
        };
        let key = key_of(&bytes).with_context(|| {
            format!(
                "{place} is not a key: copy the one of this box there, from `plumb keys export --out`"
            )
        })?;
        Ok(Some(key))
    }

    /// Finishes a replacement that was interrupted.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(&self) -> Result<()> {
        self.0.complete()
    }

    /// Stores a key; on return it is on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written. The previous key is then still stored.
    pub fn store(&self, key: &Key) -> Result<()> {
        self.0.store(Zeroizing::new(format!("{}\n", key.text().as_str())).as_bytes())
    }
}

/// Logs which key the box has, by its identity, or why it has none that can be used.
pub fn report(key: &Result<Option<Key>>) {
    match key {
        Ok(Some(key)) => log::info!("the box's key is {}", key.id()),
        Ok(None) => {}
        Err(error) => log::warn!("the box's key cannot be used: {error:#}"),
    }
}

fn key_of(bytes: &[u8]) -> Result<Key> {
    let text = std::str::from_utf8(bytes).context("it is not text")?;
    Ok(Key::from_text(text)?)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn key(seed: u8) -> Key {
        Key::new(std::array::from_fn(|at| seed ^ (at as u8 * 5 + 1))).unwrap()
    }

    fn line(seed: u8) -> Vec<u8> {
        format!("{}\n", key(seed).text().as_str()).into_bytes()
    }

    fn store(folder: &tempfile::TempDir) -> (KeyStore, PathBuf) {
        let path = beside(&folder.path().join("ward 3.plb"));
        assert_eq!(path, folder.path().join("box.key"));
        (KeyStore::file(&path), path)
    }

    #[test]
    fn a_key_is_stored_for_the_box_alone_and_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let (store, path) = store(&folder);
        assert_eq!(store.read().unwrap(), None);
        for seed in [1, 2, 2] {
            store.store(&key(seed)).unwrap();
            assert_eq!(store.read().unwrap(), Some(key(seed)));
            assert_eq!(std::fs::read(&path).unwrap(), line(seed));
        }
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_key_that_a_person_has_copied_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let (store, path) = store(&folder);
        std::fs::write(&path, format!("\r\n{}\r\n\r\n", key(1).text().as_str())).unwrap();
        assert_eq!(store.read().unwrap(), Some(key(1)));
    }

    #[test]
    fn a_key_that_cannot_be_used_is_not_taken_for_none() {
        let folder = tempfile::tempdir().unwrap();
        let (store, path) = store(&folder);
        let text = String::from_utf8(line(1)).unwrap();
        let digits = text[20..40].to_owned();
        let unusable = [
            (Vec::new(), "does not begin"),
            (text[..50].into(), "50 characters"),
            (text.replace("KEY-1", "KEY-2").into(), "another version"),
            (vec![0xff; 90], "not text"),
            (line(1).repeat(1000), "characters"),
        ];
        for (bytes, words) in unusable {
            std::fs::write(&path, &bytes).unwrap();
            let error = format!("{:#}", store.read().unwrap_err());
            for part in ["box.key is not a key", words, "plumb keys export"] {
                assert!(error.contains(part), "{error}: {part}");
            }
            assert!(!error.contains(&digits), "{error}");
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        let error = format!("{:#}", store.read().unwrap_err());
        assert!(error.contains("box.key cannot be read"), "{error}");
    }

    /// What a cut leaves behind in the middle of a replacement; the configuration's tests go
    /// through every step.
    #[test]
    fn a_cut_leaves_the_old_or_the_new_key() {
        let torn = [&line(2)[..40], &line(1)[40..]].concat();
        for (journal, in_place, expected) in [
            (Some(line(2)), Some(line(1)), 1),
            (Some(line(2)), Some(torn.clone()), 2),
            (Some(line(2)), None, 2),
            (Some(torn), Some(line(1)), 1),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let (store, path) = store(&folder);
            for (name, bytes) in [("box.new", journal), ("box.key", in_place)] {
                if let Some(bytes) = bytes {
                    std::fs::write(folder.path().join(name), bytes).unwrap();
                }
            }
            assert_eq!(store.read().unwrap(), Some(key(expected)));
            store.complete().unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), line(expected));
            assert!(!folder.path().join("box.new").exists());
            store.store(&key(3)).unwrap();
            assert_eq!(store.read().unwrap(), Some(key(3)));
            assert!(!folder.path().join("box.new").exists());
        }
    }
}
