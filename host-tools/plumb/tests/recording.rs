//! A rendered person is recorded from the box's real program: whole, cut off by `kill -9`, on a
//! disk that is full, and once more from its packets.

use plumbline_test_support::{
    Absent, PERSON, PERSON_FRAMES as FRAMES, board_beside, command, free_address, is_emulated,
    listens_at, recording, skip,
};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use plumbline::packet::{Deframer, Message, Packet, decode_datagram};
use plumbline_files::poses;
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::manifest::State;
use plumbline_trial::{Trial, names};
use tempfile::TempDir;

use crate::common::keys;

/// A test that waits this long has failed.
const PATIENCE: Duration = Duration::from_secs(120);

/// Of the person, who is recorded for four seconds.
const RATE_HZ: usize = 60;

/// A person in front of a box, and a computer that hears it.
struct Bench {
    folder: TempDir,
    udp: SocketAddr,
    board: PathBuf,
}

impl Bench {
    /// `None` where the box's program is not built, or does not keep pace.
    fn new() -> Option<Self> {
        if is_emulated() {
            let reason = "a box in an emulator does not track 60 frames in a second";
            skip(Absent::Emulator, reason);
            return None;
        }
        let board = board_beside(env!("CARGO_BIN_EXE_plumb"))?;
        let udp = free_address();
        let bench = Self { folder: tempfile::tempdir().unwrap(), udp, board };
        let settings =
            format!("device = \"ward 3\"\nserial_number = \"PL-0001\"\n[links]\nudp = \"{udp}\"\n");
        std::fs::write(bench.path("box.toml"), settings).unwrap();
        keys::known(bench.folder.path());
        symlink(recording(PERSON), bench.path("person")).unwrap();
        bench.done(
            "provision --camera person/camera.toml --targets person/targets.toml \
             --scene person/scene.toml --box box.toml --out box.plb",
        );
        Some(bench)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = command(env!("CARGO_BIN_EXE_plumb"));
        let udp = self.udp.to_string();
        command.args(arguments.split_whitespace().map(|it| if it == "UDP" { &udp } else { it }));
        command.current_dir(self.folder.path());
        command.env("XDG_DATA_HOME", keys::data(self.folder.path()));
        command
    }

    fn plumb(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    #[track_caller]
    fn done(&self, arguments: &str) -> String {
        let output = self.plumb(arguments);
        let text = text(&output);
        assert_eq!(output.status.code(), Some(0), "{arguments}: {text}");
        text
    }

    /// Starts `plumb receive`, and returns once it listens. The replay is over before it could be
    /// checked, and is wanted from its first frame on.
    fn receive(&self, arguments: &str) -> Running {
        let mut command = self.command(&format!("receive --udp UDP --anyway --past {arguments}"));
        let running = Running::start(command.stdout(Stdio::null()).stderr(Stdio::null()));
        wait_for(|| listens_at(self.udp.port()));
        running
    }

    /// Starts the box, which also writes down what it sends.
    fn start(&self, sent: &str) -> Running {
        let mut command = command(&self.board);
        command.current_dir(self.folder.path());
        command.args(["--config", "box.plb", "--replay", "person/frames.y4m", "--record", sent]);
        Running::start(command.stdout(Stdio::null()).stderr(Stdio::null()))
    }

    /// Pose packets that the box has sent until now.
    fn sent(&self, name: &str) -> usize {
        let mut poses = 0;
        Deframer::<256>::new().push(&std::fs::read(self.path(name)).unwrap(), |outcome| {
            poses += usize::from(matches!(outcome, Ok(packet) if is_pose(&packet)));
        });
        poses
    }
}

/// A program that ends with its test.
struct Running(Child);

impl Running {
    fn start(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    #[track_caller]
    fn ends(&mut self) -> Option<i32> {
        let mut code = None;
        wait_for(|| {
            code = self.0.try_wait().unwrap();
            code.is_some()
        });
        code.unwrap().code()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[track_caller]
fn wait_for(mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "waited in vain");
        sleep(Duration::from_millis(5));
    }
}

fn text(output: &Output) -> String {
    String::from_utf8([&output.stdout[..], &output.stderr].concat()).unwrap()
}

/// Who may read, write and enter.
fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

fn entries(folder: &Path) -> Vec<Entry> {
    let mut reader = Reader::open(&folder.join(names::JOURNAL)).unwrap();
    let mut entries = Vec::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        entries.push(entry);
    }
    entries
}

fn is_pose(packet: &Packet) -> bool {
    matches!(packet.message, Message::Pose(_))
}

/// The pose packets of a trial, byte by byte.
fn poses_of(folder: &Path) -> Vec<Vec<u8>> {
    let datagrams = entries(folder).into_iter().filter_map(|entry| match entry.content {
        Content::Raw(Raw::Datagram(bytes)) => Some(bytes),
        _ => None,
    });
    datagrams.filter(|bytes| decode_datagram(bytes).is_ok_and(|packet| is_pose(&packet))).collect()
}

/// The number of pose packets of a trial so far: 0 while there is no journal, or one without its
/// header.
fn recorded(folder: &Path) -> usize {
    Reader::open(&folder.join(names::JOURNAL)).map_or(0, |_| poses_of(folder).len())
}

#[test]
fn a_trial_is_recorded_marked_analysed_and_replayed_bit_by_bit() {
    let Some(bench) = Bench::new() else { return };
    let marks = free_address();
    let mut receiver = bench.receive(&format!(
        "--out p01 --participant P01 --condition control --mark-udp {marks} --frames {}",
        FRAMES
    ));
    let mut the_box = bench.start("sent.bin");
    wait_for(|| recorded(&bench.path("p01")) > FRAMES / 3);
    let before = recorded(&bench.path("p01"));
    UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"stands\n", marks).unwrap();
    assert_eq!(receiver.ends(), Some(0));
    // As long as it is there, it sends its frames again to whoever wants them.
    assert_eq!(the_box.ends(), Some(0));

    let trial = Trial::open(&bench.path("p01")).unwrap();
    assert_eq!(trial.warnings, [""; 0]);
    assert_eq!((trial.frames.len(), trial.manifest.state), (FRAMES, State::Finished));
    assert_eq!(trial.manifest.participant.as_deref(), Some("P01"));
    let config = trial.config.as_ref().expect("the box tells its configuration");
    // Asked for by the recording, and twice a second by the checks beside it.
    assert!(trial.observed.views.len() > 1, "light and focus are in the packets");
    let keys: Vec<String> =
        trial.manifest.verdict().reasons.into_iter().map(|reason| reason.key).collect();
    assert_eq!(keys, ["duration_s"], "{}", trial.manifest.verdict().lines());
    let told = trial.manifest.the_box.as_ref().unwrap();
    assert_eq!(told.config_crc, format!("{:08x}", config.crc()));
    // By the arrival of frames: the times are the recording's, which the box replays.
    let [event] = &trial.manifest.events[..] else { panic!("{:?}", trial.manifest.events) };
    // The mark was sent after the last of these frames had come.
    let last_s = (before - 1) as f64 / RATE_HZ as f64;
    assert!(event.label == "stands" && event.time_s > last_s - 1e-6, "{last_s}: {event:?}");

    // The table was written while it came; its text is that of the packets received again.
    let live = std::fs::read(bench.path("p01").join(names::CSV)).unwrap();
    bench.done("replay p01 --tables");
    assert_eq!(live, std::fs::read(bench.path("p01").join(names::CSV)).unwrap());
    assert_eq!(poses::read(&bench.path("p01").join(names::CSV)).unwrap().len(), 2 * FRAMES);

    // The directories above a trial are made. Only its owner reads it, also what is made anew.
    let mut again = bench.receive(&format!("--out trials/p01/again --frames {}", FRAMES));
    bench.done("replay p01 --to UDP --speed 2");
    assert_eq!(again.ends(), Some(0));
    let made = bench.path("trials/p01/again");
    assert_eq!(poses_of(&made), poses_of(&bench.path("p01")));
    for directory in ["trials", "trials/p01", "trials/p01/again", "p01"] {
        assert_eq!(mode(&bench.path(directory)), 0o700, "{directory}");
    }
    for entry in [made, bench.path("p01")].iter().flat_map(|it| std::fs::read_dir(it).unwrap()) {
        let path = entry.unwrap().path();
        assert_eq!(mode(&path), 0o600, "{}", path.display());
    }

    let analysis = bench.done("analyze p01 --bins -1-0,0-1 --filter paper:0.1 --json p01.json");
    assert!(analysis.contains("t = 0: the mark \"stands\""), "{analysis}");
    // Both trunks have their uncertainties, and a gapless trial gaps of no length.
    let json = std::fs::read_to_string(bench.path("p01.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&json).unwrap();
    for point in figures["points"].as_array().unwrap() {
        let length = &point["filtered"]["path"]["length_mm"]["ap"];
        assert!(length["noise_sd"].as_f64().is_some_and(|sd| sd > 0.0), "{point}");
        assert_eq!(point["filtered"]["gaps_s"].to_string(), "0.0");
    }
    bench.done("report p01 --bins -1-0,0-1 --filter paper:0.1 --out p01.html");
    let page = std::fs::read_to_string(bench.path("p01.html")).unwrap();
    for part in [
        "P01, control",
        "Upper trunk",
        "noise alone",
        "lost on the way",
        "the mark &quot;stands&quot;",
    ] {
        assert!(page.contains(part), "no {part}");
    }
    // Two trunks: three planes and three axes each; no spectrum of 4 s. Nothing of it comes from
    // elsewhere.
    assert_eq!(page.matches("<figure").count(), 2 * 6);
    assert!(!page.contains("src=") && !page.contains("href=") && !page.contains("url("));
    let refused = bench.plumb("receive --udp UDP --out p01 --frames 1");
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused).contains("nothing that was recorded is overwritten"));
}

#[test]
fn the_duration_counts_from_the_mark_and_the_mark_is_shown() {
    let Some(bench) = Bench::new() else { return };
    const DURATION_S: f64 = 2.0;
    let marks = free_address();
    let arguments =
        format!("receive --udp UDP --anyway --out p02 --mark-udp {marks} --duration {DURATION_S}");
    let mut command = bench.command(&arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for(|| listens_at(bench.udp.port()));
    let _box = bench.start("sent.bin");
    // More than a second of the recording is over, half of its duration.
    wait_for(|| recorded(&bench.path("p02")) > FRAMES / 4 + RATE_HZ / 5);
    UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"zero", marks).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("mark \"zero\" at ") && said.contains(" s: t = 0"), "{said}");

    let trial = Trial::open(&bench.path("p02")).unwrap();
    let zero_s = trial.manifest.zero_mark().unwrap().time_s;
    assert!(zero_s > 1.0, "{zero_s}");
    // The bin that ends with the duration is full, to a frame.
    let last_s = trial.frames.last().unwrap().time_s;
    assert!(last_s - zero_s >= DURATION_S - 1.0 / RATE_HZ as f64, "{zero_s} to {last_s}");
    bench.done("analyze p02 --bins 1-2 --covered-min 99 --filter paper:0.1 --json p02.json");
    let figures: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(bench.path("p02.json")).unwrap()).unwrap();
    let bin = &figures["points"][0]["filtered"]["bins"][0];
    assert!(bin["path"]["length_mm"]["ap"].is_object() || bin["length_mm"].is_object(), "{bin}");
}

#[test]
fn a_recording_that_is_killed_loses_at_most_its_last_second() {
    let Some(bench) = Bench::new() else { return };
    let mut receiver = bench.receive("--out killed");
    let _box = bench.start("sent.bin");
    wait_for(|| recorded(&bench.path("killed")) > FRAMES / 2);
    receiver.0.kill().unwrap();
    receiver.0.wait().unwrap();
    let sent = bench.sent("sent.bin");

    let trial = Trial::open(&bench.path("killed")).unwrap();
    assert!(trial.warnings[0].contains("was cut off"), "{:?}", trial.warnings);
    let lost = sent.saturating_sub(trial.frames.len());
    assert!(lost <= RATE_HZ && trial.frames.len() > FRAMES / 2, "{lost} of {sent} lost");
    let said = bench.done("replay killed --tables");
    assert!(said.contains("was cut off"), "{said}");
    // The tables do not make it whole: whoever analyses it is told.
    let analysis = bench.done("analyze killed --bins 0-1 --filter paper:0.1");
    assert!(analysis.contains("was cut off"), "{analysis}");
}

#[test]
fn a_full_disk_ends_a_recording_with_what_is_there() {
    let Some(bench) = Bench::new() else { return };
    // A file may have 24 KiB: the error is another one than that of a full disk, its way the same.
    let receive =
        format!("receive --udp {} --anyway --past --out full --frames {FRAMES}", bench.udp);
    let script =
        format!("ulimit -f 48; trap '' XFSZ; exec {} {receive}", env!("CARGO_BIN_EXE_plumb"));
    let mut shell = Command::new("sh");
    shell.args(["-c", &script]).current_dir(bench.folder.path());
    shell.env("XDG_DATA_HOME", keys::data(bench.folder.path()));
    let child = shell.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for(|| listens_at(bench.udp.port()));
    let _box = bench.start("sent.bin");
    let output = child.wait_with_output().unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("error: full/") && said.contains("file too large"), "{said}");
    let trial = Trial::open(&bench.path("full")).unwrap();
    // 48 blocks of 512 bytes hold so many frames of the table, which is the larger file.
    assert!(trial.frames.len() > 50, "{}: {said}", trial.frames.len());
}

#[test]
fn without_a_box_there_is_no_folder() {
    let Some(bench) = Bench::new() else { return };
    let output = bench.plumb("receive --udp UDP --anyway --out none/deeper --duration 0.3");
    let said = text(&output);
    assert_eq!(output.status.code(), Some(2));
    assert!(said.contains("none/deeper was not written"), "{said}");
    assert!(!bench.path("none").exists());
    for (arguments, part) in [
        ("analyze none", "not the folder of a trial"),
        ("replay person --tables", "packets.bin"),
        (
            "receive --udp UDP --anyway --out person/truth.csv/b --frames 1",
            "a file is in its place",
        ),
    ] {
        let output = bench.plumb(arguments);
        let said = text(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(part), "{arguments}: {said}");
    }
}
