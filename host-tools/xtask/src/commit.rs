//! The commit that is packed: what is made has its date, programs say that they are of it, and the lists
//! of components are called after it.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::command::Task;
use crate::debian;

/// The variable from which programs know, when they are compiled, which commit they are of; see the
/// core's `program_version!`.
pub const VARIABLE: &str = "PLUMBLINE_COMMIT";

/// Digits of a commit in a program's version: there is room for no more in a packet, and git finds a
/// commit by them.
const DIGITS: usize = 8;

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
        Self::read_but(&[])
    }

    /// Likewise, whatever has become of these files, which have no part in what is made or tried.
    pub fn read_but(files: &[&str]) -> Result<Self> {
        let git = |arguments: &[&str]| Task::new("git").args(arguments);
        let log =
            git(&["log", "-1", "--date=format-local:%Y-%m-%dT%H:%M:%SZ", "--format=%H %ct %cd"])
                .env("TZ", "UTC")
                .output()?;
        let mut words = log.split_whitespace();
        let id = words.next().context("git log names no commit")?;
        let seconds = words.next().context("git log gives no time")?.parse()?;
        let time = words.next().context("git log gives no date")?.to_owned();
        let others = files.iter().map(|file| format!(":(top,exclude){file}"));
        let status = git(&["status", "--porcelain", "--", ":(top)"]).args(others).output()?;
        let is_changed = !status.trim().is_empty();
        Ok(Self { id: id.to_owned(), seconds, time, is_changed })
    }

    /// What programs say of it after their version: `1a2b3c4d`, or `1a2b3c4d.changed`.
    pub fn mark(&self) -> String {
        let digits = &self.id[..DIGITS.min(self.id.len())];
        format!("{digits}{}", if self.is_changed { ".changed" } else { "" })
    }

    /// An error unless a program that was built with this commit's mark has it in its bytes.
    pub fn ensure_said_by(&self, program: &Path) -> Result<()> {
        let text = format!("{}+{}", debian::VERSION, self.mark());
        let bytes = fs::read(program).with_context(|| program.display().to_string())?;
        let is_there = bytes.windows(text.len()).any(|window| window == text.as_bytes());
        ensure!(is_there, "{}: it does not say that it is {text}", program.display());
        Ok(())
    }

    /// The date as other programs take it from `SOURCE_DATE_EPOCH`.
    pub fn epoch(&self) -> String {
        self.seconds.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_names_its_commit_and_whether_files_differ_from_it() {
        let id = "1a2b3c4d5e6f708192a3b4c5d6e7f8091a2b3c4d".to_owned();
        let commit = Commit { id, seconds: 0, time: String::new(), is_changed: false };
        assert_eq!(commit.mark(), "1a2b3c4d");
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("program");
        let own = format!("{}+1a2b3c4d", debian::VERSION);
        fs::write(&program, format!("\0version {own}\0")).unwrap();
        commit.ensure_said_by(&program).unwrap();
        let changed = Commit { is_changed: true, ..commit };
        assert_eq!(changed.mark(), "1a2b3c4d.changed");
        let error = changed.ensure_said_by(&program).unwrap_err().to_string();
        assert!(error.contains(&format!("{own}.changed")), "{error}");
    }
}
