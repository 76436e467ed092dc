//! `plumb demo`: the whole of Plumbline at work on a person whose motion is known.
//!
//! ```text
//! simulated person ─▶ Y4M ─▶ plumbline-board (the box's own program) ─▶ UDP ─▶ figures, CSV, plot
//! ```

mod figures;
mod person;
mod plot;
mod the_box;

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use plumbline::config::{BLOB_BYTES_MAX, Config, Links, TargetConfig};
use plumbline::packet::{
    CameraState, Health, Message, PACKET_BYTES_MAX, PosePacket, decode_datagram,
};

use self::figures::Figures;
use self::the_box::TheBox;
use crate::error::BadInput;
use crate::files::poses::{PoseRow, Writer};
use crate::simulate::{Simulation, SimulationSettings};

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
    std::fs::create_dir_all(&arguments.out)
        .map_err(|error| BadInput::io(arguments.out.display(), &error))?;

    let received = track(&program, &simulation, u64::from(arguments.frames))?;
    let figures = Figures::new(&simulation, &received, arguments.frames)?;
    println!("{figures}");

    let files = write_results(&arguments.out, &simulation, &received, &figures)?;
    println!("\nWritten in {:.0} s:", started.elapsed().as_secs_f64());
    for (file, what) in files {
        println!("  {}  {what}", file.display());
    }
    Ok(())
}

/// What came from the box.
#[derive(Debug, Default)]
struct Received {
    poses: Vec<PosePacket>,
    /// The last one.
    health: Option<Health>,
    /// Datagrams that were no packets.
    corrupt: usize,
}

/// Runs the box's program on the simulated person and gathers its packets.
fn track(program: &Path, simulation: &Simulation, frames: u64) -> Result<Received> {
    let socket = UdpSocket::bind("127.0.0.1:0")
        .context("no UDP port of this computer can be opened for the box's packets")?;
    socket.set_read_timeout(Some(Duration::from_millis(50)))?;
    let folder = tempfile::tempdir().context("no temporary directory can be made")?;
    let config = folder.path().join("demo.plb");
    write_config(&config, simulation)?;

    let mut the_box = TheBox::start(program, &config, &socket.local_addr()?.to_string())?;
    let bar = ProgressBar::new(frames).with_style(
        ProgressStyle::with_template(
            "{bar:30} {pos}/{len} frames, {per_sec} (rendering sets the pace)  {msg}",
        )
        .expect("a constant template"),
    );
    let result = std::thread::scope(|scope| {
        let frames_in = the_box.take_input();
        let feeder = scope.spawn(move || person::feed(simulation, frames, frames_in));
        let received = receive(&socket, &mut the_box, &bar);
        // Without the box the feeder's pipe is closed, so that it ends too.
        if received.is_err() {
            the_box.kill();
        }
        let fed = feeder.join().unwrap_or_else(|_| bail!("rendering the person failed"));
        // A broken pipe is the box's fault, and the box says more about it.
        received.and_then(|received| fed.map(|()| received))
    });
    bar.finish_and_clear();
    let said = the_box.finish()?;
    result.map_err(|error| anyhow::anyhow!("{error:#}; the box's program said:\n{said}"))
}

/// Gathers packets until the box says that the recording is over, and ends.
fn receive(socket: &UdpSocket, the_box: &mut TheBox, bar: &ProgressBar) -> Result<Received> {
    let mut received = Received::default();
    let mut datagram = [0; PACKET_BYTES_MAX];
    let mut heard = Instant::now();
    loop {
        match socket.recv(&mut datagram) {
            Ok(length) => {
                heard = Instant::now();
                match decode_datagram(&datagram[..length]) {
                    Ok(Message::Pose(pose)) => {
                        bar.set_position(u64::from(pose.sequence) + 1);
                        if pose.sequence % 16 == 0 {
                            bar.set_message(summary(&pose));
                        }
                        received.poses.push(pose);
                    }
                    Ok(Message::Health(health)) => received.health = Some(health),
                    Ok(_) => {}
                    Err(_) => received.corrupt += 1,
                }
            }
            Err(error) if is_timeout(&error) => {
                let ended = received.health.as_ref().is_some_and(|health| {
                    health.camera == CameraState::Ended
                });
                let gone = the_box.is_gone()?;
                if (ended || gone) && heard.elapsed() > STRAGGLERS {
                    if !ended {
                        bail!("the box's program ended before the last frame");
                    }
                    return Ok(received);
                }
                if heard.elapsed() > SILENCE_MAX {
                    bail!(
                        "nothing came from the box for {} s: does a firewall block UDP on 127.0.0.1?",
                        SILENCE_MAX.as_secs()
                    );
                }
            }
            Err(error) => return Err(error).context("receiving from the box failed"),
        }
    }
}

fn is_timeout(error: &std::io::Error) -> bool {
    matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut)
}

/// A few words on a packet, for the progress line.
fn summary(pose: &PosePacket) -> String {
    let depths = pose.targets.iter().map(|target| match &target.pose {
        Ok(measured) => format!("{:.2} mm", measured.translation_mm[2]),
        Err(reason) => reason.words().to_owned(),
    });
    format!("depth {}", depths.collect::<Vec<_>>().join(", "))
}

fn write_config(path: &Path, simulation: &Simulation) -> Result<()> {
    let mut targets = heapless::Vec::new();
    for target in simulation.targets() {
        let name = target.layout.name.try_into().map_err(|_| anyhow::anyhow!("a long name"))?;
        let target = TargetConfig { name, geometry: target.geometry.clone() };
        targets.push(target).map_err(|_| anyhow::anyhow!("more targets than a box tracks"))?;
    }
    let cam_from_scene = simulation.cam_from_scene();
    let (angles, place_mm) = (cam_from_scene.euler(), cam_from_scene.translation_mm);
    let config = Config {
        device: "demo".try_into().unwrap_or_default(),
        serial_number: heapless::String::new(),
        lens: *simulation.camera(),
        targets,
        cam_from_scene_theta: Some([
            angles.theta1_rad,
            angles.theta2_rad,
            angles.theta3_rad,
            place_mm.x,
            place_mm.y,
            place_mm.z,
        ]),
        links: Links::default(),
    };
    let mut blob = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut blob).context("the demo's own configuration is refused")?;
    std::fs::write(path, blob).map_err(|error| BadInput::io(path.display(), &error))?;
    Ok(())
}

/// Writes everything that is worth keeping, and says what is where.
fn write_results(
    folder: &Path,
    simulation: &Simulation,
    received: &Received,
    figures: &Figures,
) -> Result<Vec<(PathBuf, &'static str)>> {
    let poses = folder.join("poses.csv");
    write_poses(&poses, simulation, received)?;
    let truth = folder.join("truth.csv");
    write_truth(&truth, simulation, received)?;
    let plot = folder.join("sway.svg");
    plot::write(&plot, figures)?;
    Ok(vec![
        (plot, "the sway path and the depth error; any browser shows it"),
        (poses, "what was measured"),
        (truth, "what was true"),
    ])
}

fn write_poses(path: &Path, simulation: &Simulation, received: &Received) -> Result<()> {
    let mut rows = Writer::create(path)?;
    for packet in &received.poses {
        let time_s = packet.capture_time_ns as f64 / 1e9;
        for target in &packet.targets {
            let name = simulation
                .targets()
                .iter()
                .find(|known| known.layout.role == target.role)
                .map_or("unknown", |known| known.layout.name);
            let frame = u64::from(packet.sequence);
            let row = match &target.pose {
                Ok(pose) => {
                    let theta = [pose.theta_rad, pose.translation_mm].concat();
                    let theta = std::array::from_fn(|index| f64::from(theta[index]));
                    let [sd_x_mm, sd_y_mm, sd_z_mm] = pose.sd_mm.map(|sd| Some(f64::from(sd)));
                    PoseRow {
                        sd_x_mm,
                        sd_y_mm,
                        sd_z_mm,
                        rms_px: Some(f64::from(pose.rms_px)),
                        points: Some(u32::from(pose.corners)),
                        ..PoseRow::without_pose(frame, time_s, name, target.state.word())
                            .with_pose(&plumbline::pose::Pose::from_theta(theta))
                    }
                }
                Err(reason) => PoseRow::without_pose(frame, time_s, name, reason.words()),
            };
            rows.write(&row)?;
        }
    }
    Ok(rows.flush()?)
}

fn write_truth(path: &Path, simulation: &Simulation, received: &Received) -> Result<()> {
    let mut rows = Writer::create(path)?;
    for packet in &received.poses {
        let truth = simulation.truth(u64::from(packet.sequence));
        for (target, known) in truth.targets.iter().zip(simulation.targets()) {
            let row = PoseRow::without_pose(truth.frame, truth.time_s, known.layout.name, "truth")
                .with_pose(&target.cam_from_target);
            rows.write(&row)?;
        }
    }
    Ok(rows.flush()?)
}
