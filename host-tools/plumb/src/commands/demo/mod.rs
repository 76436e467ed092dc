//! `plumb demo`: the whole of Plumbline at work on a person whose motion is known.
//!
//! ```text
//! simulated person ─▶ Y4M ─▶ plumbline-board (the box's own program) ─▶ UDP ─▶ figures, CSV, plot
//! ```

mod figures;
mod person;
mod plot;
mod the_box;

use std::fs::File;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::Matrix6;
use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{CameraState, Message, Packet, PosePacket};
use plumbline::report::Measurement;
use plumbline::report::{Report, TargetReport};
use plumbline::seal::KEY_FILE_NAME;
use plumbline_bedside::draw;
use plumbline_bedside::keys;

use self::figures::Figures;
use self::the_box::TheBox;
use crate::ui::png;
use plumbline_files::frames::{Frame, Pixels};
use plumbline_files::poses::Writer;
use plumbline_render::simulate::recorded::truth_rows;
use plumbline_render::simulate::{Simulation, SimulationSettings};
use plumbline_stream::receiver::Receiver;
use plumbline_stream::recorder::Recorder;
use plumbline_stream::transport::{Event, KnownBox, Link, Transport, Udp};

/// Show Plumbline at work: the box's own program tracks a simulated person.
///
/// Renders a person who sways in a known way, feeds the frames to the box's
/// program, receives its packets over UDP, and compares what was measured with
/// what was true.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example: plumb demo --frames 600 --out demo

Afterwards, look at demo/sway.svg (any browser shows it).")]
pub struct Arguments {
    /// Frames to render and track; 60 are one second of standing.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(60..=36_000))]
    frames: u32,

    /// Determines the person's motion, the room and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,

    /// Directory for poses.csv, truth.csv, frame.png and sway.svg; made when absent.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
}

/// When nothing has come from the box for this long, something is wrong.
const SILENCE_MAX: Duration = Duration::from_secs(30);

/// After the box's end, packets that are still on their way get this long.
const STRAGGLERS: Duration = Duration::from_millis(300);

/// Runs the subcommand.
///
/// # Errors
/// When the box's program is absent or fails, or a result cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let started = Instant::now();
    let program = the_box::program()?;
    let settings = SimulationSettings { seed: arguments.seed, ..SimulationSettings::default() };
    let simulation = Simulation::new(&settings)?;
    plumbline_files::make_directory(&arguments.out)?;

    let config = simulation.config();
    let frames = u64::from(arguments.frames);
    let file = |name: &str| arguments.out.join(name);
    let [plot, picture, poses, truth] =
        ["sway.svg", "frame.png", "poses.csv", "truth.csv"].map(file);

    let received = track(&program, &simulation, &config, frames, &poses)?;
    let figures = Figures::new(&simulation, &received, arguments.frames)?;
    println!("{figures}");
    write_truth(&truth, &simulation, frames)?;
    write_picture(&picture, &simulation, &config, &received)?;
    plot::write(&plot, &figures)?;

    println!("\nDone in {:.0} s. To look at:", started.elapsed().as_secs_f64());
    for (file, what) in [
        (plot, "the sway path and the depth error; any browser shows it"),
        (picture, "a frame, with what the box found in it"),
        (poses, "what was measured"),
        (truth, "what was true"),
    ] {
        println!("  {:<20} {what}", file.display());
    }
    Ok(())
}

/// What came from the box.
#[derive(Debug, Default)]
struct Received {
    /// Every pose packet, as it came.
    poses: Vec<PosePacket>,
    repeated: u64,
    corrupt: u64,
    heap_allocations: Option<u32>,
}

/// Runs the box's program on the simulated person, and records its packets.
fn track(
    program: &Path,
    simulation: &Simulation,
    config: &Config,
    frames: u64,
    poses_csv: &Path,
) -> Result<Received> {
    let udp = Udp::bind((Ipv4Addr::LOCALHOST, 0).into())?;
    let address = udp.local_address().context("the UDP port has no address")?;
    // The demo's box and this program know each other by a key of this run alone.
    let key = keys::draw()?;
    let known = KnownBox { name: "the demo's box".into(), key: key.clone(), address: None };
    let mut transport = Link::new(udp, vec![known], "plumb demo").with_past();
    let recorder =
        Recorder::new(plumbline_files::create(poses_csv, true)?, poses_csv.display().to_string());
    let mut receiver = Receiver::new(Some(recorder));
    let folder = tempfile::tempdir().context("no temporary directory can be made")?;
    let config_file = folder.path().join("demo.plb");
    write_config(&config_file, config)?;
    let key_file = folder.path().join(KEY_FILE_NAME);
    plumbline_files::replace(&key_file, format!("{}\n", key.text().as_str()).as_bytes())?;

    let mut the_box = TheBox::start(program, &config_file, &address.to_string())?;
    let bar = ProgressBar::new(frames).with_style(
        ProgressStyle::with_template("tracking {bar:30} {pos}/{len} frames, {eta} left  {msg}")
            .expect("a constant template"),
    );
    let result = std::thread::scope(|scope| {
        let frames_in = the_box.take_input();
        let feeder = scope.spawn(move || person::feed(simulation, frames, frames_in));
        let received = receive(&mut transport, &mut receiver, &mut the_box, &bar);
        // Without the box the feeder's pipe breaks, so that it ends too.
        if received.is_err() {
            the_box.kill();
        }
        let fed = feeder.join().unwrap_or_else(|_| bail!("rendering the person failed"));
        received.and_then(|received| fed.map(|()| received))
    });
    bar.finish_and_clear();
    let said = the_box.finish()?;
    result.map_err(|error| anyhow!("{error:#}; the box's program said:\n{said}"))
}

/// Records packets until the box says that the recording is over.
fn receive(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<File>,
    the_box: &mut TheBox,
    bar: &ProgressBar,
) -> Result<Received> {
    let mut received = Received::default();
    let mut heard = Instant::now();
    loop {
        let mut handled = Ok(());
        transport.poll(&mut |event| {
            heard = Instant::now();
            if let Event::Packet(Packet { message: Message::Pose(pose), .. }) = &event {
                bar.set_position(u64::from(pose.sequence) + 1);
                if pose.sequence.is_multiple_of(16) {
                    bar.set_message(summary(pose));
                }
                received.poses.push(pose.clone());
            }
            if handled.is_ok() {
                handled = receiver.handle(event, heard);
            }
        })?;
        handled?;
        receiver.tick(Instant::now())?;
        let last = receiver.health().is_some_and(|health| health.camera == CameraState::Ended);
        let silent = heard.elapsed();
        if last && silent > STRAGGLERS && !transport.is_missing() {
            break;
        }
        if silent > STRAGGLERS && the_box.is_gone()? {
            bail!("the box's program ended before the last frame");
        }
        if silent > SILENCE_MAX {
            bail!(
                "nothing came from the box for {} s: does a firewall block UDP on 127.0.0.1?",
                SILENCE_MAX.as_secs()
            );
        }
    }
    receiver.finish(Instant::now())?;
    received.repeated = receiver.counts().repeated;
    let bad = receiver.bad();
    received.corrupt = bad.not_authentic
        + bad.corrupt
        + bad.malformed
        + bad.numbers
        + bad.other_version
        + bad.other_schema;
    received.heap_allocations = receiver.health().and_then(|health| health.heap_allocations);
    Ok(received)
}

/// A few words on a packet, for the progress line.
fn summary(pose: &PosePacket) -> String {
    let depths = pose.targets.iter().map(|target| match &target.pose {
        Ok(measured) => format!("{:.2} mm", measured.translation_mm[2]),
        Err(reason) => reason.words().to_owned(),
    });
    format!("depth {}", depths.collect::<Vec<_>>().join(", "))
}

fn write_config(path: &Path, config: &Config) -> Result<()> {
    let mut blob = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut blob).context("the demo's own configuration is refused")?;
    Ok(plumbline_files::replace(path, blob)?)
}

fn write_truth(path: &Path, simulation: &Simulation, frames: u64) -> Result<()> {
    let mut rows = Writer::create(path)?;
    for frame in 0..frames {
        for row in truth_rows(simulation, frame) {
            rows.write(&row)?;
        }
    }
    Ok(rows.flush()?)
}

/// The first frame with what the box found in it drawn in.
fn write_picture(
    path: &Path,
    simulation: &Simulation,
    config: &Config,
    received: &Received,
) -> Result<()> {
    let found = |packet: &&PosePacket| packet.targets.iter().all(|target| target.pose.is_ok());
    let Some(packet) = received.poses.iter().find(found).or(received.poses.first()) else {
        return Ok(());
    };
    let mut pixels = Vec::<u8>::new();
    simulation.render(u64::from(packet.sequence), &mut pixels);
    let frame = Frame {
        index: u64::from(packet.sequence),
        capture_time_ns: packet.capture_time_ns,
        width: usize::from(config.lens.width_px),
        height: usize::from(config.lens.height_px),
        white_level: 255,
        pixels: Pixels::Grey8(&pixels),
    };
    Ok(png::write(path, &draw::annotated(&frame, config, &report(packet, config)))?)
}

/// The part of a report that a packet carries and a picture needs.
fn report(packet: &PosePacket, config: &Config) -> Report {
    let targets = packet.targets.iter().zip(&config.targets).map(|(target, known)| {
        let measurement = target.pose.map(|pose| Measurement {
            cam_from_target: pose.cam_from_target(),
            delay_ns: pose.delay_ns,
            covariance: Matrix6::zeros(),
            rms_px: f64::from(pose.rms_px),
            corners: pose.corners,
            corners_total: known.geometry.corner_count() as u8,
        });
        TargetReport { role: target.role, state: target.state, measurement }
    });
    Report {
        sequence: packet.sequence,
        capture_time_ns: packet.capture_time_ns,
        targets: targets.collect(),
        upper_trunk: None,
        lower_trunk: None,
        corners_dropped: 0,
    }
}
