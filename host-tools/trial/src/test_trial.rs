//! A good trial, for tests that spoil it: thirty seconds of a person who stands and sways. And points
//! that are not of a trial.

use std::path::Path;

use nalgebra::Vector3;
use plumbline::config::Config;
use plumbline::packet::{
    AnatomicalPoint, Hello, MeasuredPose, Message, PACKET_BYTES_MAX, PosePacket, Reply,
    ReplyOutcome, Start, encode_datagram,
};
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::scene::SceneFrame;
use plumbline::target::Role;
use plumbline_analysis::series::Series;
use plumbline_stream::fixture::{START, config, health, hello, pose, pose_packet, view};
use plumbline_stream::transport::Raw;
use tempfile::TempDir;

use crate::journal::{Content, Entry, Writer};
use crate::manifest::{Manifest, State, Zero};
use crate::mark::{Mark, Source};
use crate::points::{Point, Points};
use crate::{Trial, Verdict, names};

/// One second.
pub const SECOND_NS: u64 = 1_000_000_000;

/// From a frame's capture to its packet, by clocks that agree but for their zero.
const DELAY_NS: u64 = 5_000_000;

/// The lower trunk's points at these positions, of nothing that was recorded; `place` is for messages.
pub fn points(place: &str, series: Series) -> Points {
    let frame_time_s = series.time_s().to_vec();
    Points {
        place: place.to_owned(),
        points: vec![Point { name: "lower".to_owned(), series, frame_time_s, noise: None }],
        zero: String::new(),
        zero_s: 0.0,
        is_zero_set: true,
        zero_utc_s: None,
        verdict: None,
        events: Vec::new(),
        warnings: Vec::new(),
    }
}

/// A trial that is not on the disk yet.
pub struct Made {
    /// Who was measured.
    pub manifest: Manifest,
    /// What the box tells of itself, and `config.plb`.
    pub config: Option<Config>,
    /// The packets and the mark.
    pub entries: Vec<Entry>,
}

/// Where the target of a role is in a frame: the upper one 400 mm above the lower, both swaying.
pub fn scene_from_target(role: Role, sequence: u32) -> Pose<Scene, Target> {
    let phase = 0.02 * f64::from(sequence);
    let sway_mm = Vector3::new(4.0 * phase.sin(), 0.0, 6.0 * (0.7 * phase).cos());
    let at_mm = match role {
        Role::Upper => Vector3::new(60.0, -250.0, -150.0),
        _ => Vector3::new(-20.0, 150.0, -200.0),
    };
    let [x, y, z] = (at_mm + sway_mm).into();
    Pose::from_theta([0.05, 0.1 + 0.01 * phase.sin(), -0.08, x, y, z])
}

/// The packet of a frame with the targets at these poses, as a box whose scene is known sends it, with
/// the virtual point of the lower target: the trunk points are of the poses before these are rounded.
fn packet(
    scene: Option<&(SceneFrame, Vector3<f64>)>,
    sequence: u32,
    cam_from_target: impl Fn(Role) -> Pose<Cam, Target>,
) -> PosePacket {
    let [lower, upper] = [Role::Lower, Role::Upper].map(&cam_from_target);
    let mut packet = pose_packet(sequence);
    for target in &mut packet.targets {
        target.pose = Ok(match target.role {
            Role::Lower => measured(&lower),
            Role::Upper => measured(&upper),
            other => measured(&cam_from_target(other)),
        });
    }
    if let Some((scene, virtual_point_mm)) = scene {
        let lower = scene.lower_trunk(&lower, virtual_point_mm);
        packet.lower_trunk = Some(AnatomicalPoint::from(&lower));
        packet.upper_trunk = Some(AnatomicalPoint::from(&scene.upper_trunk(&upper)));
    }
    packet
}

/// A pose with the noise of a good one.
fn measured(cam_from_target: &Pose<Cam, Target>) -> MeasuredPose {
    let [a, b, c, x, y, z] = cam_from_target.theta().map(|it| it as f32);
    let mut correlations = [0.0; 15];
    // Of the turn about y and x: a target that turns seems to move.
    correlations[6] = 64.0 / 127.0;
    MeasuredPose { theta_rad: [a, b, c], translation_mm: [x, y, z], correlations, ..pose() }
}

/// As a start of the box sends it: of a Hello, the one that it names.
pub fn raw(message: &Message) -> Content {
    raw_of(if let Message::Hello(hello) = message { hello.boot_id } else { START }, message)
}

/// As this start of the box sends it.
fn raw_of(start: u32, message: &Message) -> Content {
    let mut buffer = [0; PACKET_BYTES_MAX];
    let datagram = encode_datagram(Start::new(start), message, &mut buffer).unwrap().to_vec();
    Content::Raw(Raw::Datagram(datagram))
}

impl Made {
    /// A good one, of as many frames as thirty seconds have.
    pub fn good() -> Self {
        Self::of(&config(), 1800)
    }

    /// The good one of a box with this configuration.
    pub fn of(config: &Config, frames: u32) -> Self {
        let scene = plumbline_stream::fixture::config().cam_from_scene().unwrap();
        Self::with_poses(config, frames, |sequence, role| scene * scene_from_target(role, sequence))
    }

    /// One with these poses.
    pub fn with_poses(
        config: &Config,
        frames: u32,
        pose: impl Fn(u32, Role) -> Pose<Cam, Target>,
    ) -> Self {
        let mut manifest = Manifest::begin(
            "2026-01-01T00:00:00Z".to_owned(),
            Some("P01".to_owned()),
            Some("control".to_owned()),
            Some("a test".to_owned()),
            Zero::Mark,
        );
        manifest.state = State::Finished;
        let mut entries = vec![Entry { host_ns: 0, content: raw(&Message::Hello(hello(config))) }];
        let scene = config.cam_from_scene().map(|cam_from_scene| {
            let lower = config.targets.iter().find(|it| it.geometry.role() == Role::Lower).unwrap();
            (SceneFrame::new(cam_from_scene), lower.geometry.virtual_point_mm())
        });
        for sequence in 0..frames {
            let packet = packet(scene.as_ref(), sequence, |role| pose(sequence, role));
            let host_ns = packet.capture_time_ns + DELAY_NS;
            entries.push(Entry { host_ns, content: raw(&Message::Pose(packet)) });
            if sequence % 600 == 300 {
                entries.push(Entry { host_ns, content: raw(&Message::View(view())) });
                entries.push(Entry { host_ns, content: raw(&Message::Health(health())) });
                let outcome = ReplyOutcome::Pong {
                    host_sent_ns: host_ns - 1_000_000,
                    box_received_ns: host_ns - 600_000,
                    box_sent_ns: host_ns - 500_000,
                    stream_next: 0,
                };
                let pong = Message::Reply(Reply { id: 1, outcome });
                entries.push(Entry { host_ns, content: raw(&pong) });
            }
        }
        let mark = Content::Mark(Mark::new(Source::Key, "stands"));
        entries.insert(30, Entry { host_ns: entries[30].host_ns, content: mark });
        Self { manifest, config: Some(config.clone()), entries }
    }

    /// Changes each message; one that becomes `None` never came.
    pub fn each(&mut self, change: impl Fn(Message) -> Option<Message>) -> &mut Self {
        self.entries.retain_mut(|entry| {
            let Content::Raw(bytes) = &entry.content else { return true };
            match change(bytes.decode(&mut plumbline::packet::Deframer::new()).unwrap().message) {
                Some(message) => entry.content = raw(&message),
                None => return false,
            }
            true
        });
        self
    }

    /// Changes each pose packet; one that becomes `None` never came.
    pub fn each_pose(&mut self, change: impl Fn(PosePacket) -> Option<PosePacket>) -> &mut Self {
        self.each(|message| match message {
            Message::Pose(packet) => change(packet).map(Message::Pose),
            other => Some(other),
        })
    }

    /// The box starts anew with this entry, and answers nothing from then on.
    pub fn restart_at(&mut self, entry: usize) -> &mut Self {
        let start = START + 1;
        let mut after = self.entries.split_off(entry);
        after.retain_mut(|entry| {
            let Content::Raw(bytes) = &entry.content else { return true };
            let packet = bytes.decode(&mut plumbline::packet::Deframer::new()).unwrap();
            entry.content = raw_of(start, &packet.message);
            !matches!(packet.message, Message::Reply(_))
        });
        let anew = Hello { boot_id: start, ..hello(&plumbline_stream::fixture::config()) };
        self.push(&Message::Hello(anew));
        self.entries.extend(after);
        self
    }

    /// Adds a message at the end.
    pub fn push(&mut self, message: &Message) -> &mut Self {
        let host_ns = self.entries.last().unwrap().host_ns;
        self.entries.push(Entry { host_ns, content: raw(message) });
        self
    }

    /// Writes the folder.
    pub fn write(&self, folder: &Path) {
        std::fs::create_dir(folder).unwrap();
        self.manifest.write(folder).unwrap();
        if let Some(config) = &self.config {
            let mut buffer = vec![0; plumbline::config::BLOB_BYTES_MAX];
            std::fs::write(folder.join(names::CONFIG), config.encode(&mut buffer).unwrap())
                .unwrap();
        }
        let mut journal = Writer::create(&folder.join(names::JOURNAL)).unwrap();
        for content in self.manifest.said() {
            journal.write(&Entry { host_ns: 0, content }).unwrap();
        }
        for entry in &self.entries {
            journal.write(entry).unwrap();
        }
        journal.sync().unwrap();
    }

    /// Writes it into a folder of its own, and reads it.
    pub fn trial(&self) -> (TempDir, Trial) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p01");
        self.write(&path);
        (folder, Trial::open(&path).unwrap())
    }

    /// The verdict on it.
    pub fn verdict(&self) -> Verdict {
        self.trial().1.manifest.verdict()
    }
}
