//! A laboratory of the Lab Streaming Layer on this computer: pylsl takes the frames of `plumb`, and sends
//! markers.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use plumbline_test_support::{free_ports, python, root};
use serde_json::Value;

/// Three streams of `plumb` and one of stimuli, and the sockets of those who ask for them.
const PORTS: u16 = 12;

/// What was taken last.
const TAKEN: &str = "taken.json";

fn script() -> PathBuf {
    root().join("tests/common/lsl.py")
}

/// Ports for LSL on this computer, free at this moment: one for discovery and as many in a row as all
/// streams of a test need.
fn ports() -> (u16, u16) {
    let first = free_ports(PORTS + 1);
    (first, first + 1)
}

/// Settings of LSL by which it asks for streams at the ports of this test on this computer, and nowhere
/// else.
fn settings() -> String {
    let (discovery, base) = ports();
    format!(
        "[ports]\nMulticastPort = {discovery}\nBasePort = {base}\nPortRange = {PORTS}\nIPv6 = disable\n\
         [multicast]\nResolveScope = machine\nAddressesOverride = {{127.0.0.1}}\n\
         ListenAddress = 127.0.0.1\n\
         [lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = test-{discovery}\n[log]\nlevel = -2\n"
    )
}

/// The laboratory, which has its files in a folder.
pub struct Lab {
    python: PathBuf,
    folder: PathBuf,
    /// Variables by which `plumb` finds liblsl, and the laboratory.
    pub environment: Vec<(&'static str, OsString)>,
}

impl Lab {
    /// `None`, with the test recorded as skipped, without Python.
    #[must_use]
    pub fn new(folder: &Path) -> Option<Self> {
        let python = python()?;
        let settings_file = folder.join("lsl_api.cfg");
        std::fs::write(&settings_file, settings()).expect("there is room");
        let library = Command::new(&python).arg(script()).arg("library").output();
        let library = String::from_utf8(library.expect("Python runs").stdout).expect("a path");
        assert!(Path::new(library.trim()).exists(), "{library}");
        let environment = vec![
            ("PLUMBLINE_LIBLSL", OsString::from(library.trim())),
            ("LSLAPICFG", settings_file.into_os_string()),
        ];
        Some(Self { python, folder: folder.to_owned(), environment })
    }

    /// Begins to take the frames of `plumb`. Wishes: `record` them by LSL's own recorder too, `mark` them
    /// with stimuli.
    #[must_use]
    pub fn take(&self, wishes: &[&str]) -> Taking {
        let mut command = Command::new(&self.python);
        command.arg(script()).arg("take").arg(self.folder.join(TAKEN)).args(wishes);
        command
            .envs(self.environment.iter().cloned())
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = command.spawn().expect("Python runs");
        // It takes them from here on.
        let mut line = String::new();
        let said = BufReader::new(child.stdout.take().expect("it is piped")).read_line(&mut line);
        assert!(said.is_ok() && line.trim() == "taking", "{line}");
        Taking { child, out: self.folder.join(TAKEN) }
    }
}

/// A program that takes frames.
pub struct Taking {
    child: Child,
    out: PathBuf,
}

impl Taking {
    /// Sends a marker to whoever listens to the stream Stimuli.
    pub fn mark(&mut self, label: &str) {
        let input = self.child.stdin.as_mut().expect("it is piped");
        writeln!(input, "{label}").expect("it listens");
    }

    /// It takes no more; what it took.
    #[track_caller]
    #[must_use]
    pub fn end(mut self) -> Taken {
        drop(self.child.stdin.take());
        assert!(self.child.wait().expect("it ends").success());
        let text = std::fs::read(&self.out).expect("it has written");
        let all: Value = serde_json::from_slice(&text).expect("JSON");
        let taken = Taken { times_s: numbers(&all["times"]), all };
        assert!(taken.times_s.len() > 1, "hardly a sample has come");
        taken
    }
}

impl Drop for Taking {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a program took.
pub struct Taken {
    /// The times of the samples, by LSL's clock.
    pub times_s: Vec<f64>,
    /// All of it: `rows`, `labels`, `received`, `xml`, `marks` and `xdf`.
    pub all: Value,
}

impl Taken {
    /// The channel with this label; NaN where there is nothing.
    #[must_use]
    pub fn column(&self, label: &str) -> Vec<f64> {
        column(&self.all, "rows", label)
    }

    /// The numbers of the frames, of which none is missing.
    #[track_caller]
    #[must_use]
    pub fn frames(&self) -> Vec<f64> {
        let frames = self.column("frame");
        assert!(frames.windows(2).all(|pair| pair[1] - pair[0] == 1.0), "a frame is missing");
        frames
    }

    /// When each marker was sent, by LSL's clock.
    #[must_use]
    pub fn marks_s(&self) -> Vec<f64> {
        numbers(&self.all["marks"])
    }

    /// What the stream says of itself.
    #[must_use]
    pub fn xml(&self) -> &str {
        self.all["xml"].as_str().unwrap_or_default()
    }
}

/// A list of numbers; NaN where there is none.
#[must_use]
pub fn numbers(list: &Value) -> Vec<f64> {
    let list = list.as_array().expect("a list");
    list.iter().map(|it| it.as_f64().unwrap_or(f64::NAN)).collect()
}

/// One column of these rows.
#[must_use]
pub fn column(of: &Value, rows: &str, label: &str) -> Vec<f64> {
    let labels = of["labels"].as_array().expect("labels");
    let at = labels.iter().position(|it| it == label).expect(label);
    let rows = of[rows].as_array().expect("rows");
    rows.iter().map(|row| row[at].as_f64().unwrap_or(f64::NAN)).collect()
}
