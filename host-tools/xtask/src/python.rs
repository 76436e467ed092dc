//! Python with the packages that some tests need: other people's readers as a second opinion, and
//! Apache Spark. They are installed in the target directory, so the system is not changed and
//! `cargo clean` removes them.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::command::{Task, root, target_directory};

/// The time limit for installing packages: on some networks the download hangs.
const INSTALLED_WITHIN: Duration = Duration::from_secs(900);

/// A Python with packages of its own.
#[derive(Debug, Clone, Copy)]
pub struct Environment {
    /// The variable that tells tests which Python it is.
    pub variable: &'static str,
    /// Its folder in the target directory.
    folder: &'static str,
    /// The packages, with pinned versions.
    requirements: &'static str,
}

/// Readers of the files by other people.
pub const READERS: Environment = Environment {
    variable: "PLUMBLINE_PYTHON",
    folder: "python",
    requirements: "host-tools/plumb/tests/export/requirements.txt",
};

/// Apache Spark, which is large.
pub const SPARK: Environment = Environment {
    variable: "PLUMBLINE_SPARK",
    folder: "spark",
    requirements: "host-tools/python/tests/spark/requirements.txt",
};

impl Environment {
    /// Installs what is missing. What is present is used as it is, without the network.
    pub fn prepare(self) -> Result<()> {
        let wanted = fs::read(root().join(self.requirements)).context(self.requirements)?;
        let place = self.place();
        // Written last, so that an interrupted installation starts again.
        let installed = place.join("requirements.txt");
        if fs::read(&installed).is_ok_and(|there| there == wanted) {
            return Ok(());
        }
        Task::new("python3").args(["-m", "venv", "--clear"]).args([&place]).run()?;
        Task::new(self.program())
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
            // Spark, whose programs are Java's, is published without a wheel.
            .args(["--only-binary", ":all:", "--no-binary", "pyspark"])
            .args(["--requirement", self.requirements])
            .run_within(INSTALLED_WITHIN)?;
        fs::write(&installed, wanted).with_context(|| installed.display().to_string())
    }

    /// The Python interpreter.
    pub fn program(self) -> PathBuf {
        self.place().join("bin/python")
    }

    fn place(self) -> PathBuf {
        target_directory().join(self.folder)
    }
}
