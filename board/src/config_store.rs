//! Where the box's configuration is kept, and how a new one takes its place.
//!
//! The power may go at any moment, and then the old configuration is there or the new one. A
//! new one is first written into a file of its own beside the old one ([`journal_of`]). Elsewhere
//! that is then renamed, at one stroke. A FAT file system, which a box's card has, does not
//! rename at one stroke. There it is written twice, and each step is on the disk before the
//! next begins:
//!
//! 1. into the file of its own;
//! 2. over the old one, where that lies;
//! 3. the file of its own is removed.
//!
//! Cut off in 2, the file of its own is whole, and the one in its place is not: the next start
//! takes the former, and does 2 and 3. Whenever the one in its place is whole, it counts, so that
//! a person who puts another one there is never overruled.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use plumbline::config::{BLOB_BYTES_MAX, Config};

use crate::machine::read_only_partition::{ReadOnlyPartition, sync_disk_of};

/// The configuration's name on a box's card.
pub const CONFIG_NAME: &str = "config.plb";

/// The file of its own beside a configuration.
#[must_use]
pub fn journal_of(config: &Path) -> PathBuf {
    config.with_extension("new")
}

/// One configuration's place.
#[derive(Debug, Clone)]
pub struct ConfigStore {
    path: PathBuf,
    /// The file system that is mounted for reading only, where it is.
    partition: Option<ReadOnlyPartition>,
}

impl ConfigStore {
    /// A file that can be written to at any time.
    #[must_use]
    pub fn file(path: &Path) -> Self {
        Self { path: path.to_owned(), partition: None }
    }

    /// A file of this name on a partition.
    #[must_use]
    pub fn on_partition(partition: &ReadOnlyPartition, name: &str) -> Self {
        Self { path: partition.file(name), partition: Some(partition.clone()) }
    }

    /// The configuration's bytes, whether or not they are one; an error of the kind
    /// [`ErrorKind::NotFound`] where there are none.
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

    /// Ends what was cut off: the next to be stored must not be written over the only one
    /// that is whole.
    ///
    /// # Errors
    /// When the disk cannot be written to.
    pub fn complete(&self) -> Result<()> {
        if self.journal().is_none() {
            return Ok(());
        }
        let blob = self.read()?;
        self.written_to(|| self.put_in_place(&blob))
    }

    /// Keeps a configuration; on return it is on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written to. What was stored before still is.
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

    /// What was to be stored when it was cut off, if that is whole.
    fn journal(&self) -> Option<Vec<u8>> {
        read_bounded(&journal_of(&self.path)).ok().filter(|blob| is_whole(blob))
    }

    /// What comes after it is on the disk, in the file of its own or in its place.
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

/// Writes a file where it lies, so that it never loses its place, and waits for the disk.
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

/// Whether nothing is there, rather than something that cannot be read.
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
