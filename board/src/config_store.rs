//! Where the box's configuration is kept: a [`StoredFile`], in whose place a new one comes so that a
//! power cut leaves either.

use std::io;
use std::path::Path;

use anyhow::Result;
use plumbline::config::{BLOB_BYTES_MAX, Config};

use crate::machine::read_only_partition::ReadOnlyPartition;
use crate::stored_file::{Kind, StoredFile};

static CONFIGURATION: Kind =
    Kind { bytes_max: BLOB_BYTES_MAX, mode: 0o666, is_whole: |blob| Config::decode(blob).is_ok() };

/// Where one configuration is kept.
#[derive(Debug, Clone)]
pub struct ConfigStore(StoredFile);

impl ConfigStore {
    /// A file that can be written at any time.
    #[must_use]
    pub fn file(path: &Path) -> Self {
        Self(StoredFile::file(&CONFIGURATION, path))
    }

    /// A file of this name on a partition.
    #[must_use]
    pub fn on_partition(partition: &ReadOnlyPartition, name: &str) -> Self {
        Self(StoredFile::on_partition(&CONFIGURATION, partition, name))
    }

    /// The configuration's bytes, which are not checked; an error of the kind
    /// [`io::ErrorKind::NotFound`] if there are none.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn read(&self) -> io::Result<Vec<u8>> {
        self.0.read()
    }

    /// Finishes a replacement that was interrupted: the next one must not be written over the
    /// only intact copy.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(&self) -> Result<()> {
        self.0.complete()
    }

    /// Stores a configuration; on return it is on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written. The previous configuration is then still stored.
    pub fn store(&self, blob: &[u8]) -> Result<()> {
        self.0.store(blob)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stored_file::is_absent;
    use crate::test_config::config;

    fn blob(device: &str) -> Vec<u8> {
        let mut config = config();
        config.device = device.try_into().unwrap();
        config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
    }

    fn names(directory: &Path) -> Vec<String> {
        let listed = std::fs::read_dir(directory).unwrap();
        let mut names: Vec<String> =
            listed.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_new_configuration_takes_the_place_of_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let store = ConfigStore::file(&folder.path().join("config.plb"));
        assert!(is_absent(&store.read().unwrap_err()));
        for device in ["a box with a long name", "box"] {
            store.store(&blob(device)).unwrap();
            assert_eq!(std::fs::read(folder.path().join("config.plb")).unwrap(), blob(device));
            assert_eq!(names(folder.path()), ["config.plb"]);
        }
    }

    /// Every state that a cut can leave behind, in the order of the steps, and what the next
    /// start must find.
    #[test]
    fn a_cut_at_any_step_leaves_the_old_or_the_new_one() {
        let (old, new) = (blob("old"), blob("new, and longer"));
        let half = |blob: &[u8]| blob[..blob.len() / 2].to_vec();
        let torn = [&new[..new.len() / 2], &old[new.len() / 2..]].concat();
        let states = [
            (None, &old, &old),
            (Some(Vec::new()), &old, &old),
            (Some(half(&new)), &old, &old),
            (Some(new.clone()), &old, &old),
            (Some(new.clone()), &torn, &new),
            (Some(new.clone()), &new, &new),
            (None, &new, &new),
        ];
        for (journal, main, expected) in states {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("config.plb");
            let store = ConfigStore::file(&path);
            std::fs::write(&path, main).unwrap();
            if let Some(journal) = &journal {
                std::fs::write(folder.path().join("config.new"), journal).unwrap();
            }
            assert_eq!(&store.read().unwrap(), expected);
            store.complete().unwrap();
            assert_eq!(names(folder.path()), ["config.plb"]);
            assert_eq!(&store.read().unwrap(), expected);
            assert_eq!(&std::fs::read(&path).unwrap(), expected);
            // And the next is stored as ever.
            store.store(&blob("next")).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), blob("next"));
            assert_eq!(names(folder.path()), ["config.plb"]);
        }
    }

    #[test]
    fn where_nothing_can_be_written_the_old_one_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.plb");
        std::fs::write(&path, blob("old")).unwrap();
        // A directory in the journal's place: even root cannot write a file there.
        std::fs::create_dir(folder.path().join("config.new")).unwrap();
        let error = format!("{:#}", ConfigStore::file(&path).store(&blob("new")).unwrap_err());
        assert!(error.contains("config.new cannot be written"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), blob("old"));
    }
}
