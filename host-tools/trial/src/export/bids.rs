//! A data set that follows the Brain Imaging Data Structure, extension for motion: one
//! participant, one task, one run.
//!
//! The body's axes are in it as they are, under the names ap, ml and si. Times that are not quite
//! even are in the channel `latency`.

use std::fmt::Write as _;
use std::path::Path;

use plumbline_analysis::series::Axis;
use plumbline_files::BadInput;
use plumbline_files::write_all;
use serde_json::{Value, json};

use super::rows::Rows;
use super::{BODY_AXES, csv};
use crate::Trial;
use crate::points::Points;

/// The version of the standard.
const VERSION: &str = "1.11.0";

/// Writes the folder, and returns what a user should know.
///
/// # Errors
/// When the folder exists, or cannot be written; then nothing of it is left.
pub fn write(
    rows: &Rows,
    trial: &Trial,
    points: &Points,
    out: &Path,
) -> Result<Vec<String>, BadInput> {
    let mut warnings = Vec::new();
    let mut label = |given: Option<&String>, what: &str, otherwise: &str| {
        let given = given.map_or("", String::as_str);
        let letters: String = given.chars().filter(char::is_ascii_alphanumeric).collect();
        let label = if letters.is_empty() { otherwise.to_owned() } else { letters };
        if label != given {
            warnings.push(format!(
                "the {what} {given:?} is {label:?} in the data set, whose labels have letters and \
                 digits only"
            ));
        }
        label
    };
    let participant = label(trial.manifest.participant.as_ref(), "participant", "01");
    let task = label(trial.manifest.condition.as_ref(), "condition", "standing");
    let subject = format!("sub-{participant}");
    let stem = format!("{subject}_task-{task}_tracksys-plumbline");

    let top = [
        ("dataset_description.json", pretty(&description())),
        ("README", readme(rows)),
        ("participants.tsv", format!("participant_id\n{subject}\n")),
    ];
    // The standard allows at most microseconds.
    let started = trial.manifest.started.parse::<jiff::Timestamp>();
    let started = started.map_or_else(|_| "n/a".to_owned(), |time| format!("{time:.6}"));
    let scans = format!("filename\tacq_time\nmotion/{stem}_motion.tsv\t{started}\n");
    let parts = [
        ("motion.tsv", motion(rows)),
        ("motion.json", pretty(&motion_json(rows, trial, &task))),
        ("channels.tsv", channels(rows)),
        ("channels.json", pretty(&channels_json())),
        ("events.tsv", events(points, rows.first_s())),
        ("events.json", pretty(&events_json(&points.zero))),
    ];
    let folder = out.join(&subject).join("motion");
    if out.exists() {
        let remedy = "give another --out: no data set is overwritten";
        return Err(BadInput::whole(out.display(), "exists already", remedy));
    }
    let top = top.into_iter().map(|(name, text)| (out.join(name), text));
    let scans = [(out.join(&subject).join(format!("{subject}_scans.tsv")), scans)];
    let parts = parts.into_iter().map(|(name, text)| (folder.join(format!("{stem}_{name}")), text));
    let all = top.chain(scans).chain(parts).map(|(path, text)| (path, text.into_bytes()));
    let written = std::fs::create_dir_all(&folder)
        .map_err(|error| BadInput::io(out.display(), &error))
        .and_then(|()| write_all(&all.collect::<Vec<_>>(), false));
    if written.is_err() {
        // It did not exist before, and would be in the way of the next attempt.
        let _ = std::fs::remove_dir_all(out);
    }
    written.map(|()| warnings)
}

const README: &str = "Postural sway, recorded with Plumbline: positions of the lower and of the upper \
trunk of a standing person, seen by one camera from behind as two printed targets.

Positions are in millimetres along the axes of the body: AP forward, ML to the person's right, SI \
up. These three are a left-handed frame.

The time of each sample, in seconds from the first, is in the channel \"latency\". Samples in which a \
point was not seen are n/a. The event \"t_zero\" is the trial's t = 0. The acquisition time is when \
the recording began, shortly before the first sample.
";

fn readme(rows: &Rows) -> String {
    match rows.moved() {
        Some(moved) => format!("{README}\nThe camera has a rolling shutter: {moved}.\n"),
        None => README.to_owned(),
    }
}

fn description() -> Value {
    json!({
        "Name": "Postural sway",
        "BIDSVersion": VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "plumb", "Version": env!("CARGO_PKG_VERSION")}],
    })
}

/// No header: [`channels`] names the columns.
fn motion(rows: &Rows) -> String {
    let first_s = rows.first_s();
    let mut text = String::new();
    for (row, time_s) in rows.time_s.iter().enumerate() {
        text += &csv::seconds(time_s - first_s);
        for point in &rows.points {
            text += &csv::cells(point.position_mm[row], '\t', "n/a");
        }
        text.push('\n');
    }
    text
}

fn motion_json(rows: &Rows, trial: &Trial, task: &str) -> Value {
    let channels = 3 * rows.points.len();
    let seen = rows.points.iter().flat_map(|point| &point.position_mm).flatten().count();
    let cells = rows.time_s.len() * rows.points.len();
    let mut about = json!({
        "TaskName": task,
        "SamplingFrequency": rows.rate_hz,
        "SamplingFrequencyEffective": rows.rate_hz,
        "TrackingSystemName": "plumbline",
        "Manufacturer": "Plumbline",
        "SoftwareVersions": env!("CARGO_PKG_VERSION"),
        "TrackedPointsCount": rows.points.len(),
        "MotionChannelCount": channels + 1,
        "POSChannelCount": channels,
        "LATENCYChannelCount": 1,
        "RecordingDuration": (rows.time_s.len() - 1) as f64 / rows.rate_hz,
        "RecordingType": "continuous",
        "MissingValues": "n/a",
        "SubjectArtefactDescription":
            format!("{:.1} % of the positions are missing", 100.0 * (1.0 - seen as f64 / cells as f64)),
    });
    // The standard allows further fields; these two are ours.
    let verdict = trial.manifest.verdict();
    about["Verdict"] = json!(verdict.grade().word());
    about["VerdictDescription"] = json!(verdict.line());
    if let Some(the_box) = &trial.manifest.the_box {
        about["DeviceSerialNumber"] = json!(the_box.serial_number);
    }
    about
}

fn channels(rows: &Rows) -> String {
    let mut text = "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\n".to_owned();
    text += "latency\tn/a\tLATENCY\tn/a\ts\tn/a\n";
    for point in &rows.points {
        for (axis, component) in Axis::ALL.into_iter().zip(["x", "y", "z"]) {
            let (name, axis) = (&point.name, axis.word().to_lowercase());
            // Writing to a String does not fail.
            let _ = writeln!(text, "{name}_{axis}\t{component}\tPOS\t{name}_trunk\tmm\tbody");
        }
    }
    text
}

fn channels_json() -> Value {
    let body = json!({
        // Anterior, right, superior.
        "SpatialAxes": "ARS",
        "Description": BODY_AXES,
    });
    let description = "The frame of the positions";
    json!({"reference_frame": {"Description": description, "Levels": {"body": body}}})
}

/// Times count from the first sample, as the standard requires.
fn events(points: &Points, first_s: f64) -> String {
    let zero = [(0.0, "t_zero".to_owned())];
    let marks = points.events.iter().map(|event| (event.time_s, word(&event.label)));
    let mut all: Vec<(f64, String)> = zero.into_iter().chain(marks).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rows =
        all.iter().map(|(time_s, name)| format!("{}\t0\t{name}\n", csv::seconds(time_s - first_s)));
    format!("onset\tduration\ttrial_type\n{}", rows.collect::<String>())
}

/// A label as a cell of the table. Labels have no control characters; a double quote would begin a
/// quoted cell.
fn word(label: &str) -> String {
    label.replace('"', "'")
}

fn events_json(zero: &str) -> Value {
    json!({"trial_type": {
        "Description": format!("t_zero: t = 0 of the trial ({zero}). Others: marks set during it."),
    }})
}

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}
