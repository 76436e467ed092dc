//! Boxes and the desk, each with what it has on its disk.

use std::ffi::OsString;
use std::fs::File;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use plumbline::packet::{Message, PosePacket, decode_datagram};
use plumbline_stream::transport::Raw;
use plumbline_test_support::{
    Absent, command, free_address, free_port, is_emulated, program, skip,
};
use plumbline_trial::journal::{Content, Reader};
use plumbline_trial::names;
use tempfile::TempDir;

use crate::camera::{RATE_HZ, rendered};

/// The board that is photographed, and stands where the person will stand.
const BOARD: &str =
    "\n[[target]]\nname = \"board\"\nrole = \"scene\"\ncolumns = 9\nrows = 6\npitch_mm = 20.0\n";

/// A test that waits this long has failed.
pub const PATIENCE: Duration = Duration::from_secs(120);

pub fn plumb() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumb").expect("plumb builds"))
}

/// A folder with what a user has, and one for each box.
pub struct Stand {
    folder: TempDir,
    /// Where the boxes are heard.
    pub udp: SocketAddr,
    /// Variables that `plumb` finds besides its own.
    pub environment: Vec<(&'static str, OsString)>,
}

impl Stand {
    /// `None`, with the test recorded as skipped, where the box's program cannot keep pace.
    pub fn new() -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "a box in an emulator does not keep its camera's pace");
            return None;
        }
        // Before anybody waits for a box.
        program("plumbline-board").expect("the box's program builds");
        let udp = free_address();
        Some(Self { folder: tempfile::tempdir().unwrap(), udp, environment: Vec::new() })
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A box with its key that is calibrated and has a scene. It is called by its serial number: PL-0003
    /// is ward 3.
    pub fn ready_box(&self, serial_number: &str) -> PathBuf {
        let person = rendered().join("person");
        let [camera, scene] = ["camera.toml", "scene.toml"].map(|it| person.join(it));
        self.a_box(
            serial_number,
            &format!("--camera {} --scene {}", camera.display(), scene.display()),
        )
    }

    fn a_box(&self, serial_number: &str, camera: &str) -> PathBuf {
        let folder = self.path(serial_number);
        std::fs::create_dir(&folder).unwrap();
        let ward = serial_number.trim_start_matches(|it: char| !it.is_ascii_digit());
        let ward: u32 = ward.parse().unwrap();
        let settings = format!(
            "device = \"ward {ward}\"\nserial_number = \"{serial_number}\"\n[capture]\n\
             driver = \"v4l2\"\npixel_format = \"grey\"\nrate_hz = {RATE_HZ}.0\n\
             exposure_us = 4000\n[links]\nudp = \"{}\"\n",
            self.udp
        );
        std::fs::write(folder.join("box.toml"), settings).unwrap();
        let pair = std::fs::read_to_string(rendered().join("person/targets.toml")).unwrap();
        std::fs::write(folder.join("targets.toml"), pair + BOARD).unwrap();
        let rest = "--targets targets.toml --box box.toml --new-key --out box.plb";
        let mut provision = self.plumb(&format!("provision {camera} {rest}"));
        let output = provision.current_dir(&folder).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        folder
    }

    /// `plumb` in this folder.
    pub fn plumb(&self, arguments: &str) -> Command {
        let mut command = command(plumb());
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.env("XDG_DATA_HOME", self.path("data"));
        command.envs(self.environment.iter().cloned());
        command
    }

    /// Starts the desk.
    pub fn desk(&self) -> Desk {
        self.desk_at(free_port())
    }

    /// The same at a port, as after a restart of the computer.
    pub fn desk_at(&self, port: u16) -> Desk {
        self.desk_with(&format!("--port {port}"))
    }

    /// The same with these options.
    pub fn desk_with(&self, options: &str) -> Desk {
        let said = self.path("desk.txt");
        let file = File::create(&said).unwrap();
        let mut command = self.plumb(&format!("desk --folder desk --udp {} {options}", self.udp));
        command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file);
        let child = command.spawn().unwrap();
        let mut desk = Desk { child, said, url: String::new() };
        desk.url = desk.address();
        desk
    }
}

/// The desk, which ends with its test.
pub struct Desk {
    child: Child,
    said: PathBuf,
    /// The address that it prints.
    pub url: String,
}

impl Desk {
    #[track_caller]
    fn address(&mut self) -> String {
        let give_up = Instant::now() + PATIENCE;
        loop {
            let said = self.said();
            if let Some((_, url)) = said.split_once("the desk: ")
                && let Some((url, _)) = url.split_once('\n')
            {
                return url.to_owned();
            }
            assert!(self.child.try_wait().unwrap().is_none(), "the desk has ended: {said}");
            assert!(Instant::now() < give_up, "the desk prints no address: {said}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn said(&self) -> String {
        text_of(&self.said)
    }

    /// The port of its address.
    pub fn port(&self) -> u16 {
        let (_, rest) = self.url.rsplit_once(':').unwrap();
        rest.split('/').next().unwrap().parse().unwrap()
    }

    /// As a power cut does.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// As Ctrl-C does; what it has said.
    #[track_caller]
    pub fn interrupt(mut self) -> String {
        let id = self.child.id().to_string();
        assert!(command("kill").args(["-s", "INT", &id]).status().unwrap().success());
        let give_up = Instant::now() + PATIENCE;
        while self.child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < give_up, "the desk does not end: {}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
        let status = self.child.wait().unwrap();
        assert!(status.success(), "{}", self.said());
        self.said()
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

/// What a program has said, as far as it is there.
pub fn text_of(file: &Path) -> String {
    String::from_utf8_lossy(&std::fs::read(file).unwrap_or_default()).into_owned()
}

/// For how long a trial was heard, by this computer's clock: a box that shares a busy computer has a
/// pace of its own.
pub fn lasted_s(trial: &Path) -> f64 {
    let mut last_ns = 0;
    each_raw(trial, |host_ns, _| last_ns = host_ns);
    1e-9 * last_ns as f64
}

/// The poses of a trial in their order, each with when it came since the trial began.
pub fn packets_of(trial: &Path) -> Vec<(u64, PosePacket)> {
    let mut packets = Vec::new();
    each_raw(trial, |host_ns, raw| {
        if let Raw::Datagram(bytes) = raw
            && let Ok(Message::Pose(pose)) = decode_datagram(&bytes).map(|it| it.message)
        {
            packets.push((host_ns, pose));
        }
    });
    packets.sort_by_key(|(_, pose)| pose.sequence);
    packets.dedup_by_key(|(_, pose)| pose.sequence);
    packets
}

/// What came from the box, and when, up to where a recording was cut off.
fn each_raw(trial: &Path, mut take: impl FnMut(u64, Raw)) {
    let mut reader = Reader::open(&trial.join(names::JOURNAL)).unwrap();
    while let Ok(Some(entry)) = reader.next_entry() {
        if let Content::Raw(raw) = entry.content {
            take(entry.host_ns, raw);
        }
    }
}
