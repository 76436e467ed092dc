//! A copy of the sources, in which mutants are compiled: what is checked out never changes.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::command::{BadInput, Task, root};

/// The copy.
pub struct Tree {
    place: PathBuf,
    /// As long as it is open, no other run changes the copy.
    _lock: File,
}

impl Tree {
    /// Makes the copy in this directory, or brings it up to date. Files that are the same keep their time,
    /// so that what was compiled of them is not compiled again.
    pub fn at(place: PathBuf) -> Result<Self> {
        let tree = Self::locked(place)?;
        let list = ["ls-files", "--cached", "--others", "--exclude-standard", "-z"];
        let list = Task::new("git").args(list).output()?;
        let files: BTreeSet<&str> = list.split('\0').filter(|name| !name.is_empty()).collect();
        for name in &files {
            // A file may be deleted and still be known to git.
            match fs::read(root().join(name)) {
                Ok(bytes) => tree.write(name, &bytes)?,
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => tree.remove(name)?,
                Err(error) => return Err(error).with_context(|| (*name).to_owned()),
            }
        }
        let known = tree.place.with_extension("files");
        let before = fs::read_to_string(&known).unwrap_or_default();
        for name in before.lines().filter(|name| !files.contains(name)) {
            tree.remove(name)?;
        }
        let names: Vec<&str> = files.into_iter().collect();
        fs::write(&known, names.join("\n")).with_context(|| known.display().to_string())?;
        Ok(tree)
    }

    /// The directory, as it is, of this run alone.
    pub fn locked(place: PathBuf) -> Result<Self> {
        fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
        let lock = place.with_extension("lock");
        let lock = File::create(&lock).with_context(|| lock.display().to_string())?;
        if lock.try_lock().is_err() {
            let place = place.display();
            bail!(BadInput(format!("{place}: another run is trying mutants; wait until it ends")));
        }
        Ok(Self { place, _lock: lock })
    }

    /// Its directory.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Gives a file this content.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.place.join(name);
        let said = || path.display().to_string();
        if fs::read(&path).is_ok_and(|now| now == bytes) {
            return Ok(());
        }
        fs::create_dir_all(path.parent().context("a file in no directory")?).with_context(said)?;
        fs::write(&path, bytes).with_context(said)
    }

    fn remove(&self, name: &str) -> Result<()> {
        let path = self.place.join(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(error).with_context(|| path.display().to_string())
            }
            _ => Ok(()),
        }
    }
}
