//! Reads a trial from its packets: the only way to read a recording, whether it was ended properly
//! or cut off.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Vector3};
use plumbline::config::Config;
use plumbline::packet::{
    AnatomicalPoint, Deframer, Hello, MarkedInstant, MeasuredPose, Message, PacketError, Reply,
    ReplyOutcome, View,
};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::scene::SceneFrame;
use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_stream::clock::Exchange;
use plumbline_stream::others::{is_same_box, name};
use plumbline_stream::power::PowerSeen;
use plumbline_stream::sessions::{self, Judged, Sessions};
use serde::{Deserialize, Serialize};

use super::correction::{Correction, corrected};
use super::journal::{Content, Entry, Reader};
use super::manifest::{BoxSeen, EventSeen, Manifest, NoiseSeen, Packets, State};
use super::mark::Mark;
use super::names;
use super::run::Run;
use super::verdict::{Verdict, judge};

/// A recording that has gone wrong must not fill the memory. Ten hours at 200 Hz.
pub(crate) const FRAMES_MAX: usize = 7_200_000;

/// A trunk point in one frame, along the body's axes: AP, ML, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// When its target was exposed, on the clock of [`Frame::time_s`]: later than the frame by as
    /// much as the camera's row was read later than the first one.
    pub time_s: f64,
    /// The position.
    pub position_mm: [f64; 3],
    /// Its covariance, from that of the target's pose. `None` where the trial has no configuration,
    /// which alone relates the target to the body.
    pub covariance_mm2: Option<Matrix3<f64>>,
}

/// One frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The box's run, from 1.
    pub session: u32,
    /// The number that the box gave it.
    pub sequence: u32,
    /// Time since the trial's first frame; [`Manifest::instant`] says of which instant.
    pub time_s: f64,
    /// The upper trunk.
    pub upper: Option<Point>,
    /// The lower trunk.
    pub lower: Option<Point>,
    /// theta1..6 of `cam_from_target`, as the box gave them: of the upper target, and of the
    /// lower.
    pub theta: [Option<[f32; 6]>; 2],
    /// Root mean square reprojection errors, pixels: of the upper target, and of the lower.
    pub rms_px: [Option<f32>; 2],
}

impl Frame {
    /// The point of a trunk.
    #[must_use]
    pub fn point(&self, trunk: Trunk) -> Option<&Point> {
        match trunk {
            Trunk::Upper => self.upper.as_ref(),
            Trunk::Lower => self.lower.as_ref(),
        }
    }

    /// The pose of the target that a trunk's point is fixed to.
    #[must_use]
    pub fn cam_from_target(&self, trunk: Trunk) -> Option<Pose<Cam, Target>> {
        let [upper, lower] = self.theta;
        let theta = match trunk {
            Trunk::Upper => upper,
            Trunk::Lower => lower,
        };
        Some(Pose::from_theta(theta?.map(f64::from)))
    }

    /// Whether a trunk was seen, with or without axes to measure it along.
    #[must_use]
    pub fn sees(&self, trunk: Trunk) -> bool {
        self.point(trunk).is_some() || self.cam_from_target(trunk).is_some()
    }
}

/// One of the two points of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Trunk {
    /// At the shoulder.
    Upper,
    /// In front of the lower back.
    Lower,
}

impl Trunk {
    /// Both, in the order of the paper's tables.
    pub const ALL: [Self; 2] = [Self::Lower, Self::Upper];

    /// Its name in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }
}

/// A recording.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Its folder.
    pub folder: PathBuf,
    /// What its packets say of it as a whole.
    pub manifest: Manifest,
    /// The box's configuration, if the box sent it, with what was replaced afterwards.
    pub config: Option<Config>,
    /// What else the packets tell.
    pub observed: Observed,
    /// In the order of their times.
    pub frames: Vec<Frame>,
    /// When the first was captured, seconds since 1970 by this computer's clock.
    pub first_frame_utc_s: Option<f64>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// What the packets tell of the circumstances of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Observed {
    /// The box was given another configuration during the trial.
    pub config_changed: bool,
    /// Other boxes that sent to the same computer.
    pub others: Vec<String>,
    /// What the box has told of its power supply.
    pub power: PowerSeen,
    /// How frames looked, every few seconds.
    pub views: Vec<View>,
    /// Bytes that belong to no packet.
    pub damaged_bytes: u64,
}

impl Trial {
    /// Reads a trial's folder.
    ///
    /// # Errors
    /// When there is no trial in it, or it cannot be read.
    pub fn open(folder: &Path) -> Result<Self, BadInput> {
        check_folder(folder)?;
        Self::open_as(folder, Manifest::read(folder)?)
    }

    /// Reads a trial's folder, whose manifest is this one.
    ///
    /// # Errors
    /// When its packets or its configuration cannot be read.
    pub(crate) fn open_as(folder: &Path, manifest: Manifest) -> Result<Self, BadInput> {
        let mut warnings = Vec::new();
        let recorded = read_config(folder, &mut warnings)?;
        let correction = Correction::read(folder, recorded.as_ref())?;
        if let Some(corrected) = &manifest.corrected {
            check_corrected(folder, &corrected.config_crc, correction.as_ref())?;
            warnings.push(corrected.words());
        } else if correction.is_some() {
            warnings.push(format!(
                "{} replaces what the box was told, by files that are not known any more",
                names::CORRECTED
            ));
        }
        let mut reader = Reader::open(&folder.join(names::JOURNAL))?;
        let mut builder = Builder::new(recorded, correction);
        while let Some(entry) = reader.next_entry()? {
            builder.take(entry);
            if builder.frames.len() > FRAMES_MAX {
                return Err(too_long(folder));
            }
        }
        if manifest.state == State::Recording {
            warnings.push(
                "the recording was cut off: this is what was on the disk until then".to_owned(),
            );
        }
        if reader.damaged_bytes() > 0 {
            warnings.push(format!(
                "{} bytes of {} belong to no packet and are left out",
                reader.damaged_bytes(),
                names::JOURNAL
            ));
        }
        builder.observed.damaged_bytes = reader.damaged_bytes();
        Ok(builder.finish(folder, manifest, warnings))
    }

    /// From the first frame to the last.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        let time_s = |frame: Option<&Frame>| frame.map_or(0.0, |frame| frame.time_s);
        time_s(self.frames.last()) - time_s(self.frames.first())
    }

    /// Frames per second on average, pauses included; `None` where they have no length.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let length_s = self.length_s();
        (length_s > 0.0).then(|| (self.frames.len() - 1) as f64 / length_s)
    }

    /// The participant and the condition or, without them, the folder's name.
    #[must_use]
    pub fn title(&self) -> String {
        let folder = self.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let parts = [self.manifest.participant.clone(), self.manifest.condition.clone()];
        let named: Vec<String> = parts.into_iter().flatten().collect();
        if named.is_empty() { folder.unwrap_or_default() } else { named.join(", ") }
    }
}

/// Checks that a path can be a trial's.
pub(crate) fn check_folder(folder: &Path) -> Result<(), BadInput> {
    if folder.is_dir() {
        return Ok(());
    }
    Err(BadInput::whole(
        folder.display(),
        "it is not the folder of a trial",
        "give the folder that `plumb receive --out` has made",
    ))
}

/// Checks that what was replaced is what `trial.toml` says.
fn check_corrected(
    folder: &Path,
    crc: &str,
    correction: Option<&Correction>,
) -> Result<(), BadInput> {
    let found = match correction {
        Some(correction) if format!("{:08x}", correction.config().crc()) == crc => return Ok(()),
        Some(correction) => format!("its checksum is {:08x}", correction.config().crc()),
        None => "it is not there".to_owned(),
    };
    Err(BadInput::whole(
        folder.join(names::CORRECTED).display(),
        format!("{found}, and {} names one with the checksum {crc}", names::MANIFEST),
        "give the files again, or take the replacement back: `plumb replay TRIAL --tables \
         --as-recorded`",
    ))
}

/// The error for more than [`FRAMES_MAX`] frames.
pub(crate) fn too_long(folder: &Path) -> BadInput {
    BadInput::whole(
        folder.join(names::JOURNAL).display(),
        format!("more than {FRAMES_MAX} frames"),
        "no trial is so long: check what was recorded",
    )
}

/// The box's configuration, if it is in the folder and can be used; a warning says why it is not.
pub(crate) fn read_config(
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<Option<Config>, BadInput> {
    let path = folder.join(names::CONFIG);
    let blob = match std::fs::read(&path) {
        Ok(blob) => blob,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            warnings.push(
                "the box did not tell its configuration: the uncertainty of the trunk points is \
                 not known"
                    .to_owned(),
            );
            return Ok(None);
        }
        Err(error) => return Err(BadInput::io(path.display(), &error)),
    };
    match Config::decode(&blob) {
        Ok(config) => Ok(Some(config)),
        Err(error) => {
            warnings.push(format!("{}: {error}; it is not used", path.display()));
            Ok(None)
        }
    }
}

/// Builds a trial from its packets.
struct Builder {
    /// What the box was told, and what it should have been told.
    recorded: Option<Config>,
    correction: Option<Correction>,
    sessions: Sessions,
    scene: Option<(SceneFrame, Vector3<f64>)>,
    runs: BTreeMap<u32, Run>,
    frames: Vec<Frame>,
    marks: Vec<(u64, Mark)>,
    hello: Option<Hello>,
    observed: Observed,
    corrupt: u64,
    /// Packets with a number that no measurement gives.
    beyond: u64,
    instant: Option<MarkedInstant>,
    deframer: Deframer,
}

impl Builder {
    fn new(recorded: Option<Config>, correction: Option<Correction>) -> Self {
        let config = correction.as_ref().map(Correction::config).or(recorded.as_ref());
        Self {
            scene: config.and_then(scene_of),
            recorded,
            correction,
            sessions: Sessions::default(),
            runs: BTreeMap::new(),
            frames: Vec::new(),
            marks: Vec::new(),
            hello: None,
            observed: Observed::default(),
            corrupt: 0,
            beyond: 0,
            instant: None,
            deframer: Deframer::new(),
        }
    }

    fn take(&mut self, entry: Entry) {
        let outcome = match entry.content {
            Content::Mark(mark) => {
                self.marks.push((entry.host_ns, mark));
                return;
            }
            Content::About(_) => return,
            Content::Raw(raw) => raw.decode(&mut self.deframer),
        };
        match outcome {
            Ok(packet) => {
                let packet = corrected(self.correction.as_ref(), packet);
                self.sessions.take(packet, entry.host_ns);
                self.take_judged(entry.host_ns);
            }
            Err(PacketError::Fragment) => {}
            Err(PacketError::Number) => self.beyond += 1,
            Err(_) => self.corrupt += 1,
        }
    }

    fn take_judged(&mut self, host_ns: u64) {
        while let Some(judged) = self.sessions.next_judged() {
            match judged {
                Judged::Begins { hello, .. } => self.hello(hello),
                Judged::Frame(frame) => self.frame(&frame),
                Judged::Message(message) => self.message(message, host_ns),
                Judged::OtherBox(hello) => note(&mut self.observed.others, name(&hello)),
                Judged::Unnamed(_) | Judged::Conflict(_) => {}
            }
        }
    }

    fn message(&mut self, message: Message, host_ns: u64) {
        match message {
            Message::Health(health) => {
                self.observed.power.take(&health);
            }
            // It says once more who it is.
            Message::Hello(hello) => self.hello(hello),
            Message::View(view) => self.observed.views.push(view),
            Message::Reply(Reply {
                outcome: ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns },
                ..
            }) => {
                let exchange = Exchange {
                    host_sent_ns,
                    box_received_ns,
                    box_sent_ns,
                    host_received_ns: host_ns,
                };
                // An answer before its question was given to another recording.
                if host_sent_ns <= host_ns {
                    self.runs.entry(self.sessions.count()).or_default().answer(exchange);
                }
            }
            _ => {}
        }
    }

    fn hello(&mut self, hello: Hello) {
        let before = self.hello.as_ref().filter(|before| is_same_box(before, &hello));
        let told = before.map(|before| before.config_crc);
        let known = told.or(self.recorded.as_ref().map(Config::crc));
        self.observed.config_changed |= known.is_some_and(|crc| crc != hello.config_crc);
        self.hello = Some(hello);
    }

    fn frame(&mut self, frame: &sessions::Frame) {
        let sessions::Frame { session, clock, packet, .. } = frame;
        self.instant = Some(packet.instant);
        self.runs.entry(*session).or_default().frame(frame);
        let [upper, lower] = [Role::Upper, Role::Lower].map(|role| packet.pose(role));
        let point = |point: Option<AnatomicalPoint>, pose: Option<&MeasuredPose>, lever_mm| {
            let AnatomicalPoint { ap_mm, ml_mm, si_mm } = point?;
            let frame_ns = packet.capture_time_ns;
            let own_ns = pose.map_or(frame_ns, |pose| pose.own_time_ns(frame_ns));
            Some(Point {
                time_s: clock.time_s(own_ns),
                position_mm: [ap_mm, ml_mm, si_mm].map(f64::from),
                covariance_mm2: self
                    .scene
                    .zip(pose)
                    .map(|((scene, _), pose)| covariance_mm2(&scene, pose, lever_mm)),
            })
        };
        let lever_mm = self.scene.map(|(_, lever_mm)| lever_mm).unwrap_or_default();
        self.frames.push(Frame {
            session: *session,
            sequence: packet.sequence,
            time_s: clock.time_s(packet.capture_time_ns),
            upper: point(packet.upper_trunk, upper, Vector3::zeros()),
            lower: point(packet.lower_trunk, lower, lever_mm),
            theta: [upper, lower].map(|pose| {
                let MeasuredPose { theta_rad: [a, b, c], translation_mm: [x, y, z], .. } = pose?;
                Some([*a, *b, *c, *x, *y, *z])
            }),
            rms_px: [upper, lower].map(|pose| pose.map(|pose| pose.rms_px)),
        });
    }

    /// An event of the run that was under way or, before the first frame, of the first.
    fn event(&self, host_ns: u64, mark: &Mark) -> Option<EventSeen> {
        let has_begun = |run: &&Run| run.begun_ns().is_some_and(|begun_ns| begun_ns <= host_ns);
        let of_its_run = self.runs.values().rev().find(has_begun);
        let first = self.runs.values().find(|run| run.begun_ns().is_some());
        of_its_run.or(first)?.event(host_ns, mark)
    }

    fn finish(mut self, folder: &Path, mut manifest: Manifest, mut warnings: Vec<String>) -> Trial {
        self.sessions.finish();
        self.take_judged(u64::MAX);
        // The network may reorder packets.
        self.frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        if self.observed.config_changed {
            warnings.push(
                "the box was given another configuration during the trial: positions before and \
                 after are not of one calibration"
                    .to_owned(),
            );
        }
        let (counts, left_out) = (self.sessions.counts(), self.sessions.left_out());
        let packets = Packets {
            frames: counts.received,
            lost: counts.lost,
            late: counts.late,
            repeated: counts.repeated,
            corrupt: self.corrupt,
            implausible: counts.implausible + self.beyond,
            other_box: left_out.other_box,
            conflicting: left_out.conflicting,
            unknown_start: left_out.unknown_start,
            sessions: self.sessions.count(),
        };
        warnings.extend(packets.warnings());
        warnings.extend(self.observed.power.warnings().into_iter().map(str::to_owned));
        manifest.the_box = self.hello.as_ref().map(|hello| BoxSeen {
            device: hello.device.to_string(),
            serial_number: hello.serial_number.to_string(),
            firmware: hello.firmware.to_string(),
            config_crc: format!("{:08x}", hello.config_crc),
        });
        manifest.instant = self.instant;
        manifest.packets = Some(packets);
        manifest.clocks =
            self.runs.iter().filter_map(|(session, run)| run.clock_seen(*session)).collect();
        manifest.noise =
            Trunk::ALL.into_iter().filter_map(|trunk| noise(&self.frames, trunk)).collect();
        manifest.events =
            self.marks.iter().filter_map(|(host_ns, mark)| self.event(*host_ns, mark)).collect();
        let first_frame_utc_s = manifest.started.parse::<jiff::Timestamp>().ok().and_then(|it| {
            let first_s = self.runs.values().find_map(Run::first_capture_s)?;
            Some(1e-9 * it.as_nanosecond() as f64 + first_s)
        });
        let config = self.correction.map(|it| it.config().clone()).or(self.recorded);
        let (frames, observed) = (self.frames, self.observed);
        let folder = folder.to_owned();
        let mut trial =
            Trial { folder, manifest, config, observed, frames, first_frame_utc_s, warnings };
        let computed = judge(&trial, &trial.manifest.criteria);
        let Verdict { overruled, by, why, .. } = trial.manifest.verdict();
        trial.manifest.verdict = Some(Verdict { overruled, by, why, ..computed });
        trial
    }
}

/// Takes note of a name, once.
fn note(names: &mut Vec<String>, name: String) {
    if !names.contains(&name) {
        names.push(name);
    }
}

/// The scene, and the lower trunk's lever on its target.
fn scene_of(config: &Config) -> Option<(SceneFrame, Vector3<f64>)> {
    let theta = config.cam_from_scene_theta?;
    let lower = config.targets.iter().find(|it| it.geometry.role() == Role::Lower);
    let lever_mm = lower.map(|it| it.geometry.virtual_point_mm());
    Some((SceneFrame::new(Pose::from_theta(theta)), lever_mm.unwrap_or_default()))
}

/// The covariance along AP, ML and SI of a point that is fixed to a target, `lever_mm` from its
/// origin.
fn covariance_mm2(scene: &SceneFrame, pose: &MeasuredPose, lever_mm: Vector3<f64>) -> Matrix3<f64> {
    let by_increment = pose.cam_from_target().point_by_increment(&lever_mm);
    let jacobian = scene.anatomical_from_cam() * by_increment;
    let covariance = jacobian * pose.covariance() * jacobian.transpose();
    let covariance = 0.5 * (covariance + covariance.transpose());
    if covariance.cholesky().is_some() {
        return covariance;
    }
    // Correlations come rounded to 1/127, which can leave a variance below 0 in some direction:
    // the nearest covariance has none there.
    let mut eigen = covariance.symmetric_eigen();
    eigen.eigenvalues.apply(|it| *it = it.max(0.0));
    eigen.recompose()
}

fn noise(frames: &[Frame], trunk: Trunk) -> Option<NoiseSeen> {
    let sd_mm = |axis: usize| {
        let of = frames.iter().filter_map(|frame| frame.point(trunk)?.covariance_mm2);
        let mut values: Vec<f64> = of.map(|it| it[(axis, axis)].max(0.0).sqrt()).collect();
        let middle = values.len() / 2;
        (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
    };
    Some(NoiseSeen {
        trunk: trunk.word().to_owned(),
        ap_mm: sd_mm(0)?,
        ml_mm: sd_mm(1)?,
        si_mm: sd_mm(2)?,
    })
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use plumbline::packet::{Health, PACKET_BYTES_MAX, Packet, encode_datagram};
    use plumbline_analysis::series::Series;
    use plumbline_stream::fixture::adversity::{self, Adversity};
    use plumbline_stream::fixture::health;
    use plumbline_stream::receiver::Receiver;
    use plumbline_stream::transport::{Event, Raw};

    use super::super::manifest::Zero;
    use super::*;

    fn finished(builder: Builder) -> Trial {
        let manifest =
            Manifest::begin("2026-01-01T00:00:00Z".to_owned(), None, None, None, Zero::Mark);
        builder.finish(Path::new("trial"), manifest, Vec::new())
    }

    /// The trial in what a recording has kept of these packets.
    fn trial(packets: &[(u64, Packet)]) -> Trial {
        let mut builder = Builder::new(None, None);
        for (host_ns, Packet { start, message }) in packets {
            let mut buffer = [0; PACKET_BYTES_MAX];
            let datagram = encode_datagram(*start, message, &mut buffer).unwrap().to_vec();
            let content = Content::Raw(Raw::Datagram(datagram));
            builder.take(Entry { host_ns: *host_ns, content });
        }
        finished(builder)
    }

    /// Receives packets at their times, while time is seen to pass.
    fn received(packets: &[(u64, Packet)]) -> Receiver<Vec<u8>> {
        let mut receiver = Receiver::new(None);
        // Half a second after the recording began.
        let begun = Instant::now() + Duration::from_millis(500);
        let mut passed_ns = 0;
        for (host_ns, packet) in packets {
            for now_ns in (passed_ns..*host_ns).step_by(100_000_000) {
                receiver.tick(begun + Duration::from_nanos(now_ns)).unwrap();
            }
            passed_ns = *host_ns;
            let now = begun + Duration::from_nanos(*host_ns);
            receiver.handle(Event::Packet(packet.clone()), now).unwrap();
        }
        receiver.finish(begun).unwrap();
        receiver
    }

    #[test]
    fn a_recording_says_of_its_packets_what_was_said_when_they_came() {
        for Adversity { name, packets, sessions, counts, left_out, boxes } in adversity::all() {
            let receiver = received(&packets);
            assert_eq!((receiver.counts(), receiver.left_out()), (counts, left_out), "{name}");
            assert_eq!(receiver.sessions(), sessions, "{name}");
            let error = receiver.exchanged().map(|error| error.to_string()).unwrap_or_default();
            assert_eq!(boxes.1.is_some(), error.contains("another box sends now: "), "{error}");
            assert!(boxes.1.is_none_or(|other| error.contains(other)), "{name}: {error}");

            let trial = trial(&packets);
            let expected = Packets {
                frames: counts.received,
                lost: counts.lost,
                late: counts.late,
                repeated: counts.repeated,
                corrupt: 0,
                implausible: counts.implausible,
                other_box: left_out.other_box,
                conflicting: left_out.conflicting,
                unknown_start: left_out.unknown_start,
                sessions,
            };
            assert_eq!(trial.manifest.packets, Some(expected), "{name}");
            assert_eq!(trial.manifest.the_box.unwrap().device, boxes.0, "{name}");
            // Late frames are in their places.
            let numbers = trial.frames.iter().map(|frame| (frame.session, frame.sequence));
            assert!(numbers.is_sorted(), "{name}");
            assert!(trial.frames.iter().map(|it| it.time_s).is_sorted(), "{name}");
            let is_worth_a_warning = left_out != Default::default() || counts.implausible > 0;
            let warned = trial.warnings.iter().any(|it| it.starts_with("left out: "));
            assert_eq!(warned, is_worth_a_warning, "{name}: {:?}", trial.warnings);
        }
    }

    #[test]
    fn a_border_between_sessions_is_a_gap() {
        // The next start's frames are 100 mm away, and come as soon as the last one's have ended.
        let frames = |start: u32, away_mm: f32| {
            (0..300).map(move |number| {
                let mut packet = adversity::frame_of(start, number, 60);
                if let Message::Pose(pose) = &mut packet.message {
                    let point = AnatomicalPoint { ap_mm: away_mm, ml_mm: 0.0, si_mm: 1400.0 };
                    pose.upper_trunk = Some(point);
                }
                (u64::from(number) * 16_666_667, packet)
            })
        };
        let mut packets = vec![(0, adversity::hello_of("ward 3", 1))];
        packets.extend(frames(1, 0.0));
        let next_ns = 300 * 16_666_667;
        packets.push((next_ns, adversity::hello_of("ward 3", 2)));
        packets.extend(frames(2, 100.0).map(|(at_ns, packet)| (next_ns + at_ns, packet)));
        let trial = trial(&packets);
        assert_eq!(trial.manifest.packets.unwrap().sessions, 2);
        let points: Vec<Point> = trial.frames.iter().filter_map(|frame| frame.upper).collect();
        assert_eq!(points.len(), 600);
        let along = |axis: usize| points.iter().map(|it| it.position_mm[axis]).collect();
        let time_s = points.iter().map(|it| it.time_s).collect();
        let series = Series::new(time_s, [along(0), along(1), along(2)]).unwrap();
        let segments: Vec<_> = series.segments().collect();
        assert_eq!(segments, [0..300, 300..600], "no step leads from one session to the next");
    }

    #[test]
    fn positions_that_no_room_holds_are_no_part_of_a_trial() {
        let mut packets: Vec<_> =
            (0..60).map(|number| (u64::from(number), adversity::frame_of(1, number, 60))).collect();
        if let Message::Pose(pose) = &mut packets[30].1.message {
            let point = AnatomicalPoint { ap_mm: 1e30, ml_mm: 0.0, si_mm: 1400.0 };
            pose.upper_trunk = Some(point);
        }
        packets.insert(0, (0, adversity::hello_of("ward 3", 1)));
        let found = trial(&packets).manifest.packets.unwrap();
        assert_eq!((found.frames, found.lost, found.implausible), (59, 1, 1));
    }

    #[test]
    fn a_trial_tells_that_the_box_had_too_little_power() {
        let trial = |undervoltages: &[bool]| {
            let mut builder = Builder::new(None, None);
            for undervoltage in undervoltages.iter().copied().map(Some) {
                builder.message(Message::Health(Health { undervoltage, ..health() }), 0);
            }
            finished(builder)
        };
        assert_eq!(trial(&[false, false]).warnings, [""; 0]);
        let warnings = trial(&[false, true, true, false]).warnings;
        assert!(matches!(&warnings[..], [one] if one.contains("power supply")), "{warnings:?}");
    }
}
