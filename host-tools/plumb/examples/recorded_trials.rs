//! Writes trials as `plumb receive --out` leaves them, of a simulated person at 60 Hz: what
//! `cargo xtask bench` measures the analyses on.
//!
//! ```sh
//! cargo run --release --locked --package plumb --example recorded_trials -- NEW_FOLDER
//! ```
//!
//! | there | what |
//! |---|---|
//! | `p01-control`, `p01-hypoperfusion`, `p02-...` | 28 trials of a minute |
//! | `trials.toml` | the study of them |
//! | `tables.toml` | the same study, of the lower trunk in `p01-control.csv` and so on |
//! | `hour` | a trial of an hour |

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use nalgebra::{Matrix6, Vector6};
use plumbline::config::BLOB_BYTES_MAX;
use plumbline::packet::{
    Hello, MarkedInstant, Message, PACKET_BYTES_MAX, PosePacket, Reply, ReplyOutcome, ResetReason,
    Start, TargetInfo, encode_datagram,
};
use plumbline::report::Measurement;
use plumbline::report::{Report, TargetReport, TargetState};
use plumbline::scene::SceneFrame;
use plumbline::target::Role;
use plumbline_render::simulate::{Simulation, SimulationSettings};
use plumbline_stream::transport::Raw;
use plumbline_trial::derived::{self, Changes};
use plumbline_trial::journal::{Content, Entry, Writer};
use plumbline_trial::manifest::{Manifest, State, Zero};
use plumbline_trial::mark::{Mark, Source};
use plumbline_trial::{Trial, names};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const PARTICIPANTS: u64 = 14;
const CONDITIONS: [&str; 2] = ["control", "hypoperfusion"];

const FRAMES_PER_S: u64 = 60;

/// The box has run so long when a recording begins.
const BOX_BEGAN_NS: u64 = 7_000_000_000;

/// And its clock runs so much faster than the host's, in millionths.
const DRIFT_PPM: u64 = 20;

/// From the start of the exposure to the packet: 4 ms of light, read-out, tracking.
const LATENCY_NS: u64 = 14_000_000;

/// On the link, one way.
const WAY_NS: u64 = 300_000;

/// Standard deviations of a tracked pose at 1 m, as the box gives them: small turns about the
/// target's axes (rad), then x, y and z in the camera frame (mm).
const POSE_SD: [f64; 6] = [1.2e-4, 1.1e-4, 3e-5, 0.001, 0.003, 0.013];

/// The start of the box.
const START: Start = Start::MIN;

/// The day on which they are said to be recorded.
const STARTED: &str = "2026-01-01T00:00:00Z";

fn main() -> Result<()> {
    let out = std::env::args_os().nth(1).context("name a folder that does not exist yet")?;
    let out = PathBuf::from(out);
    fs::create_dir(&out).context(format!("{}", out.display()))?;
    let head = format!("title = \"Simulated\"\nconditions = {CONDITIONS:?}\n");
    let (mut trials, mut tables) = (head.clone(), head);
    for (at, participant) in (1..=PARTICIPANTS).enumerate() {
        for (condition, seed) in CONDITIONS.iter().zip(2 * at as u64..) {
            let code = format!("P{participant:02}");
            let name = format!("p{participant:02}-{condition}");
            let manifest = Manifest::begin(
                STARTED.to_owned(),
                Some(code.clone()),
                Some((*condition).to_owned()),
                None,
                Zero::Mark,
            );
            let trial = write(&out.join(&name), &manifest, 60, seed)?;
            fs::write(out.join(format!("{name}.csv")), table(&trial))?;
            writeln!(trials, "[[trial]]\nfolder = \"{name}\"")?;
            writeln!(
                tables,
                "[[trial]]\ntable = \"{name}.csv\"\ncolumns = \"time=time,ap=ap,ml=ml,si=si\"\n\
                 unit = \"mm\"\nparticipant = \"{code}\"\ncondition = \"{condition}\""
            )?;
        }
    }
    fs::write(out.join("trials.toml"), trials)?;
    fs::write(out.join("tables.toml"), tables)?;
    let manifest = Manifest::begin(STARTED.to_owned(), None, None, None, Zero::Mark);
    write(&out.join("hour"), &manifest, 3600, 1)?;
    Ok(())
}

/// The lower trunk's positions, from t = 0 on.
fn table(trial: &Trial) -> String {
    let zero_s = trial.manifest.events.first().map_or(0.0, |mark| mark.time_s);
    let mut text = "time,ap,ml,si\n".to_owned();
    for frame in &trial.frames {
        if let Some(point) = &frame.lower {
            let [ap, ml, si] = point.position_mm;
            // Writing to a String does not fail.
            let _ = writeln!(text, "{},{ap},{ml},{si}", point.time_s - zero_s);
        }
    }
    text
}

/// One trial, with a mark at its first frame.
fn write(folder: &Path, manifest: &Manifest, seconds: u64, seed: u64) -> Result<Trial> {
    let simulation = Simulation::new(&SimulationSettings { seed, ..Default::default() })?;
    fs::create_dir(folder)?;
    Manifest { state: State::Finished, ..manifest.clone() }.write(folder)?;
    let mut blob = [0; BLOB_BYTES_MAX];
    fs::write(folder.join(names::CONFIG), simulation.config().encode(&mut blob)?)?;
    let mut journal = Writer::create(&folder.join(names::JOURNAL))?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    journal.write(&entry(0, &hello(&simulation))?)?;
    for frame in 0..seconds * FRAMES_PER_S {
        let captured_ns = frame * 1_000_000_000 / FRAMES_PER_S;
        let arrived_ns = captured_ns + LATENCY_NS + WAY_NS;
        journal.write(&entry(arrived_ns, &pose(&simulation, frame, captured_ns, &mut random))?)?;
        if frame == 0 {
            let content = Content::Mark(Mark::new(Source::Key, "stands"));
            journal.write(&Entry { host_ns: arrived_ns, content })?;
        }
        if frame % FRAMES_PER_S == 0 {
            journal.write(&entry(arrived_ns + 2 * WAY_NS, &pong(arrived_ns))?)?;
        }
    }
    journal.sync()?;
    Ok(derived::remake(folder, &Changes::default())?)
}

fn entry(host_ns: u64, message: &Message) -> Result<Entry> {
    let mut buffer = [0; PACKET_BYTES_MAX];
    let datagram = encode_datagram(Some(START), message, &mut buffer)?.to_vec();
    Ok(Entry { host_ns, content: Content::Raw(Raw::Datagram(datagram)) })
}

/// The box's clock at a time of the host's.
fn box_ns(host_ns: u64) -> u64 {
    BOX_BEGAN_NS + host_ns + host_ns / 1_000_000 * DRIFT_PPM
}

fn hello(simulation: &Simulation) -> Message {
    let config = simulation.config();
    let info = config.targets.iter().map(|target| TargetInfo {
        name: target.name.clone(),
        role: target.geometry.role(),
        corners: target.geometry.corner_count() as u8,
    });
    Message::Hello(Hello {
        device: config.device.clone(),
        serial_number: config.serial_number.clone(),
        firmware: heapless::String::new(),
        config_crc: config.crc(),
        boot_id: START.get(),
        boot_count: None,
        reset_reason: ResetReason::PowerOn,
        width_px: config.lens.width_px,
        height_px: config.lens.height_px,
        targets: info.collect(),
    })
}

/// The answer to a question of the box's clock.
fn pong(host_sent_ns: u64) -> Message {
    let box_received_ns = box_ns(host_sent_ns + WAY_NS);
    let outcome = ReplyOutcome::Pong {
        host_sent_ns,
        box_received_ns,
        box_sent_ns: box_received_ns,
        stream_next: 0,
    };
    Message::Reply(Reply { id: 1, outcome })
}

/// A frame in which both targets are where they truly are, but for their poses' noise.
fn pose(simulation: &Simulation, frame: u64, captured_ns: u64, random: &mut ChaCha8Rng) -> Message {
    let scene = SceneFrame::new(simulation.cam_from_scene());
    let (mut upper_trunk, mut lower_trunk) = (None, None);
    let truth = simulation.truth(frame);
    let targets = simulation.targets().iter().zip(&truth.targets).map(|(target, truth)| {
        let noise = POSE_SD.map(|sd| sd * Distribution::<f64>::sample(&StandardNormal, random));
        let cam_from_target = truth.cam_from_target.moved_by(&noise.into());
        let role = target.geometry.role();
        match role {
            Role::Upper => upper_trunk = Some(scene.upper_trunk(&cam_from_target)),
            Role::Lower => {
                let virtual_point_mm = target.geometry.virtual_point_mm();
                lower_trunk = Some(scene.lower_trunk(&cam_from_target, &virtual_point_mm));
            }
            Role::Scene => {}
        }
        let corners = target.geometry.corner_count() as u8;
        let variances = Vector6::from(POSE_SD.map(|sd| sd * sd));
        let measurement = Measurement {
            cam_from_target,
            delay_ns: 0,
            covariance: Matrix6::from_diagonal(&variances),
            rms_px: 0.03,
            corners,
            corners_total: corners,
        };
        TargetReport { role, state: TargetState::Tracking, measurement: Ok(measurement) }
    });
    let report = Report {
        sequence: frame as u32,
        capture_time_ns: box_ns(captured_ns),
        targets: targets.collect(),
        upper_trunk,
        lower_trunk,
        corners_dropped: 0,
    };
    let latency_us = (LATENCY_NS / 1000) as u32;
    Message::Pose(PosePacket::from_report(&report, MarkedInstant::ExposureStart, latency_us))
}
