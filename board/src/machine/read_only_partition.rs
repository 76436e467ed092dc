//! A partition that is mounted for reading only, so that the power may be pulled at any time,
//! and is made writable for the moment in which something is written.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use nix::mount::{MsFlags, mount};
use nix::unistd::syncfs;

/// How it is mounted, besides for reading or writing.
pub const MOUNT_FLAGS: MsFlags =
    MsFlags::MS_NOSUID.union(MsFlags::MS_NODEV).union(MsFlags::MS_NOEXEC);

/// The partition that is mounted at a place.
#[derive(Debug, Clone)]
pub struct ReadOnlyPartition {
    place: PathBuf,
}

impl ReadOnlyPartition {
    /// What is mounted at `place`.
    #[must_use]
    pub fn at(place: &Path) -> Self {
        Self { place: place.to_owned() }
    }

    /// The path of a file in its root directory.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.place.join(name)
    }

    /// Runs `write` while the partition can be written to.
    ///
    /// # Errors
    /// When it cannot be made writable; those of `write`.
    pub fn while_writable(&self, write: impl FnOnce() -> Result<()>) -> Result<()> {
        self.remount(MsFlags::empty()).context("the card cannot be written to")?;
        let written = write();
        if let Err(error) = self.remount(MsFlags::MS_RDONLY) {
            // It is stored all the same; the next start mounts it for reading only.
            log::warn!("{} stays writable until the next start: {error}", self.place.display());
        }
        written
    }

    fn remount(&self, access: MsFlags) -> nix::Result<()> {
        let flags = MsFlags::MS_REMOUNT | MOUNT_FLAGS | access;
        mount(None::<&str>, &self.place, None::<&str>, flags, None::<&str>)
    }
}

/// Waits until all that was changed on the disk of this file is stored.
///
/// # Errors
/// When the disk does not take it.
pub fn sync_disk_of(path: &Path) -> Result<()> {
    let sync = || -> std::io::Result<()> { Ok(syncfs(File::open(path)?)?) };
    sync().with_context(|| format!("the disk of {} does not take it", path.display()))
}
