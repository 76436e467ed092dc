//! Removes trials from a cohort.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::path::Path;

use plumbline_files::counting::counted;
use plumbline_files::{BadInput, replace_with, sync_directory};
use plumbline_trial::parquet::{Reader, Writer};

use crate::change::{Change, Stage};
use crate::folder::{Cohort, TRIALS_MAX};
use crate::key::Key;
use crate::row::Row;
use crate::{figures, names};

/// The fewest digits by which a trial's content is known.
const DIGITS_MIN: usize = 8;

/// So many faults are named; of more, only the number.
const FAULTS_NAMED: usize = 20;

/// Which trials are removed.
#[derive(Debug, Clone, Default)]
pub struct Chosen {
    /// Each names one trial: `PARTICIPANT/SESSION/CONDITION/RUN`, or at least the first eight digits of
    /// the column `trial`.
    pub keys: Vec<String>,
    /// All trials of these participants.
    pub participants: Vec<String>,
}

impl Chosen {
    /// The chosen rows of a cohort's, in their order; `place` is the cohort.
    ///
    /// # Errors
    /// When a key names no trial or several, or a participant has none.
    pub fn of<'a>(&self, rows: &'a [Row], place: &Path) -> Result<Vec<&'a Row>, BadInput> {
        let mut by_name: HashMap<String, Vec<&Row>> = HashMap::new();
        for row in rows {
            by_name.entry(name(&row.key)).or_default().push(row);
        }
        let mut chosen: HashSet<&Key> = HashSet::new();
        let mut faults = Vec::new();
        for text in &self.keys {
            let begins = |row: &&Row| text.len() >= DIGITS_MIN && row.trial.starts_with(text);
            let named = by_name.get(text).cloned();
            match &named.unwrap_or_else(|| rows.iter().filter(begins).collect())[..] {
                [row] => {
                    chosen.insert(&row.key);
                }
                [] => faults.push(format!("no trial is {text:?}")),
                several => faults.push(format!("{} are {text:?}", counted(several.len(), "trial"))),
            }
        }
        for participant in &self.participants {
            let is_own = |row: &&Row| row.key.participant == *participant;
            if !rows.iter().any(|row| is_own(&row)) {
                faults.push(format!("no trial is of the participant {participant:?}"));
            }
            chosen.extend(rows.iter().filter(is_own).map(|row| &row.key));
        }
        if faults.is_empty() {
            return Ok(rows.iter().filter(|row| chosen.contains(&row.key)).collect());
        }
        let more = faults.len().saturating_sub(FAULTS_NAMED);
        faults.truncate(FAULTS_NAMED);
        if more > 0 {
            faults.push(format!("and {more} more"));
        }
        Err(BadInput::whole(
            place.display(),
            format!("{}; nothing was removed", faults.join("; ")),
            "give PARTICIPANT/SESSION/CONDITION/RUN as `plumb cohort list` shows them, or the digits \
             beside \"content\" of `plumb cohort show`",
        ))
    }
}

/// What names a trial on the command line. Where parts of keys have a `/`, two may have the same.
fn name(Key { participant, session, condition, run }: &Key) -> String {
    format!("{participant}/{session}/{condition}/{run}")
}

/// Removes trials: all that are chosen or, when something is wrong, none. Gives their keys, and the
/// number of trials that stay.
///
/// # Errors
/// When there is no such cohort or trial, another program is changing the cohort, a table cannot be
/// read, or the operating system refuses.
pub fn remove(cohort: &Path, chosen: &Chosen) -> Result<(Vec<Key>, usize), BadInput> {
    let locked = Cohort::open(cohort)?.lock()?;
    let rows = locked.cohort().rows()?;
    let gone = chosen.of(&rows, cohort)?;
    let stage = locked.stage(Change::Removal)?;
    write(&stage, locked.cohort(), &gone)?;
    stage.make()?;
    Ok((gone.iter().map(|row| row.key.clone()).collect(), rows.len() - gone.len()))
}

/// Writes the tables without these trials, and brings them to the disk.
fn write(stage: &Stage<'_>, cohort: &Cohort, gone: &[&Row]) -> Result<(), BadInput> {
    let trials: HashSet<&str> = gone.iter().map(|row| &*row.trial).collect();
    for (name, rows_max) in [(names::TRIALS, TRIALS_MAX), (names::FIGURES, figures::ROWS_MAX)] {
        for path in cohort.tables(name)? {
            without(stage, cohort, name, &Reader::open(&path, rows_max)?, &path, &trials)?;
        }
    }
    for row in gone {
        stage.delete(&row.key.points_file())?;
    }
    sync_directory(stage.path());
    Ok(())
}

/// Writes a file of a table without the rows of these trials; one that has none of them stays as it
/// is.
fn without(
    stage: &Stage<'_>,
    cohort: &Cohort,
    name: &str,
    reader: &Reader,
    path: &Path,
    gone: &HashSet<&str>,
) -> Result<(), BadInput> {
    // Whether each row stays, group by group.
    let mut stays: Vec<Vec<bool>> = Vec::with_capacity(reader.groups());
    for group in 0..reader.groups() {
        let table = reader.group(group, &["trial"])?;
        stays.push(table.texts("trial")?.iter().map(|it| !gone.contains(&**it)).collect());
    }
    if stays.iter().flatten().all(|it| *it) {
        return Ok(());
    }
    let own = path.strip_prefix(cohort.path()).unwrap_or(path);
    if !stays.iter().flatten().any(|it| *it) {
        return stage.delete(own);
    }
    let place = stage.path().join(own);
    let failed = |error: &dyn std::fmt::Display| {
        BadInput::whole(place.display(), error, "check the disk, and that it has room")
    };
    replace_with(&place, |file| {
        let mut writer: Option<Writer<&File>> = None;
        for (group, stays) in stays.iter().enumerate().filter(|(_, it)| it.contains(&true)) {
            let mut table = reader.group(group, &[])?;
            table.retain(stays);
            let columns = table.columns();
            let writer = match &mut writer {
                Some(writer) => writer,
                None => writer.insert(
                    Writer::new(file, name, columns, Vec::new()).map_err(|it| failed(&it))?,
                ),
            };
            writer.group(columns).map_err(|it| failed(&it))?;
        }
        writer.map_or(Ok(()), |it| it.close().map_err(|it| failed(&it)))
    })
}
