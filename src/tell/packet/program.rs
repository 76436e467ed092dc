//! Which program a box runs: its version, and the commit that it was built from.

use crate::limits::DEVICE_TEXT_BYTES_MAX;

/// The text by which a program says which one it is, put together when it is compiled.
///
/// | text | built |
/// |---|---|
/// | `0.1.0+1a2b3c4d` | from this commit |
/// | `0.1.0+1a2b3c4d.changed` | from this commit, in a checkout with other changes |
/// | `0.1.0+dev` | without being told from which commit: while the program is developed |
///
/// Use [`program_version!`](crate::program_version), which fills it in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProgramVersion {
    bytes: [u8; DEVICE_TEXT_BYTES_MAX],
    length: usize,
}

impl ProgramVersion {
    /// The text for a version and, unless it is unknown or empty, a commit.
    ///
    /// # Panics
    /// When both together are longer than [`Hello::firmware`](super::Hello::firmware): in a constant,
    /// the program does not compile.
    #[must_use]
    pub const fn new(version: &str, commit: Option<&str>) -> Self {
        let commit = match commit {
            Some(commit) if !commit.is_empty() => commit,
            _ => "dev",
        };
        let mut text = Self { bytes: [0; DEVICE_TEXT_BYTES_MAX], length: 0 };
        text.push(version);
        text.push("+");
        text.push(commit);
        text
    }

    const fn push(&mut self, more: &str) {
        let more = more.as_bytes();
        assert!(
            self.length + more.len() <= DEVICE_TEXT_BYTES_MAX,
            "the version and PLUMBLINE_COMMIT together are longer than a Hello has room for"
        );
        let mut index = 0;
        while index < more.len() {
            self.bytes[self.length] = more[index];
            self.length += 1;
            index += 1;
        }
    }

    /// The text.
    #[must_use]
    pub const fn as_str(&self) -> &str {
        match core::str::from_utf8(self.bytes.split_at(self.length).0) {
            Ok(text) => text,
            Err(_) => unreachable!(),
        }
    }
}

/// Which program the crate is that says this: a constant `&'static str`, see
/// [`ProgramVersion`](crate::packet::ProgramVersion).
///
/// The version is that of the crate. The commit is the environment variable `PLUMBLINE_COMMIT` of the
/// build, which `cargo xtask image` and `cargo xtask dist` set: when it changes, only the crates that say
/// this are compiled again, and where it is not set, nothing is for the sake of a new commit.
#[macro_export]
macro_rules! program_version {
    () => {{
        const VERSION: $crate::packet::ProgramVersion = $crate::packet::ProgramVersion::new(
            ::core::env!("CARGO_PKG_VERSION"),
            ::core::option_env!("PLUMBLINE_COMMIT"),
        );
        const TEXT: &str = VERSION.as_str();
        TEXT
    }};
}
