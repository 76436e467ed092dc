//! A box, the desk and a browser: the real programs; only what the camera sees is rendered.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::python::python;
use plumbline_test_support::{Absent, command, is_emulated, program, root, skip};
use tempfile::TempDir;

use crate::camera::{RATE_HZ, Shown, TheBox, rendered};

/// A test that waits this long has failed.
const PATIENCE: Duration = Duration::from_secs(120);

/// The box's own name, as the page shows it.
pub const NAME: &str = "ward 3";

/// The board that is photographed, and stands where the person will stand.
const BOARD: &str =
    "\n[[target]]\nname = \"board\"\nrole = \"scene\"\ncolumns = 9\nrows = 6\npitch_mm = 20.0\n";

pub fn plumb() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumb").expect("plumb builds"))
}

/// A folder with what a box and a user have.
pub struct Stage {
    folder: TempDir,
    python: PathBuf,
    /// Where the box is heard.
    udp: SocketAddr,
    rate_hz: usize,
}

impl Stage {
    /// `None`, with the test recorded as skipped, where there is no browser, or nothing that drives
    /// it.
    pub fn new() -> Option<Self> {
        Self::at_hz(RATE_HZ)
    }

    /// The same, of a box whose camera has this rate.
    pub fn at_hz(rate_hz: usize) -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "a box in an emulator does not track 60 frames in a second");
            return None;
        }
        let paths = std::env::var_os("PATH")?;
        if !std::env::split_paths(&paths).any(|it| it.join("chromium").is_file()) {
            skip(Absent::Tool, "there is no chromium; `cargo xtask test` installs it");
            return None;
        }
        let python = python()?;
        let stage =
            Self { folder: tempfile::tempdir().unwrap(), python, udp: free_udp_port(), rate_hz };
        let settings = format!(
            "device = \"{NAME}\"\nserial_number = \"PL-0001\"\n[capture]\ndriver = \"v4l2\"\n\
             pixel_format = \"grey\"\nrate_hz = {rate_hz}.0\nexposure_us = 4000\n[links]\n\
             udp = \"{}\"\n",
            stage.udp
        );
        std::fs::write(stage.path("box.toml"), settings).unwrap();
        let pair = std::fs::read_to_string(rendered().join("person/targets.toml")).unwrap();
        std::fs::write(stage.path("targets.toml"), pair + BOARD).unwrap();
        Some(stage)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A box with its key that knows nothing of its camera.
    pub fn new_box(&self) {
        self.provision("--uncalibrated 640x480");
    }

    /// A box with its key that is calibrated and has a scene.
    pub fn ready_box(&self) {
        let person = rendered().join("person");
        let [camera, scene] = ["camera.toml", "scene.toml"].map(|it| person.join(it));
        self.provision(&format!("--camera {} --scene {}", camera.display(), scene.display()));
    }

    fn provision(&self, camera: &str) {
        let rest = "--targets targets.toml --box box.toml --new-key --out box.plb";
        let output = self.plumb(&format!("provision {camera} {rest}")).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
    }

    /// `plumb` in this folder.
    pub fn plumb(&self, arguments: &str) -> Command {
        let mut command = command(plumb());
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.env("XDG_DATA_HOME", self.path("data"));
        command
    }

    /// Starts the box.
    pub fn start_box(&self, shown: Shown) -> TheBox {
        TheBox::start(self.folder.path(), shown, self.rate_hz)
    }

    /// Starts the desk, which keeps studies in `desk`.
    pub fn desk(&self) -> Desk {
        self.desk_at(free_tcp_port())
    }

    /// The same at a port, as after a restart of the computer.
    pub fn desk_at(&self, port: u16) -> Desk {
        let said = self.path("desk.txt");
        let file = File::create(&said).unwrap();
        let mut command =
            self.plumb(&format!("desk --folder desk --port {port} --udp {}", self.udp));
        command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file);
        let mut desk = Desk { child: command.spawn().unwrap(), said, port, url: String::new() };
        desk.url = desk.address();
        desk
    }

    /// Runs a script beside this file in the browser, and answers each of its lines that asks for
    /// something. Other lines are its figures; they are printed, and returned.
    #[track_caller]
    pub fn browse(
        &self,
        script: &str,
        arguments: &[&str],
        mut ask: impl FnMut(&str) -> String,
    ) -> String {
        let mut command = Command::new(&self.python);
        command.arg(root().join("tests/desk").join(script)).args(arguments);
        command.env("PYTHONDONTWRITEBYTECODE", "1").env("PLUMBLINE_SHOTS", shots());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut answers = child.stdin.take().unwrap();
        let mut figures = String::new();
        for line in BufReader::new(child.stdout.take().unwrap()).lines() {
            let line = line.unwrap();
            if let Some(asked) = line.strip_prefix("ask ") {
                writeln!(answers, "{}", ask(asked)).unwrap();
            } else {
                println!("{line}");
                figures += &(line + "\n");
            }
        }
        assert!(child.wait().unwrap().success(), "{script}: see what it says above");
        figures
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("the box: {}", text_of(&self.path("box.txt")));
        }
    }
}

/// What a program has said, as far as it is there.
fn text_of(file: &Path) -> String {
    String::from_utf8_lossy(&std::fs::read(file).unwrap_or_default()).into_owned()
}

/// The desk, which ends with its test.
pub struct Desk {
    child: Child,
    said: PathBuf,
    pub port: u16,
    /// The address that signs a browser in.
    pub url: String,
}

impl Desk {
    /// The address that it prints.
    #[track_caller]
    fn address(&mut self) -> String {
        let give_up = Instant::now() + PATIENCE;
        loop {
            let said = self.said();
            let words = said.split_whitespace();
            if let Some(url) = words
                .map(str::to_owned)
                .find(|it| it.starts_with("http://") && it.contains("token="))
            {
                return url;
            }
            assert!(self.child.try_wait().unwrap().is_none(), "the desk has ended: {said}");
            assert!(Instant::now() < give_up, "the desk prints no address: {said}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn said(&self) -> String {
        text_of(&self.said)
    }

    /// The memory that it holds, in kilobytes.
    pub fn resident_kb(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").trim().parse().unwrap()
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            println!("{}", self.said());
        }
    }
}

/// Where pictures of the page are kept, to be looked at.
fn shots() -> impl AsRef<OsStr> {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR"));
    target.join("desk")
}

fn free_udp_port() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

fn free_tcp_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// For scripts that only watch.
pub fn nothing_is_asked(asked: &str) -> String {
    panic!("nobody can {asked}")
}
