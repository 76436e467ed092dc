//! A study on the disk.
//!
//! Everything is written atomically, for its owner alone. Before a shared file is changed the study's
//! folder is locked for that moment, and the folder of a session for as long as the session is open,
//! so that two programs neither undo each other's changes nor run one session.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Instant;

use plumbline_files::{BadInput, make_directory, read_text, replace};

use crate::names;
use crate::open::OpenSession;
use crate::participants::{Participant, Participants};
use crate::protocol::Protocol;
use crate::session::{Session, State};
use crate::study_toml;
use crate::words::{NAME_LETTERS_MAX, check_text, of_field};

/// A study's folder.
#[derive(Debug, Clone)]
pub struct StudyFolder {
    path: PathBuf,
}

/// A session in a study's folder.
#[derive(Debug)]
pub struct SessionSeen {
    /// The name of its folder.
    pub name: String,
    /// The session, or why it cannot be read.
    pub session: Result<Session, BadInput>,
}

impl StudyFolder {
    /// Makes a study in a folder, which may exist; a `study.toml` that is in it stays.
    ///
    /// # Errors
    /// When the title or the protocol has a fault, there is a protocol already, or the operating
    /// system refuses.
    pub fn create(path: &Path, title: &str, protocol: &Protocol) -> Result<Self, BadInput> {
        of_field("the study", "title", check_text(title, NAME_LETTERS_MAX))?;
        protocol.check("the protocol")?;
        make_directory(path)?;
        let _lock = locked(path)?;
        let at = |name| path.join(name);
        if at(names::PROTOCOL).exists() {
            return Err(BadInput::whole(
                at(names::PROTOCOL).display(),
                "exists already",
                "open this study, or give another folder",
            ));
        }
        if !at(names::STUDY).exists() {
            replace(&at(names::STUDY), study_toml::new(title, protocol).as_bytes())?;
        }
        // Last: a folder with a protocol is a study.
        protocol.write(&at(names::PROTOCOL))?;
        Ok(Self { path: path.to_owned() })
    }

    /// Opens a study.
    ///
    /// # Errors
    /// When the folder has no protocol, or one with a fault.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        let protocol = path.join(names::PROTOCOL);
        if !protocol.exists() {
            return Err(BadInput::whole(
                path.display(),
                format!("it is not the folder of a study: it has no {}", names::PROTOCOL),
                "give the folder of a study, or make one there",
            ));
        }
        Protocol::read(&protocol)?;
        Ok(Self { path: path.to_owned() })
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its protocol.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn protocol(&self) -> Result<Protocol, BadInput> {
        Protocol::read(&self.path.join(names::PROTOCOL))
    }

    /// Changes the protocol for the sessions that begin from now on; those that have begun keep
    /// theirs. The times that the study compares follow it, unless a person has chosen others.
    ///
    /// # Errors
    /// When it has a fault, or the operating system refuses.
    pub fn set_protocol(&self, protocol: &Protocol) -> Result<(), BadInput> {
        let _lock = locked(&self.path)?;
        let before = self.protocol();
        protocol.write(&self.path.join(names::PROTOCOL))?;
        let study = self.path.join(names::STUDY);
        let Some(before) = before.ok().filter(|_| study.exists()) else { return Ok(()) };
        let text = read_text(&study)?;
        let place = study.display().to_string();
        let after = study_toml::following(&text, &place, &before, protocol)?;
        if after == text { Ok(()) } else { replace(&study, after.as_bytes()) }
    }

    /// Its participants.
    ///
    /// # Errors
    /// When the table cannot be read.
    pub fn participants(&self) -> Result<Participants, BadInput> {
        Participants::read(&self.path)
    }

    /// Adds a participant, or changes what is known of one, and returns the number in the study.
    ///
    /// # Errors
    /// When something of it cannot be used, or the operating system refuses.
    pub fn set_participant(&self, participant: Participant) -> Result<u32, BadInput> {
        let _lock = locked(&self.path)?;
        let mut participants = self.participants()?;
        let number = participants.set(participant)?;
        participants.write(&self.path)?;
        Ok(number)
    }

    /// The sessions that are there, by participant and number.
    ///
    /// # Errors
    /// When the folder cannot be read. A session that cannot is listed with its error.
    pub fn sessions(&self) -> Result<Vec<SessionSeen>, BadInput> {
        let mut names = self.session_names()?;
        names.retain(|it| self.session_folder(it).join(names::SESSION).exists());
        let seen = names.into_iter().map(|name| {
            let session = Session::read(&self.session_folder(&name));
            SessionSeen { name, session }
        });
        Ok(seen.collect())
    }

    fn session_names(&self) -> Result<Vec<String>, BadInput> {
        let path = self.path.join(names::SESSIONS);
        if !path.exists() {
            return Ok(Vec::new());
        }
        let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
        let entries = std::fs::read_dir(&path).map_err(failed)?;
        let names = entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
        let mut names: Vec<String> = names.collect::<std::io::Result<_>>().map_err(failed)?;
        // P01-10 comes after P01-9.
        names.sort_by_cached_key(|it| {
            let number = it.rsplit_once('-').and_then(|(code, at)| Some((code, at.parse().ok()?)));
            number.map_or((it.clone(), 0_u32), |(code, at)| (code.to_owned(), at))
        });
        Ok(names)
    }

    pub(crate) fn session_folder(&self, name: &str) -> PathBuf {
        self.path.join(names::SESSIONS).join(name)
    }

    /// Begins a session of a participant, by the study's protocol. `operator` is whoever measures, and
    /// `started` the time of day, as RFC 3339 writes it.
    ///
    /// # Errors
    /// When the participant is not in the study, a session of the same participant is not over, a
    /// text cannot be used, or the operating system refuses.
    pub fn begin(
        &self,
        code: &str,
        operator: Option<&str>,
        started: &str,
        now: Instant,
    ) -> Result<OpenSession, BadInput> {
        let protocol = self.protocol()?;
        if let Some(operator) = operator {
            of_field("the session", "operator", check_text(operator, NAME_LETTERS_MAX))?;
        }
        of_field("the session", "started", check_text(started, NAME_LETTERS_MAX))?;
        let study_lock = locked(&self.path)?;
        let mut participants = self.participants()?;
        let Some((number, participant)) = participants.get(code) else {
            return Err(BadInput::new(
                self.path.join(names::PARTICIPANTS).display(),
                "participant_id",
                format!("there is no participant {code:?}"),
                "add the participant first",
            ));
        };
        let participant = participant.clone();
        let own = format!("{code}-");
        let taken: Vec<u32> = self
            .session_names()?
            .iter()
            .filter_map(|it| it.strip_prefix(&own)?.parse().ok())
            .collect();
        for name in taken.iter().map(|it| format!("{own}{it}")) {
            let folder = self.session_folder(&name);
            // One that cannot be read cannot be continued either.
            if Session::read(&folder).is_ok_and(|it| it.state != State::Over) {
                return Err(BadInput::whole(
                    folder.display(),
                    "this participant's session is not over",
                    "continue it, or skip what is left of it",
                ));
            }
        }
        // The number must not change any more, even if other rows come before it.
        participants.set(participant)?;
        participants.write(&self.path)?;
        let name = format!("{own}{}", taken.iter().max().map_or(1, |it| it.saturating_add(1)));
        let folder = self.session_folder(&name);
        make_directory(&folder)?;
        let lock = try_locked(&folder)?;
        let operator = operator.map(str::to_owned);
        let session =
            Session::begin(code.to_owned(), number, operator, started.to_owned(), protocol);
        session.write(&folder)?;
        drop(study_lock);
        Ok(OpenSession::of(self, name, lock, session, now))
    }

    /// Opens a session that is there. A recording that was going on when its program ended is judged,
    /// and then waits for the operator's decision.
    ///
    /// # Errors
    /// When it cannot be read, another program has it open, or the operating system refuses.
    pub fn resume(&self, name: &str, now: Instant) -> Result<OpenSession, BadInput> {
        if !self.session_names()?.iter().any(|it| it == name) {
            return Err(BadInput::whole(
                self.path.join(names::SESSIONS).display(),
                format!("there is no session {name:?}"),
                "choose one that is listed",
            ));
        }
        let folder = self.session_folder(name);
        let lock = try_locked(&folder)?;
        let session = Session::read(&folder)?;
        let mut open = OpenSession::of(self, name.to_owned(), lock, session, now);
        open.catch_up(now)?;
        Ok(open)
    }
}

/// Waits until nobody else changes the study's shared files. Without locks on the file system it goes
/// on without.
pub(crate) fn locked(folder: &Path) -> Result<Option<File>, BadInput> {
    let file = File::open(folder).map_err(|error| BadInput::io(folder.display(), &error))?;
    Ok(file.lock().is_ok().then_some(file))
}

/// As [`locked`], for as long as a session is open.
fn try_locked(folder: &Path) -> Result<Option<File>, BadInput> {
    let file = File::open(folder).map_err(|error| BadInput::io(folder.display(), &error))?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Err(BadInput::whole(
            folder.display(),
            "this session is open in another program",
            "close it there first",
        )),
        Err(TryLockError::Error(_)) => Ok(None),
    }
}
