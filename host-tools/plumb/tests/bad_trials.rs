//! Trials, tables and settings that cannot be used: every command says what is wrong with what,
//! and what to do, in one line, with exit code 2; and writes nothing.

use crate::common::finished;
use crate::common::trial;
use std::path::Path;

use crate::common::trial::Frame;
use tempfile::TempDir;

const FRAMES: u32 = 600;

/// Ten seconds on an ellipse.
fn ellipse() -> Vec<Frame> {
    let frame = |at: u32| {
        let time_s = f64::from(at) / 60.0;
        let angle = std::f64::consts::TAU * 0.3 * time_s;
        let position_mm = Some([5.0 * angle.cos(), 4.0 * angle.sin(), 900.0 + angle.sin()]);
        Frame { sequence: at, time_s, lower_mm: position_mm, upper_mm: position_mm }
    };
    (0..FRAMES).map(frame).collect()
}

fn setting() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    trial::write(&folder.path().join("t1"), &ellipse(), &[(1.0, "stands")]);
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    std::fs::write(folder.path().join("there.json"), "kept").unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|it| it.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[track_caller]
fn refused(folder: &TempDir, arguments: &str, parts: &[&str]) {
    let before = names(folder.path());
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let finished = finished::plumb(folder.path(), &words);
    let said = finished.stdout + &finished.stderr;
    assert_eq!(finished.code, Some(2), "{arguments}: {said}");
    assert!(said.contains("error: "), "{arguments}: {said}");
    for part in parts {
        assert!(said.contains(part), "{arguments}: no {part:?} in {said}");
    }
    assert_eq!(names(folder.path()), before, "{arguments} left something behind");
}

#[test]
fn what_is_no_trial_is_refused_by_every_command() {
    let folder = setting();
    for command in [
        "analyze WHAT",
        "report WHAT",
        "replay WHAT --to 127.0.0.1:9",
        "export WHAT --format csv --out new.csv",
        "validate --trial WHAT --reference there.trc",
    ] {
        for (what, part) in [("nowhere", "not the folder of a trial"), ("empty", "trial.toml")] {
            refused(&folder, &command.replace("WHAT", what), &[what, part]);
        }
    }
    // It would make trial.toml again, of packets.
    for (what, part) in [("nowhere", "not the folder of a trial"), ("empty", "packets.bin")] {
        refused(&folder, &format!("replay {what} --tables"), &[what, part]);
    }
}

#[test]
fn settings_that_suit_no_trial_are_refused() {
    let folder = setting();
    for (arguments, parts) in [
        ("analyze t1 --bins 5-3", &["5-3", "0-20"][..]),
        ("analyze t1 --bins a-b", &["a-b"]),
        ("analyze t1 --filter -1", &["--filter", "paper:0.5", "none"]),
        ("analyze t1 --filter paper:nan", &["--filter"]),
        ("analyze t1 --filter paper:60", &["filter", "samples"]),
        ("analyze t1 --filter butterworth:500", &["does not suit a rate of"]),
        ("analyze t1 --covered-min 120", &["--covered-min", "0 to 100 percent"]),
        ("analyze t1 --span 100-200", &["fewer than two samples in the span"]),
        ("analyze t1 --radius 0", &["radius", "--radius"]),
        ("analyze t1 --zero onset", &["nobody rises", "--zero mark"]),
        ("analyze t1 --json there.json", &["there.json", "--force"]),
        ("report t1 --out there.json", &["there.json", "--force"]),
        ("report t1 --span 100-200 --out new.html", &["span"]),
        ("export t1 --format c3d --out there.json", &["there.json", "--force"]),
        (
            "export t1 --format csv --out there.json/new.csv",
            &["there.json", "file is in its place"],
        ),
        ("replay t1 --to 127.0.0.1:9 --speed 0", &["--speed", "0.01"]),
        ("replay t1 --to nowhere", &["numeric address"]),
        ("receive --udp 127.0.0.1:0 --out t1 --frames 1", &["t1: exists already"]),
        ("validate --trial t1 --reference nowhere.trc", &["nowhere.trc"]),
        ("validate --trial t1 --reference t1/samples.csv", &["--columns"]),
        ("study nowhere.toml", &["nowhere.toml"]),
        ("study --long there.json --response a --within b --subject c", &["no such column"]),
    ] {
        refused(&folder, arguments, parts);
    }
    assert_eq!(std::fs::read(folder.path().join("there.json")).unwrap(), b"kept");
}

/// A table that is cut off by a full disk must not pass for the whole one.
#[test]
fn a_result_that_standard_output_does_not_take_is_an_error() {
    let folder = setting();
    for arguments in [&["figures", "t1", "--out", "-"][..], &["analyze", "t1"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_plumb"));
        let output = command.current_dir(folder.path()).args(arguments).stdout(full).output();
        let output = output.unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("error: standard output: "), "{arguments:?}: {said}");
        assert!(said.contains("make room"), "{arguments:?}: {said}");
    }
}

/// Whoever gives an option relies on it: what it cannot be applied to is refused by its name.
#[test]
fn options_that_would_go_unheard_are_refused() {
    let folder = setting();
    for name in ["study.toml", "marks.trc"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    for option in [
        "--bins 0-30",
        "--filter paper:1",
        "--covered-min 80",
        "--span 0-9",
        "--radius 3",
        "--zero mark",
        "--keep-origins",
    ] {
        let name = option.split(' ').next().unwrap();
        let field = format!("study.toml: {name}: ");
        let parts = [&*field, "settings in study.toml", "leave it out"];
        refused(&folder, &format!("report study.toml {option}"), &parts);
    }
    for option in ["--columns time=t,ap=x", "--unit mm", "--delimiter tab"] {
        refused(&folder, &format!("analyze t1 {option}"), &[option.split(' ').next().unwrap()]);
    }
    for option in
        ["--response a", "--within b", "--subject c", "--delimiter tab", "--drop-incomplete"]
    {
        let name = option.split(' ').next().unwrap();
        refused(&folder, &format!("study study.toml {option}"), &[name]);
        refused(&folder, &format!("study --new new.toml {option}"), &[name]);
    }
    refused(&folder, "study --new new.toml --json new.json", &["--json"]);
    let pair = "validate --trial t1 --reference";
    for (more, parts) in [
        ("there.csv --columns time=t,ap=x --unit mm --marker LPSI", ["there.csv: --marker: "]),
        ("marks.trc --columns time=t,ap=x --unit mm", ["marks.trc: --columns: "]),
        ("marks.trc --event 3 --align lag", ["t1: --event: "]),
        ("marks.trc --event 3 --align none", ["t1: --event: "]),
        ("marks.trc --event 3 --lag-max 5", ["t1: --lag-max: "]),
        ("marks.trc --lag-max 5 --align none", ["t1: --lag-max: "]),
    ] {
        refused(&folder, &format!("{pair} {more}"), &parts);
    }
}

#[test]
fn a_trial_whose_files_are_damaged_is_read_or_refused_but_never_wrongly() {
    let folder = setting();
    let path = |name: &str| folder.path().join("t1").join(name);
    let manifest = std::fs::read_to_string(path("trial.toml")).unwrap();
    for (from, to, part) in [
        ("format = 2", "format = 9", "format: 9"),
        ("format = 2", "format = 1", "format: 1"),
        ("state", "stat", "stat"),
        ("control", "cont\nrol", "trial.toml"),
    ] {
        std::fs::write(path("trial.toml"), manifest.replacen(from, to, 1)).unwrap();
        refused(&folder, "analyze t1", &["trial.toml", part]);
    }
    std::fs::write(path("trial.toml"), &manifest).unwrap();
    let packets = std::fs::read(path("packets.bin")).unwrap();
    std::fs::write(path("packets.bin"), b"not a recording").unwrap();
    refused(&folder, "analyze t1", &["packets.bin"]);
    // A hole in the middle is a gap of the frames that were in it, and said so.
    let mut holed = packets.clone();
    let middle = packets.len() / 2;
    holed[middle..middle + packets.len() / 20].fill(0xa5);
    std::fs::write(path("packets.bin"), &holed).unwrap();
    let finished = finished::plumb(folder.path(), &["analyze", "t1", "--bins", "0-5"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stderr.contains("bytes of packets.bin belong to no packet"));
    assert!(finished.stdout.contains("1 gap of 0.5"), "{}", finished.stdout);
    // A packet with a position that is no number is a corrupt one: its frame is a gap.
    let mut frames = ellipse();
    frames[200].lower_mm = Some([f64::NAN, 0.0, 0.0]);
    trial::write(&folder.path().join("t2"), &frames, &[]);
    let finished = finished::plumb(folder.path(), &["analyze", "t2", "--bins", "0-5"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stdout.contains("1 gap of 0.0"), "{}", finished.stdout);
    // The configuration is another box's, or none at all: there is no uncertainty, and a reason.
    std::fs::write(path("packets.bin"), &packets).unwrap();
    std::fs::write(path("config.plb"), b"no configuration").unwrap();
    let finished = finished::plumb(folder.path(), &["analyze", "t1", "--bins", "0-5"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stderr.contains("config.plb"), "{}", finished.stderr);
    assert!(!finished.stdout.contains("noise alone"), "{}", finished.stdout);
}
