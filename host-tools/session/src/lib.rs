//! Guided measurements: a participant is measured under the conditions of a protocol, one trial after
//! the other, whatever happens to the page, the computer or the box meanwhile.
//!
//! ```text
//! protocol, the participant's number ─▶ order: the plan ─▶ session: a pure state machine
//!                                                            │ after every step
//!                                                            ▼
//! folder: the study on the disk ─▶ open, stored: session.toml ─▶ study_toml: what `plumb study` reads
//! ```
//!
//! A study is a folder:
//!
//! | place | holds |
//! |---|---|
//! | `study.toml` | what `plumb study` reads: the conditions, the times, and each accepted trial |
//! | `protocol.toml` | how participants are measured: see [`protocol`] |
//! | `participants.tsv`, `participants.json` | who, by codes alone: see [`participants`] |
//! | `sessions/P01-1/session.toml` | the first session of P01: plan, recordings, what is going on |
//! | `sessions/P01-1/03-control` | the folder of its third trial, as every trial's |
//! | `sessions/P01-1/03-control-2` | the same trial once more |
//!
//! **Nothing recorded is overwritten.** A recording that is not accepted stays; its `trial.toml` says
//! so, as a verdict that a person has overruled: unusable, by whom and why. An unusable recording is
//! accepted only with a reason, and is then overruled to be doubtful: otherwise it would stop the study.
//!
//! **Who calls what.** Whoever runs a session asks [`folder::StudyFolder`] for a
//! [`open::OpenSession`], shows its [`session::State`], and gives it [`session::Event`]s: a tick
//! several times a second, what the operator does, and what comes of the recording. It begins a
//! recording when the state has become `Recording`, ends it when that has become `Judging`, and then
//! calls [`open::OpenSession::judge`]. This crate neither listens to a box nor makes a sound.

pub mod folder;
pub mod open;
pub mod order;
pub mod participants;
pub mod protocol;
pub mod session;
mod stored;
mod study_toml;
mod words;

pub use words::{check_short, check_text, of_field};

/// The names of files and folders in a study.
pub mod names {
    /// What `plumb study` reads.
    pub const STUDY: &str = "study.toml";
    /// How participants are measured.
    pub const PROTOCOL: &str = "protocol.toml";
    /// Who is measured.
    pub const PARTICIPANTS: &str = "participants.tsv";
    /// What the columns of that table are.
    pub const PARTICIPANTS_COLUMNS: &str = "participants.json";
    /// The folder with a folder for each session.
    pub const SESSIONS: &str = "sessions";
    /// A session, in its own folder.
    pub const SESSION: &str = "session.toml";
}
