use plumbline::config::BLOB_BYTES_MAX;
use plumbline::packet::{
    Command, Deframer, Document, Health, Hello, PART_BYTES_MAX, Part, PosePacket, Reply,
    ReplyOutcome,
};
use plumbline::report::NoPose;
use plumbline_stream::fixture::{config, event, health, hello, pose_packet, view};

use super::*;
use crate::derived::{Changes, remake};
use crate::manifest::Zero;
use crate::mark;
use crate::test_trial::{Made, raw};
use crate::verdict::Grade;

/// The box tells its configuration.
fn tell(recording: &mut Recording, config: &Config, now: Instant) {
    let mut blob = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut blob).unwrap();
    let (bytes, crc) = (blob.len() as u32, config.crc());
    let outcome = ReplyOutcome::Config { bytes, crc, next_crc: crc };
    let mut messages = vec![Message::Reply(Reply { id: 1, outcome })];
    messages.extend(blob.chunks(PART_BYTES_MAX).enumerate().map(|(at, piece)| {
        let offset = (at * PART_BYTES_MAX) as u32;
        let bytes = piece.iter().copied().collect();
        Message::Part(Part { document: Document::Config, offset, bytes })
    }));
    for message in messages {
        recording.event(&event(message), now).unwrap();
    }
    assert_eq!(recording.config().map(Config::crc), Some(config.crc()));
}

/// Records this trial as if it came from a box: what the verdict was five seconds after its
/// last packet, and the one of the trial on the disk.
fn recorded(made: &Made) -> (Verdict, Verdict) {
    recorded_as(made, |recording| recording)
}

fn recorded_as(made: &Made, how: impl Fn(Recording) -> Recording) -> (Verdict, Verdict) {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let (sender, marks) = mark::channel();
    let manifest = Manifest { state: State::Recording, ..made.manifest.clone() };
    let path = folder.path().join("p01");
    let heard = Box::new(|_: &Mark, _| {});
    let mut recording = how(Recording::begin(&path, &manifest, marks, start, heard).unwrap());
    let mut deframer = Deframer::new();
    for (at, Entry { host_ns, content }) in made.entries.iter().enumerate() {
        let now = start + Duration::from_nanos(*host_ns);
        match content {
            Content::Mark(mark) => assert!(sender.send(now, mark.clone())),
            Content::About(_) | Content::Check(_) | Content::NotAuthentic(_) => {}
            Content::Raw(raw) => {
                recording.event(&Event::Raw(raw.clone()), now).unwrap();
                recording.event(&Event::of(raw.decode(&mut deframer)), now).unwrap();
            }
        }
        recording.turn(now).unwrap();
        // As late as a slow line has it.
        if let Some(config) = made.config.as_ref().filter(|_| at == 100) {
            tell(&mut recording, config, now);
        }
    }
    // A box is believed to have restarted once the start before is silent.
    let last_ns = made.entries.last().unwrap().host_ns;
    recording.turn(start + Duration::from_nanos(last_ns) + Duration::from_secs(5)).unwrap();
    let live = recording.verdict();
    (live, recording.end(1).unwrap().unwrap().manifest.verdict())
}

#[test]
fn a_recording_that_keeps_nothing_in_memory_has_the_same_verdict_in_the_end() {
    let mut made = Made::good();
    made.each_pose(|packet| (packet.sequence % 7 != 0).then_some(packet));
    let (_, judged) = recorded(&made);
    let (meanwhile, unjudged) = recorded_as(&made, Recording::unjudged);
    assert_ne!(judged.is, Grade::Good);
    assert_eq!((meanwhile, unjudged), (Verdict::default(), judged));
}

#[test]
fn the_verdict_while_it_is_recorded_is_the_one_in_the_folder() {
    let spoiled = |change: &dyn Fn(&mut Made)| {
        let mut made = Made::good();
        change(&mut made);
        made
    };
    let thinned = |keep: fn(u32) -> bool| {
        spoiled(&|made| {
            made.each_pose(|packet| keep(packet.sequence).then_some(packet));
        })
    };
    let half_the_rate = spoiled(&|made| {
        made.each_pose(|packet| {
            let PosePacket { sequence, .. } = packet;
            let slower = PosePacket { sequence: sequence / 2, ..packet };
            (sequence % 2 == 0).then_some(slower)
        });
    });
    let covered = spoiled(&|made| {
        made.each_pose(|mut packet| {
            if packet.sequence > 1000 {
                packet.lower_trunk = None;
                packet.targets.iter_mut().for_each(|it| it.pose = Err(NoPose::Searching));
            }
            Some(packet)
        });
    });
    let exchanged = spoiled(&|made| {
        made.each_pose(|mut packet| {
            std::mem::swap(&mut packet.upper_trunk, &mut packet.lower_trunk);
            Some(packet)
        });
    });
    let with = |message: Message| {
        let mut made = Made::good();
        made.push(&message);
        made
    };
    let without_scene = Config { cam_from_scene_theta: None, ..config() };
    let serial_number = "PL-0002".try_into().unwrap();
    let cases = [
        ("good", Made::good(), vec![]),
        ("loss", thinned(|it| it % 4 != 3), vec!["lost_percent"]),
        ("late frames", late(), vec![]),
        ("half the rate", half_the_rate, vec!["rate_percent", "rate_hz"]),
        ("covered", covered, vec!["gap_s", "poses_percent", "gaps_percent"]),
        ("exchanged", exchanged, vec!["upper_above_lower_mm"]),
        ("no scene", Made::of(&without_scene, 1800), vec!["no_scene"]),
        ("short", Made::of(&config(), 600), vec!["duration_s"]),
        ("unmarked", unmarked(), vec!["no_mark"]),
        (
            "restarted",
            with(Message::Hello(Hello { boot_id: 8, ..hello(&config()) })),
            vec!["starts"],
        ),
        (
            "another box",
            with(Message::Hello(Hello { serial_number, boot_id: 9, ..hello(&config()) })),
            vec!["others"],
        ),
        (
            "another configuration",
            with(Message::Hello(Hello { config_crc: 1, ..hello(&config()) })),
            vec!["configuration_changed"],
        ),
        (
            "weak supply",
            with(Message::Health(Health { undervoltage: Some(true), ..health() })),
            vec!["undervoltage"],
        ),
    ];
    for (name, made, wanted) in cases {
        let (live, written) = recorded(&made);
        assert_eq!(live, written, "{name}");
        let keys: Vec<&str> = live.reasons.iter().map(|it| &*it.key).collect();
        for key in &wanted {
            assert!(keys.contains(key), "{name}: no {key} in {keys:?}");
        }
        assert_eq!(live.is == Grade::Good, wanted.is_empty(), "{name}: {keys:?}");
        // What the rest of the recording can mend is no reason to look up yet.
        let is_open = matches!(wanted[..], ["duration_s" | "no_mark"]);
        let so_far = |awaits_mark| live.clone().so_far(awaits_mark).is == Grade::Good;
        assert_eq!(so_far(true), wanted.is_empty() || is_open, "{name}");
        // A mark that cannot come any more is.
        assert_eq!(so_far(false), so_far(true) && name != "unmarked", "{name}");
    }
}

/// Each hundredth frame comes half a second late.
fn late() -> Made {
    let mut made = Made::good();
    for entry in &mut made.entries {
        let Content::Raw(raw) = &entry.content else { continue };
        let message = raw.decode(&mut Deframer::new()).unwrap().message;
        if matches!(message, Message::Pose(pose) if pose.sequence % 100 == 50) {
            entry.host_ns += 500_000_000;
        }
    }
    made.entries.sort_by_key(|entry| entry.host_ns);
    made
}

fn unmarked() -> Made {
    let mut made = Made::good();
    made.entries.retain(|entry| !matches!(entry.content, Content::Mark(_)));
    made
}

fn begun(folder: &Path, now: Instant) -> Recording {
    let (_, marks) = mark::channel();
    let manifest = Manifest::begin(
        "2026-01-01T00:00:00Z".to_owned(),
        Some("P07".to_owned()),
        None,
        None,
        Zero::Start,
    );
    Recording::begin(folder, &manifest, marks, now, Box::new(|_, _| {})).unwrap()
}

/// The network fails for a minute, between the answer to the first question and the first part.
#[test]
fn the_configuration_is_asked_for_until_it_has_come() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let path = folder.path().join("p07");
    let mut recording = begun(&path, start);
    recording.event(&event(Message::Health(health())), start).unwrap();
    let outcome = ReplyOutcome::Config { bytes: 1000, crc: 1, next_crc: 1 };
    let answer = event(Message::Reply(Reply { id: 1, outcome }));
    recording.event(&answer, start).unwrap();
    let mut asked = [0; 2];
    for at_ds in 0..600_u32 {
        let now = start + Duration::from_millis(100) * at_ds;
        if let Some(Message::Command(Command { action, .. })) = recording.turn(now).unwrap() {
            asked[0] += usize::from(matches!(action, Action::SendParts { .. }));
            asked[1] += usize::from(action == Action::QueryConfig);
        }
    }
    // Six times for the parts, as a document is, and then every two seconds what it is.
    assert!(asked[0] == 6 && (20..30).contains(&asked[1]), "{asked:?}");
    tell(&mut recording, &config(), start + Duration::from_secs(61));
    assert!(path.join(names::CONFIG).exists());
}

#[test]
fn light_and_focus_are_asked_for_until_they_come_and_then_every_ten_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let mut recording = begun(&folder.path().join("p07"), start);
    // There is nobody to ask.
    assert_eq!(recording.turn(start).unwrap(), None);
    recording.event(&event(Message::Health(health())), start).unwrap();
    let mut asked_ds = Vec::new();
    for at_ds in 0..350_u32 {
        let now = start + Duration::from_millis(100) * at_ds;
        let question = recording.turn(now).unwrap();
        let Some(Message::Command(Command { action: Action::SendView, .. })) = question else {
            continue;
        };
        asked_ds.push(at_ds);
        // The box does not answer before the fourth second.
        if at_ds > 40 {
            recording.event(&event(Message::View(view())), now).unwrap();
        }
    }
    let steps_ds: Vec<u32> = asked_ds.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let expected_ds = [20, 20, 100, 100, 100];
    assert!(asked_ds[0] <= 3 && steps_ds.len() == expected_ds.len(), "{asked_ds:?}");
    for (step_ds, expected_ds) in steps_ds.into_iter().zip(expected_ds) {
        // Other questions go first, one in each turn.
        assert!((expected_ds..expected_ds + 3).contains(&step_ds), "{asked_ds:?}");
    }
}

#[test]
fn views_other_boxes_and_who_was_measured_are_in_the_packets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p07");
    let start = Instant::now();
    let mut recording = begun(&path, start);
    let serial_number = "PL-0002".try_into().unwrap();
    let other = Hello { serial_number, boot_id: 9, ..hello(&config()) };
    for at in 0..3_u32 {
        let now = start + Duration::from_secs(1) * (at + 1);
        for message in [
            Message::Hello(hello(&config())),
            Message::Hello(other.clone()),
            Message::View(view()),
            Message::Pose(pose_packet(at)),
        ] {
            let Content::Raw(bytes) = raw(&message) else { unreachable!() };
            recording.event(&Event::Raw(bytes), now).unwrap();
            recording.event(&event(message), now).unwrap();
        }
    }
    let check = CheckSeen {
        subject: "rate".to_owned(),
        verdict: crate::manifest::CheckVerdict::Warn,
        seen: "10 Hz of 60".to_owned(),
    };
    recording.note(vec![check.clone()]).unwrap();
    // However it goes on: the file is lost before the recording is over.
    let lost = path.join(names::MANIFEST);
    let written = std::fs::read(&lost).unwrap();
    std::fs::remove_file(&lost).unwrap();
    let after = remake(&path, &Changes::default()).unwrap();
    assert_eq!(after.manifest.participant.as_deref(), Some("P07"));
    assert_eq!(after.manifest.checks, [check]);
    assert_eq!((after.manifest.zero, after.manifest.state), (Zero::Start, State::Recording));
    std::fs::write(&lost, written).unwrap();

    let trial = recording.end(3).unwrap().unwrap();
    assert_eq!(trial.observed.views.len(), 3);
    assert_eq!(trial.observed.others, ["ward 3 (PL-0002)"]);
    let keys: Vec<String> = trial.manifest.verdict().reasons.into_iter().map(|it| it.key).collect();
    assert!(keys.contains(&"others".to_owned()), "{keys:?}");
    // After the end the packets tell that it ended.
    std::fs::remove_file(&lost).unwrap();
    assert_eq!(remake(&path, &Changes::default()).unwrap().manifest.state, State::Finished);
}

/// A copy that a full disk has cut off between two entries has no damaged byte; its
/// `trial.toml`, which was copied whole, does not know of it.
#[test]
fn a_file_that_lacks_its_end_is_cut_off_whatever_the_manifest_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p07");
    let start = Instant::now();
    let mut recording = begun(&path, start);
    for at in 0..60 {
        let message = Message::Pose(pose_packet(at));
        let Content::Raw(bytes) = raw(&message) else { unreachable!() };
        recording.event(&Event::Raw(bytes), start + Duration::from_millis(16) * at).unwrap();
    }
    let whole = recording.end(60).unwrap().unwrap();
    assert_eq!(whole.manifest.state, State::Finished);

    let journal = path.join(names::JOURNAL);
    let bytes = std::fs::read(&journal).unwrap();
    // Before the last entry, which says that the recording has ended.
    let end = bytes.windows(2).rposition(|pair| pair == [0, 0]).unwrap() + 1;
    std::fs::write(&journal, &bytes[..end]).unwrap();
    let cut = Trial::open(&path).unwrap();
    assert_eq!((cut.frames.len(), cut.observed.damaged_bytes), (whole.frames.len(), 0));
    assert_eq!(cut.manifest.state, State::Recording);
    let reasons = cut.manifest.verdict().reasons;
    assert!(reasons.iter().any(|it| it.key == "cut_off"), "{reasons:?}");
    assert!(cut.warnings.iter().any(|it| it.contains("cut off")), "{:?}", cut.warnings);

    // The whole file is there again, and the trial is what it was.
    remake(&path, &Changes::default()).unwrap();
    std::fs::write(&journal, &bytes).unwrap();
    let again = remake(&path, &Changes::default()).unwrap();
    assert_eq!(again.manifest.state, State::Finished);
}
