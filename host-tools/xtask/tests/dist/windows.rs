//! From the printed board to the report under Wine. What Windows' program reads and writes is compared
//! with what Linux' makes of the same files.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::thread;
use std::time::{Duration, Instant};

use plumbline_test_support::{free_port, listens_at};
use serde_json::Value;

use crate::{DIST, WINE};

/// How long anything may take on a busy computer.
const WITHIN: Duration = Duration::from_secs(600);

/// The largest difference of what is computed with sines and logarithms, relative to the value: each
/// system has its own library for those.
const WITHIN_SHARE: f64 = 1e-9;

/// Both programs, unpacked, and a Windows of their own: a folder in the Debian that has Wine.
struct Bench {
    debian: PathBuf,
    folder: PathBuf,
}

/// Runs its arguments after the first two in the folder that is the second, in the Debian that is the
/// first, with this computer's devices and processes.
const IN_DEBIAN: &str = r#"
    mount --bind /proc "$1/proc" && mount --rbind /dev "$1/dev" || exit 125
    debian=$1 folder=$2
    shift 2
    exec chroot "$debian" sh -c 'cd "$1" && shift && exec "$@"' sh "$folder" "$@"
"#;

/// A program of a system with its arguments.
type Program = fn(&Bench, &[&str]) -> Command;

/// One for all tests: making a Windows takes longest.
static BENCH: LazyLock<Bench> = LazyLock::new(Bench::new);

impl Bench {
    fn new() -> Self {
        let dist = PathBuf::from(env::var_os(DIST).expect("cargo xtask test dist sets it"));
        let debian = PathBuf::from(env::var_os(WINE).expect("cargo xtask test dist sets it"));
        // One that is used by all tests is there until the next run. Its server ends with its programs.
        let folder = debian.join("srv/bench");
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        fs::create_dir(&folder).unwrap();
        let only = |ending: &str| {
            let entries = fs::read_dir(&dist).unwrap().map(|entry| entry.unwrap().path());
            let is = |path: &PathBuf| path.to_string_lossy().ends_with(ending);
            entries.filter(is).max().unwrap_or_else(|| panic!("no {ending} in {}", dist.display()))
        };
        let unpack = |program: &str, arguments: &[&str], archive: &Path| {
            let mut command = Command::new(program);
            command.args(arguments).arg(archive).current_dir(&folder);
            assert!(command.status().unwrap().success(), "{}", archive.display());
        };
        unpack("tar", &["--strip-components=1", "-xzf"], &only("linux-x86-64.tar.gz"));
        unpack("unzip", &["-q", "-j"], &only("windows-x86-64.zip"));
        let bench = Self { debian, folder };
        let said = bench.done(bench.windows(&["--version"]));
        assert!(said.starts_with("plumb "), "{said}");
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Windows' program, in the folder.
    fn windows(&self, arguments: &[&str]) -> Command {
        let inside = self.folder.strip_prefix(&self.debian).unwrap();
        let inside = Path::new("/").join(inside);
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", IN_DEBIAN, "sh"]).arg(&self.debian).arg(&inside);
        command.args(["wine", "plumb.exe"]).args(arguments).env("HOME", &inside);
        command.env("WINEPREFIX", inside.join("wine")).env("WINEDEBUG", "-all");
        // No offer to install .NET or a browser.
        command.env("WINEDLLOVERRIDES", "mscoree=;mshtml=").env_remove("DISPLAY");
        command
    }

    /// Linux' program, in the folder.
    fn linux(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.path("bin/plumb"));
        command.args(arguments).current_dir(&self.folder);
        command.env("XDG_DATA_HOME", self.path("data"));
        command
    }

    /// Runs to the end; what was said on standard output.
    #[track_caller]
    fn done(&self, command: Command) -> String {
        let output = finished(command);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {said}", output.status);
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Provisions a box that sends to this address, and lets Windows know its key.
    fn give_a_box_its_key(&self, person: &str, address: &str) {
        self.done(self.linux(&["provision", "--new-box", "box.toml"]));
        let file = |name: &str| format!("{person}/{name}.toml");
        let [camera, targets, scene] = ["camera", "targets", "scene"].map(file);
        let files = ["--camera", &camera, "--targets", &targets, "--scene", &scene];
        let to = ["--box", "box.toml", "--udp", address, "--new-key", "--out", "box.plb"];
        self.done(self.linux(&[&["provision"][..], &files, &to].concat()));
        let name = ["--name", "ward 3", "--serial", "PL-0001"];
        self.done(self.windows(&[&["keys", "import", "box.key"][..], &name].concat()));
    }

    fn text(&self, name: &str) -> String {
        let path = self.path(name);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }
}

/// Runs a command to its end, or kills it.
#[track_caller]
fn finished(mut command: Command) -> Output {
    let started = Instant::now();
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let mut child = Running(child);
    let read = |mut pipe: Box<dyn std::io::Read + Send>| {
        thread::spawn(move || {
            let mut bytes = Vec::new();
            let _ = pipe.read_to_end(&mut bytes);
            bytes
        })
    };
    let out = read(Box::new(child.0.stdout.take().unwrap()));
    let errors = read(Box::new(child.0.stderr.take().unwrap()));
    let status = loop {
        if let Some(status) = child.0.try_wait().unwrap() {
            break status;
        }
        assert!(started.elapsed() < WITHIN, "{command:?} does not end");
        thread::sleep(Duration::from_millis(20));
    };
    Output { status, stdout: out.join().unwrap(), stderr: errors.join().unwrap() }
}

/// A program that does not outlive its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Who is measured under which condition.
const TRIALS: [(&str, &str); 6] = [
    ("P1", "open"),
    ("P1", "closed"),
    ("P2", "open"),
    ("P2", "closed"),
    ("P3", "open"),
    ("P3", "closed"),
];

/// Waits until some program listens at this UDP port.
#[track_caller]
fn wait_until_heard(port: u16) {
    let started = Instant::now();
    while !listens_at(port) {
        assert!(started.elapsed() < WITHIN, "nobody listens at {port}");
        thread::sleep(Duration::from_millis(50));
    }
}

/// All numbers of a text, in their order.
fn numbers(text: &str) -> Vec<f64> {
    let is_part = |letter: char| letter.is_ascii_alphanumeric() || "+-.".contains(letter);
    text.split(|letter: char| !is_part(letter)).filter_map(|word| word.parse().ok()).collect()
}

/// The largest difference of two texts' numbers, relative to the larger of the number and 1.
#[track_caller]
fn difference(one: &str, other: &str) -> f64 {
    let (one, other) = (numbers(one), numbers(other));
    assert_eq!(one.len(), other.len());
    assert!(one.len() > 10, "{one:?}");
    let pairs = one.iter().zip(&other).filter(|(one, other)| one != other);
    pairs.map(|(one, other)| (one - other).abs() / one.abs().max(1.0)).fold(0.0, f64::max)
}

/// Without what names the time and the computer.
fn lines_that_last(text: &str) -> String {
    let passes = ["date", "made", "plumb", "utc"];
    let lasts = |line: &&str| !passes.iter().any(|word| line.starts_with(word));
    text.lines().filter(lasts).collect::<Vec<_>>().join("\n")
}

#[test]
fn photographs_are_calibrated_with_a_pattern_that_no_shell_expands() {
    let bench = &*BENCH;
    bench.done(bench.linux(&["simulate", "--board", "9x6", "--pitch-mm", "20", "--out", "board"]));
    let calibrate = |out| {
        ["calibrate", "--board", "9x6", "--pitch-mm", "20", "--out", out, "board/photos/*.png"]
    };
    bench.done(bench.windows(&calibrate("windows.toml")));
    let mut linux: Vec<_> = calibrate("linux.toml")[..7].to_vec();
    let photographs = fs::read_dir(bench.path("board/photos")).unwrap();
    let photographs = photographs.map(|it| it.unwrap().file_name().into_string().unwrap());
    let mut photographs: Vec<_> = photographs.map(|it| format!("board/photos/{it}")).collect();
    photographs.sort();
    linux.extend(photographs.iter().map(String::as_str));
    bench.done(bench.linux(&linux));
    let [windows, linux] =
        ["windows.toml", "linux.toml"].map(|name| lines_that_last(&bench.text(name)));
    let difference = difference(&windows, &linux);
    println!("camera: largest relative difference {difference:e}");
    assert!(difference < 1e-6, "{difference}:\n{windows}\n{linux}");
}

#[test]
fn tracked_poses_are_the_same_to_the_last_bit() {
    let bench = &*BENCH;
    bench.done(bench.linux(&["simulate", "--frames", "120", "--out", "tracked"]));
    let track = |out| {
        let files = ["--camera", "tracked/camera.toml", "--targets", "tracked/targets.toml"];
        let scene = ["--scene", "tracked/scene.toml", "--out", out, "tracked/frames.y4m"];
        [&["track"][..], &files, &scene].concat()
    };
    bench.done(bench.windows(&track("windows.csv")));
    bench.done(bench.linux(&track("linux.csv")));
    let [windows, linux] = ["windows.csv", "linux.csv"].map(|name| bench.text(name));
    assert!(linux.lines().count() > 240 && numbers(&linux).len() > 2000);
    assert!(windows == linux, "the poses differ: {:e}", difference(&windows, &linux));
    println!("{} numbers of poses, each the same", numbers(&linux).len());
}

/// The box's real program on this computer sends to Windows' `plumb receive`, over the trusted link: its
/// key comes from the file that Linux' `plumb provision` has written.
#[test]
fn a_box_is_received_recorded_reported_and_compared() {
    let bench = &*BENCH;
    let port = free_port();
    let address = format!("127.0.0.1:{port}");
    let mut trials = Vec::new();
    for (seed, (participant, condition)) in (1..).zip(TRIALS) {
        let person = format!("person-{seed}");
        let seed = seed.to_string();
        let frames = ["--lens", "vga", "--frames", "480", "--seed", &seed, "--out", &person];
        bench.done(bench.linux(&[&["simulate"][..], &frames].concat()));
        if trials.is_empty() {
            bench.give_a_box_its_key(&person, &address);
        }
        let trial = format!("trials/{participant}-{condition}");
        let whom = ["--participant", participant, "--condition", condition];
        let how = ["--anyway", "--past", "--zero", "start", "--frames", "450"];
        let receive = ["receive", "--udp", &address, "--out", &trial];
        let receive = bench.windows(&[&receive[..], &whom, &how].concat());
        let receiver = thread::spawn(move || finished(receive));
        wait_until_heard(port);
        let mut board = Command::new(bench.path("lib/plumb/plumbline-board"));
        board.args(["--config", "box.plb", "--replay", &format!("{person}/frames.y4m")]);
        board.current_dir(&bench.folder).stdin(Stdio::null());
        let board = board.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let board = Running(board);
        let output = receiver.join().unwrap();
        drop(board);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{trial}: {}: {said}", output.status);
        trials.push(trial);
    }
    let recorded = bench.text(&format!("{}/samples.csv", trials[0]));
    assert!(recorded.lines().count() > 450, "{} lines", recorded.lines().count());
    let study = "title = \"Standing\"\ntrials = [\"trials/*\"]\n\
                 conditions = [\"open\", \"closed\"]\nbins_s = [[0, 3], [3, 6]]\n\
                 figures = [\"RMS AP\"]\n";
    fs::write(bench.path("study.toml"), study).unwrap();

    let systems: [(Program, &str); 2] = [(Bench::windows, "windows"), (Bench::linux, "linux")];
    for (program, name) in systems {
        let file = |it| format!("{name}-{it}");
        let all: Vec<&str> = trials.iter().map(String::as_str).collect();
        let out = ["--span", "0-6", "--out", &file("figures.csv")];
        bench.done(program(bench, &[&["figures"][..], &all, &out].concat()));
        bench.done(program(bench, &["report", &trials[0], "--out", &file("report.html")]));
        bench.done(program(bench, &["study", "study.toml", "--json", &file("study.json")]));
    }
    let [windows, linux] = ["windows", "linux"].map(|it| bench.text(&format!("{it}-figures.csv")));
    let of_figures = difference(&windows, &linux);
    let study = |name: &str| {
        let json: Value = serde_json::from_str(&bench.text(&format!("{name}-study.json"))).unwrap();
        json.to_string()
    };
    let of_study = difference(&study("windows"), &study("linux"));
    println!("figures: largest relative difference {of_figures:e}; study: {of_study:e}");
    assert!(of_figures < WITHIN_SHARE && of_study < WITHIN_SHARE, "{of_figures} {of_study}");
    let report = bench.text("windows-report.html");
    assert!(report.starts_with("<!DOCTYPE html>") && report.contains("<svg"), "no report");
}

#[test]
fn what_windows_lacks_is_said() {
    let bench = &*BENCH;
    let output = finished(bench.windows(&["demo", "--frames", "60", "--out", "demo"]));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("runs on Linux only"), "{said}");
}
