//! The Python that has the packages of other people.

use std::path::PathBuf;

use plumbline_test_support::{Absent, skip};

/// Names it; `cargo xtask test` installs the packages.
const PYTHON: &str = "PLUMBLINE_PYTHON";

/// Where it is; `None`, with the test recorded as skipped, where nobody says so.
pub fn python() -> Option<PathBuf> {
    let python = std::env::var_os(PYTHON).map(PathBuf::from);
    if python.is_none() {
        skip(Absent::Tool, "PLUMBLINE_PYTHON does not say which Python has the packages");
    }
    python
}
