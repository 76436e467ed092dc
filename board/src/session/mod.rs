//! The main loop: frames through the pipeline, packets to the links, a
//! heartbeat once a second, and the figures at the end.
//!
//! One thread does all of it in a fixed order, so that it is always clear what it is doing,
//! and it waits for nothing but the next frame. (Storing a configuration, and a picture in
//! set-up mode, delay it by some frames.)

mod aim;
mod commands;
mod counters;
mod durations;
mod outgoing;
mod picture;
mod summary;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::config::{BLOB_BYTES_MAX, Capture, Config};
use plumbline::packet::{
    CameraState, Command, Document, Hello, LINKS_MAX, LinkKind, Message, PosePacket, ResetReason,
    Start, TargetInfo, View,
};
use plumbline::pipeline::Pipeline;

use crate::config_store::ConfigStore;
use crate::link::{Link, Links, send};
use crate::logger;
use crate::machine::clock;
use crate::machine::watchdog::Watchdog;
use crate::provisioning::Provisioning;
use crate::source::{Exposure, Frame, FrameSource, Next, Pixels};
use crate::status::{self, Status};
use aim::Aim;
use counters::Counters;
use outgoing::Outgoing;
pub use summary::{Ended, Summary};

/// How often Hello and Health are sent.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// The longest iteration of the loop: within this time a signal or a command is noticed.
const TURN_MAX: Duration = Duration::from_millis(20);

/// How long the links may take at the end to send their waiting packets.
const FINISH: Duration = Duration::from_secs(2);

/// How often a pose is sent over a serial line that is also sending a document.
const POSE_BESIDE_DOCUMENT: Duration = Duration::from_millis(200);

/// What a session needs besides the configuration.
#[derive(Debug)]
pub struct Setup {
    /// Where the packets go.
    pub links: Links,
    /// How often the program has started, if that is counted.
    pub boot_count: Option<u32>,
    /// Why the box started this time.
    pub reset_reason: ResetReason,
    /// Restarts the computer when no frames are processed.
    pub watchdog: Option<Watchdog>,
    /// Where a configuration that a host sends is stored.
    pub store: Option<ConfigStore>,
    /// Whether the host may ask for a restart, which the caller then carries out.
    pub may_reboot: bool,
}

/// Tracks until the source ends, the host asks for a restart, or `stop` is set.
pub fn run(
    pipeline: &mut Pipeline,
    config: &Config,
    source: &mut impl FrameSource,
    setup: Setup,
    stop: &AtomicBool,
) -> Ended {
    let mut session = Session::new(config, setup);
    let broken = session.run(pipeline, source, stop);
    let (summary, unrecorded) = session.finish();
    Ended { summary, broken, unrecorded }
}

struct Session {
    started: Instant,
    /// The number of this start, in each of its packets.
    start: Start,
    hello: Hello,
    /// The configuration in use, encoded for hosts.
    blob: heapless::Vec<u8, BLOB_BYTES_MAX>,
    /// The checksum of the configuration that takes effect at the next start.
    next_crc: u32,
    capture: Option<Capture>,
    links: Links,
    watchdog: Option<Watchdog>,
    may_reboot: bool,
    reboot: bool,
    counters: Counters,
    /// The status after the last frame.
    tracking: Status,
    aim: Aim,
    outgoing: Outgoing,
    provisioning: Provisioning,
    /// Whether a View of the next frame is wanted, per link.
    views_wanted: [bool; LINKS_MAX],
    /// When the last pose was sent beside a document.
    pose_beside: Instant,
}

impl Session {
    fn new(config: &Config, setup: Setup) -> Self {
        let started = Instant::now();
        let mut blob = heapless::Vec::new();
        // The vector has room for every configuration.
        let _ = blob.resize(BLOB_BYTES_MAX, 0);
        let bytes = config.encode(&mut blob).map_or(0, <[u8]>::len);
        blob.truncate(bytes);
        let start = crate::start::draw();
        Self {
            started,
            start,
            hello: hello(config, &setup, start),
            blob,
            next_crc: config.crc(),
            capture: config.capture.clone(),
            links: setup.links,
            watchdog: setup.watchdog,
            may_reboot: setup.may_reboot,
            reboot: false,
            counters: Counters::new(started),
            tracking: Status::Searching,
            aim: Aim::default(),
            outgoing: Outgoing::default(),
            provisioning: Provisioning::new(setup.store),
            views_wanted: [false; LINKS_MAX],
            pose_beside: started,
        }
    }

    /// The loop itself; returns the source's message if that failed.
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
                // Missed beats are not caught up.
                beat = (beat + HEARTBEAT).max(now);
            }
            if self.aim.end_in_time(now) {
                // Does nothing to a recording, which has only one exposure.
                let _ = source.expose(Exposure::default());
                self.counters.forget_allocations();
                self.send_health();
            }
            self.serve_links(source);
            let exposure = source.exposure();
            match source.next(beat.min(now + TURN_MAX)) {
                Next::Frame(frame) => self.process(pipeline, &frame, exposure),
                Next::Quiet => {}
                Next::End => break,
                Next::Broken(message) => return Some(message),
            }
        }
        None
    }

    /// Reads the source's condition and sets the box's status: in every iteration, so that a
    /// status that is not refreshed means that the loop hangs.
    fn look_after(&mut self, source: &impl FrameSource) {
        let before = std::mem::replace(&mut self.counters.source, source.condition());
        let camera = self.counters.source.camera;
        status::set(match camera {
            CameraState::Running | CameraState::Ended => self.tracking,
            CameraState::Starting | CameraState::Stalled | CameraState::Lost => Status::NoCamera,
        });
        if camera == before.camera {
            return;
        }
        if matches!(camera, CameraState::Lost | CameraState::Stalled)
            && let Some(watchdog) = &mut self.watchdog
        {
            watchdog.stop();
        }
        // A camera that is lost or back is reported without waiting for the next beat.
        if self.counters.frames > 0 || camera == CameraState::Lost {
            self.send_health();
        }
    }

    /// Measures, sends and counts one frame.
    fn process(&mut self, pipeline: &mut Pipeline, frame: &Frame<'_>, exposure: Exposure) {
        let began = Instant::now();
        let time_ns = frame.capture_time_ns;
        let report = match &frame.pixels {
            Pixels::Grey8(image) => pipeline.step(image, time_ns),
            Pixels::Grey16(image) => pipeline.step(image, time_ns),
        };
        self.counters.step.record(began.elapsed());
        self.counters.corners_dropped = report.corners_dropped;
        let is_whole = report.targets.iter().all(|target| target.measurement.is_ok());
        self.tracking = if is_whole { Status::Tracking } else { Status::Searching };
        let latency_us = u32::try_from(frame.ready_at.elapsed().as_micros()).unwrap_or(u32::MAX);
        let packet = PosePacket::from_report(&report, frame.instant, latency_us);
        self.send_pose(packet);
        let losses = self.counters.source.camera_losses;
        self.counters.frame(frame.ready_at.elapsed(), frame.late, losses);
        if let Some(watchdog) = &mut self.watchdog {
            watchdog.feed();
        }
        self.show(pipeline, frame, report.sequence, exposure);
    }

    /// Sends the Views and the picture of the frame that hosts have asked for.
    fn show(
        &mut self,
        pipeline: &mut Pipeline,
        frame: &Frame<'_>,
        sequence: u32,
        Exposure { exposure_us, gain }: Exposure,
    ) {
        if self.views_wanted.contains(&true) {
            let (whole, targets) = match &frame.pixels {
                Pixels::Grey8(image) => pipeline.view(image),
                Pixels::Grey16(image) => pipeline.view(image),
            };
            let view = View { sequence, exposure_us, gain, frame: whole, targets };
            let wanted = std::mem::take(&mut self.views_wanted);
            let links = self.links.iter_mut().zip(wanted).filter(|(_, wanted)| *wanted);
            send(links.map(|(link, _)| link), self.start, &Message::View(view));
        }
        if let Some((link, picture)) = self.aim.take(frame, sequence) {
            self.counters.forget_allocations();
            send(self.links.get_mut(link), self.start, &Message::Picture(picture));
        }
    }

    /// Sends a pose to every link, except where a document needs the room.
    fn send_pose(&mut self, packet: PosePacket) {
        let is_due = self.pose_beside.elapsed() >= POSE_BESIDE_DOCUMENT;
        if is_due {
            self.pose_beside = Instant::now();
        }
        let links = self.links.iter_mut().enumerate().filter(|(index, link)| {
            let is_needed = self.outgoing.is_busy(*index) && self.aim.is_on(*index);
            is_due || !is_needed || link.kind() != LinkKind::Serial
        });
        send(links.map(|(_, link)| link), self.start, &Message::Pose(packet));
    }

    fn send_hello(&mut self) {
        let hello = Message::Hello(self.hello.clone());
        self.send(&hello);
    }

    fn send_health(&mut self) {
        let aiming_s = self.aim.left_s(Instant::now());
        let health = Message::Health(self.counters.health(&self.links, aiming_s));
        self.send(&health);
    }

    fn send_logs(&mut self) {
        while let Some(log) = logger::take(self.started) {
            self.send(&Message::Log(log));
        }
    }

    /// Sends what has been logged, carries out commands, and sends waiting packets.
    fn serve_links(&mut self, source: &mut impl FrameSource) {
        self.send_logs();
        for index in 0..self.links.len() {
            let mut commands = heapless::Vec::<Command, 8>::new();
            self.links[index].receive(|message| match message {
                // More at once than there is room for are a flood; the host asks again.
                Message::Command(command) => drop(commands.push(command)),
                Message::Part(part) => self.provisioning.take(&part),
                _ => {}
            });
            let received_ns = clock::monotonic_ns();
            for command in commands {
                let reply = self.carry_out(command, index, received_ns, source);
                send(self.links.get_mut(index), self.start, &Message::Reply(reply));
            }
            let file = |document| match document {
                Document::Config => Some(&self.blob[..]),
                Document::Picture(number) => self.aim.file(number),
            };
            self.outgoing.serve(index, &mut self.links[index], self.start, file);
            self.links[index].service();
        }
    }

    fn send(&mut self, message: &Message) {
        send(&mut self.links, self.start, message);
    }

    /// Tells the hosts that the session ends, and sends waiting packets. Returns the figures,
    /// and why packets could not be recorded, if so.
    fn finish(mut self) -> (Summary, Option<String>) {
        let source = self.counters.source;
        self.counters.source.camera = CameraState::Ended;
        self.send_logs();
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

fn hello(config: &Config, setup: &Setup, start: Start) -> Hello {
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
        boot_id: start.get(),
        boot_count: setup.boot_count,
        reset_reason: setup.reset_reason,
        width_px: config.lens.width_px,
        height_px: config.lens.height_px,
        targets: targets.collect(),
    }
}
