//! The real program, its inputs, a host that listens to it, and bounded waits.

mod host;
pub mod pictures;

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use plumbline::config::{
    Capture, CaptureDriver, Config, Links, Machine, PixelFormat, TargetConfig,
};
use plumbline::lens::{Distortion, Lens};
use plumbline::packet::{Deframer, Message, Packet, PosePacket, Start};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_test_support::command;
use tempfile::TempDir;

pub use host::{Host, STREAM, key};

/// A test that waits this long has failed.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The recordings here show nothing: links and timing do not depend on targets.
pub const SIZE_PX: (u16, u16) = (80, 64);

pub fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

pub fn config() -> Config {
    let target = |name: &str, columns, rows, role| TargetConfig {
        name: name.try_into().unwrap(),
        geometry: TargetGeometry::checker(columns, rows, 12.0, Origin::Center, role, [0.0; 3])
            .unwrap(),
    };
    Config {
        device: "bench".try_into().unwrap(),
        serial_number: "7".try_into().unwrap(),
        lens: Lens {
            width_px: SIZE_PX.0,
            height_px: SIZE_PX.1,
            fx_px: 200.0,
            fy_px: 200.0,
            cx_px: 39.5,
            cy_px: 31.5,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        },
        readout_ns: 0,
        targets: [target("lumbar", 6, 5, Role::Lower), target("shoulder", 5, 4, Role::Upper)]
            .into_iter()
            .collect(),
        cam_from_scene_theta: Some([0.0, 0.0, 0.0, 0.0, 0.0, 1000.0]),
        links: Links::default(),
        capture: None,
        machine: Machine::default(),
        trigger: None,
    }
}

/// What a box can run with by itself.
pub fn config_with_camera() -> Config {
    let capture = Capture {
        driver: CaptureDriver::V4l2,
        device: heapless::String::new(),
        pixel_format: PixelFormat::Grey,
        rate_hz: 60.0,
        exposure_us: None,
        gain: None,
    };
    let links = Links { udp: Some("127.0.0.1:4210".parse().unwrap()), serial: None };
    Config { capture: Some(capture), links, ..config() }
}

pub fn write_config(folder: &TempDir, config: &Config) -> PathBuf {
    let mut blob = vec![0; plumbline::config::BLOB_BYTES_MAX];
    let path = folder.path().join("box.plb");
    std::fs::write(&path, config.encode(&mut blob).unwrap()).unwrap();
    path
}

/// Gives the box with this configuration the key of the hosts here.
pub fn write_key(config: &Path) {
    std::fs::write(config.with_file_name("box.key"), key().text().as_str()).unwrap();
}

/// Y4M bytes of `frames` grey frames at 100 Hz.
pub fn recording(frames: usize) -> Vec<u8> {
    let (width, height) = (usize::from(SIZE_PX.0), usize::from(SIZE_PX.1));
    let mut bytes = Vec::new();
    let mut encoder = y4m::encode(width, height, y4m::Ratio::new(100, 1))
        .with_colorspace(y4m::Colorspace::Cmono)
        .write_header(&mut bytes)
        .unwrap();
    let luma = vec![90; width * height];
    for _ in 0..frames {
        encoder.write_frame(&y4m::Frame::new([&luma, &[], &[]], None)).unwrap();
    }
    bytes
}

pub fn write_recording(folder: &TempDir, frames: usize) -> PathBuf {
    let path = folder.path().join("trial.y4m");
    std::fs::write(&path, recording(frames)).unwrap();
    path
}

/// The program under test; killed when the test leaves it behind.
pub struct Board {
    pub child: Child,
}

pub struct Finished {
    pub status: ExitStatus,
    pub stdout: String,
    pub stderr: String,
}

impl Board {
    pub fn start(config: &Path, arguments: &[&str]) -> Self {
        let child = command(env!("CARGO_BIN_EXE_plumbline-board"))
            .arg("--config")
            .arg(config)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        Self { child }
    }

    /// A box with the key of the hosts here, whose camera the test plays by [`Self::feed`].
    pub fn start_fed(config: &Path, arguments: &[&str]) -> Self {
        write_key(config);
        let mut board = Self::start(config, &[&["--replay", "-", "--unpaced"], arguments].concat());
        board.write(&recording(0));
        board
    }

    fn write(&mut self, bytes: &[u8]) {
        self.child.stdin.as_mut().expect("an open camera").write_all(bytes).unwrap();
    }

    /// The camera takes this number of frames.
    pub fn feed(&mut self, frames: usize) {
        self.write(&recording(frames)[recording(0).len()..]);
    }

    /// The camera has taken its last frame.
    pub fn end_feed(&mut self) {
        drop(self.child.stdin.take());
    }

    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &id]).status().unwrap().success());
    }

    pub fn wait(mut self) -> Finished {
        let give_up = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < give_up, "the program never ended");
            std::thread::sleep(Duration::from_millis(5));
        };
        // What it prints is far less than a pipe holds, so it never waited for this.
        let mut finished = Finished { status, stdout: String::new(), stderr: String::new() };
        self.child.stdout.take().unwrap().read_to_string(&mut finished.stdout).unwrap();
        self.child.stderr.take().unwrap().read_to_string(&mut finished.stderr).unwrap();
        finished
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// All messages in a stream of frames, every one intact and of a start of a box.
pub fn messages(bytes: &[u8]) -> Vec<Message> {
    packets(bytes).into_iter().map(|packet| packet.message).collect()
}

/// The starts in a stream of frames.
pub fn starts(bytes: &[u8]) -> BTreeSet<Start> {
    packets(bytes).into_iter().filter_map(|packet| packet.start).collect()
}

fn packets(bytes: &[u8]) -> Vec<Packet> {
    let mut packets = Vec::new();
    let mut deframer: Deframer = Deframer::new();
    deframer.push(bytes, |outcome| packets.push(outcome.expect("an intact frame")));
    packets
}

pub fn poses(messages: &[Message]) -> Vec<&PosePacket> {
    messages
        .iter()
        .filter_map(|message| match message {
            Message::Pose(pose) => Some(pose),
            _ => None,
        })
        .collect()
}

/// Sequence numbers and times are those of a whole recording at 100 Hz.
pub fn assert_whole(messages: &[Message], frames: usize) {
    let poses = poses(messages);
    assert_eq!(poses.len(), frames);
    for (index, pose) in poses.iter().enumerate() {
        assert_eq!(pose.sequence as usize, index);
        assert_eq!(pose.capture_time_ns, index as u64 * 10_000_000);
        assert_eq!(pose.targets.len(), 2);
    }
    let first = |is_it: fn(&Message) -> bool| messages.iter().position(is_it).unwrap();
    let hello = first(|it| matches!(it, Message::Hello(_)));
    assert!(hello < first(|it| matches!(it, Message::Pose(_))), "{messages:?}");
    assert!(matches!(messages.last(), Some(Message::Health(_))));
}
