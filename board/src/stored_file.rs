//! A small file of the box, and how a new one takes its place.
//!
//! The power may fail at any moment, and either the old or the new file must survive it. A new one is
//! first written to a second file beside the old one, the journal ([`journal_of`]). Most file systems
//! then rename the journal atomically. FAT, which a box's card has, does not. There the content is
//! written twice, and each step is on the disk before the next begins:
//!
//! 1. the new content is written to the journal;
//! 2. it is written over the old one, in place;
//! 3. the journal is removed.
//!
//! After a power cut in step 2 the journal is intact and the file in place is not: the next start
//! uses the journal, and repeats steps 2 and 3. Whenever the file in place is intact it is the one
//! that is used, so that a file which a person copies there is never overruled; and a journal that
//! was cut off in step 1 is removed.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::machine::read_only_partition::{ReadOnlyPartition, sync_disk_of};
use crate::machine::watchdog;

/// The journal of a file: where a new one is written first.
#[must_use]
pub fn journal_of(path: &Path) -> PathBuf {
    path.with_extension("new")
}

/// What kind of file it is.
#[derive(Debug)]
pub struct Kind {
    /// The size of the largest.
    pub bytes_max: usize,
    /// Its permissions where it is made; FAT has none.
    pub mode: u32,
    /// Whether these bytes are all of one, undamaged.
    pub is_whole: fn(&[u8]) -> bool,
}

/// Where one file is kept.
#[derive(Debug, Clone)]
pub struct StoredFile {
    kind: &'static Kind,
    path: PathBuf,
    /// The partition it is on, if that is mounted read-only.
    partition: Option<ReadOnlyPartition>,
}

impl StoredFile {
    /// A file that can be written at any time.
    #[must_use]
    pub fn file(kind: &'static Kind, path: &Path) -> Self {
        Self { kind, path: path.to_owned(), partition: None }
    }

    /// A file of this name on a partition.
    #[must_use]
    pub fn on_partition(kind: &'static Kind, partition: &ReadOnlyPartition, name: &str) -> Self {
        Self { kind, path: partition.file(name), partition: Some(partition.clone()) }
    }

    /// Where it is, for messages.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's bytes, which are not checked; an error of the kind [`ErrorKind::NotFound`] if there
    /// are none.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn read(&self) -> io::Result<Vec<u8>> {
        let in_place = self.read_bounded(&self.path);
        match self.journal() {
            Some(journal) if !in_place.as_ref().is_ok_and(|bytes| (self.kind.is_whole)(bytes)) => {
                Ok(journal)
            }
            _ => in_place,
        }
    }

    /// Finishes a replacement that was interrupted, or gives it up where the journal is not intact:
    /// the next one must not be written over the only intact copy.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(&self) -> Result<()> {
        if self.read_bounded(&journal_of(&self.path)).is_err() {
            return Ok(());
        }
        // The very first file was cut off, or the one in place cannot be read: the next is written over it.
        let Ok(bytes) = self.read() else { return Ok(()) };
        self.written_to(|| self.put_in_place(&bytes))
    }

    /// Stores new bytes; on return they are on the disk.
    ///
    /// # Errors
    /// When the disk cannot be written. What was there is then still stored.
    pub fn store(&self, bytes: &[u8]) -> Result<()> {
        self.complete()?;
        if self.read().is_ok_and(|stored| stored == bytes) {
            return Ok(());
        }
        self.written_to(|| {
            self.write_to_disk(&journal_of(&self.path), bytes)?;
            self.put_in_place(bytes)
        })?;
        ensure!(self.read()? == bytes, "the disk does not give back what was written to it");
        Ok(())
    }

    /// The journal that an interrupted replacement left, if it is intact.
    fn journal(&self) -> Option<Vec<u8>> {
        let journal = self.read_bounded(&journal_of(&self.path)).ok();
        journal.filter(|bytes| (self.kind.is_whole)(bytes))
    }

    /// The last step, once the content is on the disk, in the journal or in place.
    fn put_in_place(&self, bytes: &[u8]) -> Result<()> {
        let journal = journal_of(&self.path);
        let is_there = self.read_bounded(&self.path).is_ok_and(|there| there == bytes);
        if is_there || self.partition.is_some() {
            if !is_there {
                self.write_to_disk(&self.path, bytes)?;
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

    /// Writes a file in place, so that its directory entry stays, and waits for the disk.
    fn write_to_disk(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let write = || -> io::Result<()> {
            let mut options = OpenOptions::new();
            options.write(true).create(true).truncate(false).mode(self.kind.mode);
            let mut file = options.open(path)?;
            file.write_all(bytes)?;
            file.set_len(bytes.len() as u64)?;
            file.sync_all()
        };
        write()
            .inspect(|()| watchdog::written())
            .with_context(|| format!("{} cannot be written", path.display()))?;
        sync_disk_of(path)
    }

    /// One byte more than the largest is enough to see that a file is too long.
    fn read_bounded(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        File::open(path)?.take(self.kind.bytes_max as u64 + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

/// Whether the file does not exist, rather than cannot be read.
#[must_use]
pub fn is_absent(error: &io::Error) -> bool {
    error.kind() == ErrorKind::NotFound
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_end_is_not_read_to_its_end() {
        static KIND: Kind = Kind { bytes_max: 1000, mode: 0o600, is_whole: |_| true };
        let endless = StoredFile::file(&KIND, Path::new("/dev/zero"));
        assert_eq!(endless.read().unwrap().len(), 1001);
    }

    #[test]
    fn where_the_first_one_was_cut_off_there_is_none_and_the_next_is_stored() {
        static KIND: Kind =
            Kind { bytes_max: 9, mode: 0o600, is_whole: |bytes| bytes.ends_with(b".") };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(journal_of(&path), b"cut o").unwrap();
        let file = StoredFile::file(&KIND, &path);
        file.complete().unwrap();
        assert!(is_absent(&file.read().unwrap_err()));
        file.store(b"whole.").unwrap();
        assert_eq!(file.read().unwrap(), b"whole.");
        assert!(!journal_of(&path).exists());
    }
}
