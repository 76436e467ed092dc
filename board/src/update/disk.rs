//! A partition without its file system: written and read past the kernel's memory of it, so that what
//! is written is on the card, and what is read comes from there.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileExt, OpenOptionsExt as _};
use std::path::Path;

use anyhow::{Context, Result};
use nix::libc;

/// The bytes that are written and read at once: a card's own blocks are of this order.
pub const BLOCK_BYTES: usize = 128 * 1024;

/// Memory that a disk takes and gives without a copy: aligned to a page.
#[repr(C, align(4096))]
pub struct Block([u8; BLOCK_BYTES]);

impl Block {
    /// A block of zeros.
    pub fn new() -> Box<Self> {
        Box::new(Self([0; BLOCK_BYTES]))
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8; BLOCK_BYTES] {
        &self.0
    }

    /// Its bytes, to be filled.
    pub fn bytes_mut(&mut self) -> &mut [u8; BLOCK_BYTES] {
        &mut self.0
    }
}

impl std::fmt::Debug for Block {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Block")
    }
}

/// A partition's device.
#[derive(Debug)]
pub struct Disk {
    file: File,
    place: String,
}

impl Disk {
    /// Opens it for reading, and for writing if `is_written`.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open(path: &Path, is_written: bool) -> Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(is_written);
        options.custom_flags(libc::O_DIRECT | libc::O_CLOEXEC);
        let place = path.display().to_string();
        let file = options.open(path).with_context(|| format!("{place} cannot be opened"))?;
        Ok(Self { file, place })
    }

    /// Writes the first bytes of a block, whole sectors, at a sector's start.
    ///
    /// # Errors
    /// When the disk does not take them.
    pub fn write(&self, at: u64, block: &Block, bytes: usize) -> Result<()> {
        self.file
            .write_all_at(&block.0[..bytes], at)
            .with_context(|| format!("{} does not take what is written to it", self.place))
    }

    /// Reads the first bytes of a block, whole sectors, from a sector's start.
    ///
    /// # Errors
    /// When the disk does not give them.
    pub fn read(&self, at: u64, block: &mut Block, bytes: usize) -> Result<()> {
        self.file
            .read_exact_at(&mut block.0[..bytes], at)
            .with_context(|| format!("{} does not give back what is on it", self.place))
    }

    /// Waits until the disk itself keeps nothing back.
    ///
    /// # Errors
    /// When it does not.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_all().with_context(|| format!("{} is not written", self.place))
    }
}

#[cfg(test)]
mod tests {
    use nix::fcntl::{FcntlArg, OFlag, fcntl};

    use super::*;

    #[test]
    fn what_is_written_and_read_goes_past_the_kernels_memory() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for is_written in [false, true] {
            let disk = Disk::open(file.path(), is_written).unwrap();
            let flags = OFlag::from_bits_truncate(fcntl(&disk.file, FcntlArg::F_GETFL).unwrap());
            assert!(flags.contains(OFlag::O_DIRECT), "{flags:?}");
        }
    }

    #[test]
    fn an_error_names_the_partition() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let (name, mut block) = (file.path().display().to_string(), Block::new());
        let only_read = Disk::open(file.path(), false).unwrap();
        let errors = [
            only_read.write(0, &block, BLOCK_BYTES).unwrap_err(),
            only_read.read(0, &mut block, BLOCK_BYTES).unwrap_err(),
            Disk::open(Path::new("/nowhere"), true).unwrap_err(),
        ];
        let words = errors.map(|error| error.to_string());
        assert_eq!(words[0], format!("{name} does not take what is written to it"));
        assert_eq!(words[1], format!("{name} does not give back what is on it"));
        assert_eq!(words[2], "/nowhere cannot be opened");
    }
}
