//! A cohort on the disk.

use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use plumbline_files::{BadInput, from_toml, make_directory, read_text, replace};
use plumbline_trial::parquet::Reader;
use plumbline_trial::points::Points;
use serde::{Deserialize, Serialize};

use crate::change::{Change, Stage, complete_all, is_any_made};
use crate::row::{self, Row};
use crate::{names, samples};

/// The format that this program writes.
const FORMAT: u32 = 1;

/// Far more trials than one computer analyses.
pub(crate) const TRIALS_MAX: u64 = 10_000_000;

/// `cohort.toml`.
#[derive(Debug, Serialize, Deserialize)]
struct About {
    format: u32,
    made_with: String,
}

const HEADING: &str =
    "# A cohort of trials, kept by `plumb cohort`: see `plumb cohort --help`.\n\n";

/// A cohort's folder.
#[derive(Debug, Clone)]
pub struct Cohort {
    path: PathBuf,
}

/// A cohort that nobody else changes until this is dropped.
#[derive(Debug)]
pub struct Locked {
    cohort: Cohort,
    _lock: File,
}

impl Cohort {
    /// Opens a cohort, and completes a change that was interrupted.
    ///
    /// # Errors
    /// When there is none, it is of another format, or another program is changing it right now.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        let about = path.join(names::ABOUT);
        if !about.is_file() {
            return Err(BadInput::whole(
                path.display(),
                format!("it is no cohort: it has no {}", names::ABOUT),
                "give the folder that `plumb cohort add --to` has made",
            ));
        }
        check_format(&about)?;
        let cohort = Self { path: path.to_owned() };
        if is_any_made(path) {
            // Whoever is moving the files holds the lock.
            cohort.clone().lock()?;
        }
        Ok(cohort)
    }

    /// Locks a cohort for an addition; without one, makes it. What an interrupted change has left is
    /// completed or deleted.
    ///
    /// # Errors
    /// When the folder is something else, another program is changing it, or the operating system
    /// refuses.
    pub fn for_addition(path: &Path, program: &str) -> Result<Locked, BadInput> {
        let about = path.join(names::ABOUT);
        if about.is_file() {
            return Self::open(path)?.lock();
        }
        if path.exists() && !is_empty(path)? {
            return Err(BadInput::whole(
                path.display(),
                format!("it is no cohort, and not empty: it has no {}", names::ABOUT),
                "give the folder of a cohort, or the name of a new one",
            ));
        }
        make_directory(path)?;
        let locked = Self { path: path.to_owned() }.lock()?;
        let text = toml::to_string(&About { format: FORMAT, made_with: program.to_owned() })
            .map_err(|error| BadInput::whole(about.display(), error, "report it"))?;
        replace(&about, format!("{HEADING}{text}").as_bytes())?;
        Ok(locked)
    }

    /// Locks it for a change. What an interrupted one has left is completed or deleted.
    ///
    /// # Errors
    /// When another program is changing it, or the operating system refuses.
    pub fn lock(self) -> Result<Locked, BadInput> {
        let path = self.path.join(names::LOCK);
        let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
        let lock = File::options().create(true).append(true).open(&path).map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(BadInput::whole(
                    self.path.display(),
                    "another program is changing this cohort",
                    "try again when it has ended",
                ));
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        complete_all(&self.path)?;
        Ok(Locked { cohort: self, _lock: lock })
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The table of trials, ordered by key.
    ///
    /// # Errors
    /// When it cannot be read, or names a key or a trial twice.
    pub fn rows(&self) -> Result<Vec<Row>, BadInput> {
        let mut rows = Vec::new();
        for path in self.tables(names::TRIALS)? {
            let table = Reader::open(&path, TRIALS_MAX)?.all()?;
            rows.extend(row::rows(&table, &path.display().to_string())?);
        }
        rows.sort_by(|a, b| a.key.cmp(&b.key));
        if let Some(pair) = rows.windows(2).find(|pair| pair[0].key == pair[1].key) {
            return Err(BadInput::new(
                self.path.join(names::TRIALS).display(),
                &pair[0].key,
                "two trials have this key",
                "files were copied into this folder: remove them, and add the trials instead",
            ));
        }
        Ok(rows)
    }

    /// The files of a table, in the order of their names.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn tables(&self, name: &str) -> Result<Vec<PathBuf>, BadInput> {
        let folder = self.path.join(name);
        let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
        let entries = match std::fs::read_dir(&folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(failed)?,
        };
        let paths: Result<Vec<PathBuf>, _> = entries.map(|it| it.map(|it| it.path())).collect();
        let mut paths = paths.map_err(failed)?;
        paths.retain(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.ends_with(".parquet") && !name.starts_with(['.', '_'])
        });
        paths.sort();
        Ok(paths)
    }

    /// The file of a trial's points.
    #[must_use]
    pub fn points_file(&self, row: &Row) -> PathBuf {
        self.path.join(row.key.points_file())
    }

    /// Reads a trial's points.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn points(&self, row: &Row) -> Result<Points, BadInput> {
        samples::read(&self.points_file(row), row)
    }
}

impl Locked {
    /// The cohort.
    #[must_use]
    pub fn cohort(&self) -> &Cohort {
        &self.cohort
    }

    /// An empty folder for a change.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn stage(&self, change: Change) -> Result<Stage<'_>, BadInput> {
        Stage::begin(&self.cohort.path, change)
    }
}

fn check_format(path: &Path) -> Result<(), BadInput> {
    let place = path.display().to_string();
    let remedy = "it is written by `plumb cohort add` and not meant to be edited: put back a copy";
    let about: About = from_toml(&read_text(path)?, &place, remedy)?;
    if about.format == FORMAT {
        return Ok(());
    }
    Err(BadInput::new(
        place,
        "format",
        format!("{}, and this program knows {FORMAT}", about.format),
        format!("use the program that made it, {}", about.made_with),
    ))
}

/// Whether nothing is in a folder but what the beginning of an addition leaves.
fn is_empty(folder: &Path) -> Result<bool, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        // The beginning of cohort.toml has a hidden name.
        if !name.to_string_lossy().starts_with('.') {
            return Ok(false);
        }
    }
    Ok(true)
}

/// All files below a folder, in the order of their names; none where there is no such folder.
pub(crate) fn files(folder: &Path) -> Result<Vec<PathBuf>, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(failed)?,
    };
    let mut paths =
        entries.map(|it| Ok(it?.path())).collect::<Result<Vec<_>, _>>().map_err(failed)?;
    paths.sort();
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() {
            found.extend(files(&path)?);
        } else {
            found.push(path);
        }
    }
    Ok(found)
}
