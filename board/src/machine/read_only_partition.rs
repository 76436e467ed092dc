//! A partition that is mounted read-only, so that the power may be pulled at any time, and is
//! made writable only while something is written.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use nix::mount::{MsFlags, mount};
use nix::unistd::syncfs;

use super::watchdog;

/// How it is mounted, apart from read-only or writable.
pub const MOUNT_FLAGS: MsFlags =
    MsFlags::MS_NOSUID.union(MsFlags::MS_NODEV).union(MsFlags::MS_NOEXEC);

/// A mounted partition.
#[derive(Debug, Clone)]
pub struct ReadOnlyPartition {
    place: PathBuf,
}

impl ReadOnlyPartition {
    /// The partition that is mounted at `place`.
    #[must_use]
    pub fn at(place: &Path) -> Self {
        Self { place: place.to_owned() }
    }

    /// The path of a file in its root directory.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.place.join(name)
    }

    /// Runs `write` while the partition is writable.
    ///
    /// # Errors
    /// When it cannot be made writable, and those of `write`.
    pub fn while_writable(&self, write: impl FnOnce() -> Result<()>) -> Result<()> {
        self.remount(MsFlags::empty()).context("the card cannot be written to")?;
        let written = write();
        if let Err(error) = self.remount(MsFlags::MS_RDONLY) {
            // The data is stored nevertheless; the next start mounts it read-only.
            log::warn!("{} stays writable until the next start: {error}", self.place.display());
        }
        written
    }

    fn remount(&self, access: MsFlags) -> nix::Result<()> {
        let flags = MsFlags::MS_REMOUNT | MOUNT_FLAGS | access;
        mount(None::<&str>, &self.place, None::<&str>, flags, None::<&str>)
            .inspect(|()| watchdog::written())
    }
}

/// Waits until all changes to the file system of this file are on the disk.
///
/// # Errors
/// When the disk does not accept them.
pub fn sync_disk_of(path: &Path) -> Result<()> {
    let sync = || -> std::io::Result<()> { Ok(syncfs(File::open(path)?)?) };
    sync()
        .inspect(|()| watchdog::written())
        .with_context(|| format!("the disk of {} does not accept what was written", path.display()))
}
