//! Trials, figures, statistics and exports.

use std::fs;

use nalgebra::Vector3;
use plumbline::packet::PosePacket;
use plumbline::pose::Pose;
use plumbline::report::{NoPose, TargetState};
use plumbline::target::Role;
use plumbline_stream::fixture::config;
use plumbline_trial::Trial;
use plumbline_trial::frame::{Point, Trunk};
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_trial::test_trial::{Made, scene_from_target};
use serde_json::json;

use crate::bench::Bench;

const PARTICIPANTS: [&str; 3] = ["p01", "p02", "p03"];
const CONDITIONS: [&str; 2] = ["control", "foam"];

/// Half a minute each; every participant sways more on foam.
const FRAMES: u32 = 1800;

/// Frames that never came.
const LOST: std::ops::Range<u32> = 100..105;

/// Frames in which the lower target was hidden.
const HIDDEN: std::ops::Range<u32> = 400..420;

const STUDY: &str = "title = \"Standing on foam\"
trials = [\"trials/*\"]
conditions = [\"control\", \"foam\"]
bins_s = [[0, 10], [10, 20]]
figures = \"all\"
drop_incomplete = true
";

/// The folders of all trials.
pub const EVERYBODY: [&str; 6] = [
    "trials/p01-control",
    "trials/p01-foam",
    "trials/p02-control",
    "trials/p02-foam",
    "trials/p03-control",
    "trials/p03-foam",
];

/// Writes all trials and the study.
pub fn write_all(bench: &Bench) {
    let all = PARTICIPANTS.into_iter().flat_map(|who| CONDITIONS.map(|what| (who, what)));
    write(bench, &all.collect::<Vec<_>>());
    fs::write(bench.path("study.toml"), STUDY).unwrap();
}

/// Writes the trials of these participants and conditions.
fn write(bench: &Bench, trials: &[(&str, &str)]) {
    fs::create_dir(bench.path("trials")).unwrap();
    for (who, what) in trials {
        let at = (1..).zip(PARTICIPANTS).find(|(_, it)| it == who).unwrap().0;
        let more = if *what == CONDITIONS[1] { 0.4 } else { 0.0 };
        write_trial(bench, [who, what], FRAMES, at, more);
    }
}

/// Writes the trial of a participant under a condition; `at` tells participants apart, and `more` is
/// the share by which this one sways more.
pub fn write_trial(
    bench: &Bench,
    [participant, condition]: [&str; 2],
    frames: u32,
    at: u32,
    more: f64,
) {
    let config = config();
    let cam_from_scene = config.cam_from_scene().unwrap();
    let mut made = Made::with_poses(&config, frames, |sequence, role| {
        // Each with a part of their own.
        let scene_from_target = scene_from_target(role, sequence + 100 * at);
        let phase = f64::from(sequence) * (0.03 + 0.007 * f64::from(at));
        let share = more + 0.1 * f64::from(at);
        let sway_mm = Vector3::new(phase.sin(), 0.0, (1.3 * phase).cos()) * 5.0 * share;
        let moved_mm = scene_from_target.translation_mm + sway_mm;
        cam_from_scene * Pose::new(scene_from_target.rotation, moved_mm)
    });
    made.manifest.participant = Some(participant.to_owned());
    made.manifest.condition = Some(condition.to_owned());
    made.each_pose(|packet| (!LOST.contains(&packet.sequence)).then(|| hidden(packet)));
    made.write(&bench.path(&format!("trials/{participant}-{condition}")));
}

/// The packet of a frame in which the lower target may be hidden.
fn hidden(mut packet: PosePacket) -> PosePacket {
    if HIDDEN.contains(&packet.sequence) {
        packet.lower_trunk = None;
        for target in packet.targets.iter_mut().filter(|target| target.role == Role::Lower) {
            target.state = TargetState::Coasting;
            target.pose = Err(NoPose::TooFewCorners);
        }
    }
    packet
}

/// What the trial holds by the library itself: an object for each frame that came.
fn frames_of(bench: &Bench, name: &str) -> serde_json::Value {
    let trial = Trial::open(&bench.path(name)).unwrap();
    let zero_s = Points::of(&trial, Zero::Mark).unwrap().zero_s;
    assert!(zero_s > 0.1, "the mark is t = 0");
    let rows = trial.frames.iter().map(|frame| {
        let of = |trunk| {
            let point = frame.point(trunk).map(|Point { time_s, position_mm, covariance_mm2 }| {
                let covariance_mm2: Vec<f64> = covariance_mm2.unwrap().iter().copied().collect();
                json!([time_s - zero_s, position_mm, covariance_mm2])
            });
            let theta = frame.theta_of(trunk).map(|theta| theta.map(f64::from));
            json!({ "point": point, "theta": theta, "rms_px": frame.rms_px(trunk).map(f64::from) })
        };
        json!({
            "frame": frame.sequence,
            "time_s": frame.time_s - zero_s,
            "lower": of(Trunk::Lower),
            "upper": of(Trunk::Upper),
        })
    });
    rows.collect()
}

#[test]
fn a_trial_has_every_number_of_the_library_and_nan_in_its_gaps() {
    let Some(bench) = Bench::new() else { return };
    write(&bench, &[("p01", "control")]);
    let frames = frames_of(&bench, "trials/p01-control");
    assert_eq!(frames.as_array().unwrap().len(), (FRAMES - 5) as usize);
    fs::write(bench.path("frames.json"), frames.to_string()).unwrap();
    bench.plumb(&["export", "trials/p01-control", "--format", "parquet", "--out", "p01.parquet"]);
    bench.ran(bench.script("open_trial.py"));
}

#[test]
fn figures_and_statistics_are_those_of_plumb() {
    let Some(bench) = Bench::new() else { return };
    write_all(&bench);
    let trials = ["trials/p01-control", "trials/p02-foam"];
    let method = ["--filter", "butterworth:10", "--span", "0-25", "--bins", "0-8,8-20"];
    let more = ["--covered-min", "75", "--radius", "2.5"];
    bench.plumb(&[&["figures"], &trials[..], &["--out", "figures.csv"]].concat());
    let out = ["--zero", "start", "--out", "chosen.csv"];
    bench.plumb(&[&["figures", trials[0]], &method[..], &more, &out].concat());
    bench.plumb(&["analyze", trials[0], "--json", "analysis.json"]);
    bench.plumb(&[&["analyze", trials[0], "--json", "chosen.json"], &method[..], &more].concat());
    bench.plumb(&["study", "study.toml", "--json", "study.json"]);
    let mut table = "path,condition,half,id\n".to_owned();
    for (at, (who, what)) in (0..12).map(|at| (at, (at / 4, at % 4))) {
        let (condition, half) = (CONDITIONS[what / 2], what % 2);
        let path_mm = 100.0 + f64::from(who as u32 * 7 + (at * at) as u32 % 11) / 3.0;
        table += &format!("{path_mm},{condition},{half},{who}\n");
    }
    fs::write(bench.path("long.csv"), table).unwrap();
    let long = ["study", "--long", "long.csv", "--response", "path", "--within", "condition,half"];
    bench.plumb(&[&long[..], &["--subject", "id", "--json", "long.json"]].concat());
    bench.ran(bench.script("figures.py"));
}

#[test]
fn a_cohort_has_the_figures_and_statistics_of_plumb() {
    let Some(bench) = Bench::new() else { return };
    write_all(&bench);
    bench.plumb(&[&["cohort", "add", "--to", "cohort"], &EVERYBODY[..]].concat());
    bench.plumb(&[&["figures"], &EVERYBODY[..], &["--out", "figures.csv"]].concat());
    let foam = EVERYBODY.into_iter().filter(|it| it.ends_with("foam")).collect::<Vec<_>>();
    let method = ["--filter", "butterworth:10", "--bins", "0-8,8-20", "--out", "chosen.csv"];
    bench.plumb(&[&["figures"], &foam[..], &method].concat());
    let elsewhere = STUDY.replace("trials/*", "elsewhere/*");
    fs::write(bench.path("elsewhere.toml"), elsewhere).unwrap();
    let study = ["study", "--cohort", "cohort", "elsewhere.toml", "--json", "study.json"];
    bench.plumb(&study);
    bench.ran(bench.script("cohort.py"));
}

#[test]
fn exports_are_those_of_plumb() {
    let Some(bench) = Bench::new() else { return };
    write(&bench, &[("p02", "foam")]);
    for maker in ["plumb", "python"] {
        fs::create_dir(bench.path(maker)).unwrap();
    }
    for format in ["csv", "parquet", "trc", "c3d"] {
        let out = format!("plumb/p02.{format}");
        bench.plumb(&["export", "trials/p02-foam", "--format", format, "--out", &out]);
    }
    let session = ["--session", "week4", "--run", "2"];
    let bids = ["export", "trials/p02-foam", "--format", "bids", "--out", "plumb/bids"];
    bench.plumb(&[&bids[..], &session].concat());
    bench.ran(bench.script("export.py"));
}

#[test]
fn what_cannot_be_used_is_an_exception_with_its_place_and_its_remedy() {
    let Some(bench) = Bench::new() else { return };
    write(&bench, &[("p01", "control"), ("p01", "foam")]);
    fs::copy(bench.path("trials/p01-foam/packets.bin"), bench.path("packets.bin")).unwrap();
    bench.ran(bench.script("bad_input.py"));
}

#[test]
fn other_threads_go_on_while_something_takes_long() {
    let Some(bench) = Bench::new() else { return };
    write_all(&bench);
    bench.ran(bench.script("threads.py"));
}

#[test]
fn pandas_polars_and_arrow_have_the_same_table() {
    let Some(bench) = Bench::new() else { return };
    write(&bench, &[("p01", "control")]);
    bench.ran(bench.script("tables.py"));
}
