//! Python with the packages that some tests use as a second opinion. They are installed in the
//! target directory, so the system is not changed and `cargo clean` removes them.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::command::{Task, root, target_directory};

/// The variable that tells tests which Python has the packages.
pub const VARIABLE: &str = "PLUMBLINE_PYTHON";

/// The packages, with pinned versions.
const REQUIREMENTS: &str = "host-tools/plumb/tests/export/requirements.txt";

/// The time limit for installing the packages: on some networks the download hangs.
const INSTALLED_WITHIN: Duration = Duration::from_secs(600);

/// Installs what is missing. What is present is used as it is, without the network.
pub fn prepare() -> Result<()> {
    let wanted = fs::read(root().join(REQUIREMENTS)).context(REQUIREMENTS)?;
    let place = place();
    // Written last, so that an interrupted installation starts again.
    let installed = place.join("requirements.txt");
    if fs::read(&installed).is_ok_and(|there| there == wanted) {
        return Ok(());
    }
    Task::new("python3").args(["-m", "venv", "--clear"]).args([&place]).run()?;
    Task::new(program())
        .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
        .args(["--only-binary", ":all:", "--requirement", REQUIREMENTS])
        .run_within(INSTALLED_WITHIN)?;
    fs::write(&installed, wanted).with_context(|| installed.display().to_string())
}

/// The Python interpreter.
pub fn program() -> PathBuf {
    place().join("bin/python")
}

fn place() -> PathBuf {
    target_directory().join("python")
}
