//! Adds trials to a cohort.

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use plumbline_files::counting::counted;
use plumbline_files::{BadInput, make_directory, replace, sync_directory};
use plumbline_study::method::Choice;
use plumbline_study::tidy;
use plumbline_trial::Trial;
use plumbline_trial::parquet::{self, Writer};
use plumbline_trial::points::Points;
use rayon::prelude::*;

use crate::change::{Change, Stage};
use crate::folder::Cohort;
use crate::given::{Assumed, Fate, Given, People, Said};
use crate::key::{Key, RUN_MAX};
use crate::row::{self, Addition, Person, Row};
use crate::{content, figures, names, samples};

/// So many trials are in memory at once, at most, as values; their points are only while they are
/// read.
const TRIALS_AT_ONCE: usize = 64;

/// So many faults are named; of more, only the number.
const FAULTS_NAMED: usize = 20;

/// What was done.
#[derive(Debug, Clone, Default)]
pub struct Added {
    /// The trials that were added.
    pub added: Vec<Key>,
    /// The trials that were there already.
    pub already: Vec<Key>,
    /// The recordings that are no trials of their session, and why.
    pub left_out: Vec<(PathBuf, String)>,
    /// What a user should know of the trials that were added.
    pub notes: Vec<String>,
}

/// How far an addition has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// One more folder was looked at.
    LookedAt,
    /// One more trial was written.
    Written,
}

/// Adds the trials of these folders: all or, when something is wrong with one, none.
///
/// # Errors
/// When a trial cannot be read or has no key, another one has the same key, or the disk is full.
pub fn add(
    cohort: &Path,
    folders: &[PathBuf],
    said: &Said,
    program: &str,
    advance: &(dyn Fn(Step) + Sync),
) -> Result<Added, BadInput> {
    tidy::refuse_twice(folders)?;
    let people = People::of(folders, said.participants.as_deref())?;
    let fates: Vec<_> = folders
        .par_iter()
        .map(|folder| {
            let fate = said.look_at(folder, &people);
            advance(Step::LookedAt);
            fate
        })
        .collect();
    let (mut given, mut faults) = (Vec::new(), Vec::new());
    let mut done = Added::default();
    for fate in fates {
        match fate {
            Ok(Fate::Taken(it)) => given.push(*it),
            Ok(Fate::LeftOut(folder, why)) => done.left_out.push((folder, why)),
            Err(error) => faults.push(error),
        }
    }
    refuse(faults)?;
    let locked = Cohort::for_addition(cohort, program)?;
    let rows = locked.cohort().rows()?;
    let new = new_ones(given, &rows, said, &mut done)?;
    if new.is_empty() {
        return Ok(done);
    }
    done.notes = notes(&new, &people);
    let addition =
        Addition { added_us: jiff::Timestamp::now().as_microsecond(), program: program.to_owned() };
    let stage = locked.stage(Change::Addition)?;
    let warnings = write(&stage, &new, &addition, &|| advance(Step::Written))?;
    stage.make()?;
    done.notes.extend(warnings);
    done.added = new.into_iter().map(|it| it.key).collect();
    Ok(done)
}

/// One error for all of these.
fn refuse(mut faults: Vec<BadInput>) -> Result<(), BadInput> {
    if faults.len() < 2 {
        return faults.pop().map_or(Ok(()), Err);
    }
    let mut lines: Vec<String> =
        faults.iter().take(FAULTS_NAMED).map(|it| format!("\n  {it}")).collect();
    if faults.len() > FAULTS_NAMED {
        lines.push(format!("\n  and {} more", faults.len() - FAULTS_NAMED));
    }
    let found = format!(
        "{} cannot be added:{}\n  nothing was added",
        counted(faults.len(), "trial"),
        lines.concat()
    );
    Err(BadInput::whole("trials", found, "correct these, or name the others only"))
}

/// Those that are not in the cohort yet.
fn new_ones(
    given: Vec<Given>,
    rows: &[Row],
    said: &Said,
    done: &mut Added,
) -> Result<Vec<Given>, BadInput> {
    let by_content: HashMap<&str, &Row> = rows.iter().map(|it| (&*it.trial, it)).collect();
    let mut contents: HashMap<String, PathBuf> = HashMap::new();
    let (mut new, mut faults) = (Vec::new(), Vec::new());
    for it in given {
        if let Some(row) = by_content.get(&*it.trial) {
            match same(row, &it) {
                None => done.already.push(row.key.clone()),
                Some(fault) => faults.push(fault),
            }
            continue;
        }
        if let Some(first) = contents.insert(it.trial.clone(), it.folder.clone()) {
            let found = format!("it is a copy of {}", first.display());
            let remedy = "give each trial once";
            faults.push(BadInput::whole(it.folder.display(), found, remedy));
        }
        new.push(it);
    }
    if said.numbers_runs {
        number_runs(&mut new, rows);
    }
    let mut keys: HashMap<&Key, String> = HashMap::new();
    for row in rows {
        keys.insert(
            &row.key,
            format!("the cohort has another trial under this key, added from {}", row.folder),
        );
    }
    for it in &new {
        if let Some(other) =
            keys.insert(&it.key, format!("{} has the same key", it.folder.display()))
        {
            let remedy = if it.is_assumed.run {
                "give --run, or --number-runs to number such trials in the order in which they began"
            } else {
                "give another --session or --run; a trial that was changed since takes a new cohort"
            };
            faults.push(BadInput::new(it.folder.display(), &it.key, other, remedy));
        }
    }
    refuse(faults)?;
    new.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(new)
}

/// What differs between a trial and the cohort's row of it.
fn same(row: &Row, given: &Given) -> Option<BadInput> {
    let differ = |field: &str, found: String, remedy: &str| {
        Some(BadInput::new(given.folder.display(), field, found, remedy))
    };
    let Assumed { session, run } = given.is_assumed;
    let is_same = row.key.participant == given.key.participant
        && row.key.condition == given.key.condition
        && (session || row.key.session == given.key.session)
        && (run || row.key.run == given.key.run);
    if !is_same {
        let found = format!("the cohort has this trial as {}, and not as {}", row.key, given.key);
        return differ("key", found, "leave it out, or make a new cohort: a trial counts once");
    }
    if row.person != given.person && given.person != Person::default() {
        let found = "the participants' file says something else than when this trial was added";
        let remedy = "make a new cohort: age, sex, height and mass are those of all its trials";
        return differ("participant", found.to_owned(), remedy);
    }
    None
}

/// Numbers those that have no run of their own, in the order in which they began, after those that
/// have.
fn number_runs(new: &mut [Given], rows: &[Row]) {
    type Cell = (String, String, String);
    let cell = |key: &Key| -> Cell {
        (key.participant.clone(), key.session.clone(), key.condition.clone())
    };
    let mut last: HashMap<Cell, u32> = HashMap::new();
    let told = new.iter().filter(|it| !it.is_assumed.run).map(|it| &it.key);
    for key in rows.iter().map(|it| &it.key).chain(told) {
        let run = last.entry(cell(key)).or_default();
        *run = key.run.max(*run);
    }
    let mut order: Vec<usize> = (0..new.len()).filter(|at| new[*at].is_assumed.run).collect();
    let began = |it: &Given| (it.started.parse::<jiff::Timestamp>().ok(), it.folder.clone());
    order.sort_by_cached_key(|at| began(&new[*at]));
    for at in order {
        let run = last.entry(cell(&new[at].key)).or_default();
        *run = (*run + 1).min(RUN_MAX);
        new[at].key.run = *run;
    }
}

/// What was taken for granted.
fn notes(new: &[Given], people: &People) -> Vec<String> {
    let assumed = new.iter().filter(|it| it.is_assumed.session).count();
    let mut notes = Vec::new();
    if assumed > 0 {
        let trials = counted(assumed, "trial");
        notes.push(format!(
            "nothing says the session of {trials}: it is 1 (--session says another)"
        ));
    }
    let mut places: Vec<String> = people.places().map(|it| it.display().to_string()).collect();
    places.sort();
    let known = new.iter().filter(|it| it.person != Person::default()).count();
    if !places.is_empty() {
        let trials = counted(new.len(), "trial");
        let places = places.join(", ");
        notes.push(format!("age, sex, height and mass of {known} of {trials} are from {places}"));
    }
    notes
}

/// Writes everything that is to be added, and brings it to the disk. Gives warnings.
fn write(
    stage: &Stage<'_>,
    new: &[Given],
    addition: &Addition,
    advance: &(dyn Fn() + Sync),
) -> Result<Vec<String>, BadInput> {
    let name = file_name(new, addition);
    let place = stage.path().join(names::FIGURES).join(&name);
    make_directory(&stage.path().join(names::FIGURES))?;
    let failed = |error: &dyn std::fmt::Display| {
        BadInput::whole(place.display(), error, "check the disk, and that it has room")
    };
    let file = File::create(&place).map_err(|error| BadInput::io(place.display(), &error))?;
    let mut figures: Option<Writer<&File>> = None;
    let (mut rows, mut warnings) = (Vec::with_capacity(new.len()), Vec::new());
    for some in new.chunks(TRIALS_AT_ONCE) {
        let written: Vec<_> = some
            .par_iter()
            .map(|given| {
                let written = write_trial(stage, given, addition);
                advance();
                written
            })
            .collect();
        let (mut keys, mut tidy_rows) = (Vec::new(), Vec::new());
        for (row, of_trial) in written.into_iter().collect::<Result<Vec<_>, _>>()? {
            warnings.extend(row.warnings.iter().map(|it| (it.clone(), row.key.clone())));
            keys.extend(std::iter::repeat_n(row.key.clone(), of_trial.len()));
            tidy_rows.extend(of_trial);
            rows.push(row);
        }
        let columns = figures::columns(&keys, &tidy_rows);
        let writer = match &mut figures {
            Some(writer) => writer,
            None => figures.insert(
                Writer::new(&file, "figures", &columns, Vec::new()).map_err(|it| failed(&it))?,
            ),
        };
        writer.group(&columns).map_err(|it| failed(&it))?;
    }
    if let Some(writer) = figures {
        writer.close().map_err(|it| failed(&it))?;
    }
    file.sync_all().map_err(|error| BadInput::io(place.display(), &error))?;
    sync_directory(&stage.path().join(names::FIGURES));
    let place = stage.path().join(names::TRIALS).join(&name);
    let bytes = parquet::bytes("trials", &row::columns(&rows), Vec::new()).map_err(|error| {
        BadInput::whole(place.display(), error, "report it: rows can be written")
    })?;
    replace(&place, &bytes)?;
    sync_directory(stage.path());
    Ok(grouped(warnings))
}

/// One line for each warning, which names the first trial that has it and says how many others do.
fn grouped(warnings: Vec<(String, Key)>) -> Vec<String> {
    let mut groups: Vec<(String, Key, usize)> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    for (text, key) in warnings {
        match places.get(&text) {
            Some(at) => groups[*at].2 += 1,
            None => {
                places.insert(text.clone(), groups.len());
                groups.push((text, key, 0));
            }
        }
    }
    let line = |(text, key, others): (String, Key, usize)| match others {
        0 => format!("{key}: {text}"),
        others => format!("{key}, and {}: {text}", counted(others, "other trial")),
    };
    groups.into_iter().map(line).collect()
}

/// When it was added, and which trials.
fn file_name(new: &[Given], addition: &Addition) -> String {
    let sum = content::of_texts(new.iter().map(|it| &*it.trial));
    let added = jiff::Timestamp::from_microsecond(addition.added_us).unwrap_or_default();
    format!("{}-{}.parquet", added.strftime("%Y%m%dT%H%M%SZ"), &sum[..8])
}

/// Writes the points of a trial; gives its row and its figures.
fn write_trial(
    stage: &Stage<'_>,
    given: &Given,
    addition: &Addition,
) -> Result<(Row, Vec<tidy::Row>), BadInput> {
    let trial = Trial::open(&given.folder)?;
    let points = Points::of(&trial, trial.manifest.zero)?;
    let frames_s: Vec<f64> = trial.frames.iter().map(|it| it.time_s - points.zero_s).collect();
    let bytes = samples::bytes(&given.trial, &points, &frames_s)?;
    replace(&stage.path().join(given.key.points_file()), &bytes)?;
    let row = Row::of(
        given.key.clone(),
        given.trial.clone(),
        given.person.clone(),
        &trial,
        &points,
        addition,
    );
    drop(trial);
    let figures = figures::of(&row, &points, &Choice::default());
    Ok((row, figures))
}
