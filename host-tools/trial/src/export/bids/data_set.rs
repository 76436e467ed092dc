//! What is in a data set on the disk, and where a recording goes in it.
//!
//! ```text
//! dataset_description.json   README   participants.tsv
//! sub-LABEL/[ses-LABEL/]sub-LABEL_[ses-LABEL_]scans.tsv
//! sub-LABEL/[ses-LABEL/]motion/sub-LABEL_[ses-LABEL_]task-LABEL_tracksys-plumbline_run-N_*
//! ```
//!
//! What others have written there stays as it is: of the files that several recordings share, only
//! the two tables get a row, with `n/a` in the columns that are not ours.

use std::path::{Path, PathBuf};

use plumbline_files::{BadInput, read_text};
use serde_json::Value;

use super::table::Table;

/// The name of the system in file names.
pub const SYSTEM: &str = "plumbline";

const DESCRIPTION: &str = "dataset_description.json";

/// The field of a recording's description that holds [`Labels::participant_code`]; ours.
pub const PARTICIPANT_CODE: &str = "ParticipantCode";

/// The standard's field that holds [`Labels::task_name`].
pub const TASK_NAME: &str = "TaskName";

/// Whose recording, and of what. Labels have letters and digits only.
#[derive(Debug, Clone)]
pub struct Labels {
    /// The participant.
    pub participant: String,
    /// The participant's code, of which the label is made.
    pub participant_code: String,
    /// The session, in studies that have several.
    pub session: Option<String>,
    /// The task.
    pub task: String,
    /// The task's name, of which the label is made.
    pub task_name: String,
}

impl Labels {
    /// `sub-LABEL`.
    pub fn subject(&self) -> String {
        format!("sub-{}", self.participant)
    }

    /// `sub-LABEL` or `sub-LABEL_ses-LABEL`.
    fn prefix(&self) -> String {
        match &self.session {
            Some(session) => format!("{}_ses-{session}", self.subject()),
            None => self.subject(),
        }
    }

    /// What the names of a recording's files have in common but for its run.
    fn stem(&self) -> String {
        format!("{}_task-{}_tracksys-{SYSTEM}", self.prefix(), self.task)
    }
}

/// A folder that is a data set, or is to be one.
pub struct DataSet<'a> {
    root: &'a Path,
    /// Whether there is nothing yet.
    pub is_new: bool,
}

impl<'a> DataSet<'a> {
    /// Looks at a folder: it must be absent, empty, or a data set of recordings.
    ///
    /// # Errors
    /// When it is something else, or cannot be read.
    pub fn at(root: &'a Path) -> Result<Self, BadInput> {
        let is_new = !root.exists() || (root.is_dir() && entries(root)?.is_empty());
        if !is_new {
            check_description(root)?;
        }
        Ok(Self { root, is_new })
    }

    /// A file at the top.
    pub fn top(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    fn subject(&self, labels: &Labels) -> PathBuf {
        self.root.join(labels.subject())
    }

    /// The folder of a session or, without sessions, of the participant.
    fn session(&self, labels: &Labels) -> PathBuf {
        let subject = self.subject(labels);
        match &labels.session {
            Some(session) => subject.join(format!("ses-{session}")),
            None => subject,
        }
    }

    /// The file with the list of a session's recordings.
    pub fn scans(&self, labels: &Labels) -> PathBuf {
        self.session(labels).join(format!("{}_scans.tsv", labels.prefix()))
    }

    /// A recording's name in that list.
    pub fn scan(labels: &Labels, run: u32) -> String {
        format!("motion/{}_run-{run}_motion.tsv", labels.stem())
    }

    /// A file of a recording.
    pub fn part(&self, labels: &Labels, run: u32, name: &str) -> PathBuf {
        self.session(labels).join("motion").join(format!("{}_run-{run}_{name}", labels.stem()))
    }

    /// The numbers of the runs that are there.
    pub fn runs(&self, labels: &Labels) -> Result<Vec<u32>, BadInput> {
        let start = format!("{}_run-", labels.stem());
        let names = entries(&self.session(labels).join("motion"))?;
        let run = |name: &String| {
            let (number, _) = name.strip_prefix(&start)?.split_once('_')?;
            number.parse::<u32>().ok()
        };
        Ok(names.iter().filter_map(run).collect())
    }

    /// Refuses a participant whose recordings are in sessions for some and not for others: which
    /// session would the others be?
    pub fn check_sessions(&self, labels: &Labels) -> Result<(), BadInput> {
        let subject = self.subject(labels);
        let names = entries(&subject)?;
        let session = names.iter().find_map(|name| name.strip_prefix("ses-"));
        let (found, remedy) = match (&labels.session, session) {
            (None, Some(there)) => (
                format!("this participant has sessions, such as {there:?}"),
                "say which session this is: --session LABEL",
            ),
            (Some(_), None) if names.iter().any(|name| !name.ends_with("_scans.tsv")) => (
                "this participant has recordings without a session".to_owned(),
                "leave --session out",
            ),
            _ => return Ok(()),
        };
        Err(BadInput::whole(subject.display(), found, remedy))
    }

    /// Refuses a participant or a task whose label is another one's there: "P-1" and "P1" have the
    /// same. Recordings that do not say what their labels are made of are taken to agree.
    pub fn check_names(&self, labels: &Labels) -> Result<(), BadInput> {
        let task = format!("_task-{}_", labels.task);
        for path in self.descriptions(labels)? {
            let Ok(about) = serde_json::from_str::<Value>(&read_text(&path)?) else { continue };
            let other = |field: &str, ours: &str| {
                let name = about[field].as_str().filter(|name| *name != ours)?;
                Some(BadInput::new(
                    path.display(),
                    field,
                    format!("this label is of {name:?} there, and the trial is of {ours:?}"),
                    "if they are the same, write it into trial.toml as it is there; otherwise give \
                     it other letters or digits",
                ))
            };
            let is_task = path.file_name().is_some_and(|it| it.to_string_lossy().contains(&task));
            let other_task = || other(TASK_NAME, &labels.task_name).filter(|_| is_task);
            if let Some(error) =
                other(PARTICIPANT_CODE, &labels.participant_code).or_else(other_task)
            {
                return Err(error);
            }
        }
        Ok(())
    }

    /// The files that describe the participant's recordings of this system, in all sessions.
    fn descriptions(&self, labels: &Labels) -> Result<Vec<PathBuf>, BadInput> {
        let subject = self.subject(labels);
        let is_session = |name: &String| name.starts_with("ses-");
        let sessions = entries(&subject)?.into_iter().filter(is_session);
        let mut paths = Vec::new();
        for folder in sessions.map(|name| subject.join(name)).chain([subject.clone()]) {
            let motion = folder.join("motion");
            let is_ours = |name: &String| {
                name.contains(&format!("_tracksys-{SYSTEM}_")) && name.ends_with("_motion.json")
            };
            paths.extend(
                entries(&motion)?.iter().filter(|it| is_ours(it)).map(|it| motion.join(it)),
            );
        }
        Ok(paths)
    }

    /// The list of participants with this one in it; none of them is taken out.
    pub fn participants(&self, labels: &Labels) -> Result<Table, BadInput> {
        let path = self.top("participants.tsv");
        let mut table = Table::read(&path, "participant_id")?;
        let is_folder = |name: &String| name.starts_with("sub-") && self.root.join(name).is_dir();
        // A list is not required: then the others are named as well.
        let others = match path.exists() {
            true => Vec::new(),
            false => entries(self.root)?.into_iter().filter(is_folder).collect(),
        };
        for subject in others.into_iter().chain([labels.subject()]) {
            if table.row(&subject).is_none() {
                table.add(&[("participant_id", &subject)]);
            }
        }
        Ok(table)
    }
}

/// The names in a directory, sorted; none where it does not exist.
fn entries(directory: &Path) -> Result<Vec<String>, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(directory.display(), &error);
    if !directory.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(directory).map_err(failed)?;
    let names = entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let mut names: Vec<String> = names.collect::<std::io::Result<_>>().map_err(failed)?;
    names.sort();
    Ok(names)
}

fn check_description(root: &Path) -> Result<(), BadInput> {
    const REMEDY: &str = "give the folder of a BIDS data set, or one that does not exist";
    let path = root.join(DESCRIPTION);
    if !path.is_file() {
        let found = format!("it is no BIDS data set: it has no {DESCRIPTION}");
        return Err(BadInput::whole(root.display(), found, REMEDY));
    }
    let wrong = |field: &str, found: String| BadInput::new(path.display(), field, found, REMEDY);
    let about: Value = serde_json::from_str(&read_text(&path)?)
        .map_err(|error| wrong("", format!("it is not JSON ({error})")))?;
    if !about["BIDSVersion"].is_string() {
        return Err(wrong("BIDSVersion", "it is missing".to_owned()));
    }
    match about["DatasetType"].as_str() {
        None | Some("raw") => Ok(()),
        Some(other) => Err(wrong(
            "DatasetType",
            format!("{other:?}, and a recording belongs into a data set of type \"raw\""),
        )),
    }
}
