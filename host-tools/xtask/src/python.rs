//! Python packages that some tasks use. They are installed in the target directory, so the system is
//! not changed and `cargo clean` removes them.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result};
use plumbline_test_support::PYTHON;

use crate::command::{Task, root, target_directory};

/// The time limit for installing packages: on some networks the download hangs.
const INSTALLED_WITHIN: Duration = Duration::from_secs(900);

/// Packages with pinned versions, in a directory of their own.
#[derive(Debug, Clone, Copy)]
pub struct Packages {
    /// The list of them, relative to the root of the checkout.
    pub requirements: &'static str,
    /// The directory's name below the target directory.
    pub place: &'static str,
    /// The variable that tells tests where the packages' Python is, if there are such tests.
    pub variable: Option<&'static str>,
}

/// Other people's readers of what the programs write: a second opinion in the tests.
pub const READERS: Packages = Packages {
    requirements: "host-tools/plumb/tests/export/requirements.txt",
    place: "python",
    variable: Some(PYTHON),
};

/// Apache Spark, which is large.
pub const SPARK: Packages = Packages {
    requirements: "host-tools/python/tests/spark/requirements.txt",
    place: "spark",
    variable: Some("PLUMBLINE_SPARK"),
};

impl Packages {
    /// Installs what is missing. What is present is used as it is, without the network.
    pub fn prepare(&self) -> Result<()> {
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
            // Most of what is installed is never imported; what is, Python compiles then.
            .args(["--no-compile"])
            // Spark, whose programs are Java's, is published without a wheel.
            .args(["--only-binary", ":all:", "--no-binary", "pyspark"])
            .args(["--requirement", self.requirements])
            .run_within(INSTALLED_WITHIN)?;
        fs::write(&installed, wanted).with_context(|| installed.display().to_string())
    }

    /// The Python interpreter.
    pub fn program(&self) -> PathBuf {
        self.programs().join("python")
    }

    /// The directory of the packages' programs.
    pub fn programs(&self) -> PathBuf {
        self.place().join("bin")
    }

    /// Tells tests where it is.
    pub fn tells(&self, task: Task) -> Task {
        match self.variable {
            Some(variable) => task.env(variable, &self.program().to_string_lossy()),
            None => task,
        }
    }

    fn place(&self) -> PathBuf {
        target_directory().join(self.place)
    }
}
