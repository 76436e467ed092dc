//! Builds a trial from the entries of its journal, in their order: each packet is judged as it was
//! when it came, put right where the box was told something wrong, and becomes a frame or part of
//! what is known of the circumstances. A recording builds its trial while the entries come, so that
//! it is judged by the same facts as afterwards.

use std::collections::BTreeMap;
use std::path::Path;

use plumbline::config::Config;
use plumbline::packet::{
    Deframer, Hello, MarkedInstant, MeasuredPose, Message, PacketError, Reply, ReplyOutcome,
    Trigger,
};
use plumbline::target::Role;
use plumbline_analysis::statistics::describe::median;
use plumbline_stream::clock::Exchange;
use plumbline_stream::others::name;
use plumbline_stream::sessions::{self, Judged, Sessions};

use crate::body::{self, Body};
use crate::correction::{Correction, corrected};
use crate::frame::{Frame, Seen, Trunk};
use crate::journal::{Content, Entry};
use crate::manifest::{BoxSeen, EventSeen, Manifest, NoiseSeen, Packets};
use crate::mark::Mark;
use crate::run::Run;
use crate::triggers::Triggers;
use crate::verdict::{Verdict, judge};
use crate::{Observed, Trial};

/// Builds a trial from its packets.
pub(crate) struct Builder {
    /// As far as it has come; its manifest says of the packets what [`sum_up`](Self::sum_up) wrote.
    pub(super) trial: Trial,
    /// The checksum of what the box was told.
    recorded_crc: Option<u32>,
    correction: Option<Correction>,
    sessions: Sessions,
    body: Option<Body>,
    runs: BTreeMap<u32, Run>,
    marks: Vec<(u64, Mark)>,
    triggers: Triggers,
    hello: Option<Hello>,
    corrupt: u64,
    /// What was counted while it was recorded, and not kept.
    not_authentic: u64,
    /// Packets with a number that no measurement gives.
    beyond: u64,
    instant: Option<MarkedInstant>,
    deframer: Deframer,
}

impl Builder {
    /// Before the first entry of a trial in this folder; `recorded` is what the box was told, and
    /// `correction` what it should have been told.
    pub(crate) fn new(
        folder: &Path,
        manifest: Manifest,
        recorded: Option<Config>,
        correction: Option<Correction>,
    ) -> Self {
        let recorded_crc = recorded.as_ref().map(Config::crc);
        let config = correction.as_ref().map(|it| it.config().clone()).or(recorded);
        let body = config.as_ref().and_then(Body::of);
        let trial = Trial {
            folder: folder.to_owned(),
            manifest,
            config,
            observed: Observed::default(),
            frames: Vec::new(),
            first_frame_utc_s: None,
            warnings: Vec::new(),
        };
        Self {
            trial,
            recorded_crc,
            correction,
            sessions: Sessions::default(),
            body,
            runs: BTreeMap::new(),
            marks: Vec::new(),
            triggers: Triggers::default(),
            hello: None,
            corrupt: 0,
            not_authentic: 0,
            beyond: 0,
            instant: None,
            deframer: Deframer::new(),
        }
    }

    /// The configuration has come, while the trial is being recorded.
    pub(crate) fn take_config(&mut self, config: Config) {
        let crc = config.crc();
        // A Hello that differs from those before has been noticed already.
        let told = self.hello.as_ref().map(|hello| hello.config_crc);
        self.trial.observed.config_changed |= told.is_some_and(|told| told != crc);
        self.recorded_crc = Some(crc);
        self.body = Body::of(&config);
        self.trial.config = Some(config);
    }

    /// The trial so far; its manifest is that of the last [`judged`](Self::judged).
    pub(crate) fn trial(&self) -> &Trial {
        &self.trial
    }

    pub(crate) fn take(&mut self, entry: Entry) {
        let outcome = match entry.content {
            Content::Mark(mark) => {
                self.marks.push((entry.host_ns, mark));
                return;
            }
            Content::About(_) | Content::Check(_) => return,
            Content::NotAuthentic(count) => {
                self.not_authentic = count;
                return;
            }
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

    /// Lets time pass: packets do not wait for a Hello for ever.
    pub(crate) fn pass(&mut self, host_ns: u64) {
        self.sessions.pass(host_ns);
        self.take_judged(host_ns);
    }

    fn take_judged(&mut self, host_ns: u64) {
        while let Some(judged) = self.sessions.next_judged() {
            match judged {
                Judged::Begins { hello, .. } => self.hello(hello),
                Judged::Frame(frame) => self.frame(&frame),
                Judged::Message(message) => self.message(message, host_ns),
                Judged::OtherBox(hello) => note(&mut self.trial.observed.others, name(&hello)),
                Judged::Unnamed(_) | Judged::Conflict(_) => {}
            }
        }
    }

    fn message(&mut self, message: Message, host_ns: u64) {
        match message {
            Message::Health(health) => {
                self.trial.observed.power.take(&health);
            }
            // It says once more who it is.
            Message::Hello(hello) => self.hello(hello),
            Message::Trigger(trigger) => self.triggers.take(self.sessions.count(), trigger),
            Message::View(view) => self.trial.observed.views.push(view),
            Message::Reply(Reply {
                outcome: ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, .. },
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
        let told = self.hello.as_ref().map(|before| before.config_crc);
        let known = told.or(self.recorded_crc);
        self.trial.observed.config_changed |= known.is_some_and(|crc| crc != hello.config_crc);
        self.hello = Some(hello);
    }

    fn frame(&mut self, frame: &sessions::Frame) {
        let sessions::Frame { session, clock, packet, .. } = frame;
        self.instant = Some(packet.instant);
        self.runs.entry(*session).or_default().frame(frame);
        let [upper, lower] = [Role::Upper, Role::Lower].map(|role| packet.pose(role));
        let point = |trunk| body::point(packet, trunk, self.body.as_ref(), |ns| clock.time_s(ns));
        self.trial.frames.push(Frame {
            session: *session,
            sequence: packet.sequence,
            time_s: clock.time_s(packet.capture_time_ns),
            upper: point(Trunk::Upper),
            lower: point(Trunk::Lower),
            theta: [upper, lower].map(|pose| {
                let MeasuredPose { theta_rad: [a, b, c], translation_mm: [x, y, z], .. } = pose?;
                Some([*a, *b, *c, *x, *y, *z])
            }),
            rms_px: [upper, lower].map(|pose| pose.map(|pose| pose.rms_px)),
            seen: [Role::Upper, Role::Lower].map(|role| {
                let target = packet.targets.iter().find(|target| target.role == role)?;
                Some(Seen { state: target.state, no_pose: target.pose.as_ref().err().copied() })
            }),
        });
    }

    /// An event of the run that was under way or, before the first frame, of the first.
    fn event(&self, host_ns: u64, mark: &Mark) -> Option<EventSeen> {
        let has_begun = |run: &&Run| run.begun_ns().is_some_and(|begun_ns| begun_ns <= host_ns);
        let of_its_run = self.runs.values().rev().find(has_begun);
        let first = self.runs.values().find(|run| run.begun_ns().is_some());
        of_its_run.or(first)?.event(host_ns, mark)
    }

    /// The verdict on the trial, if it ended here.
    pub(crate) fn judged(&mut self) -> Verdict {
        self.sum_up();
        judge(&self.trial, &self.trial.manifest.criteria)
    }

    /// Nothing more comes. Also returns what corrected the packets.
    pub(super) fn finish(mut self) -> (Trial, Option<Correction>) {
        self.sessions.finish();
        self.take_judged(u64::MAX);
        let computed = self.judged();
        let Self { mut trial, correction, runs, triggers, .. } = self;
        trial.manifest.noise =
            Trunk::ALL.into_iter().filter_map(|trunk| noise(&trial.frames, trunk)).collect();
        let started = trial.manifest.started.parse::<jiff::Timestamp>().ok();
        trial.first_frame_utc_s = started.and_then(|it| {
            let first_s = runs.values().find_map(Run::first_capture_s)?;
            Some(1e-9 * it.as_nanosecond() as f64 + first_s)
        });
        trial.warnings.extend(warnings(&trial));
        trial.warnings.extend(triggers.warnings());
        let Verdict { overruled, by, why, .. } = trial.manifest.verdict();
        trial.manifest.verdict = Some(Verdict { overruled, by, why, ..computed });
        (trial, correction)
    }

    /// Writes into the manifest what the packets say of the trial so far.
    fn sum_up(&mut self) {
        // The network may reorder packets.
        self.trial.frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let (counts, left_out) = (self.sessions.counts(), self.sessions.left_out());
        let packets = Packets {
            frames: counts.received,
            lost: counts.lost,
            late: counts.late,
            repeated: counts.repeated,
            corrupt: self.corrupt,
            not_authentic: self.not_authentic,
            implausible: counts.implausible + self.beyond,
            other_box: left_out.other_box,
            conflicting: left_out.conflicting,
            unknown_start: left_out.unknown_start,
            sessions: self.sessions.count(),
        };
        let the_box = self.hello.as_ref().map(|hello| BoxSeen {
            device: hello.device.to_string(),
            serial_number: hello.serial_number.to_string(),
            firmware: hello.firmware.to_string(),
            config_crc: format!("{:08x}", hello.config_crc),
        });
        let clocks =
            self.runs.iter().filter_map(|(session, run)| run.clock_seen(*session)).collect();
        let marks = self.marks.iter().filter_map(|(host_ns, mark)| self.event(*host_ns, mark));
        let of_run = |(session, trigger): &(u32, Trigger)| self.runs.get(session)?.trigger(trigger);
        let triggers = self.triggers.all().iter().filter_map(of_run);
        let mut events: Vec<EventSeen> = marks.chain(triggers).collect();
        events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let manifest = &mut self.trial.manifest;
        manifest.the_box = the_box;
        manifest.instant = self.instant;
        manifest.packets = Some(packets);
        manifest.clocks = clocks;
        manifest.events = events;
    }
}

/// What a user should know of a trial's packets.
fn warnings(trial: &Trial) -> Vec<String> {
    let changed = trial.observed.config_changed.then(|| {
        "the box was given another configuration during the trial: positions before and after are \
         not of one calibration"
            .to_owned()
    });
    let packets = trial.manifest.packets.iter().flat_map(Packets::warnings);
    let power = trial.observed.power.warnings().into_iter().map(str::to_owned);
    changed.into_iter().chain(packets).chain(power).collect()
}

/// Takes note of a name, once.
fn note(names: &mut Vec<String>, name: String) {
    if !names.contains(&name) {
        names.push(name);
    }
}

fn noise(frames: &[Frame], trunk: Trunk) -> Option<NoiseSeen> {
    let sd_mm = |axis: usize| {
        let of = frames.iter().filter_map(|frame| frame.point(trunk)?.covariance_mm2);
        median(of.map(|it| it[(axis, axis)].max(0.0).sqrt()))
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

    use plumbline::packet::{
        AnatomicalPoint, Edge, Health, PACKET_BYTES_MAX, Packet, encode_datagram,
    };
    use plumbline_analysis::series::Series;
    use plumbline_stream::fixture::adversity::{self, Adversity};
    use plumbline_stream::fixture::health;
    use plumbline_stream::receiver::Receiver;
    use plumbline_stream::transport::{Event, Raw};

    use super::*;
    use crate::frame::Point;
    use crate::manifest::Zero;
    use crate::mark::Source;

    fn builder() -> Builder {
        let manifest =
            Manifest::begin("2026-01-01T00:00:00Z".to_owned(), None, None, None, Zero::Mark);
        Builder::new(Path::new("trial"), manifest, None, None)
    }

    /// The trial in what a recording has kept of these packets.
    fn trial(packets: &[(u64, Packet)]) -> Trial {
        let mut builder = builder();
        for (host_ns, Packet { start, message }) in packets {
            let mut buffer = [0; PACKET_BYTES_MAX];
            let datagram = encode_datagram(*start, message, &mut buffer).unwrap().to_vec();
            let content = Content::Raw(Raw::Datagram(datagram));
            builder.take(Entry { host_ns: *host_ns, content });
        }
        builder.finish().0
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

    /// Two seconds at 50 Hz of a start, a Hello before them, and these messages.
    fn start_of(start: u32, from_ns: u64, more: &[(u64, Message)]) -> Vec<(u64, Packet)> {
        let mut packets = vec![(from_ns, adversity::hello_of("ward 3", start))];
        let frames = (0..100).map(|number| {
            let packet = adversity::frame_of(start, number, 50);
            (from_ns + u64::from(number) * 20_000_000, packet)
        });
        packets.extend(frames);
        let others = more.iter().map(|(ns, message)| {
            let packet = adversity::frame_of(start, 0, 50);
            (*ns, Packet { message: message.clone(), ..packet })
        });
        packets.extend(others);
        packets.sort_by_key(|(ns, _)| *ns);
        packets
    }

    #[test]
    fn triggers_are_events_by_the_clock_of_the_frames_and_the_first_mark_is_t_0() {
        let trigger = |sequence, time_ns| {
            let uncertain_ns = 100_000;
            Message::Trigger(Trigger { sequence, time_ns, uncertain_ns, edge: Edge::Rising })
        };
        // The first frame is of 1 s. A packet that comes late has its own time all the same, and the
        // one with the number 2 never comes.
        let first = [
            (700_000_000, trigger(1, 1_600_000_000)),
            (1_900_000_000, trigger(0, 1_250_000_000)),
            (1_950_000_000, trigger(3, 2_940_000_000)),
        ];
        let mut packets = start_of(1, 0, &first);
        let second_ns = 10_000_000_000;
        packets.extend(start_of(
            2,
            second_ns,
            &[(second_ns + 510_000_000, trigger(0, 1_500_000_000))],
        ));
        let trial = trial(&packets);
        let events = &trial.manifest.events;
        let times_s: Vec<f64> = events.iter().map(|event| event.time_s).collect();
        assert_eq!(times_s.len(), 4, "{events:?}");
        for (found_s, wanted_s) in times_s.iter().zip([0.25, 0.6, 1.94, 10.5]) {
            // Between two starts times are as good as the arrival of the packets.
            assert!((found_s - wanted_s).abs() < 1e-3, "{times_s:?}");
        }
        for event in events {
            assert_eq!((&*event.label, event.source), ("rising edge", Source::Trigger));
            assert!((event.uncertain_s - 1e-4).abs() < 1e-12, "{event:?}");
        }
        assert_eq!(trial.manifest.zero_mark(), Some(&events[0]));
        assert!(trial.warnings.contains(&"1 trigger of the box never came".to_owned()));
        let written = toml::to_string(&trial.manifest).unwrap();
        assert!(written.contains("source = \"trigger\"\nuncertain_s = 0.0001"), "{written}");
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
                not_authentic: 0,
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
            let mut builder = builder();
            for undervoltage in undervoltages.iter().copied().map(Some) {
                builder.message(Message::Health(Health { undervoltage, ..health() }), 0);
            }
            builder.finish().0
        };
        assert_eq!(trial(&[false, false]).warnings, [""; 0]);
        let warnings = trial(&[false, true, true, false]).warnings;
        assert!(matches!(&warnings[..], [one] if one.contains("power supply")), "{warnings:?}");
    }
}
