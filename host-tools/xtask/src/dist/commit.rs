//! The commit that is packed: what is made has its date, and is called after it in the lists of
//! components.

use anyhow::{Context, Result};

use crate::command::Task;

/// A commit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Commit {
    /// Its identity, in hexadecimal digits.
    pub id: String,
    /// When it was made, in seconds since 1970: the date of every file in every archive.
    pub seconds: u64,
    /// The same in words: `2026-01-31T12:00:00Z`.
    pub time: String,
    /// Whether files differ from it.
    pub is_changed: bool,
}

impl Commit {
    /// The commit that is checked out.
    pub fn read() -> Result<Self> {
        let git = |arguments: &[&str]| Task::new("git").args(arguments).output();
        let log = Task::new("git")
            .env("TZ", "UTC")
            .args(["log", "-1", "--date=format-local:%Y-%m-%dT%H:%M:%SZ", "--format=%H %ct %cd"])
            .output()?;
        let mut words = log.split_whitespace();
        let id = words.next().context("git log names no commit")?;
        let seconds = words.next().context("git log gives no time")?.parse()?;
        let time = words.next().context("git log gives no date")?.to_owned();
        let is_changed = !git(&["status", "--porcelain"])?.trim().is_empty();
        Ok(Self { id: id.to_owned(), seconds, time, is_changed })
    }

    /// The date as other programs take it from `SOURCE_DATE_EPOCH`.
    pub fn epoch(&self) -> String {
        self.seconds.to_string()
    }
}
