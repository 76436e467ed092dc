//! A data set that follows the Brain Imaging Data Structure, extension for motion: a new one, or
//! another recording in one that is there.
//!
//! The body's axes are in it as they are, under the names ap, ml and si; orientations are in the
//! right-handed frame of [`orientation`](super::orientation). Times that are not quite even are in
//! the channel `latency`. Where a recording goes is [`data_set`]'s.

use std::fmt::Write as _;
use std::path::Path;

use plumbline_analysis::series::Axis;
use plumbline_files::{BadInput, write_all};
use serde_json::{Value, json};

use self::data_set::{DataSet, Labels, PARTICIPANT_CODE, SYSTEM, TASK_NAME};
use self::table::word;
pub use self::table::{MISSING, Table};
use super::events::{Event, ZERO};
use super::orientation::{COMPONENTS, QUATERNION, components};
use super::rows::Rows;
use super::{BODY_AXES, RIGHT_HANDED, Recording, csv};
use crate::Trial;

mod data_set;
mod table;

/// The version of the standard.
const VERSION: &str = "1.11.0";

/// The kinds of columns in a recording.
const POSITION: &str = "POS";
const ORIENTATION: &str = "ORNT";

/// Adds the recording to the data set in a folder, which is made if there is none, and returns what
/// a user should know.
///
/// # Errors
/// When the folder is no data set, the recording is in it already, or it cannot be written; then
/// nothing is changed.
pub fn write(
    rows: &Rows,
    events: &[Event],
    trial: &Trial,
    zero: &str,
    out: &Path,
    recording: &Recording<'_>,
) -> Result<Vec<String>, BadInput> {
    let data_set = DataSet::at(out)?;
    let (labels, warnings) = labels(trial, recording.session, &data_set)?;
    data_set.check_sessions(&labels)?;
    data_set.check_names(&labels)?;
    let started = started(trial);
    let path = data_set.scans(&labels);
    let mut scans = Table::read(&path, "filename")?;
    let run = run(&data_set, &labels, &scans, &started, recording)?;
    scans.add(&[("filename", &DataSet::scan(&labels, run)), ("acq_time", &started)]);

    let mut files = vec![
        (path, scans.text()),
        (data_set.top("participants.tsv"), data_set.participants(&labels)?.text()),
    ];
    if data_set.is_new {
        files.push((data_set.top("dataset_description.json"), pretty(&description())));
        files.push((data_set.top("README"), README.to_owned()));
    }
    let parts = [
        ("motion.tsv", motion(rows)),
        ("motion.json", pretty(&motion_json(rows, trial, &labels))),
        ("channels.tsv", channels(rows)),
        ("channels.json", pretty(&channels_json())),
        ("events.tsv", events_table(events)),
        ("events.json", pretty(&events_json(zero))),
    ];
    files.extend(parts.map(|(name, text)| (data_set.part(&labels, run, name), text)));
    let files: Vec<_> = files.into_iter().map(|(path, text)| (path, text.into_bytes())).collect();
    // The tables that several recordings share are replaced; that the recording is none that is
    // there, or may be replaced, has been checked.
    write_all(&files, true)?;
    Ok(warnings)
}

/// The labels of a trial, and what there is to say about them.
fn labels(
    trial: &Trial,
    session: Option<&str>,
    data_set: &DataSet<'_>,
) -> Result<(Labels, Vec<String>), BadInput> {
    let mut warnings = Vec::new();
    let mut label = |given: Option<&String>, what: &str, otherwise: &str| {
        let given = given.map_or("", |given| given.trim());
        let letters: String = given.chars().filter(char::is_ascii_alphanumeric).collect();
        let label = if letters.is_empty() { otherwise.to_owned() } else { letters };
        if given.is_empty() {
            warnings.push(format!("the trial has no {what}: it is {label:?} in the data set"));
        } else if label != given {
            warnings.push(format!(
                "the {what} {given:?} is {label:?} in the data set, whose labels have letters and \
                 digits only"
            ));
        }
        let name = if given.is_empty() { label.clone() } else { given.to_owned() };
        (label, name)
    };
    let is_named = trial.manifest.participant.as_ref().is_some_and(|it| !it.trim().is_empty());
    if !is_named && !data_set.is_new {
        // Whoever is called 01 there may be another person.
        return Err(BadInput::new(
            trial.folder.join(crate::names::MANIFEST).display(),
            "participant",
            "it is not known whose recording this is",
            "write it there: participant = \"P01\"",
        ));
    }
    let (participant, participant_code) =
        label(trial.manifest.participant.as_ref(), "participant", "01");
    let (task, task_name) = label(trial.manifest.condition.as_ref(), "condition", "standing");
    let session = session.map(str::to_owned);
    if let Some(session) = session.iter().find(|it| !is_label(it)) {
        let found = format!("{session:?} is no label of a session");
        return Err(BadInput::whole("--session", found, "use letters and digits only"));
    }
    Ok((Labels { participant, participant_code, session, task, task_name }, warnings))
}

fn is_label(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|letter| letter.is_ascii_alphanumeric())
}

/// When the recording began, with microseconds: the standard allows no more.
fn started(trial: &Trial) -> String {
    let started = trial.manifest.started.parse::<jiff::Timestamp>();
    started.map_or_else(|_| MISSING.to_owned(), |time| format!("{time:.6}"))
}

/// The number of the recording: the one asked for or, with `force`, the one that it has already; else
/// the next.
fn run(
    data_set: &DataSet<'_>,
    labels: &Labels,
    scans: &Table,
    started: &str,
    recording: &Recording<'_>,
) -> Result<u32, BadInput> {
    let there = data_set.runs(labels)?;
    let is_this = |run: &&u32| {
        let row = scans.row(&DataSet::scan(labels, **run));
        let began = row.and_then(|row| scans.get(row, "acq_time"));
        started != MISSING && began == Some(started)
    };
    let same = there.iter().find(is_this).copied();
    let run = match recording.run {
        Some(run) => run,
        None => same.unwrap_or(there.iter().max().map_or(1, |last| last.saturating_add(1))),
    };
    let doubled = same.filter(|same| *same != run || !recording.force);
    let taken = there.contains(&run).then_some(run).filter(|_| !recording.force);
    let (at, found) = match (doubled, taken) {
        (Some(same), _) => (same, "this trial is in the data set already"),
        (None, Some(run)) => (run, "this run is another trial's"),
        (None, None) => return Ok(run),
    };
    let place = data_set.part(labels, at, "motion.tsv");
    let remedy = match (at == run, doubled) {
        (true, Some(_)) => "leave it, or give --force to replace it".to_owned(),
        (true, None) => "leave --run out to add one, or give --force to replace it".to_owned(),
        (false, _) => format!("leave it, or give --run {at} and --force to replace it"),
    };
    Err(BadInput::whole(place.display(), found, remedy))
}

const README: &str = "Postural sway, recorded with Plumbline: positions of the lower and of the upper \
trunk of a standing person, seen by one camera from behind as two printed targets.

Positions are in millimetres along the axes of the body: AP forward, ML to the person's right, SI \
up. These three are a left-handed frame. Orientations are unit quaternions in a right-handed one: X \
forward (AP), Y to the person's left (-ML), Z up (SI); the identity is a target that is parallel to \
the board that defined the axes.

The time of each sample, in seconds from the first, is in the channel \"latency\". Samples in which a \
point was not seen are n/a. The event \"t_zero\" is the trial's t = 0. The acquisition time is when \
the recording began, shortly before the first sample.
";

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
            text += &csv::cells(point.position_mm[row], '\t', MISSING);
            text += &csv::cells(point.orientation[row].as_ref().map(components), '\t', MISSING);
        }
        text.push('\n');
    }
    text
}

fn motion_json(rows: &Rows, trial: &Trial, labels: &Labels) -> Value {
    let points = rows.points.len();
    let [positions, orientations] = [Axis::ALL.len() * points, COMPONENTS.len() * points];
    let seen = rows.points.iter().flat_map(|point| &point.position_mm).flatten().count();
    let cells = rows.time_s.len() * rows.points.len();
    let mut about = json!({
        TASK_NAME: labels.task_name,
        "SamplingFrequency": rows.rate_hz,
        "SamplingFrequencyEffective": rows.rate_hz,
        "TrackingSystemName": SYSTEM,
        "Manufacturer": "Plumbline",
        "SoftwareVersions": env!("CARGO_PKG_VERSION"),
        "TrackedPointsCount": points,
        "MotionChannelCount": positions + orientations + 1,
        "POSChannelCount": positions,
        "ORNTChannelCount": orientations,
        "LATENCYChannelCount": 1,
        "RecordingDuration": (rows.time_s.len() - 1) as f64 / rows.rate_hz,
        "RecordingType": "continuous",
        "MissingValues": MISSING,
        "SubjectArtefactDescription":
            format!("{:.1} % of the positions are missing", 100.0 * (1.0 - seen as f64 / cells as f64)),
    });
    // The standard allows further fields; these are ours.
    about[PARTICIPANT_CODE] = json!(labels.participant_code);
    let verdict = trial.manifest.verdict();
    about["Verdict"] = json!(verdict.grade().word());
    about["VerdictDescription"] = json!(verdict.line());
    if let Some(the_box) = &trial.manifest.the_box {
        about["DeviceSerialNumber"] = json!(the_box.serial_number);
    }
    if let Some(moved) = rows.moved() {
        about["TrackingSystemDescription"] = json!(moved);
    }
    about
}

fn channels(rows: &Rows) -> String {
    let mut text = "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\n".to_owned();
    text += "latency\tn/a\tLATENCY\tn/a\ts\tn/a\n";
    for point in &rows.points {
        let name = &point.name;
        // Writing to a String does not fail.
        for (axis, component) in Axis::ALL.into_iter().zip(["x", "y", "z"]) {
            let axis = axis.word().to_lowercase();
            let _ =
                writeln!(text, "{name}_{axis}\t{component}\t{POSITION}\t{name}_trunk\tmm\tbody");
        }
        for component in COMPONENTS {
            let _ = writeln!(
                text,
                "{name}_quat_{component}\tquat_{component}\t{ORIENTATION}\t{name}_trunk\t{MISSING}\t\
                 turned"
            );
        }
    }
    text
}

fn channels_json() -> Value {
    json!({"reference_frame": {
        "Description": "The frames of the positions and of the orientations",
        "Levels": {
            "body": {
                // Anterior, right, superior.
                "SpatialAxes": "ARS",
                "RotationRule": "left-hand",
                "Description": BODY_AXES,
            },
            "turned": {
                // Anterior, left, superior.
                "SpatialAxes": "ALS",
                "RotationRule": "right-hand",
                "Description": format!("{RIGHT_HANDED}; {QUATERNION}"),
            },
        },
    }})
}

/// Times count from the first sample, as the standard requires.
fn events_table(events: &[Event]) -> String {
    let row =
        |event: &Event| format!("{}\t0\t{}\n", csv::seconds(event.time_s), word(&event.label));
    format!("onset\tduration\ttrial_type\n{}", events.iter().map(row).collect::<String>())
}

fn events_json(zero: &str) -> Value {
    json!({"trial_type": {
        "Description": format!("{ZERO}: t = 0 of the trial ({zero}). Others: marks set during it."),
    }})
}

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}
