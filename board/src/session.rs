//! The main loop: frames through the pipeline, packets to the links, a
//! heartbeat once a second, and the figures at the end.
//!
//! One thread does all of it, in this order: what it is doing is always plain,
//! and nothing waits for anything but the next frame.

mod counters;
mod summary;

use std::hash::BuildHasher;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::{
    Action, CameraState, Command, FRAME_BYTES_MAX, Hello, LINKS_MAX, Message, PACKET_BYTES_MAX,
    PosePacket, Refusal, Reply, ReplyOutcome, ResetReason, TargetInfo, encode_datagram,
    encode_frame,
};
use plumbline::pipeline::Pipeline;

use crate::clock;
use crate::link::{Encoded, Link};
use crate::logger;
use crate::source::{Frame, FrameSource, Next, Pixels};
use crate::watchdog::Watchdog;
use counters::Counters;
pub use summary::{Ended, Summary};

/// Hello and Health go out this often.
pub const HEARTBEAT: Duration = Duration::from_secs(1);

/// The loop turns at least this often: so soon is a signal or a command noticed.
const TURN_MAX: Duration = Duration::from_millis(20);

/// At the end, links get this long to hand on what waits.
const FINISH: Duration = Duration::from_secs(2);

/// The links in use, one of each kind at most.
pub type Links = heapless::Vec<Link, LINKS_MAX>;

/// What a session starts with, besides the configuration.
#[derive(Debug)]
pub struct Setup {
    /// Where the packets go.
    pub links: Links,
    /// How often the program has started, where that is kept.
    pub boot_count: Option<u32>,
    /// Why it started this time.
    pub reset_reason: ResetReason,
    /// Restarts the computer when no frame is processed.
    pub watchdog: Option<Watchdog>,
    /// The host may ask for a restart, which the caller then carries out.
    pub may_reboot: bool,
}

/// Tracks until the source ends, the host asks for a restart or `stop` is raised.
pub fn run(
    pipeline: &mut Pipeline,
    config: &Config,
    source: &mut impl FrameSource,
    setup: Setup,
    stop: &AtomicBool,
) -> Ended {
    let mut session = Session::new(config, setup);
    let broken = session.run(pipeline, source, stop);
    let reboot = session.reboot;
    let (summary, unrecorded) = session.finish();
    Ended { summary, broken, unrecorded, reboot }
}

struct Session {
    started: Instant,
    hello: Hello,
    links: Links,
    watchdog: Option<Watchdog>,
    may_reboot: bool,
    reboot: bool,
    counters: Counters,
}

impl Session {
    fn new(config: &Config, setup: Setup) -> Self {
        let started = Instant::now();
        Self {
            started,
            hello: hello(config, &setup),
            links: setup.links,
            watchdog: setup.watchdog,
            may_reboot: setup.may_reboot,
            reboot: false,
            counters: Counters::new(started),
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
        while !stop.load(Ordering::Relaxed) && !self.reboot {
            let now = Instant::now();
            self.look_after(source);
            if now >= beat {
                self.send_hello();
                self.send_health();
                // Beats that were missed are not made up for.
                beat = (beat + HEARTBEAT).max(now);
            }
            self.serve_links();
            match source.next(beat.min(now + TURN_MAX)) {
                Next::Frame(frame) => self.process(pipeline, &frame),
                Next::Quiet => {}
                Next::End => break,
                Next::Broken(message) => return Some(message),
            }
        }
        None
    }

    /// Takes note of how the source is doing.
    fn look_after(&mut self, source: &impl FrameSource) {
        let before = std::mem::replace(&mut self.counters.source, source.condition());
        let camera = self.counters.source.camera;
        if camera == before.camera {
            return;
        }
        if matches!(camera, CameraState::Lost | CameraState::Stalled)
            && let Some(watchdog) = &mut self.watchdog
        {
            watchdog.stop();
        }
        // A camera that is lost or back is no news that can wait for the next beat.
        if self.counters.frames > 0 || camera == CameraState::Lost {
            self.send_health();
        }
    }

    /// One frame: measured, sent, counted.
    fn process(&mut self, pipeline: &mut Pipeline, frame: &Frame<'_>) {
        let began = Instant::now();
        let time_ns = frame.capture_time_ns;
        let report = match &frame.pixels {
            Pixels::Grey8(image) => pipeline.step(image, time_ns),
            Pixels::Grey16(image) => pipeline.step(image, time_ns),
        };
        self.counters.step.record(began.elapsed());
        self.counters.corners_dropped = report.corners_dropped;
        let latency_us = u32::try_from(frame.ready_at.elapsed().as_micros()).unwrap_or(u32::MAX);
        let packet = PosePacket::from_report(&report, frame.instant, latency_us);
        self.send(&Message::Pose(packet));
        let losses = self.counters.source.camera_losses;
        self.counters.frame(frame.ready_at.elapsed(), frame.late, losses);
        if let Some(watchdog) = &mut self.watchdog {
            watchdog.feed();
        }
    }

    fn send_hello(&mut self) {
        let hello = Message::Hello(self.hello.clone());
        self.send(&hello);
    }

    fn send_health(&mut self) {
        let health = Message::Health(self.counters.health(&self.links));
        self.send(&health);
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
            let received_ns = clock::monotonic_ns();
            for command in commands {
                let reply = self.carry_out(command, received_ns);
                send(std::slice::from_mut(&mut self.links[index]), &Message::Reply(reply));
            }
            self.links[index].service();
        }
    }

    fn carry_out(&mut self, command: Command, box_received_ns: u64) -> Reply {
        let outcome = match command.action {
            Action::Ping { host_sent_ns } => ReplyOutcome::Pong {
                host_sent_ns,
                box_received_ns,
                box_sent_ns: clock::monotonic_ns(),
            },
            Action::QueryConfig => ReplyOutcome::Config { crc: self.hello.config_crc, bytes: 0 },
            Action::SendHello => {
                self.send_hello();
                ReplyOutcome::Accepted
            }
            Action::SendHealth => {
                self.send_health();
                ReplyOutcome::Accepted
            }
            Action::Reboot if self.may_reboot => {
                log::warn!("restarting: the host has asked for it");
                self.reboot = true;
                ReplyOutcome::Accepted
            }
            // Whoever started this program can start it anew.
            _ => ReplyOutcome::Refused {
                refusal: Refusal::NotSupported,
                reason: heapless::String::new(),
            },
        };
        Reply { id: command.id, outcome }
    }

    fn send(&mut self, message: &Message) {
        send(&mut self.links, message);
    }

    /// Tells the host that this is the end, and hands on what waits. The figures,
    /// and why packets could not be recorded, if so.
    fn finish(mut self) -> (Summary, Option<String>) {
        let source = self.counters.source;
        self.counters.source.camera = CameraState::Ended;
        self.serve_links();
        self.send_health();
        let give_up = Instant::now() + FINISH;
        for link in &mut self.links {
            link.finish(give_up.saturating_duration_since(Instant::now()));
        }
        let unrecorded = self.links.iter().find_map(Link::fault).map(str::to_owned);
        let summary = Summary {
            frames: self.counters.frames,
            late: self.counters.late,
            source,
            allocations: self.counters.allocations(),
            links: self.links.iter().map(|link| (link.to_string(), link.counts())).collect(),
            step: self.counters.step,
            latency: self.counters.latency,
        };
        (summary, unrecorded)
    }
}

fn hello(config: &Config, setup: &Setup) -> Hello {
    let targets = config.targets.iter().map(|target| TargetInfo {
        name: target.name.clone(),
        role: target.geometry.role(),
        // At most TARGET_CORNERS_MAX, which fits.
        corners: target.geometry.corner_count() as u8,
    });
    Hello {
        device: config.device.clone(),
        serial_number: config.serial_number.clone(),
        firmware: concat!("plumbline ", env!("CARGO_PKG_VERSION")).try_into().unwrap_or_default(),
        config_crc: config.crc(),
        boot_id: boot_id(),
        boot_count: setup.boot_count,
        reset_reason: setup.reset_reason,
        width_px: config.lens.width_px,
        height_px: config.lens.height_px,
        targets: targets.collect(),
    }
}

/// A number that no earlier start is likely to have had.
fn boot_id() -> u32 {
    // The keys of the standard hasher are drawn at random by the operating system.
    std::collections::hash_map::RandomState::new().hash_one(0_u8) as u32
}

/// Sends one message over each of the links.
pub fn send(links: &mut [Link], message: &Message) {
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
