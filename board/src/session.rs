//! The main loop: frames through the pipeline, packets to the links, a
//! heartbeat once a second, and the figures at the end.

use std::hash::BuildHasher;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::{
    Action, CameraState, Command, FRAME_BYTES_MAX, Health, Hello, LINKS_MAX, LinkHealth, Message,
    PACKET_BYTES_MAX, PosePacket, Refusal, Reply, ReplyOutcome, ResetReason, TargetInfo,
    encode_datagram, encode_frame,
};
use plumbline::pipeline::Pipeline;

use crate::allocation::allocations;
use crate::link::{Counts, Encoded, Link};
use crate::logger;
use crate::measure::Durations;
use crate::source::{Condition, FrameSource, Next, Pixels};
use crate::temperature::Sensor;

/// Hello and Health go out this often.
pub const HEARTBEAT: Duration = Duration::from_secs(1);

/// The loop turns at least this often: so soon is a signal or a command noticed.
const TURN_MAX: Duration = Duration::from_millis(20);

/// At the end, links get this long to hand on what waits.
const FINISH: Duration = Duration::from_secs(2);

/// The links in use, one of each kind at most.
pub type Links = heapless::Vec<Link, LINKS_MAX>;

/// How a session ended.
#[derive(Debug)]
pub struct Ended {
    /// The figures.
    pub summary: Summary,
    /// Why the source broke, when it did.
    pub broken: Option<String>,
}

/// The figures of a session.
#[derive(Debug)]
pub struct Summary {
    /// Frames tracked.
    pub frames: u64,
    /// Of them, those taken up when the next one was already due.
    pub late: u64,
    /// Time in the pipeline, per frame.
    pub step: Durations,
    /// From a frame's being ready to its packet's being handed to the links.
    pub latency: Durations,
    /// What became of the packets, per link.
    pub links: heapless::Vec<(String, Counts), LINKS_MAX>,
    /// Heap allocations of the whole process between the end of the first frame
    /// and the end of the last.
    pub allocations: u64,
}

/// Tracks until the source ends or `stop` is raised.
pub fn run(
    pipeline: &mut Pipeline,
    config: &Config,
    source: &mut impl FrameSource,
    links: Links,
    boot_count: Option<u32>,
    stop: &AtomicBool,
) -> Ended {
    let mut session = Session::new(config, links, boot_count);
    let broken = session.run(pipeline, source, stop);
    Ended { summary: session.finish(), broken }
}

/// What a source is before anybody asked.
const STARTING: Condition = Condition {
    camera: CameraState::Starting,
    frames_dropped: 0,
    frames_missed: 0,
    camera_losses: 0,
};

struct Session {
    started: Instant,
    hello: Hello,
    links: Links,
    sensor: Sensor,
    /// Of the source, when it was last asked.
    source: Condition,
    frames: u64,
    corners_dropped: u32,
    late: u64,
    step: Durations,
    latency: Durations,
    latency_max_since_health: Duration,
    /// The allocator's count after the first frame, and after the last.
    allocations: Option<(u64, u64)>,
}

impl Session {
    fn new(config: &Config, links: Links, boot_count: Option<u32>) -> Self {
        let targets = config.targets.iter().map(|target| TargetInfo {
            name: target.name.clone(),
            role: target.geometry.role(),
            // At most TARGET_CORNERS_MAX, which fits.
            corners: target.geometry.corner_count() as u8,
        });
        let hello = Hello {
            device: config.device.clone(),
            serial_number: config.serial_number.clone(),
            firmware: concat!("plumbline ", env!("CARGO_PKG_VERSION"))
                .try_into()
                .unwrap_or_default(),
            config_crc: config.crc(),
            boot_id: boot_id(),
            boot_count,
            reset_reason: ResetReason::Unknown,
            width_px: config.lens.width_px,
            height_px: config.lens.height_px,
            targets: targets.collect(),
        };
        let now = Instant::now();
        Self {
            started: now,
            hello,
            links,
            sensor: Sensor::open(),
            source: STARTING,
            frames: 0,
            corners_dropped: 0,
            late: 0,
            step: Durations::new(),
            latency: Durations::new(),
            latency_max_since_health: Duration::ZERO,
            allocations: None,
        }
    }

    /// The loop itself; the source's message when it broke.
    fn run(
        &mut self,
        pipeline: &mut Pipeline,
        source: &mut impl FrameSource,
        stop: &AtomicBool,
    ) -> Option<String> {
        let mut beat = self.started;
        while !stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            let condition = source.condition();
            // A camera that is lost or back is no news that can wait.
            let news = condition.camera != self.source.camera;
            self.source = condition;
            if news && now < beat {
                self.send_health();
            }
            if now >= beat {
                self.heartbeat();
                // Beats that were missed are not made up for.
                beat = (beat + HEARTBEAT).max(now);
            }
            self.serve_links();
            match source.next(beat.min(now + TURN_MAX)) {
                Next::Frame(frame) => {
                    let began = Instant::now();
                    let time_ns = frame.capture_time_ns;
                    let report = match &frame.pixels {
                        Pixels::Grey8(image) => pipeline.step(image, time_ns),
                        Pixels::Grey16(image) => pipeline.step(image, time_ns),
                    };
                    self.step.record(began.elapsed());
                    self.corners_dropped = report.corners_dropped;
                    let latency = frame.ready_at.elapsed();
                    let packet = PosePacket::from_report(
                        &report,
                        frame.instant,
                        u32::try_from(latency.as_micros()).unwrap_or(u32::MAX),
                    );
                    self.send(&Message::Pose(packet));
                    self.count_frame(frame.ready_at.elapsed(), frame.late);
                }
                Next::Quiet => {}
                Next::End => break,
                Next::Broken(message) => return Some(message),
            }
        }
        None
    }

    fn count_frame(&mut self, latency: Duration, late: bool) {
        self.frames += 1;
        self.late += u64::from(late);
        self.latency.record(latency);
        self.latency_max_since_health = self.latency_max_since_health.max(latency);
        let count = allocations();
        let after_first = self.allocations.map_or(count, |(after_first, _)| after_first);
        self.allocations = Some((after_first, count));
    }

    fn allocations_after_first_frame(&self) -> u64 {
        self.allocations.map_or(0, |(after_first, after_last)| after_last - after_first)
    }

    fn heartbeat(&mut self) {
        self.send_hello();
        self.send_health();
    }

    fn send_hello(&mut self) {
        let hello = Message::Hello(self.hello.clone());
        self.send(&hello);
    }

    fn send_health(&mut self) {
        let latency_max = std::mem::take(&mut self.latency_max_since_health);
        let links = self.links.iter().map(|link| {
            let counts = link.counts();
            LinkHealth {
                kind: link.kind(),
                packets_sent: saturated(counts.sent),
                packets_dropped: saturated(counts.dropped),
            }
        });
        let health = Health {
            uptime_ms: self.started.elapsed().as_millis() as u64,
            frames: saturated(self.frames),
            frames_dropped: saturated(self.source.frames_dropped),
            frames_missed: saturated(self.source.frames_missed),
            camera_losses: self.source.camera_losses,
            corners_dropped: self.corners_dropped,
            heap_allocations: Some(saturated(self.allocations_after_first_frame())),
            temperature_decicelsius: self.sensor.decicelsius(),
            camera: self.source.camera,
            latency_us_max: u32::try_from(latency_max.as_micros()).unwrap_or(u32::MAX),
            logs_dropped: logger::dropped(),
            links: links.collect(),
        };
        self.send(&Message::Health(health));
    }

    /// Sends what has been logged, carries out commands, hands on what waits.
    fn serve_links(&mut self) {
        while let Some(log) = logger::take(self.started) {
            self.send(&Message::Log(log));
        }
        for index in 0..self.links.len() {
            let mut commands = heapless::Vec::<Command, 8>::new();
            self.links[index].receive(|message| {
                if let Message::Command(command) = message {
                    // More at once than this are a flood; the host asks again.
                    let _ = commands.push(command);
                }
            });
            let received_ns = self.uptime_ns();
            for command in commands {
                let reply = self.carry_out(command, received_ns);
                send(std::slice::from_mut(&mut self.links[index]), &Message::Reply(reply));
            }
            self.links[index].service();
        }
    }

    /// A replay has no capture clock of its own: pings get the time since the start.
    fn uptime_ns(&self) -> u64 {
        self.started.elapsed().as_nanos() as u64
    }

    fn carry_out(&mut self, command: Command, box_received_ns: u64) -> Reply {
        let outcome = match command.action {
            Action::Ping { host_sent_ns } => {
                ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns: self.uptime_ns() }
            }
            Action::QueryConfig => ReplyOutcome::Config { crc: self.hello.config_crc },
            Action::SendHello => {
                self.send_hello();
                ReplyOutcome::Accepted
            }
            Action::SendHealth => {
                self.send_health();
                ReplyOutcome::Accepted
            }
            // There is nothing to reboot: whoever started this program can start it anew.
            Action::Reboot => ReplyOutcome::Refused(Refusal::NotSupported),
        };
        Reply { id: command.id, outcome }
    }

    fn send(&mut self, message: &Message) {
        send(&mut self.links, message);
    }

    /// Tells the host that this is the end, and hands on what waits.
    fn finish(mut self) -> Summary {
        self.source.camera = CameraState::Ended;
        self.serve_links();
        self.send_health();
        let give_up = Instant::now() + FINISH;
        for link in &mut self.links {
            link.finish(give_up.saturating_duration_since(Instant::now()));
        }
        Summary {
            frames: self.frames,
            late: self.late,
            allocations: self.allocations_after_first_frame(),
            links: self.links.iter().map(|link| (link.to_string(), link.counts())).collect(),
            step: self.step,
            latency: self.latency,
        }
    }
}

fn send(links: &mut [Link], message: &Message) {
    let mut datagram = [0; PACKET_BYTES_MAX];
    let mut frame = [0; FRAME_BYTES_MAX];
    let encoded = (encode_datagram(message, &mut datagram), encode_frame(message, &mut frame));
    let (Ok(datagram), Ok(frame)) = encoded else {
        // The buffers hold every message: the packet module computes them so.
        unreachable!("a message larger than the largest");
    };
    for link in links {
        link.send(Encoded { datagram, frame });
    }
}

/// A number that no earlier start is likely to have had.
fn boot_id() -> u32 {
    // The keys of the standard hasher are drawn at random by the operating system.
    std::collections::hash_map::RandomState::new().hash_one(0_u8) as u32
}

fn saturated(count: u64) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

impl std::fmt::Display for Summary {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        writeln!(formatter, "frames       {} ({} late)", self.frames, self.late)?;
        for (name, durations) in [("step time", &self.step), ("latency", &self.latency)] {
            writeln!(
                formatter,
                "{name:<12} median {:.3} ms, worst {:.3} ms",
                ms(durations.median()),
                ms(durations.worst())
            )?;
        }
        for (name, counts) in &self.links {
            writeln!(
                formatter,
                "packets      {} sent, {} dropped ({name})",
                counts.sent, counts.dropped
            )?;
        }
        write!(formatter, "allocations  {} after the first frame", self.allocations)
    }
}
