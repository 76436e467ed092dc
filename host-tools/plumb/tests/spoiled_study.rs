//! Twelve simulated participants under two conditions, and trials that are spoiled in one way each:
//! each is caught and named, and the study of the others has the figures of the true motion.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use plumbline::packet::{Deframer, Hello, Message, PosePacket, Reply, ReplyOutcome};
use plumbline::report::NoPose;
use plumbline::target::Role;
use plumbline_render::simulate::sway::SwaySettings;
use plumbline_render::simulate::{Simulation, SimulationSettings, TargetTruth, Truth};
use plumbline_stream::fixture;
use plumbline_trial::Manifest;
use plumbline_trial::journal::{Content, Entry};
use plumbline_trial::test_trial::{Made, SECOND_NS, raw};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::finished::plumb;
use crate::common::trial;

const PARTICIPANTS: u64 = 12;
const CONDITIONS: [&str; 2] = ["calm", "wild"];

/// At 60 Hz, as the box of the fixture has it: 32 s from the mark on.
const FRAMES: u32 = 33 * 60;

/// The mark comes with this frame.
const ZERO: u32 = 29;

/// The study's times, which are 30 s together.
const BINS: &str = "bins_s = [[0, 10], [10, 20], [20, 30]]\n";

/// Frames of those 30 s.
const STUDIED: std::ops::RangeInclusive<u32> = ZERO..=ZERO + 30 * 60;

/// The twelve seconds in which a target is covered.
const COVERED: std::ops::Range<u32> = 600..600 + 12 * 60;

/// The frame at which something happens to the box.
const MIDDLE: u32 = 900;

/// Changes a good trial.
type Spoil = fn(&mut Made);

/// Each spoiled trial, how it is spoiled, and what the verdict on it says.
const SPOILED: [(&str, Spoil, &str); 8] = [
    ("P01-calm", exchange, "unusable: upper trunk above the lower: -4"),
    ("P02-calm", cover, "unusable: upper trunk, longest gap: 12 s (at most 10)"),
    ("P03-calm", lose, "unusable: frames lost on the way: 40 % (at most 20)"),
    ("P04-calm", shorten, "doubtful: from t = 0 to the last frame: 12 s (at least 25)"),
    ("P05-calm", forget_the_scene, "unusable: no frame has a position along the body's axes"),
    ("P06-calm", restart, "doubtful: starts of the box: 2 (at most 1)"),
    ("P01-wild", hear_another_box, "doubtful: other boxes"),
    ("P02-wild", forget_the_mark, "doubtful: t = 0 is to be a mark, and there is none"),
];

/// The lower trunk's target was worn on the shoulder, and the other on the back.
fn exchange(made: &mut Made) {
    made.each_pose(|mut packet| {
        std::mem::swap(&mut packet.upper_trunk, &mut packet.lower_trunk);
        Some(packet)
    });
}

fn cover(made: &mut Made) {
    made.each_pose(|mut packet| {
        if COVERED.contains(&packet.sequence) {
            let upper = packet.targets.iter_mut().find(|it| it.role == Role::Upper).unwrap();
            upper.pose = Err(NoPose::Searching);
            packet.upper_trunk = None;
        }
        Some(packet)
    });
}

/// Two of five packets are lost.
fn lose(made: &mut Made) {
    made.each_pose(|packet| (![1, 3].contains(&(packet.sequence % 5))).then_some(packet));
}

fn shorten(made: &mut Made) {
    made.each_pose(|packet| (packet.sequence <= ZERO + 12 * 60).then_some(packet));
}

fn forget_the_scene(made: &mut Made) {
    made.config.as_mut().unwrap().cam_from_scene_theta = None;
    made.each_pose(|packet| Some(PosePacket { upper_trunk: None, lower_trunk: None, ..packet }));
    of_its_configuration(made);
}

/// The box names the configuration that lies in the trial.
fn of_its_configuration(made: &mut Made) {
    let config_crc = made.config.as_ref().unwrap().crc();
    made.each(|message| match message {
        Message::Hello(hello) => Some(Message::Hello(Hello { config_crc, ..hello })),
        other => Some(other),
    });
}

/// In the middle the box starts anew: it counts frames and time from its start, and its camera was
/// moved by a hand's width.
fn restart(made: &mut Made) {
    const EARLIER_NS: u64 = 10 * SECOND_NS;
    let start = fixture::START + 1;
    let is_middle =
        |entry: &Entry| matches!(message(entry), Some(Message::Pose(it)) if it.sequence == MIDDLE);
    let middle = made.entries.iter().position(is_middle).unwrap();
    let hello = Hello { boot_id: start, ..fixture::hello(made.config.as_ref().unwrap()) };
    for entry in &mut made.entries[middle..] {
        let anew = match message(entry) {
            Some(Message::Pose(mut packet)) => {
                packet.sequence -= MIDDLE;
                packet.capture_time_ns -= EARLIER_NS;
                for point in [&mut packet.upper_trunk, &mut packet.lower_trunk] {
                    point.as_mut().unwrap().ap_mm += 100.0;
                }
                Message::Pose(packet)
            }
            Some(Message::Reply(Reply {
                id,
                outcome:
                    ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, stream_next },
            })) => {
                let [box_received_ns, box_sent_ns] =
                    [box_received_ns, box_sent_ns].map(|ns| ns - EARLIER_NS);
                let outcome =
                    ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, stream_next };
                Message::Reply(Reply { id, outcome })
            }
            Some(other) => other,
            None => continue,
        };
        entry.content = trial::content(&fixture::packet(start, anew));
    }
    let host_ns = made.entries[middle].host_ns;
    let content = trial::content(&fixture::packet(start, Message::Hello(hello)));
    made.entries.insert(middle, Entry { host_ns, content });
}

/// Another box sends to the same computer.
fn hear_another_box(made: &mut Made) {
    let mut other = Hello { boot_id: 9, ..fixture::hello(&fixture::config()) };
    other.device = "ward 5".try_into().unwrap();
    other.serial_number = "PL-0005".try_into().unwrap();
    let middle = made.entries.len() / 2;
    let host_ns = made.entries[middle].host_ns;
    made.entries.insert(middle, Entry { host_ns, content: raw(&Message::Hello(other)) });
}

fn forget_the_mark(made: &mut Made) {
    made.entries.retain(|entry| !matches!(entry.content, Content::Mark(_)));
}

/// The message of an entry that is a packet.
fn message(entry: &Entry) -> Option<Message> {
    let Content::Raw(raw) = &entry.content else { return None };
    Some(raw.decode(&mut Deframer::new()).unwrap().message)
}

/// The frames of a person who sways half as far again under the second condition, and each more than
/// the one before.
fn person(participant: u64, condition: usize) -> Vec<Truth> {
    let ap_sd_mm = (4.0 + 0.25 * participant as f64) * [1.0, 1.5][condition];
    let settings = SimulationSettings {
        seed: 2 * participant + condition as u64,
        sway: SwaySettings::of_ap_sd_mm(ap_sd_mm),
        ..SimulationSettings::default()
    };
    let person = Simulation::new(&settings).unwrap();
    assert_eq!(person.targets()[1].geometry.role(), Role::Upper);
    // The box of the fixture stands where the simulation puts its camera.
    assert_eq!(Some(person.cam_from_scene().theta()), fixture::config().cam_from_scene_theta);
    (0..u64::from(FRAMES)).map(|frame| person.truth(frame)).collect()
}

/// A target in a frame of a person.
fn target(person: &[Truth], frame: u32, role: Role) -> &TargetTruth {
    // As the standard pair is listed.
    &person[frame as usize].targets[usize::from(role == Role::Upper)]
}

/// The good trial of a person.
fn recorded(person: &[Truth], participant: &str, condition: &str) -> Made {
    let config = fixture::config();
    let pose = |frame: u32, role: Role| target(person, frame, role).cam_from_target;
    let mut made = Made::with_poses(&config, FRAMES, pose);
    made.manifest.participant = Some(participant.to_owned());
    made.manifest.condition = Some(condition.to_owned());
    made
}

/// The true RMS of the upper trunk along AP.
fn true_rms_mm(person: &[Truth]) -> f64 {
    let ap_mm: Vec<f64> =
        STUDIED.map(|frame| target(person, frame, Role::Upper).trunk_point.ap_mm).collect();
    let mean_mm = ap_mm.iter().sum::<f64>() / ap_mm.len() as f64;
    let square = ap_mm.iter().map(|it| (it - mean_mm).powi(2)).sum::<f64>();
    (square / ap_mm.len() as f64).sqrt()
}

/// All trials, the spoiled ones as well; and each participant's true RMS under each condition.
fn setting() -> (TempDir, HashMap<String, [f64; 2]>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("trials")).unwrap();
    let mut truth = HashMap::new();
    for participant in 1..=PARTICIPANTS {
        let code = format!("P{participant:02}");
        let rms_mm = [0, 1].map(|at| {
            let person = person(participant, at);
            let name = format!("{code}-{}", CONDITIONS[at]);
            let mut made = recorded(&person, &code, CONDITIONS[at]);
            if let Some((_, spoil, _)) = SPOILED.iter().find(|(it, ..)| *it == name) {
                spoil(&mut made);
            }
            made.write(&path(&folder, &name));
            true_rms_mm(&person)
        });
        truth.insert(code, rms_mm);
    }
    (folder, truth)
}

fn path(folder: &TempDir, trial: &str) -> PathBuf {
    folder.path().join("trials").join(trial)
}

/// Runs the study with these settings; gives its exit code, its messages and its figures.
fn study(folder: &TempDir, more: &str) -> (Option<i32>, String, Option<Value>) {
    let conditions =
        if more.contains("conditions") { "" } else { "conditions = [\"calm\", \"wild\"]\n" };
    let text = format!("title = \"Spoiled\"\n{conditions}{BINS}trials = [\"trials/*\"]\n{more}");
    std::fs::write(folder.path().join("study.toml"), text).unwrap();
    let json = folder.path().join("study.json");
    let _ = std::fs::remove_file(&json);
    let finished = plumb(folder.path(), &["study", "study.toml", "--json", "study.json"]);
    let figures = std::fs::read(&json).ok().map(|it| serde_json::from_slice(&it).unwrap());
    (finished.code, finished.stderr, figures)
}

#[track_caller]
fn assert_has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
}

/// The verdict of each trial in the table of all figures.
fn verdicts(csv: &Path) -> HashMap<String, String> {
    let mut reader = csv::Reader::from_path(csv).unwrap();
    let rows = reader.deserialize::<HashMap<String, String>>().map(Result::unwrap);
    rows.map(|mut row| (row.remove("trial").unwrap(), row.remove("verdict").unwrap())).collect()
}

/// With everything but the good trials left out, the study's mean difference and its t are those of
/// the true motion.
fn assert_true(figures: &Value, truth: &HashMap<String, [f64; 2]>) {
    let sway = figures["sway"].as_array().unwrap();
    let rms = sway.iter().find(|it| it["figure"] == "RMS" && it["point"] == "upper").unwrap();
    let names = rms["inference"]["subjects"].as_array().unwrap();
    let names: Vec<&str> = names.iter().map(|it| it.as_str().unwrap()).collect();
    assert_eq!(names, ["P07", "P08", "P09", "P10", "P11", "P12"]);
    let n = names.len() as f64;
    let differences: Vec<f64> = names.iter().map(|it| truth[*it][1] - truth[*it][0]).collect();
    let mean_mm = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|it| (it - mean_mm).powi(2)).sum::<f64>() / (n - 1.0);
    let test = &rms["inference"]["comparisons"][0]["t_test"];
    for (key, expected) in [("mean_difference", mean_mm), ("t", mean_mm / (variance / n).sqrt())] {
        let found = test[key].as_f64().unwrap();
        // The filter takes 0.0002 of an amplitude at 0.3 Hz and 0.0015 at 0.5 Hz, below which nearly
        // all of the sway is; t, which is of small differences, changes by a little more.
        assert!((found / expected - 1.0).abs() < 3e-3, "{key}: {found} {expected}");
    }
}

#[test]
fn each_spoiled_trial_of_a_study_is_named_and_the_others_give_the_true_figures() {
    let (folder, truth) = setting();

    // The table of all figures has each trial's verdict; what has no position is an error.
    let names = SPOILED.iter().map(|(name, ..)| *name);
    let trials: Vec<String> = (1..=PARTICIPANTS)
        .flat_map(|who| CONDITIONS.map(|it| format!("trials/P{who:02}-{it}")))
        .collect();
    let arguments = ["figures", "--bins", "0-10", "--out", "figures.csv"].into_iter();
    let arguments: Vec<&str> = arguments.chain(trials.iter().map(String::as_str)).collect();
    let finished = plumb(folder.path(), &arguments);
    assert_eq!(finished.code, Some(1), "{}", finished.stderr);
    assert_has(&finished.stderr, &["error: trials/P05-calm", "--tables --scene scene.toml"]);
    let verdicts = verdicts(&folder.path().join("figures.csv"));
    assert_eq!(verdicts.len(), 2 * PARTICIPANTS as usize - 1);
    for (trial, verdict) in &verdicts {
        let spoiled = SPOILED.iter().find(|(name, ..)| trial.ends_with(name));
        let expected = spoiled.map_or("good", |(.., words)| words.split(':').next().unwrap());
        assert_eq!(verdict, expected, "{trial}");
    }

    // The study stops, and names every trial that is unusable, and the way to go on.
    let (code, said, _) = study(&folder, "");
    assert_eq!(code, Some(2), "{said}");
    assert_has(&said, &["4 trials unusable", "plumb show TRIAL", "unusable = \"leave_out\""]);
    for (name, _, words) in SPOILED.iter().filter(|it| it.2.starts_with("unusable")) {
        assert_has(&said, &[&format!("{name}: verdict: {words}")]);
    }

    // Without them those that are doubtful take part, named, as far as they go.
    let leave_out = "unusable = \"leave_out\"\ndrop_incomplete = true\n";
    let figures = "figures = [\"path length\", \"RMS AP\"]\n";
    let (code, said, found) = study(&folder, &format!("{leave_out}{figures}"));
    assert_eq!(code, Some(0), "{said}");
    for (name, _, words) in SPOILED {
        let doubtful = words.starts_with("doubtful");
        assert_has(
            &said,
            &[&format!("{name} is {}{words}", if doubtful { "" } else { "left out: " })],
        );
    }
    assert_has(
        &said,
        &["P04 is left out: no value in calm, T2", "P01 is left out: no value in calm"],
    );
    assert_eq!(found.unwrap()["participants"].as_array().unwrap().len(), 12);

    // And without any of them the figures are those of the true motion.
    let (code, said, found) =
        study(&folder, &format!("{leave_out}doubtful = \"leave_out\"\n{figures}"));
    assert_eq!(code, Some(0), "{said}");
    for (name, _, words) in SPOILED {
        assert_has(&said, &[&format!("{name} is left out: {words}")]);
    }
    assert_true(&found.unwrap(), &truth);

    // What was written wrongly is found before anything is compared.
    for name in names {
        std::fs::remove_dir_all(path(&folder, name)).unwrap();
    }
    let rewrite = |trial: &str, change: fn(&mut Manifest)| {
        let mut manifest = Manifest::read(&path(&folder, trial)).unwrap();
        change(&mut manifest);
        manifest.write(&path(&folder, trial)).unwrap();
    };
    let drop = "drop_incomplete = true\n";
    rewrite("P07-calm", |it| it.condition = Some("clam".to_owned()));
    let (code, said, _) = study(&folder, drop);
    assert_eq!(code, Some(2), "{said}");
    let condition = ["trials/P07-calm: \"clam\" is not one of calm, wild", "trial.toml"];
    assert_has(&said, &condition);
    rewrite("P07-calm", |it| it.condition = Some("calm".to_owned()));
    rewrite("P08-calm", |it| it.participant = Some("P09".to_owned()));
    let (code, said, _) = study(&folder, drop);
    assert_eq!(code, Some(2), "{said}");
    assert_has(&said, &["P09 has 2 trials in calm: ", "trials/P08-calm, ", "correct trial.toml"]);
    rewrite("P08-calm", |it| it.participant = Some("P08".to_owned()));
    let (code, said, _) = study(&folder, &format!("conditions = [\"calm\", \"wilt\"]\n{drop}"));
    assert_eq!(code, Some(2), "{said}");
    assert_has(&said, &["\"wild\" is not one of calm, wilt", "conditions"]);
}
