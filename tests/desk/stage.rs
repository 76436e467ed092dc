//! A box, the desk and a browser: the real programs; only what the camera sees is rendered.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use plumbline::config::FILE_NAME;
use plumbline::seal::KEY_FILE_NAME;
use plumbline_test_support::{chromium, python, root};

use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::{Desk, Stand, text_of};

/// The box's serial number.
const BOX: &str = "PL-0003";

/// What a browser is shown: one box, whose name is ward 3, and the desk.
pub struct Stage {
    stand: Stand,
    python: PathBuf,
    the_box: PathBuf,
}

impl Stage {
    /// With a box that is calibrated and has a scene. `None`, with the test recorded as skipped, where
    /// there is no browser, or nothing that drives it.
    pub fn new() -> Option<Self> {
        Self::of(|stand| stand.ready_box(BOX))
    }

    /// Without any box: one is made on the page, and gets its card.
    pub fn without_box() -> Option<Self> {
        Self::of(|stand| {
            let folder = stand.path(BOX);
            std::fs::create_dir(&folder).unwrap();
            folder
        })
    }

    /// Puts a card with the files of this folder into the box.
    pub fn put_in(&self, card: &Path) {
        for (name, kept) in [(FILE_NAME, "box.plb"), (KEY_FILE_NAME, KEY_FILE_NAME)] {
            std::fs::copy(card.join(name), self.the_box.join(kept)).unwrap();
        }
    }

    fn of(a_box: impl FnOnce(&Stand) -> PathBuf) -> Option<Self> {
        let stand = Stand::new()?;
        chromium()?;
        let python = python()?;
        let the_box = a_box(&stand);
        Some(Self { stand, python, the_box })
    }

    /// In the folder where the desk keeps studies.
    pub fn path(&self, name: &str) -> PathBuf {
        self.stand.path("desk").join(name)
    }

    /// Starts the box.
    pub fn start_box(&self, shown: Shown) -> TheBox {
        TheBox::start(&self.the_box, shown, RATE_HZ)
    }

    /// The same with another rate of its camera.
    pub fn start_box_at(&self, shown: Shown, rate_hz: usize) -> TheBox {
        TheBox::start(&self.the_box, shown, rate_hz)
    }

    /// Starts the desk.
    pub fn desk(&self) -> Desk {
        self.stand.desk()
    }

    /// The same at a port, as after a restart of the computer.
    pub fn desk_at(&self, port: u16) -> Desk {
        self.stand.desk_at(port)
    }

    /// Runs a script beside this file in the browser, and answers each of its lines that asks for
    /// something. A line may say why the script fails: that is in the panic, too. Other lines are its
    /// figures; they are printed, and returned.
    #[track_caller]
    pub fn browse(
        &self,
        script: &str,
        arguments: &[&str],
        mut ask: impl FnMut(&str) -> String,
    ) -> String {
        let mut command = Command::new(&self.python);
        command.arg(root().join("tests/desk").join(script)).args(arguments);
        command.env("PYTHONDONTWRITEBYTECODE", "1").env("PLUMBLINE_PICTURES", pictures());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut answers = child.stdin.take().unwrap();
        let (mut figures, mut failure) = (String::new(), "see what it says above".to_owned());
        for line in BufReader::new(child.stdout.take().unwrap()).lines() {
            let line = line.unwrap();
            if let Some(asked) = line.strip_prefix("ask ") {
                writeln!(answers, "{}", ask(asked)).unwrap();
            } else if let Some(how) = line.strip_prefix("failed ") {
                failure = how.to_owned();
            } else {
                println!("{line}");
                figures += &(line + "\n");
            }
        }
        assert!(child.wait().unwrap().success(), "{script}: {failure}");
        figures
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("the box: {}", text_of(&self.the_box.join("box.txt")));
        }
    }
}

/// Where pictures of the page are kept.
fn pictures() -> impl AsRef<OsStr> {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR"));
    target.join("desk")
}

/// For scripts that only watch.
pub fn nothing_is_asked(asked: &str) -> String {
    panic!("nobody can {asked}")
}
