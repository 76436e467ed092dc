//! Changes of a cohort that are made as a whole or not at all.
//!
//! ```text
//! .adding/   ──all written and on the disk──▶ .added/   ──file by file──▶ points/, figures/, trials/
//! .removing/ ──all written and on the disk──▶ .removed/ ──file by file──▶ trials/, figures/, points/
//! ```
//!
//! A change is written into a folder of its own, which nobody reads. Once everything is on the disk,
//! the folder is renamed: from then on the change is made. Its files then move to their places, in
//! which they may replace others. A file without content deletes the one in its place: no Parquet file
//! is empty. The table of trials is last of an addition and first of a removal, so that each trial that
//! it names has its points and figures. Whatever happens to the program or the computer: a change that
//! was only begun is deleted, and the moves of one that was made are completed when the cohort is next
//! opened.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use plumbline_files::{BadInput, directory_of, make_directory, replace, sync_directory};
use rayon::prelude::*;

use crate::folder::files;
use crate::names;

/// What is done to a cohort.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Trials are added.
    Addition,
    /// Trials are removed.
    Removal,
}

impl Change {
    const ALL: [Self; 2] = [Self::Addition, Self::Removal];

    /// The folder in which it is written.
    fn begun(self) -> &'static str {
        match self {
            Self::Addition => names::ADDING,
            Self::Removal => names::REMOVING,
        }
    }

    /// The folder from which its files move to their places.
    fn made(self) -> &'static str {
        match self {
            Self::Addition => names::ADDED,
            Self::Removal => names::REMOVED,
        }
    }

    /// The order in which the parts of a cohort change.
    fn order(self) -> [&'static str; 3] {
        match self {
            Self::Addition => [names::POINTS, names::FIGURES, names::TRIALS],
            Self::Removal => [names::TRIALS, names::FIGURES, names::POINTS],
        }
    }

    /// Moves its files to their places, if it was made.
    fn complete(self, cohort: &Path) -> Result<(), BadInput> {
        let made = cohort.join(self.made());
        if !made.exists() {
            return Ok(());
        }
        for part in self.order() {
            let (from, to) = (made.join(part), cohort.join(part));
            files(&from)?.par_iter().try_for_each(|file| {
                let place = to.join(file.strip_prefix(&from).unwrap_or(file));
                let about = std::fs::metadata(file);
                let about = about.map_err(|error| BadInput::io(file.display(), &error))?;
                if about.len() == 0 { delete(&place, &to) } else { put(file, &place) }
            })?;
            sync_directory(&to);
        }
        sync_directory(cohort);
        std::fs::remove_dir_all(&made).map_err(|error| BadInput::io(made.display(), &error))
    }
}

/// Moves a file to its place.
fn put(file: &Path, place: &Path) -> Result<(), BadInput> {
    let folder = directory_of(place);
    make_directory(folder)?;
    std::fs::rename(file, place).map_err(|error| BadInput::io(place.display(), &error))?;
    sync_directory(folder);
    Ok(())
}

/// Deletes a file, which may be gone already, and the folders up to `top` that are empty then: their
/// names tell of the trial.
fn delete(file: &Path, top: &Path) -> Result<(), BadInput> {
    let gone = |path: &Path, done: std::io::Result<()>| match done {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(BadInput::io(path.display(), &error))
        }
        _ => Ok(()),
    };
    gone(file, std::fs::remove_file(file))?;
    let mut folder = directory_of(file);
    while folder != top && folder.starts_with(top) {
        match std::fs::remove_dir(folder) {
            Err(error) if error.kind() == ErrorKind::DirectoryNotEmpty => break,
            done => gone(folder, done)?,
        }
        folder = directory_of(folder);
    }
    sync_directory(folder);
    Ok(())
}

/// Whether a change was made whose files may not all be in their places.
pub fn is_any_made(cohort: &Path) -> bool {
    Change::ALL.iter().any(|change| cohort.join(change.made()).exists())
}

/// Completes the changes that were made, and deletes those that were only begun. Nobody else may
/// change the cohort meanwhile.
///
/// # Errors
/// When the operating system refuses.
pub fn complete_all(cohort: &Path) -> Result<(), BadInput> {
    for change in Change::ALL {
        let begun = cohort.join(change.begun());
        if begun.exists() {
            std::fs::remove_dir_all(&begun)
                .map_err(|error| BadInput::io(begun.display(), &error))?;
        }
        change.complete(cohort)?;
    }
    Ok(())
}

/// A change that is being written. Unless it is [made](Self::make), it is deleted.
#[derive(Debug)]
pub struct Stage<'a> {
    cohort: &'a Path,
    change: Change,
    path: PathBuf,
    is_made: bool,
}

impl<'a> Stage<'a> {
    /// An empty one. Nobody else may change the cohort until it is dropped.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub(crate) fn begin(cohort: &'a Path, change: Change) -> Result<Self, BadInput> {
        let path = cohort.join(change.begun());
        make_directory(&path)?;
        Ok(Self { cohort, change, path, is_made: false })
    }

    /// Its folder, in which everything has its place as in the cohort.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file of this name in the cohort, relative to it, is to be deleted.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn delete(&self, name: &Path) -> Result<(), BadInput> {
        replace(&self.path.join(name), &[])
    }

    /// Makes the change. Every file must be on the disk.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn make(mut self) -> Result<(), BadInput> {
        let made = self.cohort.join(self.change.made());
        std::fs::rename(&self.path, &made).map_err(|error| BadInput::io(made.display(), &error))?;
        self.is_made = true;
        sync_directory(self.cohort);
        self.change.complete(self.cohort)
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        if !self.is_made {
            // What stays is deleted when the cohort is next changed.
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}
