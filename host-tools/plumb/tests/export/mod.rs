//! What `plumb export` writes, opened by programs of other people.
//!
//! They are Python packages. `cargo xtask test` installs them and says where in
//! `PLUMBLINE_PYTHON`; without it these tests do nothing, and say so.

use crate::common::finished;
use crate::common::trial;
use plumbline_test_support::{Absent, command, skip};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::finished::plumb;
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
    trial::write(&folder.path().join("trial"), &frames, &[(ZERO_S, "stands"), (2.0, "\"turns\"")]);
    folder
}

fn python() -> Option<PathBuf> {
    let python = std::env::var_os("PLUMBLINE_PYTHON").map(PathBuf::from);
    if python.is_none() {
        skip(Absent::Tool, "PLUMBLINE_PYTHON does not say which Python has the readers");
    }
    python
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
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), FRAMES);
    for (frame, row) in rows.iter().enumerate() {
        let mut cells = row.as_array().unwrap().iter();
        if with_time {
            // Times have microseconds; the mark's packet was under way as long as the frames'.
            let time_s = cells.next().unwrap().as_f64().unwrap();
            assert!((time_s - (frame as f64 / RATE_HZ - ZERO_S)).abs() < 2e-6, "{frame}: {time_s}");
        }
        let wanted = position_mm(frame).into_iter().flat_map(|position_mm| match position_mm {
            Some(values) => turned(values).map(Some),
            None => [None; 3],
        });
        let cells: Vec<Option<f64>> = cells.map(Value::as_f64).collect();
        let wanted: Vec<Option<f64>> = wanted.collect();
        assert_eq!(cells.len(), wanted.len());
        for (cell, wanted) in cells.iter().zip(&wanted) {
            let alike = match (cell, wanted) {
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

const COLUMNS: [&str; 7] = [
    "time_s",
    "lower_ap_mm",
    "lower_ml_mm",
    "lower_si_mm",
    "upper_ap_mm",
    "upper_ml_mm",
    "upper_si_mm",
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
    assert_eq!(csv["types"], serde_json::json!(vec!["double"; 7]));
    assert_rows(&csv, true, |it| it, DIGITS);
    let parquet = read(&python, "parquet", &export(folder.path(), "parquet", "trial.parquet"));
    assert_eq!(parquet["names"], serde_json::json!(COLUMNS));
    assert_eq!(parquet["types"], serde_json::json!(vec!["double"; 7]));
    assert!(parquet["axes"].as_str().unwrap().contains("ml: to the person's right"));
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
    let motion = path.join("sub-p01/motion/sub-p01_task-control_tracksys-plumbline_motion.tsv");
    let text = std::fs::read_to_string(&motion).unwrap();
    assert_eq!(text.lines().count(), FRAMES);
    assert!(text.lines().nth(60).unwrap().ends_with("n/a\tn/a\tn/a\tn/a\tn/a\tn/a"));
    // A column less than channels.tsv names: the validator must see that.
    let cut: String =
        text.lines().map(|line| line.rsplit_once('\t').unwrap().0.to_owned() + "\n").collect();
    std::fs::write(&motion, cut).unwrap();
    assert_ne!(read(&python, "bids", &path)["code"], 0);
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
    assert!(refused.stderr.contains("no data set is overwritten"), "{}", refused.stderr);
    let absent = plumb(folder.path(), &["export", "no", "--format", "csv", "--out", "no.csv"]);
    assert_eq!(absent.code, Some(2));
    assert!(absent.stderr.contains("not the folder of a trial"), "{}", absent.stderr);
}
