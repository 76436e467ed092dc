//! What the desk remembers from one run to the next: which sessions go on with which boxes, the study
//! in which was worked last, and who is signed in.
//!
//! It is a file of this user's data for each folder of studies, `desk/....toml`, which nobody else can
//! read. Without it nothing is lost but that: sessions are in their studies.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use plumbline_bedside::kept;
use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// A session that goes on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Going {
    study: String,
    session: String,
}

/// Whoever is signed in: not the cookie, but its digest, and until when, UTC seconds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedIn {
    /// The digest of the cookie.
    pub digest: String,
    /// Until when.
    pub until_s: i64,
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Kept {
    #[serde(skip_serializing_if = "Option::is_none")]
    latest_study: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    signed_in: Vec<SignedIn>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    sessions: BTreeMap<String, Going>,
}

/// What the desk remembers.
#[derive(Debug)]
pub struct Memory {
    path: PathBuf,
    kept: Mutex<Kept>,
}

impl Memory {
    /// What was remembered of this folder. What cannot be read is forgotten.
    ///
    /// # Errors
    /// When this user has no home directory.
    pub fn open(folder: &Path) -> Result<Self, BadInput> {
        let digest = Sha256::digest(folder.as_os_str().as_encoded_bytes());
        let name: String = digest.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        let path = kept::folder("desk")?.join(format!("{name}.toml"));
        let text = plumbline_files::read_text(&path).ok();
        let kept = text.and_then(|text| toml::from_str(&text).ok()).unwrap_or_default();
        Ok(Self { path, kept: Mutex::new(kept) })
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes it, and writes it if it is another one then. What cannot be written is remembered until
    /// the desk ends.
    fn change(&self, change: impl FnOnce(&mut Kept)) {
        let mut kept = self.lock();
        let before = kept.clone();
        change(&mut kept);
        if *kept == before {
            return;
        }
        if let Ok(text) = toml::to_string(&*kept) {
            let folder = plumbline_files::directory_of(&self.path);
            let _ = plumbline_files::make_directory(folder)
                .and_then(|()| plumbline_files::replace(&self.path, text.as_bytes()));
        }
    }

    /// The study and the session that go on with a box.
    #[must_use]
    pub fn session_of(&self, box_id: &str) -> Option<(String, String)> {
        let kept = self.lock();
        kept.sessions.get(box_id).map(|it| (it.study.clone(), it.session.clone()))
    }

    /// A session goes on with a box.
    pub fn note_session(&self, box_id: &str, study: &str, session: &str) {
        self.change(|kept| {
            let going = Going { study: study.to_owned(), session: session.to_owned() };
            kept.sessions.insert(box_id.to_owned(), going);
            kept.latest_study = Some(study.to_owned());
        });
    }

    /// No session goes on with a box any more.
    pub fn forget_session(&self, box_id: &str) {
        self.change(|kept| {
            kept.sessions.remove(box_id);
        });
    }

    /// The study in which was worked last.
    #[must_use]
    pub fn latest_study(&self) -> Option<String> {
        self.lock().latest_study.clone()
    }

    /// The study in which is worked now.
    pub fn note_study(&self, study: &str) {
        self.change(|kept| kept.latest_study = Some(study.to_owned()));
    }

    /// Who is signed in.
    #[must_use]
    pub fn signed_in(&self) -> Vec<SignedIn> {
        self.lock().signed_in.clone()
    }

    /// Changes who is signed in.
    pub fn change_signed_in(&self, change: impl FnOnce(&mut Vec<SignedIn>)) {
        self.change(|kept| change(&mut kept.signed_in));
    }
}
