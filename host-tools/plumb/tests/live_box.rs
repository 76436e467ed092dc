//! What a technician reads while setting up a live box: the box's real program looks at a
//! rendered scene, and one that refuses its configuration is played.

use plumbline_test_support::{board_beside, command, free_address};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::lens::{Distortion, Lens};
use plumbline::packet::{
    Action, Command as Question, Document, Hello, Log, LogLevel, Message, Refusal, ReplyOutcome,
    ResetReason,
};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_files::lens_id::LensId;
use plumbline_render::simulate::render::{Board, Ink, Picture, PlacedBoard, render_targets};
use plumbline_render::simulate::sensor::Sensor;
use plumbline_stream::fixture::SealedBox;
use plumbline_trial::Trial;
use plumbline_trial::manifest::{CheckSeen, CheckVerdict};
use tempfile::TempDir;

use crate::common::finished::interrupt;
use crate::common::keys;

const CAMERA: &str = "width_px = 640
height_px = 480
fx_px = 800.0
fy_px = 800.0
cx_px = 319.5
cy_px = 239.5
model = \"radial2\"
distortion = [0.0, 0.0]
";

pub const PAIR: &str = "[[target]]
name = \"lumbar\"
role = \"lower\"
columns = 6
rows = 5
pitch_mm = 12.0
[[target]]
name = \"shoulder\"
role = \"upper\"
columns = 5
rows = 4
pitch_mm = 12.0
";

const BOARD: &str = "[[target]]
name = \"board\"
role = \"scene\"
columns = 9
rows = 6
pitch_mm = 12.0
";

/// A print's columns and rows, and where it is: x, y, z.
type Place = (u8, u8, [f64; 3]);

/// Where the three of them are. The board hangs upright, turned by 0.1 rad; the shoulder
/// is 70 mm above the lower back.
const PLACES: [Place; 3] =
    [(6, 5, [-120.0, 110.0, 650.0]), (5, 4, [110.0, 40.0, 650.0]), (9, 6, [10.0, -80.0, 650.0])];

const BOARD_TURN_RAD: f64 = 0.1;

const RATE_HZ: usize = 15;

/// Longer than any of these tests listens; one that needs more starts it again.
const SECONDS: usize = 40;

/// A wall with structure, as a camera sees it that was turned to the left so that all moves to the
/// right by this.
fn wall(moved_px: f64) -> Picture {
    let mut wall = Picture::uniform(640, 480, 110.0);
    for (index, grey) in wall.grey.iter_mut().enumerate() {
        let (x, y) = ((index % 640) as f64 - moved_px, (index / 640) as f64);
        let (x, y) = (x / 8.0, y / 8.0);
        let waves = (0.31 * x + 0.002 * x * y).sin() + (0.27 * y - 0.0015 * x * x).cos();
        *grey += 25.0 * waves as f32;
    }
    wall
}

/// The recording that the box replays; its camera is turned to the left by this since it was
/// first set up.
pub fn recording(turned_deg: f64) -> Vec<u8> {
    recording_of(PLACES, turned_deg)
}

fn recording_of(places: [Place; 3], turned_deg: f64) -> Vec<u8> {
    let lens = Lens {
        width_px: 640,
        height_px: 480,
        fx_px: 800.0,
        fy_px: 800.0,
        cx_px: 319.5,
        cy_px: 239.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    };
    let prints = places.map(|(columns, rows, _)| {
        let checker =
            TargetGeometry::checker(columns, rows, 12.0, Origin::Center, Role::Scene, [0.0; 3]);
        Board::new(&checker.unwrap(), 12.0, Ink { black: 25.0, white: 210.0 })
    });
    let placed: Vec<PlacedBoard<'_>> = prints
        .iter()
        .zip(places)
        .map(|(board, (_, _, [x, y, z]))| {
            let before = Pose::<Cam, Target>::from_theta([0.0, BOARD_TURN_RAD, 0.0, x, y, z]);
            let turn = [0.0, turned_deg.to_radians(), 0.0, 0.0, 0.0, 0.0];
            let cam_from_target = Pose::<Cam, Cam>::from_theta(turn) * before;
            PlacedBoard { board, cam_from_target }
        })
        .collect();
    let mut picture = wall(800.0 * turned_deg.to_radians().tan());
    render_targets(&lens, 0.6, &placed, &|_, _| 1.0, &mut picture);
    // The same few over and over: what differs is the noise.
    let frames: Vec<Vec<u8>> = (0..5)
        .map(|frame| {
            let mut samples = vec![0_u8; 640 * 480];
            Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, 3, frame, &mut samples);
            samples
        })
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = y4m::encode(640, 480, y4m::Ratio::new(RATE_HZ, 1))
        .with_colorspace(y4m::Colorspace::Cmono)
        .write_header(&mut bytes)
        .unwrap();
    for luma in frames.iter().cycle().take(RATE_HZ * SECONDS) {
        encoder.write_frame(&y4m::Frame::new([luma, &[], &[]], None)).unwrap();
    }
    bytes
}

/// The box's program, if it is built.
pub fn board() -> Option<PathBuf> {
    board_beside(env!("CARGO_BIN_EXE_plumb"))
}

/// A directory with the files of a box, and the address at which it is heard.
pub struct Bench {
    pub folder: TempDir,
    pub udp: SocketAddr,
}

impl Bench {
    pub fn new(targets: &str) -> Self {
        let bench = Self { folder: tempfile::tempdir().unwrap(), udp: free_address() };
        bench.write("camera.toml", CAMERA);
        bench.write("targets.toml", targets);
        bench.write("box.toml", &bench.settings("PL-0001", bench.udp));
        keys::known(bench.folder.path());
        bench
    }

    fn settings(&self, serial_number: &str, udp: SocketAddr) -> String {
        format!(
            "device = \"ward 3\"\nserial_number = \"{serial_number}\"\n\
             [capture]\ndriver = \"v4l2\"\npixel_format = \"grey\"\nrate_hz = {RATE_HZ}.0\n\
             exposure_us = 4000\n[links]\nudp = \"{udp}\"\n"
        )
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn config(&self, name: &str) -> Config {
        Config::decode(&std::fs::read(self.path(name)).unwrap()).unwrap()
    }

    /// `plumb`, from the files of this directory; UDP stands for the address.
    pub fn plumb(&self, arguments: &str) -> Said {
        let udp = self.udp.to_string();
        let output = command(env!("CARGO_BIN_EXE_plumb"))
            .args(arguments.split_whitespace().map(|it| if it == "UDP" { &udp } else { it }))
            .env("XDG_DATA_HOME", keys::data(self.folder.path()))
            .current_dir(self.folder.path())
            .output()
            .unwrap();
        Said::of(arguments, &output)
    }

    pub fn provision(&self, more: &str) -> Said {
        self.plumb(&format!("provision --camera camera.toml --targets targets.toml {more}"))
    }

    /// Makes the configuration and the recording, and starts the box with both.
    fn start(&self, board: &Path, is_supervised: bool) -> Running {
        self.provision("--box box.toml --out box.plb").exits(0);
        std::fs::write(self.path("trial.y4m"), recording(0.0)).unwrap();
        Running::start(board, self.folder.path(), is_supervised)
    }
}

/// How a program ended and what it said.
pub struct Said {
    arguments: String,
    code: Option<i32>,
    text: String,
}

impl Said {
    pub fn of(arguments: &str, output: &Output) -> Self {
        let text = [&output.stdout[..], &output.stderr].concat();
        let text = String::from_utf8(text).unwrap();
        Self { arguments: arguments.to_owned(), code: output.status.code(), text }
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    #[track_caller]
    pub fn exits(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{}: {}", self.arguments, self.text);
        self
    }

    #[track_caller]
    pub fn says(self, parts: &[&str]) -> Self {
        for part in parts {
            assert!(self.text.contains(part), "no {part:?} in {}: {}", self.arguments, self.text);
        }
        self
    }
}

/// The box's program; started again whenever it ends, until this is dropped.
pub struct Running {
    stop: Arc<AtomicBool>,
    supervisor: Option<JoinHandle<()>>,
}

impl Running {
    pub fn start(board: &Path, directory: &Path, is_supervised: bool) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let mut command: Command = command(board);
        command
            .args(["--config", "box.plb", "--replay", "trial.y4m"])
            .args(is_supervised.then_some("--supervised"))
            .current_dir(directory)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let stopped = Arc::clone(&stop);
        let supervisor = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                let mut child = command.spawn().unwrap();
                while child.try_wait().unwrap().is_none() {
                    if stopped.load(Ordering::Relaxed) {
                        child.kill().unwrap();
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
            }
        });
        Self { stop, supervisor: Some(supervisor) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let supervisor = self.supervisor.take();
        assert!(supervisor.is_some_and(|it| it.join().is_ok()) || std::thread::panicking());
    }
}

#[test]
fn a_live_box_takes_a_configuration_and_gives_it_back() {
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let _running = bench.start(&board, true);
    let crc = format!("{:08x}", bench.config("box.plb").crc());
    let met = format!("ward 3 (PL-0001), program {}+", env!("CARGO_PKG_VERSION"));
    bench.plumb("show --udp UDP --out shown").exits(0).says(&[&met, &crc, "written to shown/"]);
    let again = "provision --camera shown/camera.toml --targets shown/targets.toml \
                 --box shown/box.toml --out again.plb";
    bench.plumb(again).exits(0);
    assert_eq!(bench.config("again.plb"), bench.config("box.plb"));

    bench.write("other.toml", &bench.settings("PL-0002", bench.udp));
    let other = "--box other.toml --send --via-udp UDP";
    bench.provision(other).exits(2).says(&[&met, "(PL-0001), and", "(PL-0002)", "--force"]);
    bench.provision("--send --via-udp UDP").exits(2).says(&["\"plumbline\" (0)", "--force"]);
    // The calibration of another camera.
    bench.write("small.toml", &CAMERA.replace("640", "320").replace("480", "240"));
    bench
        .plumb(
            "provision --camera small.toml --targets targets.toml --box box.toml --send \
             --via-udp UDP",
        )
        .exits(2)
        .says(&["small.toml: it is for frames of 320 x 240 px", "are 640 x 480 px", "--force"]);
    assert_eq!(format!("{:08x}", bench.config("box.plb").crc()), crc, "nothing was sent");

    let said = bench.provision(&format!("{other} --force --out sent.plb")).exits(0);
    let sent = bench.config("sent.plb");
    let stored = format!("stored, checksum {:08x}", sent.crc());
    said.says(&[&met, &stored, "the box has restarted with it"]);
    assert_eq!(bench.config("box.plb"), sent);

    // It will be heard elsewhere, which is no fault.
    let elsewhere = free_address();
    bench.write("away.toml", &bench.settings("PL-0002", elsewhere));
    let away = "--box away.toml --send --via-udp UDP";
    bench.provision(away).exits(2).says(&["would no longer be heard here", "--send --force"]);
    let away = "--box away.toml --send --via-udp UDP --force";
    let warning = format!("warning: the box will send by UDP to {elsewhere}, and not to");
    let kept = ["in use from the box's next start"];
    bench.provision(&format!("{away} --no-restart")).exits(0).says(&[&warning]).says(&kept);
    bench.provision(away).exits(0).says(&[&warning, "no longer heard here"]);
}

/// While it lasts, nobody changes the box.
#[test]
fn a_recording_that_is_stopped_frees_the_box_at_once() {
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let _running = bench.start(&board, true);
    let udp = bench.udp.to_string();
    let mut receive = command(env!("CARGO_BIN_EXE_plumb"))
        .args(["receive", "--udp", &udp, "--anyway", "--out", "trial"])
        .env("XDG_DATA_HOME", keys::data(bench.folder.path()))
        .current_dir(bench.folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let provision = "--box box.toml --send --via-udp";
    // The recording is begun before the box is heard, and grows from then on.
    let packets = bench.path("trial/packets.bin");
    let length = || std::fs::metadata(&packets).map_or(0, |it| it.len());
    let wait_until_longer = |than: u64| {
        let give_up = Instant::now() + Duration::from_secs(60);
        while length() <= than {
            assert!(Instant::now() < give_up, "the recording has {than} bytes and no more");
            std::thread::sleep(Duration::from_millis(50));
        }
        length()
    };
    wait_until_longer(wait_until_longer(0));
    // Its port is taken: the other one calls the box where it was met last.
    let other = bench.provision(&format!("{provision} {}", free_address()));
    interrupt(&receive);
    assert_eq!(receive.wait().unwrap().code(), Some(0));
    other.exits(2).says(&["records a trial", "--force"]);
    bench.provision(&format!("{provision} UDP")).exits(0).says(&["stored, checksum"]);
    assert_eq!(Trial::open(&bench.path("trial")).unwrap().warnings, Vec::<String>::new());
}

#[test]
fn a_program_that_nobody_starts_again_is_not_restarted() {
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let _running = bench.start(&board, false);
    bench
        .provision("--box box.toml --send --via-udp UDP")
        .exits(0)
        .says(&["stored, checksum", "takes effect at its next start"]);
    // Started with this file, the box has stored another configuration in it.
    bench.write("next.toml", &bench.settings("PL-0002", bench.udp));
    bench.provision("--box next.toml --send --via-udp UDP --force").exits(0);
    let stored = format!("box.plb is {:08x}", bench.config("box.plb").crc());
    let doctor = bench.plumb("doctor --udp UDP --config box.plb --seconds 1").exits(1);
    doctor.says(&["it runs with", "has stored", &stored, "restart the box"]);
    bench.plumb("scene --udp UDP --store").exits(2).says(&[
        "looks for lumbar, shoulder, and for no target of the role \"scene\"",
        "provision it again",
    ]);
}

#[test]
fn a_live_box_measures_its_scene_and_the_doctor_finds_it_well() {
    let Some(board) = board() else { return };
    let bench = Bench::new(&format!("{PAIR}{BOARD}"));
    let _running = bench.start(&board, true);
    let before = bench.plumb("doctor --udp UDP --seconds 2 --config box.plb").exits(1);
    before.says(&["FAIL  scene ", "plumb scene --store", "ok    board poses", ", 1 failed"]);

    let said = bench.plumb("scene --udp UDP --out scene.toml --store").exits(0);
    said.says(&["ward 3 (PL-0001)", "spread of one frame 0.0", "leans by 0.", "stored, checksum"])
        .says(&["written to scene.toml", "the box has restarted with it"])
        .says(&["a small picture of the background is kept in"]);
    let stored = bench.config("box.plb").cam_from_scene_theta.unwrap();
    let written = plumbline_files::scene::read(&bench.path("scene.toml")).unwrap();
    assert_eq!(stored, written.cam_from_scene_theta);
    assert_eq!(written.camera, Some(LensId::of(&bench.config("box.plb").lens)));
    let [_, turn_rad, _, x_mm, y_mm, z_mm] = stored;
    assert!((turn_rad - BOARD_TURN_RAD).abs() < 2e-3, "{turn_rad}");
    let [x, y, z] = PLACES[2].2;
    assert!((x_mm - x).abs() + (y_mm - y).abs() + (z_mm - z).abs() < 0.3, "{stored:?}");

    let other = bench.plumb("doctor --udp UDP --seconds 2").exits(0);
    other
        .says(&["ok    scene ", "ok    lumbar depth", "ok    camera", "a recording runs"])
        .says(&["ok    scene board", "ok    background", "turned by 0.0", "ok    upper above"]);
    bench.provision("--box box.toml --out other.plb --force").exits(0);
    let other = bench.plumb("doctor --udp UDP --seconds 1 --config other.plb").exits(1);
    other.says(&["FAIL  configuration", "and other.plb is", "plumb show", ", 1 failed"]);

    // One that is stored and not in use yet would be lost.
    bench.provision("--box box.toml --send --via-udp UDP --no-restart").exits(0);
    let pending = format!("another configuration, {:08x}, which", bench.config("box.plb").crc());
    bench.plumb("scene --udp UDP --store").exits(2).says(&[&pending, "restart it first"]);
}

#[test]
fn a_camera_that_was_turned_after_its_scene_is_found_out_before_it_records() {
    let Some(board) = board() else { return };
    let bench = Bench::new(&format!("{PAIR}{BOARD}"));
    std::fs::write(bench.path("trial.y4m"), recording(0.0)).unwrap();
    bench
        .plumb("scene --camera camera.toml --targets targets.toml --out scene.toml trial.y4m")
        .exits(0)
        .says(&["a small picture of the background is kept in"]);
    bench.provision("--scene scene.toml --box box.toml --out box.plb").exits(0);
    std::fs::write(bench.path("trial.y4m"), recording(0.5)).unwrap();
    let _running = Running::start(&board, bench.folder.path(), true);
    let receive = "receive --udp UDP --check-seconds 1 --out trial --frames 10";
    bench.plumb(receive).exits(1).says(&[
        "FAIL  scene board ",
        "0.50 degrees and 5.7 mm from where it was measured",
        "FAIL  background ",
        "the camera is turned by 0.5",
        "plumb scene --store",
        "not recorded: 2 checks failed",
        "--anyway",
    ]);
    assert!(!bench.path("trial").exists());
}

#[test]
fn exchanged_targets_are_not_recorded_unless_told_to() {
    let Some(board) = board() else { return };
    let bench = Bench::new(
        &PAIR.replace("lower", "other").replace("upper", "lower").replace("other", "upper"),
    );
    let scene = "theta1_rad = 0\ntheta2_rad = 0\ntheta3_rad = 0\nx_mm = 0\ny_mm = 0\nz_mm = 650\n";
    bench.write("scene.toml", scene);
    std::fs::write(bench.path("trial.y4m"), recording(0.0)).unwrap();
    bench.provision("--scene scene.toml --box box.toml --out box.plb").exits(0);
    let running = Running::start(&board, bench.folder.path(), true);
    let receive = "receive --udp UDP --check-seconds 1 --out trial --frames 30";
    bench.plumb(receive).exits(1).says(&[
        "FAIL  upper above lower  \"lumbar\" is 70 mm below \"shoulder\"",
        "role = \"upper\"",
        "not recorded: 1 check failed",
    ]);
    assert!(!bench.path("trial").exists());
    bench.plumb(&format!("{receive} --anyway")).exits(0).says(&[
        "FAIL  upper above lower",
        "skip  background",
        "with --anyway",
    ]);
    let amiss = |folder: &str| Trial::open(&bench.path(folder)).unwrap().manifest.checks;
    let failed: Vec<_> =
        amiss("trial").into_iter().filter(|check| check.verdict == CheckVerdict::Fail).collect();
    let [check] = &failed[..] else { panic!("{failed:?}") };
    let skipped = |check: &CheckSeen| check.verdict == CheckVerdict::Skipped;
    assert!(amiss("trial").iter().any(|it| skipped(it) && it.subject == "background"));
    assert!(
        check.subject == "upper above lower" && check.seen.contains("70 mm below"),
        "{check:?}"
    );

    // Corrected, it is recorded; that its rate is below the standard is said and written down.
    drop(running);
    bench.write("targets.toml", PAIR);
    bench.provision("--scene scene.toml --box box.toml --out box.plb --force").exits(0);
    let _running = Running::start(&board, bench.folder.path(), true);
    let said = bench.plumb(&receive.replace("trial", "right")).exits(0);
    said.says(&["warn  rate", "ISPGR", "0 failed"]);
    let checks = amiss("right");
    assert!(checks.iter().all(|check| check.verdict != CheckVerdict::Fail), "{checks:?}");
    assert!(checks.iter().any(|check| check.subject == "rate"), "{checks:?}");
}

/// A print of 12 mm that is described as one of 13: everything else is as it should be.
#[test]
fn a_wrong_pitch_is_found_by_a_tape_and_a_right_one_is_remembered() {
    let Some(board) = board() else { return };
    let bench = Bench::new(&PAIR.replace("12.0", "13.0"));
    let scene = "theta1_rad = 0\ntheta2_rad = 0\ntheta3_rad = 0\nx_mm = 0\ny_mm = 0\nz_mm = 1000\n";
    bench.write("scene.toml", scene);
    // The lumbar target is 1027 mm away: 1007 from the front of the lens.
    let places = PLACES.map(|(columns, rows, [x, y, _])| (columns, rows, [x, y, 1014.0]));
    std::fs::write(bench.path("trial.y4m"), recording_of(places, 0.0)).unwrap();
    let provision = "--scene scene.toml --box box.toml --out box.plb --force";
    bench.provision(provision).exits(0).says(&["warning: scene.toml: it does not say", "camera"]);
    let running = Running::start(&board, bench.folder.path(), true);
    let doctor = "doctor --udp UDP --seconds 1";
    let taped = format!("{doctor} --distance-mm 1007");
    bench.plumb(doctor).exits(0).says(&["warn  scale ", "--distance-mm MM`", ", 0 failed"]);
    bench.plumb(&format!("{doctor} --distance-mm 700")).exits(2).says(&["850 to 10000"]);
    bench.plumb(&taped).exits(1).says(&[
        "FAIL  scale ",
        "\"lumbar\" is 1113 mm away by the box, and 1027 by the tape",
        "pitch_mm of \"lumbar\" is 13.00, and about 12.0 would fit",
        "plumb replay FOLDER --tables --targets targets.toml",
        ", 1 failed",
    ]);
    // Nobody is stopped from recording by what nobody has measured; the trial says so.
    let receive = "receive --udp UDP --check-seconds 1 --frames 30 --out";
    bench.plumb(&format!("{receive} wrong")).exits(0).says(&["warn  scale ", "nobody has"]);
    let manifest = Trial::open(&bench.path("wrong")).unwrap().manifest;
    let warned = manifest.checks.iter().find(|check| check.subject == "scale").unwrap();
    assert_eq!(warned.verdict, CheckVerdict::Warn);
    assert!(manifest.verdict().reasons.iter().all(|reason| !reason.words.contains("scale")));

    drop(running);
    bench.write("targets.toml", PAIR);
    bench.provision(provision).exits(0);
    let _running = Running::start(&board, bench.folder.path(), true);
    bench.plumb(&taped).exits(0).says(&["ok    scale ", "is 1027 mm away by", "is kept in"]);
    let known = ["ok    scale ", "\"lumbar\" was compared with a tape on 20", "1027 mm by the box"];
    bench.plumb(&format!("{receive} right")).exits(0).says(&known);
    let checks = Trial::open(&bench.path("right")).unwrap().manifest.checks;
    assert!(checks.iter().all(|check| check.subject != "scale"), "{checks:?}");
    // A tape that does not agree any more takes it back.
    bench.plumb(&format!("{doctor} --distance-mm 1100")).exits(1).says(&["FAIL  scale "]);
    bench.plumb(doctor).exits(0).says(&["warn  scale "]);
}

#[test]
fn where_no_box_is_heard_that_is_the_failure() {
    let bench = Bench::new(PAIR);
    let said = bench.plumb("doctor --udp UDP").exits(1);
    said.says(&["FAIL  link", "no box is heard; check that the box is on", "skip  camera"]);
    bench.plumb("show --udp UDP").exits(2).says(&["no box is heard; check that the box is on"]);
    let receive = "receive --udp UDP --anyway --duration 0.3 --out received.csv";
    bench.plumb(receive).exits(2).says(&["no frame came: received.csv was not written"]);
    assert!(!bench.path("received.csv").exists());
    let _taken = UdpSocket::bind(bench.udp).unwrap();
    bench.plumb("doctor --udp UDP").exits(2).says(&["another program listens there"]);
}

#[test]
fn a_box_whose_camera_is_not_calibrated_is_shown_as_such() {
    let bench = Bench::new(&format!("{PAIR}{BOARD}"));
    let provision = "provision --targets targets.toml --box box.toml --out box.plb";
    bench.plumb(&format!("{provision} --uncalibrated 640x480")).exits(0);
    bench.plumb("show box.plb").exits(0).says(&[
        "1 target\n",
        "warning: ITS CAMERA IS NOT CALIBRATED",
        "--uncalibrated 640x480 instead of --camera",
        ", NOT CALIBRATED\"\n",
    ]);
    bench.plumb(&format!("{provision} --camera camera.toml --force")).exits(0);
    let said = bench.plumb("show box.plb").exits(0).says(&["3 targets\n"]);
    assert!(!said.text.contains("CALIBRATED"), "{}", said.text);
}

#[test]
fn of_two_boxes_on_one_port_one_is_shown_and_the_other_named() {
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let beside = Bench::new(PAIR);
    beside.write("box.toml", &beside.settings("PL-0002", bench.udp));
    let other = Key::new([9; 32]).unwrap();
    beside.write(KEY_FILE_NAME, other.text().as_str());
    keys::know(bench.folder.path(), &other, "ward 3", "PL-0002");
    let _running = [bench.start(&board, false), beside.start(&board, false)];
    let said = bench.plumb("show --udp UDP").exits(0);
    let names = ["ward 3 (PL-0001)", "ward 3 (PL-0002)"];
    let first = usize::from(!said.text.contains(&format!("{}, program", names[0])));
    let config = [&bench, &beside][first].config("box.plb");
    let met = format!("{}, program {}+", names[first], env!("CARGO_PKG_VERSION"));
    let number = ["PL-0001", "PL-0002"][1 - first];
    let others = format!("another box is heard: \"ward 3\" ({number}) (at 127.0.0.1:");
    let shown = format!("checksum {:08x}", config.crc());
    said.says(&[&met, &shown, &others, "--box-name chooses"]);
    // And the other one, by its number.
    let chosen = bench.plumb(&format!("show --udp UDP --box-name {number}")).exits(0);
    chosen.says(&[&format!("{}, program", names[1 - first])]);
}

/// A box that refuses its configuration, until it has been sent a better one.
fn refusing_box(host: SocketAddr, stop: &AtomicBool) {
    const WHY: &str = "configuration refused: links.udp: neither address nor port may be 0";
    let mut sealed = SealedBox::new(host, 1);
    let mut blob = Vec::new();
    let (mut restarted_with, mut say_at) = (None, Instant::now());
    let mut stored = None;
    while !stop.load(Ordering::Relaxed) {
        if Instant::now() >= say_at {
            say_at = Instant::now() + Duration::from_millis(200);
            sealed.send(&restarted_with.map_or_else(
                || {
                    Message::Log(Log {
                        uptime_ms: 9000,
                        level: LogLevel::Error,
                        target: "boot".try_into().unwrap(),
                        text: WHY.try_into().unwrap(),
                        cut: 0,
                    })
                },
                hello,
            ));
        }
        for (listener, message) in sealed.wait() {
            match message {
                Message::Part(part) if part.document == Document::Config => {
                    blob.truncate(part.offset as usize);
                    blob.extend_from_slice(&part.bytes);
                }
                Message::Command(Question { id, action, .. }) => {
                    let outcome = match action {
                        Action::StoreConfig { crc, .. } => {
                            assert_eq!(Config::decode(&blob).unwrap().crc(), crc);
                            stored = Some(crc);
                            ReplyOutcome::Stored { crc }
                        }
                        Action::Reboot => ReplyOutcome::Accepted,
                        _ => ReplyOutcome::Refused {
                            refusal: Refusal::NotSupported,
                            reason: WHY.try_into().unwrap(),
                        },
                    };
                    sealed.answer(listener, id, outcome);
                    if action == Action::Reboot {
                        restarted_with = stored;
                    }
                }
                _ => (),
            }
        }
    }
}

fn hello(config_crc: u32) -> Message {
    Message::Hello(Hello {
        device: "ward 3".try_into().unwrap(),
        serial_number: "PL-0001".try_into().unwrap(),
        firmware: "plumbline".try_into().unwrap(),
        config_crc,
        boot_id: 1,
        boot_count: None,
        reset_reason: ResetReason::PowerOn,
        width_px: 640,
        height_px: 480,
        targets: heapless::Vec::new(),
    })
}

#[test]
fn a_box_that_refuses_its_configuration_is_quoted_and_takes_another() {
    let bench = Bench::new(PAIR);
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| refusing_box(bench.udp, &stop));
        const WHY: &str = "links.udp: neither address nor port may be 0";
        let doctor = bench.plumb("doctor --udp UDP");
        let show = bench.plumb("show --udp UDP");
        let without = bench.provision("--udp 127.0.0.1:4210 --send --via-udp UDP");
        let provision = bench.provision("--box box.toml --send --via-udp UDP");
        stop.store(true, Ordering::Relaxed);
        let refused = ["FAIL  box", WHY, "`plumb provision --send`", "skip  light"];
        doctor.exits(1).says(&refused);
        show.exits(2).says(&["the box tracks nothing", WHY, "`plumb provision --send`"]);
        // It is no replay: it would refuse this one too.
        without.exits(2).says(&["a box that tracks nothing", "capture: no camera is given"]);
        provision
            .exits(0)
            .says(&["a box that tracks nothing; it says: ", WHY])
            .says(&["stored, checksum", "the box has restarted with it"]);
    });
}
