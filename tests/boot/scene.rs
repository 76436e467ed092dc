//! What the box sees in these tests, what it is provisioned with, and what the
//! same core makes of the same frames on this machine.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use cpio::newc::ModeFileType;
use plumbline::config::{
    BLOB_BYTES_MAX, Capture, CaptureDriver, Config, FILE_NAME, Machine, Network, PixelFormat,
    SerialLink,
};
use plumbline::image::{GreyImage, Pixel};
use plumbline::pipeline::Pipeline;
use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline_render::simulate::layout::LensChoice;
use plumbline_render::simulate::{Simulation, SimulationSettings};
use rayon::prelude::*;
use tempfile::TempDir;

use crate::machine::read;

/// As the test guest plays them.
pub const RATE_HZ: f64 = 24.0;

/// Two seconds, forwards and then backwards.
pub const FRAMES: usize = 48;

/// A position, x, y, z in mm.
pub type Position = [f64; 3];

/// How far apart two positions are.
pub fn distance_mm(a: &Position, b: &Position) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// The rendered scene, made once for all tests.
pub struct Scene {
    pub simulation: Simulation,
    /// Where the frames are, one after the other.
    pub frames_disk: PathBuf,
    /// Per target and frame.
    pub truth_mm: [Vec<Position>; 2],
    /// Per target and frame: what the core measures here, once it has seen the frames before.
    pub offline_mm: [Vec<Position>; 2],
    _directory: TempDir,
}

pub static SCENE: LazyLock<Scene> = LazyLock::new(Scene::make);

impl Scene {
    fn make() -> Self {
        let settings = SimulationSettings {
            frame_rate_hz: RATE_HZ,
            lens: LensChoice::Hd,
            ..SimulationSettings::default()
        };
        let simulation = Simulation::new(&settings).expect("settings that can be simulated");
        let render = |frame| {
            let mut pixels = Vec::new();
            simulation.render(frame, &mut pixels);
            pixels
        };
        let frames: Vec<Vec<u8>> = (0..FRAMES as u64).into_par_iter().map(render).collect();
        let directory = tempfile::tempdir().expect("a temporary directory");
        let frames_disk = directory.path().join("frames.grey");
        std::fs::write(&frames_disk, frames.concat()).expect("the frames are written");

        let truth_mm = [0, 1].map(|target| {
            let truth = (0..FRAMES as u64).map(|frame| simulation.truth(frame));
            truth.map(|truth| truth.targets[target].cam_from_target.translation_mm.into()).collect()
        });
        let (width, height) = (simulation.camera().width_px, simulation.camera().height_px);
        let read = |frame: &Vec<u8>| {
            let image = GreyImage::new(frame, width.into(), height.into(), width.into());
            Grey::of(&image.expect("a whole frame"))
        };
        let seen: Vec<_> = frames.iter().map(read).collect();
        let offline_mm = track(&simulation, &seen, RATE_HZ);
        Self { simulation, frames_disk, truth_mm, offline_mm, _directory: directory }
    }

    /// The frames as the test guest plays them where there is no disk for them.
    pub fn archive(&self) -> Vec<u8> {
        archive([("test/frames".to_owned(), read(&self.frames_disk))])
    }
}

/// Files as an archive over an initramfs, with the directories that they are in.
pub fn archive(files: impl IntoIterator<Item = (String, Vec<u8>)>) -> Vec<u8> {
    let (mut archive, mut directories) = (Vec::new(), BTreeSet::new());
    let mut add = |name: &str, kind, bytes: &[u8]| {
        let header = cpio::newc::Builder::new(name).mode(0o755).set_mode_file_type(kind);
        let mut writer = header.write(&mut archive, bytes.len() as u32);
        writer.write_all(bytes).expect("memory takes it");
        writer.finish().expect("memory takes it");
    };
    for (name, bytes) in files {
        for (end, _) in name.match_indices('/') {
            if directories.insert(name[..end].to_owned()) {
                add(&name[..end], ModeFileType::Directory, &[]);
            }
        }
        add(&name, ModeFileType::Regular, &bytes);
    }
    cpio::newc::trailer(&mut archive).expect("memory takes it");
    // Another one may follow.
    archive.resize(archive.len().next_multiple_of(4), 0);
    archive
}

/// A frame in memory.
pub struct Grey {
    samples: Vec<u16>,
    white_level: u16,
}

impl Grey {
    pub fn of<P: Pixel>(image: &GreyImage<'_, P>) -> Self {
        let row = |y| image.row(y).iter().map(|&sample| Into::<u32>::into(sample) as u16);
        let samples = (0..image.height()).flat_map(row).collect();
        Self { samples, white_level: image.white_level() }
    }
}

/// Per target and frame: where the core sees it, on the way back from the last frame to the first.
///
/// On the way there its estimates of the blur and of the print's growth settle, as those of a box
/// have that has been running for a second or two. `rate_hz` is that of the camera: the times of the
/// frames decide where the core expects a target, and one that is lost and found again is measured
/// without its border, with another error.
pub fn track(simulation: &Simulation, frames: &[Grey], rate_hz: f64) -> [Vec<Position>; 2] {
    let mut pipeline = Box::new(Pipeline::new());
    pipeline.configure(&simulation.config()).expect("the simulation's own scene");
    let (width, height) = (simulation.camera().width_px, simulation.camera().height_px);
    let mut positions = [0, 1].map(|_| vec![Position::default(); frames.len()]);
    for (time, frame) in (0..).zip((0..frames.len()).chain((0..frames.len()).rev())) {
        let Grey { samples, white_level } = &frames[frame];
        let (width, height) = (width.into(), height.into());
        let image = GreyImage::with_white_level(samples, width, height, width, *white_level)
            .expect("a whole frame");
        let report = pipeline.step(&image, (f64::from(time) / rate_hz * 1e9) as u64);
        for (target, positions) in report.targets.iter().zip(&mut positions) {
            let measured = target.measurement.as_ref().expect("both targets are always in sight");
            let position: Position = measured.cam_from_target.translation_mm.into();
            positions[frame] = position;
        }
    }
    positions
}

/// A box with vivid as its camera, both links, and everything of its computer in use.
pub fn config(host: SocketAddr) -> Config {
    let mut config = SCENE.simulation.config();
    config.device = "boot test".try_into().expect("a short name");
    config.links.udp = Some(host);
    let path = "/dev/ttyS0".try_into().expect("a short path");
    config.links.serial = Some(SerialLink { path, baud: 115_200, one_way: false });
    config.capture = Some(Capture {
        driver: CaptureDriver::V4l2,
        device: "/dev/video0".try_into().expect("a short path"),
        pixel_format: PixelFormat::Grey,
        rate_hz: RATE_HZ as f32,
        exposure_us: None,
        gain: None,
    });
    config.machine = Machine {
        network: Network::Dhcp,
        realtime_priority: Some(50),
        cpu: Some(1),
        watchdog_s: Some(5),
    };
    config
}

pub fn blob(config: &Config) -> Vec<u8> {
    config.encode(&mut vec![0; BLOB_BYTES_MAX]).expect("a sound configuration").to_vec()
}

/// A disk without partitions, and an empty FAT file system.
pub fn empty_disk(directory: &Path) -> PathBuf {
    let disk = directory.join("boot.img");
    std::fs::write(&disk, vec![0; 1 << 20]).expect("the disk is written");
    run("/usr/sbin/mkfs.fat", &[disk.to_str().expect("a plain path")]);
    disk
}

/// The same with a configuration.
pub fn unpaired_disk(directory: &Path, blob: &[u8]) -> PathBuf {
    let disk = empty_disk(directory);
    copy(&disk, 0, FILE_NAME, blob);
    disk
}

/// The same with the key of the tests' boxes, too.
pub fn boot_disk(directory: &Path, blob: &[u8]) -> PathBuf {
    let disk = unpaired_disk(directory, blob);
    copy_key(&disk, 0);
    disk
}

/// The key of the tests' boxes.
pub fn key() -> Key {
    Key::new([7; 32]).expect("a key")
}

/// The file of a box's key.
pub fn key_file(key: &Key) -> Vec<u8> {
    format!("{}\n", key.text().as_str()).into_bytes()
}

/// Puts the key of the tests' boxes into the file system that starts at `start_bytes` of the disk.
pub fn copy_key(disk: &Path, start_bytes: u64) {
    copy(disk, start_bytes, KEY_FILE_NAME, &key_file(&key()));
}

/// Puts a file into the file system that starts at `start_bytes` of the disk.
pub fn copy(disk: &Path, start_bytes: u64, name: &str, bytes: &[u8]) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let file = directory.path().join(name);
    std::fs::write(&file, bytes).expect("the file is written");
    let image = format!("{}@@{start_bytes}", disk.display());
    let (file, name) = (file.to_str().expect("a plain path"), format!("::{name}"));
    run("mcopy", &["-o", "-i", &image, file, &name]);
}

/// The names of the files in the file system of a disk, written as mtools take it.
pub fn files_on(disk: &str) -> Vec<String> {
    let listing = run("mdir", &["-b", "-i", disk]);
    listing.lines().filter_map(|line| Some(line.strip_prefix("::/")?.to_lowercase())).collect()
}

/// A file in it. `None` if it is not there or cannot be read, as one that was being written when the
/// power went.
pub fn file_on(disk: &str, name: &str) -> Option<Vec<u8>> {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let copy = directory.path().join("copy");
    let output = Command::new("mcopy")
        .args(["-n", "-i", disk, &format!("::{name}")])
        .arg(&copy)
        .output()
        .expect("mcopy starts");
    output.status.success().then(|| read(&copy))
}

/// Runs a standard tool; what it says.
pub fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("{program}: {error}"));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {said}{complained}");
    said
}
