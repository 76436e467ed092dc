//! What a trial's folder says of itself: its key, and what is known of its participant.
//!
//! | part of the key | from |
//! |---|---|
//! | participant, condition | `trial.toml` |
//! | session, run | the folder's `session.toml`, as the desk's sessions leave it: `1` of `sessions/P01-1`, and the repetition that the plan says |
//! | | otherwise the folder's name, if it has them as BIDS writes them: `sub-P01_ses-2_task-stand_run-1` |
//! | | otherwise 1, and that is said |
//!
//! An option says what the folder does not, and is refused where the folder says something else.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use plumbline_files::{BadInput, directory_of};
use plumbline_session::names;
use plumbline_session::participants::{Participants, Sex};
use plumbline_session::session::{Attempt, Outcome, Session};
use plumbline_trial::Manifest;

use crate::content;
use crate::key::Key;
use crate::row::Person;

/// What options say of all trials of an addition.
#[derive(Debug, Clone, Default)]
pub struct Said {
    /// Who was measured.
    pub participant: Option<String>,
    /// The session.
    pub session: Option<String>,
    /// The condition.
    pub condition: Option<String>,
    /// The run.
    pub run: Option<u32>,
    /// Whether trials that share participant, session and condition, and have no run of their own, are
    /// numbered in the order in which they began.
    pub numbers_runs: bool,
    /// The folder with the participants' file, or that file.
    pub participants: Option<PathBuf>,
}

/// A trial that is to be added.
#[derive(Debug, Clone)]
pub struct Given {
    /// Its folder.
    pub folder: PathBuf,
    /// Its key.
    pub key: Key,
    /// Whether nothing says its session, and its run.
    pub is_assumed: Assumed,
    /// The SHA-256 of its content.
    pub trial: String,
    /// When it began, as `trial.toml` has it.
    pub started: String,
    /// The participant.
    pub person: Person,
}

/// The parts of a key that nothing says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Assumed {
    /// The session is 1 for want of anything else.
    pub session: bool,
    /// The run is 1 likewise.
    pub run: bool,
}

/// What becomes of a folder.
#[derive(Debug, Clone)]
pub enum Fate {
    /// It is to be added.
    Taken(Box<Given>),
    /// It is a recording that a session did not accept: why.
    LeftOut(PathBuf, String),
}

/// The session that a folder belongs to, as the desk keeps it.
struct OfSession {
    label: String,
    run: u32,
}

impl Said {
    /// Looks at a trial's folder; reads its content once.
    ///
    /// # Errors
    /// When something of the key is absent or contradicts an option, or a file cannot be read.
    pub fn look_at(&self, folder: &Path, people: &People) -> Result<Fate, BadInput> {
        let manifest = Manifest::read(folder)?;
        let place = folder.display().to_string();
        let real = folder.canonicalize().map_err(|error| BadInput::io(&place, &error))?;
        let of_session = match of_session(&real)? {
            Some(Err(why)) => return Ok(Fate::LeftOut(folder.to_owned(), why)),
            Some(Ok(of_session)) => Some(of_session),
            None => None,
        };
        let name = real.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
        let session = of_session.as_ref().map(|it| it.label.clone()).or(entity(&name, "ses"));
        let run =
            of_session.map(|it| it.run).or(entity(&name, "run").and_then(|it| it.parse().ok()));
        let trimmed =
            |text: Option<String>| text.map(|it| it.trim().to_owned()).filter(|it| !it.is_empty());
        let participant =
            one_of("participant", trimmed(manifest.participant), &self.participant, &place)?;
        let condition = one_of("condition", trimmed(manifest.condition), &self.condition, &place)?;
        let session = one_of("session", session, &self.session, &place)?;
        let run = one_of("run", run, &self.run, &place)?;
        let lacking = |field: &str| {
            BadInput::new(
                &place,
                field,
                "trial.toml does not say it",
                format!("write {field} = \"...\" there, or give --{field}"),
            )
        };
        let is_assumed = Assumed { session: session.is_none(), run: run.is_none() };
        let key = Key {
            participant: participant.ok_or_else(|| lacking("participant"))?,
            session: session.unwrap_or_else(|| "1".to_owned()),
            condition: condition.ok_or_else(|| lacking("condition"))?,
            run: run.unwrap_or(1),
        };
        key.check(&place)?;
        let person = people.get(&real, &key.participant)?;
        let (trial, started) = (content::of(folder)?, manifest.started);
        let folder = folder.to_owned();
        Ok(Fate::Taken(Box::new(Given { folder, key, is_assumed, trial, started, person })))
    }
}

/// What a folder and an option say of a field, unless they contradict each other.
fn one_of<T: PartialEq + Clone + std::fmt::Display>(
    field: &str,
    told: Option<T>,
    said: &Option<T>,
    place: &str,
) -> Result<Option<T>, BadInput> {
    match (told, said) {
        (Some(told), Some(said)) if told != *said => Err(BadInput::new(
            place,
            field,
            format!("the folder says {told}, and --{field} {said}"),
            "leave the option out, or give it for other trials only",
        )),
        (told, said) => Ok(told.or_else(|| said.clone())),
    }
}

/// The value of an entity in a name as BIDS writes it: `2` of `ses` in `sub-P01_ses-2_run-1`.
fn entity(name: &str, entity: &str) -> Option<String> {
    let mut parts = name.split('_').filter_map(|part| part.split_once('-'));
    parts
        .find(|(key, value)| *key == entity && !value.is_empty())
        .map(|(_, value)| value.to_owned())
}

/// What the session says whose folder this one is in, or why the recording is no trial of it. Of a
/// folder that is in none, nothing.
fn of_session(folder: &Path) -> Result<Option<Result<OfSession, String>>, BadInput> {
    let Some(parent) = folder.parent().filter(|it| it.join(names::SESSION).is_file()) else {
        return Ok(None);
    };
    let session = Session::read(parent)?;
    let name = folder.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
    let attempt = session.attempts.iter().find(|it| it.folder == name);
    let Some(Attempt { place, outcome, .. }) = attempt else {
        return Ok(Some(Err("the session does not know this recording".to_owned())));
    };
    Ok(Some(match outcome {
        Outcome::Accepted { .. } => {
            let own = parent.file_name().map(|it| it.to_string_lossy().into_owned());
            let own = own.unwrap_or_default();
            let label = own.strip_prefix(&format!("{}-", session.participant)).unwrap_or(&own);
            let run = session.plan.get(place - 1).map_or(1, |it| it.repeat);
            Ok(OfSession { label: label.to_owned(), run })
        }
        Outcome::Rejected { why } => Err(format!("the session did not accept it: {why}")),
        Outcome::Nothing { why } => Err(format!("nothing was recorded: {why}")),
        Outcome::Open => Err("nobody has decided about it yet".to_owned()),
    }))
}

/// The participants' files of the trials of an addition.
#[derive(Debug, Default)]
pub struct People {
    /// By the folder that the file is in.
    files: HashMap<PathBuf, HashMap<String, Person>>,
    /// The one that is given.
    given: Option<PathBuf>,
}

/// A participants' file lies at most so many folders above a trial's: the desk's trials are in
/// `sessions/P01-1/03-control` of their study.
const ABOVE: usize = 3;

impl People {
    /// Reads those that lie above these trials' folders, or the one that is given.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn of(folders: &[PathBuf], given: Option<&Path>) -> Result<Self, BadInput> {
        let mut people = Self::default();
        if let Some(path) = given {
            let is_file = path.file_name().is_some_and(|it| it == names::PARTICIPANTS);
            let folder = if is_file { directory_of(path) } else { path };
            if !folder.join(names::PARTICIPANTS).is_file() {
                let remedy = format!("give a {} or the folder that it is in", names::PARTICIPANTS);
                let found = format!("there is no {}", names::PARTICIPANTS);
                return Err(BadInput::whole(path.display(), found, remedy));
            }
            people.given = Some(folder.to_owned());
            people.read(folder)?;
            return Ok(people);
        }
        for folder in folders {
            let Ok(real) = folder.canonicalize() else { continue };
            if let Some(above) = above(&real)
                && !people.files.contains_key(above)
            {
                people.read(above)?;
            }
        }
        Ok(people)
    }

    fn read(&mut self, folder: &Path) -> Result<(), BadInput> {
        let participants = Participants::read(folder)?;
        let people = participants.iter().map(|(_, it)| {
            let sex = it.sex.map(Sex::letter).map(str::to_owned);
            let (height_cm, mass_kg) = (it.height_cm, it.mass_kg);
            (it.code.clone(), Person { age_years: it.age_years, sex, height_cm, mass_kg })
        });
        self.files.insert(folder.to_owned(), people.collect());
        Ok(())
    }

    /// The files that were read.
    pub fn places(&self) -> impl Iterator<Item = PathBuf> + '_ {
        self.files.keys().map(|it| it.join(names::PARTICIPANTS))
    }

    /// What is known of the participant of the trial in this folder.
    ///
    /// # Errors
    /// When there is no such folder.
    pub fn get(&self, folder: &Path, participant: &str) -> Result<Person, BadInput> {
        let real = folder.canonicalize().map_err(|error| BadInput::io(folder.display(), &error))?;
        let file = self.given.as_deref().or_else(|| above(&real));
        let people = file.and_then(|it| self.files.get(it));
        Ok(people.and_then(|it| it.get(participant)).cloned().unwrap_or_default())
    }
}

/// The nearest folder above a trial's that has a participants' file.
fn above(folder: &Path) -> Option<&Path> {
    let mut above = folder.ancestors().skip(1).take(ABOVE);
    above.find(|it| it.join(names::PARTICIPANTS).is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entity_is_read_from_a_name_as_bids_writes_it() {
        let name = "sub-P01_ses-2_task-eyes-open_run-03";
        assert_eq!(entity(name, "ses").as_deref(), Some("2"));
        assert_eq!(entity(name, "run").as_deref(), Some("03"));
        for name in ["p01-control", "03-control-2", "ses", "ses-", "uses-2"] {
            assert_eq!((entity(name, "ses"), entity(name, "run")), (None, None), "{name}");
        }
    }

    #[test]
    fn an_option_says_what_the_folder_does_not_and_no_more() {
        let one_of = |told: Option<u32>, said: Option<u32>| one_of("run", told, &said, "t");
        assert_eq!(one_of(None, None), Ok(None));
        assert_eq!(one_of(None, Some(2)), Ok(Some(2)));
        assert_eq!(one_of(Some(2), Some(2)), Ok(Some(2)));
        let error = one_of(Some(1), Some(2)).unwrap_err().to_string();
        assert!(error.contains("t: run: the folder says 1, and --run 2"), "{error}");
    }
}
