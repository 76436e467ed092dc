//! The session that goes on: each step is on the disk before anybody sees it, and what it leads to
//! is written after it.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use plumbline_files::{BadInput, read_text, replace};
use plumbline_trial::derived::{Changes, remake};
use plumbline_trial::manifest::{Manifest, State as TrialState, Zero};
use plumbline_trial::verdict::Grade;
use plumbline_trial::{Trial, names as trial_names};

use crate::folder::{StudyFolder, locked};
use crate::names;
use crate::protocol::Protocol;
use crate::session::{Attempt, Ended, Event, Judged, Outcome, Refused, Session, State};
use crate::study_toml;

/// Why an event has changed nothing.
#[derive(Debug)]
pub enum Failed {
    /// It is not possible now.
    Refused(Refused),
    /// The session could not be written.
    Input(BadInput),
}

impl std::fmt::Display for Failed {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Refused(it) => it.fmt(formatter),
            Self::Input(it) => it.fmt(formatter),
        }
    }
}

impl std::error::Error for Failed {}

/// A session that goes on. What it shows is on the disk.
#[derive(Debug)]
pub struct OpenSession {
    study: StudyFolder,
    name: String,
    session: Session,
    /// An instant, and the session's time then.
    clock_from: (Instant, u64),
    warnings: Vec<String>,
    /// Locked as long as this is open, where the file system can.
    _lock: Option<File>,
}

impl OpenSession {
    /// A session whose folder is locked. Whatever a crash has kept from being written of its study is
    /// written now.
    pub(crate) fn of(
        study: &StudyFolder,
        name: String,
        lock: Option<File>,
        session: Session,
        now: Instant,
    ) -> Self {
        let mut open = Self {
            study: study.clone(),
            clock_from: (now, session.at_ms),
            name,
            session,
            warnings: Vec::new(),
            _lock: lock,
        };
        open.settle();
        open
    }

    /// Its program had ended: a recording that was going on is judged.
    pub(crate) fn catch_up(&mut self, now: Instant) -> Result<(), BadInput> {
        // Possible in every state.
        if let Err(Failed::Input(error)) = self.take(&Event::Interrupted, now) {
            return Err(error);
        }
        if let Err(error) = self.judge(now) {
            self.warnings.push(error.to_string());
        }
        Ok(())
    }

    /// The session.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The name of its folder.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        self.study.session_folder(&self.name)
    }

    /// What a user should know: that `study.toml` or a recording's `trial.toml` could not be
    /// brought up to date, which the next decision tries again, or that the study compares
    /// other times than the protocol.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The time of the session's clock.
    #[must_use]
    pub fn now_ms(&self, now: Instant) -> u64 {
        let (from, at_ms) = self.clock_from;
        let since = now.saturating_duration_since(from).as_millis();
        at_ms.saturating_add(u64::try_from(since).unwrap_or(u64::MAX))
    }

    /// The folder of the recording that is going on or waits for a decision.
    #[must_use]
    pub fn recording_folder(&self) -> Option<PathBuf> {
        self.session.attempt().map(|it| self.folder().join(&it.folder))
    }

    /// The manifest with which the recording that is going on begins; `started` is the time of day,
    /// as RFC 3339 writes it.
    #[must_use]
    pub fn manifest(&self, started: &str) -> Option<Manifest> {
        let attempt = self.session.attempt()?;
        let planned = self.session.plan.get(attempt.place - 1)?;
        let operator = self.session.operator.as_ref();
        let by = operator.map_or(String::new(), |it| format!(", operator {it}"));
        let note = format!(
            "session {}, trial {} of {}, repeat {}{by}",
            self.name,
            attempt.place,
            self.session.plan.len(),
            planned.repeat
        );
        Some(Manifest::begin(
            started.to_owned(),
            Some(self.session.participant.clone()),
            Some(planned.condition.clone()),
            Some(note),
            self.session.protocol.zero,
        ))
    }

    /// Lets an event happen: the session is stored, then what the step leads to is written: the
    /// accepted trial into `study.toml`, and into `trial.toml` what the operator has decided against
    /// the verdict. What of this fails is a [warning](Self::warnings).
    ///
    /// # Errors
    /// When the event is not possible now, or the session cannot be written; then nothing has
    /// changed.
    pub fn take(&mut self, event: &Event, now: Instant) -> Result<&Session, Failed> {
        let next = self.session.next(event, self.now_ms(now)).map_err(Failed::Refused)?;
        if next != self.session {
            next.write(&self.folder()).map_err(Failed::Input)?;
            let decided =
                |it: &Session| it.attempts.iter().filter(|it| it.outcome != Outcome::Open).count();
            let is_decision = decided(&next) != decided(&self.session);
            self.session = next;
            if is_decision {
                self.settle();
            }
        }
        Ok(&self.session)
    }

    /// Judges the recording that has ended, if one waits for its verdict. Its packets are read from
    /// the disk; of one that was not ended properly, `trial.toml` and the tables are made first.
    ///
    /// # Errors
    /// When the recording cannot be read, or the session cannot be written. It still waits then:
    /// correct the fault and judge it again, or give it up with [`Event::Nothing`].
    pub fn judge(&mut self, now: Instant) -> Result<&Session, BadInput> {
        if let State::Judging { ended, .. } = &self.session.state
            && let Some(folder) = self.recording_folder()
        {
            let event = judged(&folder, ended, &self.session.protocol)?;
            // A verdict belongs to this state.
            if let Err(Failed::Input(error)) = self.take(&event, now) {
                return Err(error);
            }
        }
        Ok(&self.session)
    }

    /// Makes the study's files agree with the session: whatever a crash has kept from being written
    /// is written now.
    fn settle(&mut self) {
        self.warnings = self.update_study().unwrap_or_else(|error| vec![error.to_string()]);
        for attempt in &self.session.attempts {
            if let Err(error) = self.tell(attempt) {
                self.warnings.push(error.to_string());
            }
        }
    }

    fn update_study(&self) -> Result<Vec<String>, BadInput> {
        let accepted = self.session.attempts.iter().filter(|it| it.outcome.is_accepted());
        // Relative, so that the study can be moved.
        let folder = |it: &Attempt| Path::new(names::SESSIONS).join(&self.name).join(&it.folder);
        let folders: Vec<PathBuf> = accepted.map(folder).collect();
        if folders.is_empty() {
            return Ok(Vec::new());
        }
        let study = self.study.path();
        let _lock = locked(study)?;
        let path = study.join(names::STUDY);
        let protocol = &self.session.protocol;
        let text = match path.exists() {
            true => read_text(&path)?,
            false => study_toml::new(&protocol.name, protocol),
        };
        let place = path.display().to_string();
        let (after, warnings) = study_toml::updated(&text, study, &place, protocol, &folders)?;
        if after != text || !path.exists() {
            replace(&path, after.as_bytes())?;
        }
        Ok(warnings)
    }

    /// Writes into a recording's `trial.toml` what the operator has decided against its verdict: one
    /// that was rejected is unusable, and an unusable one that was accepted is doubtful. One without
    /// that file was never a trial.
    fn tell(&self, attempt: &Attempt) -> Result<(), BadInput> {
        let (overruled, why) = match &attempt.outcome {
            Outcome::Rejected { why } => (Grade::Unusable, format!("not accepted: {why}")),
            Outcome::Accepted { why: Some(why) } => (Grade::Doubtful, format!("accepted: {why}")),
            _ => return Ok(()),
        };
        let folder = self.folder().join(&attempt.folder);
        if !folder.join(trial_names::MANIFEST).exists() {
            return Ok(());
        }
        let mut manifest = Manifest::read(&folder)?;
        let mut verdict = manifest.verdict();
        let is_told = match overruled {
            Grade::Unusable => verdict.overruled == Some(Grade::Unusable),
            _ => verdict.overruled.is_some() || verdict.is != Grade::Unusable,
        };
        if is_told {
            return Ok(());
        }
        verdict.overruled = Some(overruled);
        let operator = self.session.operator.as_deref().unwrap_or("the operator");
        verdict.by = Some(operator.to_owned());
        verdict.why = Some(format!("session {}, {why}", self.name));
        manifest.verdict = Some(verdict);
        manifest.write(&folder)
    }
}

/// What a recording on the disk is worth, as an event.
fn judged(folder: &Path, ended: &Ended, protocol: &Protocol) -> Result<Event, BadInput> {
    if !folder.join(trial_names::JOURNAL).exists() {
        let why = match ended {
            Ended::Lost(why) => why.clone(),
            _ => "no frame came".to_owned(),
        };
        return Ok(Event::Nothing(why));
    }
    let trial = read(folder)?;
    if trial.frames.is_empty() {
        return Ok(Event::Nothing("no frame came".to_owned()));
    }
    Ok(Event::Judged(worth(&trial, protocol)))
}

/// Reads a trial. Where the program had ended before it had written all that the end of a recording
/// writes, this is made first.
fn read(folder: &Path) -> Result<Trial, BadInput> {
    let is_written = |it: &Manifest| it.state == TrialState::Finished && it.verdict.is_some();
    match Manifest::read(folder) {
        Ok(manifest) if is_written(&manifest) => Trial::open(folder),
        _ => remake(folder, &Changes::default()),
    }
}

/// What a trial is worth to a session of this protocol.
#[must_use]
pub fn worth(trial: &Trial, protocol: &Protocol) -> Judged {
    let label = trial.manifest.zero_mark().map(|it| it.label.as_str());
    let is_zeroed = match protocol.zero_mark() {
        // If the protocol's mark has another name than zero, the first is meant, whatever its name.
        Some(wanted) if wanted.eq_ignore_ascii_case("zero") => {
            label.is_some_and(|it| it.eq_ignore_ascii_case(wanted))
        }
        Some(_) => label.is_some(),
        None => protocol.zero != Zero::Mark,
    };
    Judged { grade: trial.manifest.verdict().grade(), is_zeroed }
}
