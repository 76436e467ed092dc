//! `study.toml`: the trials of a study, and what of them is compared.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use plumbline_trial::positions::{Columns, Table, Unit};
use serde::Deserialize;

use crate::choose::Choose;
use crate::measures::{self, Chosen};
use crate::patterns::{self, Matched};
use crate::protocol::{Physiology, PhysiologyToml};
use crate::time::SECONDS_MAX;

/// The text of a new study.
pub const EXAMPLE: &str = include_str!("study.toml");

/// A study; its paths are relative to the working directory.
#[derive(Debug, Clone)]
pub struct Study {
    /// The file it was read from.
    pub place: String,
    /// Its name.
    pub title: String,
    /// The conditions in the order of the tables; the others are compared with the first.
    pub conditions: Vec<String>,
    /// The time bins of a trial, seconds from t = 0.
    pub bins_s: Vec<Range<f64>>,
    /// Whether a participant who lacks a value is left out of that response's statistics; otherwise
    /// the study is refused.
    pub drop_incomplete: bool,
    /// Whether several trials of one participant under one condition are averaged; otherwise they
    /// are refused.
    pub average_repeats: bool,
    /// The figures that are compared, in the order of the tables.
    pub figures: Vec<Chosen>,
    /// What becomes of a trial that is unusable.
    pub unusable: Unusable,
    /// What becomes of a trial that is doubtful.
    pub doubtful: Doubtful,
    /// The physiology that was recorded, and how its values are obtained.
    pub physiology: Option<Physiology>,
    /// The trials; none where they are a cohort's.
    pub trials: Vec<Entry>,
    /// The cohort whose trials are compared.
    pub cohort: Option<PathBuf>,
    /// Which of that cohort's trials, beside their conditions.
    pub choose: Choose,
    /// Folders that a pattern matches although there is no trial in them.
    pub skipped: Vec<PathBuf>,
}

/// One trial of a study.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Where its positions are.
    pub source: Source,
    /// The participant, if the trial's own manifest lacks it or is to be overridden.
    pub participant: Option<String>,
    /// The condition, likewise.
    pub condition: Option<String>,
    /// Its physiological recordings.
    pub physiology: Option<Recordings>,
}

impl Entry {
    /// A trial that tells everything itself.
    fn of_folder(folder: PathBuf) -> Self {
        let source = Source::Trial(folder);
        Self { source, participant: None, condition: None, physiology: None }
    }

    /// Where its positions are.
    fn path(&self) -> &Path {
        match &self.source {
            Source::Trial(folder) => folder,
            Source::Table(table) => &table.path,
        }
    }
}

/// The physiological recordings of a trial.
#[derive(Debug, Clone)]
pub struct Recordings {
    /// Where the files are.
    pub folder: PathBuf,
    /// The time of t = 0 on their clock, seconds.
    pub zero_s: Option<f64>,
    /// When the person begins to rise, seconds from t = 0.
    pub transition_s: Option<f64>,
}

/// What becomes of a trial that is unusable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unusable {
    /// The study stops, and names it.
    #[default]
    Refuse,
    /// It is left out, with a warning.
    LeaveOut,
}

/// What becomes of a trial that is doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Doubtful {
    /// It takes part, with a warning.
    #[default]
    TakePart,
    /// It is left out, with a warning.
    LeaveOut,
}

/// Where a trial's positions are.
#[derive(Debug, Clone)]
pub enum Source {
    /// A trial folder written by `plumb receive`.
    Trial(PathBuf),
    /// A table from another system.
    Table(Table),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyToml {
    title: String,
    conditions: Vec<String>,
    #[serde(default = "paper_bins")]
    bins_s: Vec<[f64; 2]>,
    #[serde(default)]
    drop_incomplete: bool,
    repeats: Option<Repeats>,
    figures: Option<FiguresToml>,
    #[serde(default)]
    unusable: Unusable,
    #[serde(default)]
    doubtful: Doubtful,
    physiology: Option<PhysiologyToml>,
    #[serde(default, rename = "trials")]
    patterns: Vec<String>,
    #[serde(default, rename = "trial")]
    entries: Vec<EntryToml>,
    cohort: Option<PathBuf>,
    choose: Option<Choose>,
}

/// What becomes of several trials of one participant under one condition.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Repeats {
    Mean,
}

/// One name, such as `all`, or several.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "figures are \"all\", or a list such as [\"path length\", \"RMS AP\"]"
)]
enum FiguresToml {
    One(String),
    Several(Vec<String>),
}

impl FiguresToml {
    fn choose(&self, place: &str) -> Result<Vec<Chosen>, BadInput> {
        let words = match self {
            Self::One(word) => std::slice::from_ref(word),
            Self::Several(words) => words,
        };
        let remedy = || {
            let known = measures::known();
            format!(
                "give \"all\", or some of {known}; each may end with AP, ML, SI, APML, APSI or MLSI"
            )
        };
        let wrong = |found: String| BadInput::new(place, "figures", found, remedy());
        if words.is_empty() {
            return Err(wrong("there is none".to_owned()));
        }
        measures::choose(words.iter().map(String::as_str)).map_err(wrong)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EntryToml {
    folder: Option<PathBuf>,
    table: Option<PathBuf>,
    columns: Option<String>,
    unit: Option<String>,
    participant: Option<String>,
    condition: Option<String>,
    physiology: Option<RecordingsToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RecordingsToml {
    folder: PathBuf,
    zero_s: Option<f64>,
    transition_s: Option<f64>,
}

fn paper_bins() -> Vec<[f64; 2]> {
    vec![[0.0, 20.0], [20.0, 40.0], [40.0, 60.0]]
}

/// Reads a study; the paths in it are relative to its own directory.
///
/// # Errors
/// When it is invalid; the error names the field.
pub fn read(path: &Path) -> Result<Study, BadInput> {
    read_with(path, None)
}

/// The same of a cohort, whatever trials or cohort the study names itself.
///
/// # Errors
/// As [`read`].
pub fn read_of_cohort(path: &Path, cohort: &Path) -> Result<Study, BadInput> {
    read_with(path, Some(cohort))
}

fn read_with(path: &Path, cohort: Option<&Path>) -> Result<Study, BadInput> {
    parse(&read_text(path)?, path, cohort)
}

/// The same of the text of a study of this cohort; `path` is where it is from.
///
/// # Errors
/// When it is invalid; the error names the field.
pub fn parse_of_cohort(text: &str, path: &Path, cohort: &Path) -> Result<Study, BadInput> {
    parse(text, path, Some(cohort))
}

fn parse(text: &str, path: &Path, cohort: Option<&Path>) -> Result<Study, BadInput> {
    let place = path.display().to_string();
    let remedy = "`plumb study --new FILE` writes an example with comments";
    let mut study: StudyToml = from_toml(text, &place, remedy)?;
    let base = plumbline_files::directory_of(path);
    if cohort.is_some() {
        (study.cohort, study.patterns, study.entries) = (None, Vec::new(), Vec::new());
    }
    let cohort = cohort.map(Path::to_owned).or(study.cohort.take().map(|it| base.join(it)));
    let wrong =
        |field: &str, found: &str, remedy: &str| Err(BadInput::new(&place, field, found, remedy));
    let conditions: Vec<String> = study.conditions.iter().map(|it| it.trim().to_owned()).collect();
    if conditions.len() < 2 {
        return wrong("conditions", "fewer than two", "name at least two: a study compares them");
    }
    if conditions.iter().any(String::is_empty) {
        return wrong("conditions", "one without a name", "name each, as the trials have it");
    }
    if (1..conditions.len()).any(|at| conditions[..at].contains(&conditions[at])) {
        return wrong("conditions", "one is named twice", "name each once");
    }
    let in_order = |[from, to]: &[f64; 2]| from < to && from.abs().max(to.abs()) <= SECONDS_MAX;
    if study.bins_s.is_empty() || !study.bins_s.iter().all(in_order) {
        return wrong(
            "bins_s",
            "no bins, or one that is not in order or beyond a day",
            "give pairs of seconds, [[0, 20], [20, 40]]",
        );
    }
    if (1..study.bins_s.len()).any(|at| study.bins_s[..at].contains(&study.bins_s[at])) {
        return wrong("bins_s", "one is given twice", "give each once: times are compared");
    }
    let names_trials = !(study.entries.is_empty() && study.patterns.is_empty());
    match &cohort {
        Some(_) if names_trials => {
            return wrong(
                "cohort",
                "trials are named as well",
                "remove one of the two: a study compares a cohort's trials, or those that it names",
            );
        }
        Some(_) if study.physiology.is_some() => {
            return wrong(
                "physiology",
                "a cohort keeps no such recordings",
                "name the trials instead of the cohort, or remove the section",
            );
        }
        None if !names_trials => {
            return wrong(
                "trials",
                "there is none",
                "give a pattern, trials = [\"trials/*\"], list each in a [[trial]] of its own, or \
                 give a cohort",
            );
        }
        None if study.choose.is_some() => {
            return wrong(
                "choose",
                "it is of a cohort, and the study names its trials",
                "remove the section, or give cohort = \"...\" instead of trials",
            );
        }
        _ => {}
    }
    let choose = study.choose.unwrap_or_default();
    choose.check(&place)?;
    let physiology = study.physiology.map(|it| it.check(&place)).transpose()?;
    if let Some(at) = study.entries.iter().position(|it| it.physiology.is_some())
        && physiology.is_none()
    {
        return Err(BadInput::new(
            &place,
            format!("[[trial]] {}, physiology", at + 1),
            "its files are not described",
            "add a [physiology] section: `plumb study --new FILE` shows one",
        ));
    }
    if physiology.is_some() && study.entries.iter().all(|it| it.physiology.is_none()) {
        return wrong(
            "physiology",
            "no trial says where its recordings are",
            "add physiology = { folder = \"...\" } to each [[trial]]",
        );
    }
    let figures = study.figures.map(|it| it.choose(&place)).transpose()?;
    let entries = study.entries.into_iter().enumerate();
    let listed: Vec<(PathBuf, Entry)> = entries
        .map(|(at, it)| it.entry(base, &place, at).map(|entry| (real(entry.path()), entry)))
        .collect::<Result<_, _>>()?;
    for (at, (path, entry)) in listed.iter().enumerate() {
        if let Some(first) = listed[..at].iter().position(|(before, _)| before == path) {
            return Err(BadInput::new(
                &place,
                format!("[[trial]] {}", at + 1),
                format!("{} is also [[trial]] {}", entry.path().display(), first + 1),
                "list each trial once",
            ));
        }
    }
    let Matched { folders, skipped } = patterns::matched(&study.patterns, base, &place)?;
    Ok(Study {
        trials: with_entries(folders, listed),
        skipped,
        cohort,
        choose,
        place,
        title: study.title,
        conditions,
        bins_s: study.bins_s.into_iter().map(|[from, to]| from..to).collect(),
        drop_incomplete: study.drop_incomplete,
        average_repeats: matches!(study.repeats, Some(Repeats::Mean)),
        figures: figures.unwrap_or_else(measures::default_choice),
        unusable: study.unusable,
        doubtful: study.doubtful,
        physiology,
    })
}

/// A path without its links and detours; of what is not there, the path as it is.
fn real(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// The folders that patterns match, and the listed trials, each with its real path: where one is
/// listed as well, its entry counts.
fn with_entries(folders: Vec<PathBuf>, mut listed: Vec<(PathBuf, Entry)>) -> Vec<Entry> {
    let mut trials: Vec<Entry> = folders
        .into_iter()
        .map(|folder| {
            let matched = real(&folder);
            let at = listed.iter().position(|(path, _)| *path == matched);
            at.map_or_else(|| Entry::of_folder(folder), |at| listed.remove(at).1)
        })
        .collect();
    trials.extend(listed.into_iter().map(|(_, entry)| entry));
    trials
}

impl EntryToml {
    fn entry(self, base: &Path, place: &str, at: usize) -> Result<Entry, BadInput> {
        let name = format!("[[trial]] {}", at + 1);
        let wrong = |found: &str, remedy: &str| BadInput::new(place, &name, found, remedy);
        let source = match (self.folder, self.table) {
            (Some(_), None) if self.columns.is_some() || self.unit.is_some() => {
                return Err(wrong(
                    "columns or a unit beside a folder",
                    "leave them out: they belong to a table",
                ));
            }
            (Some(folder), None) => Source::Trial(base.join(folder)),
            (None, Some(table)) => {
                let columns = self.columns.ok_or_else(|| {
                    wrong("a table without columns", "add columns = \"time=NAME,ap=NAME,ml=NAME\"")
                })?;
                let word = self.unit.unwrap_or_default();
                Source::Table(Table {
                    path: base.join(table),
                    columns: Columns::parse(&columns).map_err(|error| wrong(&columns, &error))?,
                    unit: Unit::of_word(&word).ok_or_else(|| {
                        wrong(
                            &format!("{word:?} is not a unit of length"),
                            "write unit = \"mm\", \"cm\" or \"m\"",
                        )
                    })?,
                    delimiter: None,
                })
            }
            _ => return Err(wrong("neither a folder nor a table, or both", "give one of them")),
        };
        let physiology = self.physiology.map(|it| Recordings {
            folder: base.join(it.folder),
            zero_s: it.zero_s,
            transition_s: it.transition_s,
        });
        let (participant, condition) = (self.participant, self.condition);
        Ok(Entry { source, participant, condition, physiology })
    }
}

#[cfg(test)]
impl Study {
    /// A study of nothing yet, for tests.
    pub fn example() -> Self {
        Self {
            place: "study.toml".to_owned(),
            title: String::new(),
            conditions: Vec::new(),
            bins_s: paper_bins().into_iter().map(|[from, to]| from..to).collect(),
            drop_incomplete: false,
            unusable: Unusable::default(),
            doubtful: Doubtful::default(),
            average_repeats: false,
            figures: measures::default_choice(),
            physiology: None,
            trials: Vec::new(),
            cohort: None,
            choose: Choose::default(),
            skipped: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_example_offers_is_understood() {
        // Settings that are commented out have no space after the sign; prose has one.
        let offered = |line: &str| match line.strip_prefix('#') {
            Some(setting) if !setting.starts_with(' ') => format!("{setting}\n"),
            _ => format!("{line}\n"),
        };
        let folder = tempfile::tempdir().unwrap();
        let trial = folder.path().join("trials/p01-control");
        std::fs::create_dir_all(&trial).unwrap();
        std::fs::write(trial.join("trial.toml"), "").unwrap();
        let path = folder.path().join("study.toml");
        // A study is of trials or of a cohort.
        let (cohort, trials): (Vec<&str>, Vec<&str>) =
            EXAMPLE.split("\n\n").partition(|part| part.contains("\n#cohort = "));
        let text = |parts: &[&str]| -> String {
            parts.iter().flat_map(|part| part.lines()).map(offered).collect()
        };
        std::fs::write(&path, text(&trials)).unwrap();
        let study = read(&path).unwrap();
        assert!(study.drop_incomplete && study.average_repeats);
        let verdicts = (study.unusable, study.doubtful);
        assert_eq!(verdicts, (Unusable::LeaveOut, Doubtful::LeaveOut));
        let measures: Vec<&str> = study.figures.iter().map(|it| it.measure.name).collect();
        assert!(measures.contains(&"path length") && measures.contains(&"ellipse area"));
        // One by the pattern, whose [[trial]] is its entry; and the table.
        assert_eq!(study.trials.len(), 2);
        let recordings = study.trials[0].physiology.as_ref().unwrap();
        assert_eq!((recordings.zero_s, recordings.transition_s), (Some(132.4), Some(-4.2)));
        let physiology = study.physiology.unwrap();
        assert_eq!(physiology.signals.len(), 3);
        assert_eq!(physiology.baseline_s, Some(-45.0..-15.0));

        let settings = "title = \"t\"\nconditions = [\"a\", \"b\"]\n";
        std::fs::write(&path, format!("{settings}{}", text(&cohort))).unwrap();
        let study = read(&path).unwrap();
        assert_eq!(study.cohort, Some(folder.path().join("cohort")));
        assert_eq!(study.choose.age_years, Some([18.0, 40.0]));
        // The option takes precedence over everything that the study names.
        let named = read_of_cohort(&path, Path::new("other")).unwrap();
        assert_eq!((named.cohort, named.trials.len()), (Some("other".into()), 0));
    }

    #[test]
    fn a_study_is_of_trials_or_of_a_cohort() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("study.toml");
        let error = |more: &str| {
            let text = format!("title = \"t\"\nconditions = [\"a\", \"b\"]\n{more}");
            std::fs::write(&path, text).unwrap();
            read(&path).unwrap_err().to_string()
        };
        for (more, part) in [
            ("cohort = \"c\"\ntrials = [\"t/*\"]\n", "cohort: trials are named as well"),
            ("cohort = \"c\"\n[physiology]\nstance_s = 5\n", "physiology: a cohort keeps no"),
            ("trials = [\"t/*\"]\n[choose]\nruns = [1]\n", "choose: it is of a cohort"),
            ("cohort = \"c\"\n[choose]\nsex = [\"X\"]\n", "choose.sex: \"X\""),
            ("cohort = \"c\"\n[choose]\nage = 5\n", "unknown field `age`"),
        ] {
            let error = error(more);
            assert!(error.contains(part), "no {part}: {error}");
        }
    }
}
