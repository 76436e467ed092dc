//! A box and its hosts: the real programs, a rendered person, and the network between them.

use std::ffi::OsString;
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use plumbline::packet::{Deframer, Message, Packet, PosePacket, decode_datagram};
use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline_stream::transport::Raw;
use plumbline_test_support::{Absent, command, free_port, is_emulated, listens_at, program, skip};
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::{Manifest, names};
use serde_json::Value;
use tempfile::TempDir;

use crate::relay::Relay;

/// A test that waits this long has failed.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Frames of the recording, which the box's camera shows again and again.
const FRAMES: usize = 60;

/// The lens of the recording is that of a small camera: a frame costs the box little.
const SIZE_PX: (usize, usize) = (640, 480);

pub const RATE_HZ: u64 = 60;

/// Of a camera with which what the box keeps is soon full: the highest rate that there is.
pub const FAST_HZ: usize = 1_000;

/// The key of the box.
pub fn key() -> Key {
    Key::new([7; 32]).unwrap()
}

pub fn plumb() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumb").expect("plumb builds"))
}

fn board() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumbline-board").expect("the box's program builds"))
}

/// The rendered person, made once.
fn person() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let frames = FRAMES.to_string();
        let arguments = ["simulate", "--lens", "vga", "--frames", &frames, "--out", "person"];
        let done = command(plumb()).args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(done.status.success(), "{}", text(&done));
        folder
    });
    made.path()
}

/// A folder with what a box and a user have, and ports of hosts.
pub struct Bench {
    folder: TempDir,
    pub hosts: [SocketAddr; 2],
    /// Variables that `plumb` finds besides its own.
    pub environment: Vec<(&'static str, OsString)>,
}

impl Bench {
    /// `None` where the box's program cannot keep pace.
    pub fn new() -> Option<Self> {
        Self::at(Ipv4Addr::LOCALHOST)
    }

    /// With hosts that listen at this address of this computer.
    pub fn at(address: Ipv4Addr) -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "a box in an emulator does not track 60 frames in a second");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let hosts = std::array::from_fn(|_| (address, free_port()).into());
        let bench = Self { folder, hosts, environment: Vec::new() };
        bench.write(
            "box.toml",
            "device = \"ward 3\"\nserial_number = \"PL-0001\"\n[links]\nudp = \"127.0.0.1:4210\"\n",
        );
        let key_text = key().text();
        let known = format!(
            "key = \"{}\"\nname = \"ward 3\"\nserial_number = \"PL-0001\"\n\
             made = \"2026-01-01T00:00:00Z\"\n",
            key_text.as_str()
        );
        let keys = bench.path("data/plumbline/keys");
        std::fs::create_dir_all(&keys).unwrap();
        std::fs::set_permissions(&keys, std::fs::Permissions::from_mode(0o700)).unwrap();
        let file = keys.join(format!("{}.toml", key().id()));
        std::fs::write(&file, known).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        bench.write(KEY_FILE_NAME, key_text.as_str());
        bench.done(&format!("provision --box box.toml {} --out box.plb", described()));
        Some(bench)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    pub fn plumb(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    #[track_caller]
    pub fn done(&self, arguments: &str) -> String {
        let output = self.plumb(arguments);
        let text = text(&output);
        assert_eq!(output.status.code(), Some(0), "{arguments}: {text}");
        text
    }

    fn command(&self, arguments: &str) -> std::process::Command {
        let mut command = command(plumb());
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.env("XDG_DATA_HOME", self.path("data"));
        command.envs(self.environment.iter().cloned());
        command
    }

    /// Starts a program of `plumb` that listens at the port of a host, and returns once it does.
    pub fn host(&self, host: usize, arguments: &str) -> Running {
        let address = self.hosts[host];
        let mut command = self.command(&format!("{arguments} --udp {address}"));
        let said = self.path(&format!("host-{host}.txt"));
        let file = File::create(&said).unwrap();
        command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file);
        let running = Running { child: command.spawn().unwrap(), said };
        wait_for("a host that listens", || listens_at(address.port()));
        running
    }

    /// Starts `plumb receive`, which records all that the box still has.
    pub fn receive(&self, host: usize, out: &str, more: &str) -> Running {
        self.host(host, &format!("receive --anyway --past --out {out} {more}"))
    }

    /// Starts the box, which announces itself to this network, and writes down in clear what it
    /// sends. Its camera shows the person until [`TheBox::end`].
    pub fn start(&self, relay: &Relay, record: &str) -> TheBox {
        self.start_at(relay.address(), record)
    }

    /// The same, without a relay: it announces itself to this address.
    pub fn start_at(&self, host: SocketAddr, record: &str) -> TheBox {
        let mut video = Vec::new();
        let frames = person().join("person/frames.y4m");
        File::open(frames).unwrap().read_to_end(&mut video).unwrap();
        let header = video.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        self.start_with("box.plb", video, header, SIZE_PX, host, record)
    }

    /// Starts a box with a fast camera, which sees nothing.
    pub fn start_fast(&self, relay: &Relay, record: &str) -> TheBox {
        const SIZE_PX: (usize, usize) = (80, 64);
        self.write(
            "fast.toml",
            "width_px = 80\nheight_px = 64\nfx_px = 200.0\nfy_px = 200.0\ncx_px = 39.5\n\
             cy_px = 31.5\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n",
        );
        let targets = person().join("person/targets.toml").display().to_string();
        self.done(&format!(
            "provision --box box.toml --camera fast.toml --targets {targets} --out fast.plb"
        ));
        let header = format!("YUV4MPEG2 W80 H64 F{FAST_HZ}:1 Ip A1:1 Cmono\n").into_bytes();
        let frame = [b"FRAME\n".to_vec(), vec![90; SIZE_PX.0 * SIZE_PX.1]].concat();
        let length = header.len();
        let video = [header, frame].concat();
        self.start_with("fast.plb", video, length, SIZE_PX, relay.address(), record)
    }

    fn start_with(
        &self,
        config: &str,
        video: Vec<u8>,
        header: usize,
        size_px: (usize, usize),
        host: SocketAddr,
        record: &str,
    ) -> TheBox {
        let udp = host.to_string();
        let mut command = command(board());
        command.args(["--config", config, "--replay", "-", "--udp", &udp, "--record", record]);
        command.args(["--key", KEY_FILE_NAME]);
        command.current_dir(self.folder.path()).stdin(Stdio::piped());
        let said = self.path("box.txt");
        let file = File::options().create(true).append(true).open(&said).unwrap();
        command.stdout(file.try_clone().unwrap()).stderr(file);
        let mut child = command.spawn().unwrap();
        let mut camera = child.stdin.take().unwrap();
        let (stop, is_over) = std::sync::mpsc::channel::<()>();
        let feeder = std::thread::spawn(move || {
            let _ = camera.write_all(&video[..header]);
            let frames = video[header..].chunks("FRAME\n".len() + size_px.0 * size_px.1);
            for frame in frames.cycle() {
                let is_stopped = is_over.try_recv() != Err(std::sync::mpsc::TryRecvError::Empty);
                if is_stopped || camera.write_all(frame).is_err() {
                    break;
                }
            }
        });
        TheBox { running: Running { child, said }, stop: Some(stop), feeder: Some(feeder) }
    }

    /// The poses that the box has sent until now, of all of its starts, by its own record.
    pub fn sent(&self, record: &str) -> Vec<PosePacket> {
        let mut poses = Vec::new();
        let record = std::fs::read(self.path(record)).unwrap_or_default();
        Deframer::<512>::new().push(&record, |outcome| {
            poses.extend(outcome.ok().and_then(pose_of));
        });
        poses
    }

    /// The poses of a trial so far, in the order in which they were recorded: none while there is no
    /// journal, or one without its header.
    pub fn recorded(&self, trial: &str) -> Vec<PosePacket> {
        let entries = self.entries(trial).into_iter();
        let poses = entries.filter_map(|entry| match entry.content {
            Content::Raw(Raw::Datagram(bytes)) => decode_datagram(&bytes).ok().and_then(pose_of),
            _ => None,
        });
        poses.collect()
    }

    pub fn entries(&self, trial: &str) -> Vec<Entry> {
        let mut entries = Vec::new();
        if let Ok(mut reader) = Reader::open(&self.path(trial).join(names::JOURNAL)) {
            while let Ok(Some(entry)) = reader.next_entry() {
                entries.push(entry);
            }
        }
        entries
    }

    pub fn manifest(&self, trial: &str) -> Manifest {
        Manifest::read(&self.path(trial)).unwrap()
    }

    /// Waits until a trial has this many poses.
    #[track_caller]
    pub fn wait_for_poses(&self, trial: &str, count: usize) {
        wait_for("poses", || self.recorded(trial).len() >= count);
    }

    /// What `plumb analyze` makes of the first seconds of a trial: all figures, but neither its name
    /// nor the verdict, to which also belongs what came damaged.
    pub fn figures(&self, trial: &str, seconds: usize) -> Value {
        let json = format!("{trial}.json");
        let filter = "--filter paper:0.1 --zero start";
        self.done(&format!(
            "analyze {trial} --span 0-{seconds} --bins 0-{seconds} {filter} --json {json}"
        ));
        let mut figures: Value = serde_json::from_slice(&self.read(&json)).unwrap();
        assert!(figures["points"].as_array().is_some_and(|it| it.len() == 2), "{figures}");
        for other in ["source", "verdict"] {
            figures.as_object_mut().unwrap().remove(other).unwrap();
        }
        figures
    }
}

pub fn described() -> String {
    let person = person().join("person");
    let file = |name: &str| person.join(name).display().to_string();
    let [camera, targets, scene] = ["camera.toml", "targets.toml", "scene.toml"].map(file);
    format!("--camera {camera} --targets {targets} --scene {scene}")
}

fn pose_of(packet: Packet) -> Option<PosePacket> {
    match packet.message {
        Message::Pose(pose) => Some(pose),
        _ => None,
    }
}

/// A program that ends with its test.
pub struct Running {
    child: Child,
    said: PathBuf,
}

impl Running {
    /// Waits until it ends; its exit code, and what it said.
    #[track_caller]
    pub fn ends(&mut self) -> (Option<i32>, String) {
        let mut status = None;
        wait_for("the end of a program", || {
            status = self.child.try_wait().unwrap();
            status.is_some()
        });
        (status.unwrap().code(), self.said())
    }

    #[track_caller]
    pub fn succeeds(&mut self) -> String {
        let (code, said) = self.ends();
        assert_eq!(code, Some(0), "{said}");
        said
    }

    pub fn said(&self) -> String {
        String::from_utf8_lossy(&std::fs::read(&self.said).unwrap()).into_owned()
    }

    /// As Ctrl-C does.
    pub fn interrupt(&self) {
        let id = self.child.id().to_string();
        assert!(command("kill").args(["-s", "INT", &id]).status().unwrap().success());
    }

    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// The memory that it holds, in kilobytes.
    pub fn resident_kb(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").trim().parse().unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            println!("{}: {}", self.said.display(), self.said());
        }
    }
}

/// The box's program, and its camera.
pub struct TheBox {
    pub running: Running,
    stop: Option<std::sync::mpsc::Sender<()>>,
    feeder: Option<std::thread::JoinHandle<()>>,
}

impl TheBox {
    /// The camera takes its last frame; the box sends what is asked for, and ends.
    #[track_caller]
    pub fn end(&mut self) {
        drop(self.stop.take());
        self.running.succeeds();
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        drop(self.stop.take());
        let _ = self.running.child.kill();
        let feeder = self.feeder.take();
        assert!(feeder.is_some_and(|it| it.join().is_ok()) || std::thread::panicking());
    }
}

#[track_caller]
pub fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "{what}: waited in vain");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

/// Every pose that the box has sent up to the newest that was recorded is in the trial, once, in
/// its place, and as it was sent. Returns how many those are.
#[track_caller]
pub fn assert_whole(bench: &Bench, trial: &str, record: &str) -> usize {
    let recorded = sorted(bench.recorded(trial));
    let sent = bench.sent(record);
    assert!(recorded.len() <= sent.len(), "{} of {}", recorded.len(), sent.len());
    for (index, (recorded, sent)) in recorded.iter().zip(&sent).enumerate() {
        assert_eq!(recorded, sent, "pose {index} of {}", sent.sequence);
    }
    recorded.len()
}

/// What comes late is recorded late; whoever reads the trial sorts it.
pub fn sorted(mut poses: Vec<PosePacket>) -> Vec<PosePacket> {
    poses.sort_by_key(|pose| pose.sequence);
    poses
}
