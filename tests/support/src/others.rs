//! Programs of other people, with which tests look at what this project's programs write.

use std::env;
use std::path::PathBuf;

use crate::{Absent, skip};

/// Names the Python that has other people's packages: `cargo xtask test` installs them.
pub const PYTHON: &str = "PLUMBLINE_PYTHON";

/// That Python. `None`, with the test recorded as skipped, where nobody says where it is.
pub fn python() -> Option<PathBuf> {
    let python = env::var_os(PYTHON).map(PathBuf::from);
    if python.is_none() {
        skip(Absent::Tool, &format!("{PYTHON} does not say which Python has the packages"));
    }
    python
}

/// The browser. `None`, with the test recorded as skipped, where there is none.
pub fn chromium() -> Option<PathBuf> {
    let paths = env::var_os("PATH").unwrap_or_default();
    let mut programs = env::split_paths(&paths).map(|it| it.join("chromium"));
    let found = programs.find(|it| it.is_file());
    if found.is_none() {
        skip(Absent::Tool, "there is no chromium; `cargo xtask test` installs it");
    }
    found
}
