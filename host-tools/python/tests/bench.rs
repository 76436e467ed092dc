//! The package, Python, and the programs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use plumbline_test_support::{Absent, PROGRAMS, command, is_emulated, program, python, root, skip};
use tempfile::TempDir;

/// As cargo names what it builds.
const EXTENSION: &str = "lib_plumbline.so";

/// As Python looks for it.
const MODULE: &str = "_plumbline.abi3.so";

/// A folder in which `plumb` and Python work, both with the same relative paths.
pub struct Bench {
    pub folder: TempDir,
    package: TempDir,
    python: PathBuf,
}

impl Bench {
    /// `None`, with the test recorded as skipped, without Python.
    pub fn new() -> Option<Self> {
        Self::with(python()?)
    }

    /// The same with this Python.
    pub fn with(python: PathBuf) -> Option<Self> {
        if is_emulated() {
            skip(
                Absent::Emulator,
                "this computer's Python loads no extension of another processor",
            );
            return None;
        }
        let package = tempfile::tempdir().unwrap();
        let place = package.path().join("plumbline");
        fs::create_dir(&place).unwrap();
        for file in fs::read_dir(sources().join("plumbline")).unwrap() {
            let file = file.unwrap();
            if file.file_type().unwrap().is_file() {
                fs::copy(file.path(), place.join(file.file_name())).unwrap();
            }
        }
        std::os::unix::fs::symlink(extension(), place.join(MODULE)).unwrap();
        Some(Self { folder: tempfile::tempdir().unwrap(), package, python })
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What `plumb` keeps for its user.
    pub fn data(&self) -> PathBuf {
        self.path("data")
    }

    /// Runs `plumb` in the folder; what it prints.
    pub fn plumb(&self, arguments: &[&str]) -> String {
        let mut plumb = command(plumb());
        plumb.args(arguments).env("XDG_DATA_HOME", self.data());
        self.ran(plumb)
    }

    /// Python, to run a script of the tests in the folder.
    pub fn script(&self, name: &str) -> Command {
        self.python_with(&sources().join("tests").join(name))
    }

    /// Python, to run a script in the folder.
    pub fn python_with(&self, script: &Path) -> Command {
        let mut python = Command::new(&self.python);
        python.arg(script).current_dir(self.folder.path()).stdin(Stdio::null());
        python.env("PYTHONPATH", self.package.path()).env("PYTHONDONTWRITEBYTECODE", "1");
        python.env("XDG_DATA_HOME", self.data()).env("MPLBACKEND", "agg");
        python
    }

    /// Runs a command to its end in the folder; what it prints.
    pub fn ran(&self, mut command: Command) -> String {
        let output = command.current_dir(self.folder.path()).stdin(Stdio::null()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{command:?}: {said}");
        String::from_utf8(output.stdout).unwrap()
    }
}

/// The crate's directory.
pub fn sources() -> PathBuf {
    root().join("host-tools/python")
}

fn plumb() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| program("plumb").unwrap())
}

/// The extension: where the programs are built, or otherwise built here.
fn extension() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        if let Some(programs) = std::env::var_os(PROGRAMS) {
            return Path::new(&programs).join(EXTENSION);
        }
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut cargo = Command::new(cargo);
        cargo.args(["build", "--quiet", "--locked", "--package", env!("CARGO_PKG_NAME"), "--lib"]);
        cargo.arg("--message-format=json-render-diagnostics").current_dir(root());
        let output = cargo.stdin(Stdio::null()).stderr(Stdio::inherit()).output().unwrap();
        assert!(output.status.success(), "{cargo:?}");
        let messages = String::from_utf8(output.stdout).unwrap();
        let mut named = messages.split('"').filter(|it| it.ends_with(EXTENSION));
        PathBuf::from(named.next_back().expect("cargo names what it has built"))
    })
}
