//! Where the box's configuration is kept, and how a new one takes its place.
//!
//! The power may fail at any moment, and either the old or the new configuration must survive
//! it. A new one is first written to a second file beside the old one, the journal
//! ([`journal_of`]). Most file systems then rename the journal atomically. FAT, which a box's card
//! has, does not. There the configuration is written twice, and each step is on the disk before
//! the next begins:
//!
//! 1. the new configuration is written to the journal;
//! 2. it is written over the old one, in place;
//! 3. the journal is removed.
//!
//! After a power cut in step 2 the journal is intact and the file in place is not: the next start
//! uses the journal, and repeats steps 2 and 3. Whenever the file in place is intact it is the one
//! that is used, so that a configuration which a person copies there is never overruled.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use plumbline::config::{BLOB_BYTES_MAX, Config};

use crate::machine::read_only_partition::{ReadOnlyPartition, sync_disk_of};

/// The journal of a configuration: where a new one is written first.
#[must_use]
pub fn journal_of(config: &Path) -> PathBuf {
    config.with_extension("new")
}

/// Where one configuration is kept.
#[derive(Debug, Clone)]
pub struct ConfigStore {
    path: PathBuf,
    /// The partition it is on, if that is mounted read-only.
    partition: Option<ReadOnlyPartition>,
}

impl ConfigStore {
    /// A file that can be written at any time.
    #[must_use]
    pub fn file(path: &Path) -> Self {
        Self { path: path.to_owned(), partition: None }
    }

    /// A file of this name on a partition.
    #[must_use]
    pub fn on_partition(partition: &ReadOnlyPartition, name: &str) -> Self {
        Self { path: partition.file(name), partition: Some(partition.clone()) }
    }

    /// The configuration's bytes, which are not checked; an error of the kind
    /// [`ErrorKind::NotFound`] if there are none.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn read(&self) -> io::Result<Vec<u8>> {
        let in_place = read_bounded(&self.path);
        match self.journal() {
            Some(journal) if !in_place.as_ref().is_ok_and(|blob| is_whole(blob)) => Ok(journal),
            _ => in_place,
        }
    }

    /// Finishes a replacement that was interrupted: the next one must not be written over the
    /// only intact copy.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(&self) -> Result<()> {
        if self.journal().is_none() {
            return Ok(());
        }
        let blob = self.read()?;
        self.written_to(|| self.put_in_place(&blob))
    }

    /// Stores a configuration; on return it is on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written. The previous configuration is then still stored.
    pub fn store(&self, blob: &[u8]) -> Result<()> {
        self.complete()?;
        if self.read().is_ok_and(|stored| stored == blob) {
            return Ok(());
        }
        self.written_to(|| {
            write_to_disk(&journal_of(&self.path), blob)?;
            self.put_in_place(blob)
        })?;
        ensure!(self.read()? == blob, "the disk does not give back what was written to it");
        Ok(())
    }

    /// The journal that an interrupted replacement left, if it is intact.
    fn journal(&self) -> Option<Vec<u8>> {
        read_bounded(&journal_of(&self.path)).ok().filter(|blob| is_whole(blob))
    }

    /// The last step, once the configuration is on the disk, in the journal or in place.
    fn put_in_place(&self, blob: &[u8]) -> Result<()> {
        let journal = journal_of(&self.path);
        let is_there = read_bounded(&self.path).is_ok_and(|there| there == blob);
        if is_there || self.partition.is_some() {
            if !is_there {
                write_to_disk(&self.path, blob)?;
            }
            std::fs::remove_file(&journal)
        } else {
            std::fs::rename(&journal, &self.path)
        }
        .with_context(|| journal.display().to_string())?;
        sync_disk_of(&self.path)
    }

    fn written_to(&self, write: impl FnOnce() -> Result<()>) -> Result<()> {
        match &self.partition {
            Some(partition) => partition.while_writable(write),
            None => write(),
        }
    }
}

fn is_whole(blob: &[u8]) -> bool {
    Config::decode(blob).is_ok()
}

/// Writes a file in place, so that its directory entry stays, and waits for the disk.
fn write_to_disk(path: &Path, blob: &[u8]) -> Result<()> {
    let write = || -> io::Result<()> {
        let mut file = OpenOptions::new().write(true).create(true).truncate(false).open(path)?;
        file.write_all(blob)?;
        file.set_len(blob.len() as u64)?;
        file.sync_all()
    };
    write().with_context(|| format!("{} cannot be written", path.display()))?;
    sync_disk_of(path)
}

/// One byte more than the largest is enough to see that a file is too long.
fn read_bounded(path: &Path) -> io::Result<Vec<u8>> {
    let mut blob = Vec::new();
    File::open(path)?.take(BLOB_BYTES_MAX as u64 + 1).read_to_end(&mut blob)?;
    Ok(blob)
}

/// Whether the file does not exist, rather than cannot be read.
#[must_use]
pub fn is_absent(error: &io::Error) -> bool {
    error.kind() == ErrorKind::NotFound
}

#[cfg(test)]
mod tests {
    use super::*;
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

    #[test]
    fn a_file_without_end_is_not_read_to_its_end() {
        assert_eq!(read_bounded(Path::new("/dev/zero")).unwrap().len(), BLOB_BYTES_MAX + 1);
    }
}
