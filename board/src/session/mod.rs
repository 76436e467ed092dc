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
    CameraState, Command, Document, Hello, Message, PosePacket, Reply, ResetReason, TargetInfo,
    UpdateOutcome, UpdateRequest, View,
};
use plumbline::pipeline::Pipeline;
use plumbline::seal::{CALLER_NAME_BYTES_MAX, LISTENERS_MAX, ListenerId};

use crate::config_store::ConfigStore;
use crate::link::{Links, MESSAGES_PER_TURN_MAX, Said};
use crate::logger;
use crate::machine::watchdog::Watchdog;
use crate::provisioning::Provisioning;
use crate::source::{Exposure, Frame, FrameSource, Next, Pixels};
use crate::status::{self, Status};
use crate::trigger::{self, Triggers};
use crate::update::Updates;
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

/// Commands that are carried out in one turn: as many as the links pass on.
const COMMANDS_PER_TURN_MAX: usize = 2 * MESSAGES_PER_TURN_MAX;

/// How often a pose is sent over a serial line that is also sending a document.
const POSE_BESIDE_DOCUMENT: Duration = Duration::from_millis(200);

/// What a session needs besides the configuration.
#[derive(Debug)]
pub struct Setup<'a> {
    /// Where the packets go.
    pub links: Links,
    /// How often the program has started, if that is counted.
    pub boot_count: Option<u32>,
    /// Why the box started this time.
    pub reset_reason: ResetReason,
    /// Restarts the computer when no frames are processed.
    pub watchdog: Option<Watchdog>,
    /// The wires to other devices.
    pub triggers: Triggers,
    /// Where a configuration that a host sends is stored.
    pub store: Option<ConfigStore>,
    /// Whether the host may ask for a restart, which the caller then carries out.
    pub may_reboot: bool,
    /// The update of the whole system.
    pub updates: &'a mut Updates,
}

/// Tracks until the source ends, the host asks for a restart, or `stop` is set.
pub fn run(
    pipeline: &mut Pipeline,
    config: &Config,
    source: &mut impl FrameSource,
    setup: Setup<'_>,
    stop: &AtomicBool,
) -> Ended {
    let mut session = Session::new(config, setup);
    let broken = session.run(pipeline, source, stop);
    let (summary, unrecorded) = session.finish();
    Ended { summary, broken, unrecorded }
}

struct Session<'a> {
    started: Instant,
    hello: Hello,
    /// The configuration in use, encoded for hosts.
    blob: heapless::Vec<u8, BLOB_BYTES_MAX>,
    /// The checksum of the configuration that takes effect at the next start.
    next_crc: u32,
    capture: Option<Capture>,
    links: Links,
    watchdog: Option<Watchdog>,
    triggers: Triggers,
    may_reboot: bool,
    reboot: bool,
    counters: Counters,
    /// The status after the last frame.
    tracking: Status,
    aim: Aim,
    outgoing: Outgoing,
    provisioning: Provisioning,
    updates: &'a mut Updates,
    /// Who wants a View of the next frame, by their places.
    views_wanted: [Option<ListenerId>; LISTENERS_MAX],
    /// When the last pose was sent beside a document.
    pose_beside: Instant,
}

impl<'a> Session<'a> {
    fn new(config: &Config, setup: Setup<'a>) -> Self {
        let started = Instant::now();
        let mut blob = heapless::Vec::new();
        // The vector has room for every configuration.
        let _ = blob.resize(BLOB_BYTES_MAX, 0);
        let bytes = config.encode(&mut blob).map_or(0, <[u8]>::len);
        blob.truncate(bytes);
        Self {
            started,
            hello: hello(config, &setup),
            blob,
            next_crc: config.crc(),
            capture: config.capture.clone(),
            links: setup.links,
            watchdog: setup.watchdog,
            triggers: setup.triggers,
            may_reboot: setup.may_reboot,
            reboot: false,
            counters: Counters::new(started),
            tracking: Status::Searching,
            aim: Aim::default(),
            outgoing: Outgoing::default(),
            provisioning: Provisioning::new(setup.store),
            updates: setup.updates,
            views_wanted: [None; LISTENERS_MAX],
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
        while !stop.load(Ordering::Relaxed) && !self.reboot && self.updates.leave().is_none() {
            let now = Instant::now();
            if self.updates.is_unproven()
                && let Some(watchdog) = &mut self.watchdog
            {
                // It watches the loop itself, with and without a camera: what hangs is no system to keep.
                watchdog.feed();
            }
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
            self.serve_triggers(now);
            self.serve_links(source);
            let exposure = source.exposure();
            let until = beat.min(now + TURN_MAX);
            match source.next(self.triggers.due().map_or(until, |due| until.min(due))) {
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
            && !self.updates.is_unproven()
            && let Some(watchdog) = &mut self.watchdog
        {
            watchdog.stop();
        }
        // A camera that is lost or back is reported without waiting for the next beat.
        if self.counters.frames > 0 || camera == CameraState::Lost {
            self.send_health();
        }
    }

    /// Sends the triggers that have come, and drives the line that marks frames or the trial.
    fn serve_triggers(&mut self, now: Instant) {
        if self.triggers.look_after(now) {
            self.counters.forget_allocations();
        }
        for _ in 0..trigger::PER_TURN_MAX {
            let Some(trigger) = self.triggers.read() else { break };
            self.send(&Message::Trigger(trigger));
        }
        self.triggers.mark_recording(self.links.is_recorded());
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
        // The latency that the packet states says when the pulse began, too.
        self.triggers.mark_frame(Instant::now());
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
        if self.views_wanted.iter().any(Option::is_some) {
            let (whole, targets) = match &frame.pixels {
                Pixels::Grey8(image) => pipeline.view(image),
                Pixels::Grey16(image) => pipeline.view(image),
            };
            let view = View { sequence, exposure_us, gain, frame: whole, targets };
            let wanted = std::mem::take(&mut self.views_wanted);
            let view = Message::View(view);
            for listener in wanted.into_iter().flatten() {
                self.links.send_to(listener, &view);
            }
        }
        if let Some((listener, picture)) = self.aim.take(frame, sequence) {
            self.counters.forget_allocations();
            self.links.send_to(listener, &Message::Picture(picture));
        }
    }

    /// Sends a pose to every listener, except where a document needs the room.
    fn send_pose(&mut self, packet: PosePacket) {
        let is_due = self.pose_beside.elapsed() >= POSE_BESIDE_DOCUMENT;
        if is_due {
            self.pose_beside = Instant::now();
        }
        // There is at most one listener on the line.
        let needs_room =
            |listener: ListenerId| self.outgoing.is_busy(listener) && self.aim.is_on(listener);
        let spared = self
            .outgoing
            .receivers()
            .find(|&listener| !is_due && needs_room(listener) && self.links.is_on_serial(listener));
        let is_spared = |listener| Some(listener) == spared;
        self.links.send_unless(&Message::Pose(packet), is_spared);
    }

    fn send_hello(&mut self) {
        let hello = Message::Hello(self.hello.clone());
        self.send(&hello);
    }

    fn send_health(&mut self) {
        let aiming_s = self.aim.left_s(Instant::now());
        let health =
            Message::Health(self.counters.health(&self.links, aiming_s, self.triggers.health()));
        self.send(&health);
    }

    /// Sends what has been logged; as long as nobody hears it, the latest of it waits.
    fn send_logs(&mut self) {
        if !self.links.has_audience() {
            logger::keep_latest();
            return;
        }
        while let Some(log) = logger::take(self.started) {
            self.send(&Message::Log(log));
        }
    }

    /// Sends what has been logged, carries out commands, and sends waiting packets.
    fn serve_links(&mut self, source: &mut impl FrameSource) {
        self.send_logs();
        let mut commands = heapless::Vec::<(ListenerId, Command), COMMANDS_PER_TURN_MAX>::new();
        let mut replies = heapless::Vec::<(u16, UpdateOutcome), COMMANDS_PER_TURN_MAX>::new();
        let recorder: Option<heapless::String<CALLER_NAME_BYTES_MAX>> =
            self.links.recorder().map(logger::cut);
        let arrivals = self.links.receive(|said| match said {
            // There is room for all of them.
            Said::Message(listener, Message::Command(command)) => {
                let _ = commands.push((listener, command));
            }
            Said::Message(listener, Message::Part(part)) => self.provisioning.take(listener, &part),
            Said::Message(..) => {}
            Said::Request(updater, UpdateRequest { id, step }) => {
                if let Some(outcome) = self.updates.answer(updater, step, recorder.as_deref()) {
                    let _ = replies.push((id, outcome));
                }
            }
        });
        if !replies.is_empty() {
            self.counters.forget_allocations();
        }
        for (id, outcome) in replies {
            self.links.reply_to_updater(id, outcome);
        }
        if self.updates.look_after(self.counters.frames, arrivals.is_heard()) {
            self.counters.forget_allocations();
        }
        if arrivals.is_paired {
            // Those who listened with the key before have no part in what follows.
            commands.clear();
            self.outgoing = Outgoing::default();
            self.views_wanted = Default::default();
            self.aim.end();
            self.counters.forget_allocations();
        }
        if arrivals.has_joined {
            self.send_hello();
            self.send_health();
        }
        for (listener, command) in commands {
            let outcome = self.carry_out(command.action, listener, source);
            let reply = Message::Reply(Reply { id: command.id, outcome });
            self.links.send_to(listener, &reply);
        }
        let file = |document| match document {
            Document::Config => Some(&self.blob[..]),
            Document::Picture(number) => self.aim.file(number),
        };
        self.outgoing.serve(&mut self.links, file);
        self.links.service();
    }

    fn send(&mut self, message: &Message) {
        self.links.send(message);
    }

    /// Tells the hosts that the session ends, and sends waiting packets. Returns the figures,
    /// and why packets could not be recorded, if so.
    fn finish(mut self) -> (Summary, Option<String>) {
        let source = self.counters.source;
        self.counters.source.camera = CameraState::Ended;
        self.send_logs();
        self.send_health();
        self.links.finish(FINISH);
        let unrecorded = self.links.fault().map(str::to_owned);
        let summary = Summary {
            frames: self.counters.frames,
            late: self.counters.late,
            source,
            allocations: self.counters.allocations(),
            links: self.links.summary(),
            step: self.counters.step,
            latency: self.counters.latency,
        };
        (summary, unrecorded)
    }
}

fn hello(config: &Config, setup: &Setup<'_>) -> Hello {
    let targets = config.targets.iter().map(|target| TargetInfo {
        name: target.name.clone(),
        role: target.geometry.role(),
        // At most TARGET_CORNERS_MAX, which fits.
        corners: target.geometry.corner_count() as u8,
    });
    Hello {
        device: config.device.clone(),
        serial_number: config.serial_number.clone(),
        firmware: crate::VERSION.try_into().unwrap_or_default(),
        config_crc: config.crc(),
        boot_id: setup.links.start().get(),
        boot_count: setup.boot_count,
        reset_reason: setup.reset_reason,
        width_px: config.lens.width_px,
        height_px: config.lens.height_px,
        targets: targets.collect(),
    }
}
