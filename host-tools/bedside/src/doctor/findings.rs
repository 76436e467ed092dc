//! What is seen of a box while it is watched: figures, not opinions.

use std::collections::BTreeMap;
use std::path::Path;

use plumbline::config::Config;
use plumbline::packet::{
    Health, Hello, Log, LogLevel, MarkedInstant, MeasuredPose, Message, Packet, PosePacket, Reply,
    ReplyOutcome, Start, View,
};
use plumbline::report::NoPose;
use plumbline::target::Role;
use plumbline_calibration::background::{Motion, Unclear};
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_stream::accounting::{Accounting, Arrival, Counts};
use plumbline_stream::bad_packets::BadPackets;
use plumbline_stream::clock::Exchange;
use plumbline_stream::complaints::text_of;
use plumbline_stream::power::PowerSeen;
use plumbline_stream::transport::{Event, words_of_other};

use super::judge::Tape;
use crate::scale::Compared;
use crate::setup;

/// A capture time that goes back while the frames' numbers go on by no more than this is a
/// fault of the clock; more than this is another start.
const AHEAD_MAX: u32 = 1000;

/// The number of different log records that are kept.
const LOGS_MAX: usize = 32;

/// A configuration that the box's is compared with.
#[derive(Debug)]
pub struct Expected {
    /// Its file.
    pub name: String,
    /// Its checksum.
    pub crc: u32,
}

impl Expected {
    /// The configuration of a file, as it is now.
    ///
    /// # Errors
    /// When the file cannot be read, or holds no configuration.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        Ok(Self { name: path.display().to_string(), crc: setup::read_blob(path)?.crc() })
    }
}

/// One target, in the frames that came.
#[derive(Debug)]
pub struct TargetSeen {
    /// Which one.
    pub role: Role,
    /// Its poses.
    pub poses: Vec<MeasuredPose>,
    /// Frames without one, by reason.
    pub without: Vec<(NoPose, usize)>,
}

impl TargetSeen {
    /// Frames that came.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.poses.len() + self.without.iter().map(|(_, frames)| frames).sum::<usize>()
    }
}

/// One frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameSeen {
    /// Its number.
    pub sequence: u32,
    /// When it was taken, on the box's clock.
    pub capture_time_ns: u64,
    /// From then until its packet left.
    pub latency_us: u32,
    /// Which instant its time marks.
    pub instant: MarkedInstant,
    /// When it came, on this program's clock.
    pub arrived_ns: u64,
}

/// What the background says of the camera since its scene was measured.
#[derive(Debug)]
pub enum Background {
    /// It was not looked at, and why.
    NotCompared(String),
    /// How it moved in the picture.
    Compared(Result<Motion, Unclear>),
}

/// Everything that was seen.
#[derive(Debug, Default)]
pub struct Findings {
    /// Where the box was listened for.
    pub place: String,
    /// When something was heard last, on this program's clock.
    pub heard_ns: u64,
    /// How long nothing had been heard when the watch was over.
    pub silence_s: f64,
    /// It was a serial line.
    pub is_serial: bool,
    /// Intact packets of this protocol.
    pub packets: u64,
    /// Packets that could not be used.
    pub bad: BadPackets,
    /// How often the serial line was lost.
    pub line_losses: u64,
    /// Who the box is.
    pub hello: Option<Hello>,
    /// The box runs with no configuration, and says why.
    pub refusing: Option<String>,
    /// How often it restarted while it was watched.
    pub starts: u32,
    /// Its first Health and its latest.
    pub healths: Option<(Health, Health)>,
    /// The worst that it reported of its power supply.
    pub power: PowerSeen,
    /// The warnings and errors that it logged, each once.
    pub logs: Vec<(LogLevel, String)>,
    /// Questions for the time that were sent.
    pub pings: usize,
    /// Those that were answered.
    pub exchanges: Vec<Exchange>,
    /// Pose packets of each start, by number.
    pub accounts: BTreeMap<Option<Start>, Accounting>,
    /// What keeps a box that is heard from being listened to, and what to do.
    pub other: Option<(String, String)>,
    /// Frames, in the order in which they came, without repetitions.
    pub frames: Vec<FrameSeen>,
    /// How often a capture time was not after the one before.
    pub backward_times: u64,
    /// The targets, as configured.
    pub targets: Vec<TargetSeen>,
    /// Frames in numbers.
    pub views: Vec<View>,
    /// The box's configuration, or why it cannot be read back.
    pub config: Option<Result<Config, BadInput>>,
    /// The checksum of the one that it will start with next, if it has told.
    pub next_crc: Option<u32>,
    /// What the box's configuration should be.
    pub expected: Option<Expected>,
    /// The background, where there is a scene.
    pub background: Option<Background>,
    /// A distance that a person has measured, to be compared now.
    pub tape: Option<Tape>,
    /// What was compared before, on this computer.
    pub compared: Vec<(Role, Compared)>,
}

impl Findings {
    /// Pose packets by what became of them.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.accounts.values().fold(Counts::default(), |mut sum, account| {
            sum += account.counts();
            sum
        })
    }

    /// The configuration, where it could be read back.
    #[must_use]
    pub fn config(&self) -> Option<&Config> {
        self.config.as_ref()?.as_ref().ok()
    }

    /// Whether the lens is known: without it there is neither a fit nor a distance.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        !self.config().is_some_and(|config| camera::is_stand_in(&config.lens))
    }

    /// A target, where frames with it came.
    #[must_use]
    pub fn target(&self, role: Role) -> Option<&TargetSeen> {
        self.targets.iter().find(|target| target.role == role)
    }

    /// Whether another of the box's targets was measured.
    #[must_use]
    pub fn measures_another(&self, role: Role) -> bool {
        self.targets.iter().any(|target| target.role != role && !target.poses.is_empty())
    }

    /// How the box was at last.
    #[must_use]
    pub fn health(&self) -> Option<&Health> {
        self.healths.as_ref().map(|(_, last)| last)
    }

    /// Whether the box is heard over a serial line, and answers nothing: a line may have one wire.
    #[must_use]
    pub fn is_one_way(&self) -> bool {
        let is_answered = !self.exchanges.is_empty() || !self.views.is_empty();
        self.is_serial && self.packets > 0 && !is_answered && self.config().is_none()
    }

    /// Whether a recording is replayed in place of a camera.
    #[must_use]
    pub fn is_replay(&self) -> bool {
        self.frames.last().is_some_and(|frame| frame.instant == MarkedInstant::Recording)
    }

    /// Frames per second by their numbers and by when they came here: what was lost on the way did
    /// not hold the box up.
    #[must_use]
    pub fn arrivals_hz(&self) -> Option<f64> {
        let (first, last) = (self.frames.first()?, self.frames.last()?);
        let numbers = last.sequence.wrapping_sub(first.sequence).cast_signed();
        let time_ns = last.arrived_ns.checked_sub(first.arrived_ns)?;
        (numbers > 0 && time_ns > 0).then(|| 1e9 * f64::from(numbers) / time_ns as f64)
    }

    /// Frames per second, by their numbers and times: what was lost on the way is no slower
    /// camera.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let (first, last) = (self.frames.first()?, self.frames.last()?);
        let numbers = last.sequence.wrapping_sub(first.sequence).cast_signed();
        let time_ns = last.capture_time_ns.checked_sub(first.capture_time_ns)?;
        (numbers > 0 && time_ns > 0).then(|| 1e9 * f64::from(numbers) / time_ns as f64)
    }

    /// A target's name, as far as the box has told it.
    #[must_use]
    pub fn name(&self, role: Role) -> String {
        let targets = self.hello.iter().flat_map(|hello| &hello.targets);
        let known = targets.into_iter().find(|target| target.role == role);
        known.map_or_else(|| format!("{role:?}").to_lowercase(), |known| known.name.to_string())
    }

    /// Takes note of what came at this time of this computer's clock.
    pub fn take(&mut self, event: &Event, now_ns: u64) {
        self.hear(event);
        if let Event::Packet(packet) = event {
            self.heard_ns = now_ns;
            self.packet(packet, now_ns);
        }
    }

    /// Takes note that something came, and not of what it says: what follows it may be missed,
    /// and must not count as lost.
    pub fn hear(&mut self, event: &Event) {
        match event {
            Event::Packet(_) => self.packets += 1,
            Event::Bad(error) => {
                self.bad.count(*error);
            }
            Event::Other { name, announcement, .. } => {
                self.other = Some(words_of_other(name.as_deref(), announcement));
            }
            Event::NotAuthentic => self.bad.not_authentic += 1,
            Event::LineLost(_) => self.line_losses += 1,
            Event::LineBack | Event::Raw(_) => (),
        }
    }

    fn packet(&mut self, Packet { start, message }: &Packet, now_ns: u64) {
        match message {
            Message::Pose(packet) => self.pose(*start, packet, now_ns),
            Message::Hello(hello) => {
                let before = self.hello.replace(hello.clone());
                if before.is_some_and(|before| before.boot_id != hello.boot_id) {
                    self.starts += 1;
                    self.healths = None;
                }
            }
            Message::Health(health) => {
                self.power.take(health);
                match &mut self.healths {
                    Some((_, last)) => *last = health.clone(),
                    none => *none = Some((health.clone(), health.clone())),
                }
            }
            Message::Log(log) => self.log(log),
            Message::Reply(Reply {
                outcome: ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, .. },
                ..
            }) => self.exchanges.push(Exchange {
                host_sent_ns: *host_sent_ns,
                box_received_ns: *box_received_ns,
                box_sent_ns: *box_sent_ns,
                host_received_ns: now_ns,
            }),
            Message::View(view) => self.views.push(view.clone()),
            Message::Reply(_)
            | Message::Command(_)
            | Message::Picture(_)
            | Message::Part(_)
            | Message::Trigger(_) => (),
        }
    }

    fn log(&mut self, log: &Log) {
        let record = (log.level, text_of(log));
        let matters = log.level <= LogLevel::Warn;
        if matters && self.logs.len() < LOGS_MAX && !self.logs.contains(&record) {
            self.logs.push(record);
        }
    }

    fn pose(&mut self, start: Option<Start>, packet: &PosePacket, now_ns: u64) {
        let account = self.accounts.entry(start).or_default();
        if account.pose(packet.sequence, packet.capture_time_ns, now_ns) == Arrival::Repeated {
            return;
        }
        if let Some(last) = self.frames.last() {
            let ahead = packet.sequence.wrapping_sub(last.sequence);
            let goes_on = (1..=AHEAD_MAX).contains(&ahead);
            self.backward_times +=
                u64::from(goes_on && packet.capture_time_ns <= last.capture_time_ns);
        }
        self.frames.push(FrameSeen {
            sequence: packet.sequence,
            capture_time_ns: packet.capture_time_ns,
            latency_us: packet.latency_us,
            instant: packet.instant,
            arrived_ns: now_ns,
        });
        for target in &packet.targets {
            let known = self.targets.iter().position(|known| known.role == target.role);
            let index = known.unwrap_or_else(|| {
                let role = target.role;
                self.targets.push(TargetSeen { role, poses: Vec::new(), without: Vec::new() });
                self.targets.len() - 1
            });
            let seen = &mut self.targets[index];
            match &target.pose {
                Ok(pose) => seen.poses.push(*pose),
                Err(reason) => match seen.without.iter_mut().find(|(known, _)| known == reason) {
                    Some((_, frames)) => *frames += 1,
                    None => seen.without.push((*reason, 1)),
                },
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::config::BLOB_BYTES_MAX;

    use super::super::fixture::{config, event, healthy, hello, pose_packet};
    use super::*;

    #[test]
    fn packets_that_were_lost_do_not_make_the_camera_slower() {
        let mut findings = Findings::default();
        assert_eq!(findings.rate_hz(), None);
        for sequence in [0, 1, 2, 5, 6, 6, 9] {
            findings.take(&event(Message::Pose(pose_packet(sequence))), 0);
        }
        assert!((findings.rate_hz().unwrap() - 60.0).abs() < 0.1);
        let counts = findings.counts();
        assert_eq!((counts.lost, counts.repeated, findings.frames.len()), (4, 1, 6));
        assert_eq!(findings.backward_times, 0);
        let mut back = pose_packet(10);
        back.capture_time_ns = 0;
        findings.take(&event(Message::Pose(back)), 0);
        assert_eq!(findings.backward_times, 1);
    }

    #[test]
    fn a_new_start_is_noticed_and_its_counters_are_its_own() {
        let mut findings = healthy();
        let mut hello = findings.hello.clone().unwrap();
        findings.take(&event(Message::Hello(hello.clone())), 0);
        assert_eq!((findings.starts, findings.healths.is_some()), (0, true));
        hello.boot_id += 1;
        findings.take(&event(Message::Hello(hello)), 0);
        assert_eq!((findings.starts, findings.healths.is_some()), (1, false));
    }

    /// The checksum that `plumb provision` prints and the box tells is that of the file's content,
    /// at the time when it is read.
    #[test]
    fn a_file_is_named_with_the_checksum_of_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.plb");
        let mut config = config();
        for exposure_us in [4000, 5000] {
            config.capture.as_mut().unwrap().exposure_us = Some(exposure_us);
            let mut blob = [0; BLOB_BYTES_MAX];
            std::fs::write(&path, config.encode(&mut blob).unwrap()).unwrap();
            let found = Expected::read(&path).unwrap();
            assert_eq!((found.crc, found.crc), (config.crc(), hello(&config).config_crc));
        }
    }
}
