//! What `plumb export` writes, opened by programs of other people.
//!
//! They are Python packages. `cargo xtask test` installs them and says where in
//! `PLUMBLINE_PYTHON`; without it these tests do nothing, and say so.

use crate::common::finished;
use crate::common::trial;
use nalgebra::Vector3;
use plumbline::config::BLOB_BYTES_MAX;
use plumbline::packet::{MeasuredPose, TargetPacket};
use plumbline::pose::{Cam, Pose, Scene, Target, rotation_from_vector};
use plumbline::report::TargetState;
use plumbline::target::Role;
use plumbline_stream::fixture;
use plumbline_test_support::{command, python};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::finished::{Finished, plumb};
use crate::common::trial::Frame;
use serde_json::Value;

const RATE_HZ: f64 = 60.0;
const FRAMES: usize = 180;

/// Frames from which t = 0 is the mark.
const ZERO_S: f64 = 0.5;

/// What the person did. In frames 20 to 29 the lower trunk was not seen, in 60 neither, and
/// frames 100 to 104 never came.
fn position_mm(frame: usize) -> [Option<[f64; 3]>; 2] {
    let at = frame as f64 / RATE_HZ;
    // As they arrive: in single precision.
    let single = |values: [f64; 3]| values.map(|it| f64::from(it as f32));
    let lower = single([8.0 * (2.0 * at).sin(), -5.0 * (3.0 * at).cos(), 1000.0 + at]);
    let upper = single([12.0 * (2.0 * at).sin(), -7.0 + at, 1400.25]);
    match frame {
        20..30 => [None, Some(upper)],
        60 | 100..105 => [None, None],
        _ => [Some(lower), Some(upper)],
    }
}

/// The trial in a new directory.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Frame> = (0..FRAMES)
        .filter(|frame| !(100..105).contains(frame))
        .map(|frame| {
            let [lower_mm, upper_mm] = position_mm(frame);
            let time_s = frame as f64 / RATE_HZ;
            Frame { sequence: frame as u32, time_s, lower_mm, upper_mm }
        })
        .collect();
    write(&folder.path().join("trial"), &frames, &[(ZERO_S, "stands"), (2.0, "\"turns\"")]);
    folder
}

/// The trial of a box that knows which way is forward.
fn write(folder: &Path, frames: &[Frame], marks: &[(f64, &str)]) {
    let config = fixture::config();
    let cam_from_scene = Pose::<Cam, Scene>::from_theta(config.cam_from_scene_theta.unwrap());
    trial::write_with(folder, frames, marks, |frame| {
        let target = |role, angle_rad: f64| {
            // To the person's left is about the vertical axis, which points down in the scene.
            let turned = rotation_from_vector(&Vector3::new(0.0, -angle_rad, 0.0));
            let cam_from_target =
                Pose::<Cam, Target>::new(cam_from_scene.rotation * turned, Vector3::z() * 1e3);
            let [a, b, c, x, y, z] = cam_from_target.theta().map(|it| it as f32);
            let pose =
                MeasuredPose { theta_rad: [a, b, c], translation_mm: [x, y, z], ..fixture::pose() };
            TargetPacket { role, state: TargetState::Tracking, pose: Ok(pose) }
        };
        let [lower_rad, upper_rad] = angle_rad(frame.sequence as usize);
        let lower = frame.lower_mm.map(|_| target(Role::Lower, lower_rad));
        let upper = frame.upper_mm.map(|_| target(Role::Upper, upper_rad));
        lower.into_iter().chain(upper).collect()
    });
    let mut blob = [0; BLOB_BYTES_MAX];
    std::fs::write(folder.join("config.plb"), config.encode(&mut blob).unwrap()).unwrap();
}

/// How far to the left the person has turned the lower and the upper trunk.
fn angle_rad(frame: usize) -> [f64; 2] {
    let at = frame as f64 / RATE_HZ;
    [0.1 * (2.0 * at).sin() - 0.05, 0.3 * at]
}

fn export(folder: &Path, format: &str, name: &str) -> PathBuf {
    let done = plumb(folder, &["export", "trial", "--format", format, "--out", name]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert!(done.stdout.contains("180 rows at 60.000 Hz, t = 0: the mark \"stands\""));
    folder.join(name)
}

/// What a reader says.
fn read(python: &Path, reader: &str, path: &Path) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/export/read.py");
    let done = Command::new(python).arg(script).arg(reader).arg(path).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{reader} does not open {}: {said}", path.display());
    serde_json::from_slice(&done.stdout).unwrap()
}

/// Asserts that the rows are those of the trial: with a time before them or not, within what
/// the format rounds.
#[track_caller]
fn assert_rows(found: &Value, with_time: bool, turned: fn([f64; 3]) -> [f64; 3], within: f64) {
    // Orientations are where the body's axes are.
    let has_orientations = with_time && turned([0.0, 1.0, 0.0])[1] > 0.0;
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), FRAMES);
    for (frame, row) in rows.iter().enumerate() {
        let mut cells = row.as_array().unwrap().iter();
        if with_time {
            // Times have microseconds; the mark's packet was under way as long as the frames'.
            let time_s = cells.next().unwrap().as_f64().unwrap();
            assert!((time_s - (frame as f64 / RATE_HZ - ZERO_S)).abs() < 2e-6, "{frame}: {time_s}");
        }
        let points = position_mm(frame).into_iter().zip(angle_rad(frame));
        let wanted = points.flat_map(|(position_mm, angle_rad)| {
            let half_rad = 0.5 * angle_rad;
            let turn = [half_rad.cos(), 0.0, 0.0, half_rad.sin()];
            let position = position_mm.map_or([None; 3], |values| turned(values).map(Some));
            let turn = turn.map(|it| position_mm.is_some().then_some(it));
            let turn = turn.into_iter().filter(|_| has_orientations);
            position.into_iter().chain(turn).collect::<Vec<_>>()
        });
        let cells: Vec<Option<f64>> = cells.map(Value::as_f64).collect();
        let wanted: Vec<Option<f64>> = wanted.collect();
        assert_eq!(cells.len(), wanted.len());
        for (cell, wanted) in cells.iter().zip(&wanted) {
            let alike = match (cell, wanted) {
                // The angles arrive in single precision, and lie below 1.
                (Some(cell), Some(wanted)) if wanted.abs() <= 1.0 && has_orientations => {
                    (cell - wanted).abs() <= 2e-7
                }
                (Some(cell), Some(wanted)) => (cell - wanted).abs() <= within * wanted.abs(),
                (cell, wanted) => cell == wanted,
            };
            assert!(alike, "frame {frame}: {cells:?} instead of {wanted:?}");
        }
    }
}

/// Shortest digits of single precision, read as double precision: half of its last bit.
const DIGITS: f64 = 6e-8;

/// What the way through JSON leaves of double precision.
const SAME: f64 = 1e-15;

const COLUMNS: [&str; 15] = [
    "time_s",
    "lower_ap_mm",
    "lower_ml_mm",
    "lower_si_mm",
    "lower_quat_w",
    "lower_quat_x",
    "lower_quat_y",
    "lower_quat_z",
    "upper_ap_mm",
    "upper_ml_mm",
    "upper_si_mm",
    "upper_quat_w",
    "upper_quat_x",
    "upper_quat_y",
    "upper_quat_z",
];

fn left([ap, ml, si]: [f64; 3]) -> [f64; 3] {
    [ap, -ml, si]
}

#[test]
fn tables_are_read_by_arrow() {
    let Some(python) = python() else { return };
    let folder = bench();
    let csv = read(&python, "csv", &export(folder.path(), "csv", "trial.csv"));
    assert_eq!(csv["names"], serde_json::json!(COLUMNS));
    assert_eq!(csv["types"], serde_json::json!(vec!["double"; 15]));
    assert_rows(&csv, true, |it| it, DIGITS);
    let parquet = read(&python, "parquet", &export(folder.path(), "parquet", "trial.parquet"));
    assert_eq!(parquet["names"], serde_json::json!(COLUMNS));
    assert_eq!(parquet["types"], serde_json::json!(vec!["double"; 15]));
    assert!(parquet["axes"].as_str().unwrap().contains("ml: to the person's right"));
    assert!(parquet["orientations"].as_str().unwrap().contains("Y to the left (-ML)"));
    assert_rows(&parquet, true, |it| it, SAME);
}

#[test]
fn a_trc_is_read_by_a_reader_of_motion_capture() {
    let Some(python) = python() else { return };
    let folder = bench();
    let trc = read(&python, "trc", &export(folder.path(), "trc", "trial.trc"));
    assert_eq!(trc["names"], serde_json::json!(["lower_trunk", "upper_trunk"]));
    assert_eq!((&trc["NumFrames"], &trc["NumMarkers"]), (&180.into(), &2.into()));
    assert_eq!((&trc["DataRate"], &trc["Units"]), (&60.0.into(), &"mm".into()));
    assert_rows(&trc, true, left, DIGITS);
}

#[test]
fn a_c3d_is_read_by_two_readers() {
    let Some(python) = python() else { return };
    let folder = bench();
    let path = export(folder.path(), "c3d", "trial.c3d");
    for reader in ["ezc3d", "c3d"] {
        let c3d = read(&python, reader, &path);
        assert_eq!(c3d["names"], serde_json::json!(["lower_trunk", "upper_trunk"]), "{reader}");
        // The rate is in single precision.
        assert!((c3d["rate"].as_f64().unwrap() - RATE_HZ).abs() < 1e-5, "{reader}");
        assert_rows(&c3d, false, left, SAME);
        for (frame, residuals) in c3d["residuals"].as_array().unwrap().iter().enumerate() {
            let wanted = position_mm(frame).map(|it| if it.is_some() { 0.0 } else { -1.0 });
            assert_eq!(*residuals, serde_json::json!(wanted), "{reader}, frame {frame}");
        }
    }
    let c3d = read(&python, "ezc3d", &path);
    assert_eq!((&c3d["frames"], &c3d["units"][0]), (&180.into(), &"mm".into()));
    assert!((c3d["zero"].as_f64().unwrap() - ZERO_S).abs() < 1e-6);
    let axes = "X forward (AP), Y to the left (-ML), Z up (SI)";
    assert_eq!(c3d["axes"], axes);
    assert_eq!(c3d["descriptions"][1], format!("upper trunk: {axes}"));
    let events = serde_json::json!([
        ["General", "stands", 0.0, 0.5],
        ["General", "t_zero", 0.0, 0.5],
        ["General", "\"turns\"", 0.0, 2.0],
    ]);
    let near = |(found, wanted): (&Value, &Value)| {
        let [found, wanted] = [found, wanted].map(|it| it[3].as_f64().unwrap());
        (found - wanted).abs() < 2e-6
    };
    let found = c3d["events"].as_array().unwrap();
    let wanted = events.as_array().unwrap();
    assert_eq!(found.len(), 3);
    assert!(found.iter().zip(wanted).all(near), "{found:?}");
    let labels = |events: &[Value]| -> Vec<Value> {
        let mut labels: Vec<Value> = events.iter().map(|it| it[1].clone()).collect();
        labels.sort_by_key(Value::to_string);
        labels
    };
    assert_eq!(labels(found), labels(wanted));
    assert!(found.iter().all(|it| it[0] == "General" && it[2] == 0.0), "{found:?}");
}

/// An hour has more frames than the header can count.
#[test]
fn a_c3d_of_twenty_minutes_has_all_its_frames() {
    const LONG: usize = 70_000;
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let frame = |frame: usize| Frame {
        sequence: frame as u32,
        time_s: frame as f64 / RATE_HZ,
        lower_mm: Some([frame as f64, 1.0, 2.0]),
        upper_mm: (frame != 69_000).then_some([3.0, 4.0, frame as f64]),
    };
    let frames: Vec<Frame> = (0..LONG).map(frame).collect();
    trial::write(&folder.path().join("trial"), &frames, &[]);
    let done = plumb(folder.path(), &["export", "trial", "--format", "c3d", "--out", "long.c3d"]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    for reader in ["ezc3d", "c3d"] {
        let c3d = read(&python, reader, &folder.path().join("long.c3d"));
        let rows = c3d["rows"].as_array().unwrap();
        assert_eq!(rows.len(), LONG, "{reader}");
        assert_eq!(rows[69_999], serde_json::json!([69_999.0, -1.0, 2.0, 3.0, -4.0, 69_999.0]));
        assert_eq!(rows[69_000][5], Value::Null, "{reader}");
    }
}

#[test]
fn a_bids_folder_passes_its_validator() {
    let Some(python) = python() else { return };
    let folder = bench();
    let path = export(folder.path(), "bids", "dataset");
    let said = read(&python, "bids", &path);
    let errors: Vec<&Value> =
        said["issues"].as_array().unwrap().iter().filter(|it| it[0] == "error").collect();
    assert!(said["code"] == 0 && errors.is_empty(), "{said}");
    let stem = "sub-p01/motion/sub-p01_task-control_tracksys-plumbline_run-1";
    let motion = path.join(format!("{stem}_motion.tsv"));
    let text = std::fs::read_to_string(&motion).unwrap();
    assert_eq!(text.lines().count(), FRAMES);
    assert_eq!(text.lines().nth(60).unwrap().matches("\tn/a").count(), 14);
    let events = std::fs::read_to_string(path.join(format!("{stem}_events.tsv"))).unwrap();
    assert!(events.contains("\t0\t'turns'\n") && events.contains("\t0\tt_zero\n"), "{events}");
    // A column less than channels.tsv names: the validator must see that.
    let cut: String =
        text.lines().map(|line| line.rsplit_once('\t').unwrap().0.to_owned() + "\n").collect();
    std::fs::write(&motion, cut).unwrap();
    assert_ne!(read(&python, "bids", &path)["code"], 0);
}

/// A trial of another participant, condition and time of day.
fn trial_of(folder: &Path, name: &str, participant: &str, condition: &str, started: &str) {
    let path = folder.join(name).join("trial.toml");
    std::fs::create_dir(folder.join(name)).unwrap();
    for file in ["packets.bin", "config.plb", "trial.toml"] {
        std::fs::copy(folder.join("trial").join(file), folder.join(name).join(file)).unwrap();
    }
    let manifest = std::fs::read_to_string(&path).unwrap();
    let manifest = manifest
        .replace("\"p-01\"", &format!("\"{participant}\""))
        .replace("\"control\"", &format!("\"{condition}\""))
        .replace("2026-01-01T00:00:00Z", started);
    std::fs::write(path, manifest).unwrap();
}

fn bids(folder: &Path, trial: &str, more: &[&str]) -> Finished {
    let arguments = ["export", trial, "--format", "bids", "--out", "sway-bids"];
    plumb(folder, &[&arguments[..], more].concat())
}

fn names_below(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        match path.is_dir() {
            true => names.extend(names_below(&path).into_iter().map(|it| format!("{name}/{it}"))),
            false => names.push(name),
        }
    }
    names.sort();
    names
}

/// Participants, conditions, runs and sessions, and what others have written between.
#[test]
fn a_study_becomes_one_data_set() {
    let folder = bench();
    let folder = folder.path();
    let trials = [
        ("a", "P01", "open", "2026-01-01T10:00:00Z"),
        ("b", "P01", "open", "2026-01-01T10:05:00Z"),
        ("c", "P01", "closed", "2026-01-01T10:10:00Z"),
        ("d", "P02", "open", "2026-01-02T10:00:00Z"),
        ("e", "P02", "open", "2026-02-02T10:00:00Z"),
    ];
    for (name, participant, condition, started) in trials {
        trial_of(folder, name, participant, condition, started);
    }
    let added = |trial: &str, more: &[&str]| {
        let done = bids(folder, trial, more);
        assert_eq!(done.code, Some(0), "{trial}: {}", done.stderr);
    };
    let set = folder.join("sway-bids");
    let path = |name: &str| set.join(name);
    added("a", &[]);
    // Somebody adds a column, and a word.
    let participants = "participant_id\tage\nsub-P01\t34\n";
    std::fs::write(path("participants.tsv"), participants).unwrap();
    std::fs::write(path("README"), "Our study of sway, with details that a reader needs.\n")
        .unwrap();
    added("b", &[]);
    added("c", &["--run", "4"]);
    added("d", &["--session", "pre"]);
    added("e", &["--session", "post"]);
    let text = |name: &str| std::fs::read_to_string(path(name)).unwrap();
    assert_eq!(text("participants.tsv"), participants.to_owned() + "sub-P02\tn/a\n");
    assert!(text("README").starts_with("Our study"));
    let scans = "filename\tacq_time\n\
        motion/sub-P01_task-open_tracksys-plumbline_run-1_motion.tsv\t2026-01-01T10:00:00.000000Z\n\
        motion/sub-P01_task-open_tracksys-plumbline_run-2_motion.tsv\t2026-01-01T10:05:00.000000Z\n\
        motion/sub-P01_task-closed_tracksys-plumbline_run-4_motion.tsv\t\
        2026-01-01T10:10:00.000000Z\n";
    assert_eq!(text("sub-P01/sub-P01_scans.tsv"), scans);
    let names = names_below(&set);
    for motion in [
        "sub-P02/ses-pre/motion/sub-P02_ses-pre_task-open_tracksys-plumbline_run-1_motion.tsv",
        "sub-P02/ses-post/motion/sub-P02_ses-post_task-open_tracksys-plumbline_run-1_motion.tsv",
        "sub-P02/ses-post/sub-P02_ses-post_scans.tsv",
    ] {
        assert!(names.iter().any(|it| it == motion), "{motion}: {names:?}");
    }
    if let Some(python) = python() {
        let said = read(&python, "bids", &set);
        let issues = said["issues"].as_array().unwrap();
        assert!(said["code"] == 0 && issues.iter().all(|it| it[0] != "error"), "{said}");
    }

    // What is not right is refused, and changes nothing.
    let before = names_below(&set);
    for (trial, more, parts) in [
        ("a", &[][..], &["run-1_motion.tsv: this trial is in the data set already", "--force"][..]),
        ("a", &["--run", "3"], &["already", "--run 1 and --force"]),
        ("c", &["--run", "3", "--force"], &["already", "--run 4 and --force"]),
        ("b", &["--run", "1", "--force"], &["already", "--run 2 and --force"]),
        ("e", &["--session", "pre", "--run", "1"], &["this run is another trial's", "--force"]),
        ("d", &[], &["has sessions, such as \"post\"", "--session LABEL"]),
        ("a", &["--session", "pre"], &["has recordings without a session", "leave --session out"]),
        ("d", &["--session", "1/2"], &["--session: \"1/2\" is no label"]),
    ] {
        let refused = bids(folder, trial, more);
        assert_eq!(refused.code, Some(2), "{trial} {more:?}: {}", refused.stderr);
        for part in parts {
            assert!(refused.stderr.contains(part), "{trial} {more:?}: {}", refused.stderr);
        }
    }
    std::fs::write(
        folder.join("d/trial.toml"),
        std::fs::read_to_string(folder.join("d/trial.toml"))
            .unwrap()
            .replace("participant = \"P02\"\n", ""),
    )
    .unwrap();
    let nobody = bids(folder, "d", &[]);
    assert!(
        nobody.stderr.contains("d/trial.toml: participant: it is not known"),
        "{}",
        nobody.stderr
    );
    assert_eq!(names_below(&set), before);

    // And with --force the same run is written again.
    added("b", &["--force"]);
    assert_eq!(names_below(&set), before);
    assert_eq!(text("sub-P01/sub-P01_scans.tsv"), scans);
    let table = plumb(folder, &["export", "a", "--format", "csv", "--out", "a.csv", "--run", "2"]);
    assert!(
        table.stderr.contains("--run: only a data set has sessions and runs"),
        "{}",
        table.stderr
    );
}

/// Labels have letters and digits only: two persons, or two conditions, may not become one.
#[test]
fn a_label_that_is_another_ones_is_refused() {
    let folder = bench();
    let folder = folder.path();
    for (name, participant, condition, started) in [
        ("a", "P-1", "eyes open", "2026-01-01T10:00:00Z"),
        ("b", "P1", "eyes open", "2026-01-01T10:05:00Z"),
        ("c", "P-1", "eyes-open", "2026-01-01T10:10:00Z"),
        ("d", "P-1", "eyes closed", "2026-01-01T10:15:00Z"),
        ("e", "P-1", "eyes open", "2026-01-01T10:20:00Z"),
        ("f", " ", "eyes open", "2026-01-01T10:25:00Z"),
    ] {
        trial_of(folder, name, participant, condition, started);
    }
    let first = bids(folder, "a", &["--session", "pre"]);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let set = folder.join("sway-bids");
    let before = names_below(&set);
    for (trial, part) in [
        ("b", "ParticipantCode: this label is of \"P-1\" there, and the trial is of \"P1\""),
        ("c", "TaskName: this label is of \"eyes open\" there, and the trial is of \"eyes-open\""),
        ("f", "it is not known whose recording this is"),
    ] {
        // In another session it is the same participant too.
        let refused = bids(folder, trial, &["--session", "post"]);
        assert_eq!(refused.code, Some(2), "{trial}: {}", refused.stderr);
        assert!(refused.stderr.contains(part), "{trial}: {}", refused.stderr);
        assert_eq!(names_below(&set), before, "{trial}");
    }
    for trial in ["d", "e"] {
        let done = bids(folder, trial, &["--session", "pre"]);
        assert_eq!(done.code, Some(0), "{trial}: {}", done.stderr);
    }
    if let Some(python) = python() {
        let said = read(&python, "bids", &set);
        let issues = said["issues"].as_array().unwrap();
        assert!(said["code"] == 0 && issues.iter().all(|it| it[0] != "error"), "{said}");
    }
}

#[test]
fn a_data_set_that_cannot_be_written_whole_leaves_nothing() {
    let folder = bench();
    // A file may have 4 KiB: the error is another one than that of a full disk, its way the same.
    let plumb = command(env!("CARGO_BIN_EXE_plumb"));
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -f 8; trap '' XFSZ; exec \"$@\"", "sh"]).arg(plumb.get_program());
    shell.args(plumb.get_args()).args(["export", "trial", "--format", "bids", "--out", "dataset"]);
    shell.current_dir(folder.path());
    let refused = finished::ended(shell);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    assert!(refused.stderr.contains("file too large"), "{}", refused.stderr);
    assert!(!folder.path().join("dataset").exists());
    // And the next one has its place.
    assert!(export(folder.path(), "bids", "dataset").is_dir());
}

#[test]
fn nothing_is_overwritten_unasked() {
    let folder = bench();
    let arguments = ["export", "trial", "--format", "csv", "--out", "trial.csv"];
    assert_eq!(plumb(folder.path(), &arguments).code, Some(0));
    let again = plumb(folder.path(), &arguments);
    assert_eq!(again.code, Some(2));
    assert!(again.stderr.contains("trial.csv: exists already"), "{}", again.stderr);
    let forced: Vec<&str> = arguments.into_iter().chain(["--force"]).collect();
    assert_eq!(plumb(folder.path(), &forced).code, Some(0));
    let taken = ["export", "trial", "--format", "bids", "--out", "trial", "--force"];
    let refused = plumb(folder.path(), &taken);
    assert_eq!(refused.code, Some(2));
    assert!(
        refused.stderr.contains("it is no BIDS data set: it has no dataset"),
        "{}",
        refused.stderr
    );
    let absent = plumb(folder.path(), &["export", "no", "--format", "csv", "--out", "no.csv"]);
    assert_eq!(absent.code, Some(2));
    assert!(absent.stderr.contains("not the folder of a trial"), "{}", absent.stderr);
}
