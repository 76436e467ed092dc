//! Each criterion, by a trial that is good but for it.

use plumbline::packet::{CameraState, Health, Hello, Message, PosePacket, View};
use plumbline::report::NoPose;
use plumbline::target::Role;
use plumbline_stream::fixture::{config, hello};
use plumbline_stream::transport::Raw;

use super::Grade::{Doubtful, Unusable};
use super::*;
use crate::journal::{Content, Entry};
use crate::manifest::{State, Zero};
use crate::names;
use crate::test_trial::{Made, SECOND_NS};

/// Checks what a trial's reasons are, all of them, the worst first.
#[track_caller]
fn assert_reasons(made: &Made, wanted: &[(&str, Grade)]) -> Verdict {
    let verdict = made.verdict();
    let found: Vec<(&str, Grade)> =
        verdict.reasons.iter().map(|reason| (&*reason.key, reason.is)).collect();
    assert_eq!(found, wanted, "{}", verdict.lines());
    assert_eq!(verdict.is, wanted.first().map_or(Grade::Good, |(_, grade)| *grade));
    verdict
}

/// A target is not seen in frames from `from`, for so many.
fn without(made: &mut Made, role: Role, from: u32, frames: u32) {
    made.each_pose(|mut packet| {
        if (from..from + frames).contains(&packet.sequence) {
            let target = packet.targets.iter_mut().find(|it| it.role == role).unwrap();
            target.pose = Err(NoPose::Searching);
            match role {
                Role::Upper => packet.upper_trunk = None,
                _ => packet.lower_trunk = None,
            }
        }
        Some(packet)
    });
}

fn each_view(made: &mut Made, change: impl Fn(&mut plumbline::view::TargetView)) {
    made.each(|message| match message {
        Message::View(mut view) => {
            view.targets.iter_mut().filter(|it| it.role == Role::Upper).for_each(&change);
            Some(Message::View(view))
        }
        other => Some(other),
    });
}

#[test]
fn a_good_trial_is_good() {
    let verdict = assert_reasons(&Made::good(), &[]);
    assert_eq!(verdict.line(), "good");
    assert_eq!(verdict.lines(), "verdict: good");
}

#[test]
fn a_trunk_that_is_not_seen() {
    // 28 frames less are a gap of 29 periods, which is not yet half a second.
    let mut made = Made::good();
    without(&mut made, Role::Upper, 600, 28);
    assert_reasons(&made, &[]);
    let mut made = Made::good();
    without(&mut made, Role::Upper, 600, 30);
    let verdict = assert_reasons(&made, &[("gap_s", Doubtful)]);
    // The step from the last frame before to the first after.
    assert!((verdict.reasons[0].found.unwrap() - 31.0 / 60.0).abs() < 1e-6);
    assert_eq!(verdict.reasons[0].words, "upper trunk, longest gap: 0.52 s (at most 0.5)");

    let mut made = Made::good();
    without(&mut made, Role::Lower, 600, 100);
    let all = [("poses_percent", Doubtful), ("gap_s", Doubtful), ("gaps_percent", Doubtful)];
    assert_reasons(&made, &all);
    // A gap at the end counts, although no sample ends it.
    let mut made = Made::good();
    without(&mut made, Role::Lower, 1700, 100);
    assert_reasons(&made, &all);
    let mut made = Made::good();
    without(&mut made, Role::Lower, 100, 1700);
    let all = [("poses_percent", Unusable), ("gap_s", Unusable), ("gaps_percent", Unusable)];
    assert_reasons(&made, &all);
}

#[test]
fn many_short_gaps_add_up() {
    // Every tenth frame: a gap of two periods in ten.
    let mut made = Made::good();
    made.each_pose(|mut packet| {
        if packet.sequence % 10 == 5 {
            packet.targets.iter_mut().for_each(|target| target.pose = Err(NoPose::Searching));
            packet.upper_trunk = None;
            packet.lower_trunk = None;
        }
        Some(packet)
    });
    let verdict = made.verdict();
    let found: Vec<(&str, f64)> =
        verdict.reasons.iter().map(|it| (&*it.key, it.found.unwrap())).collect();
    let [("poses_percent", lower), ("gaps_percent", gaps), ("poses_percent", _), (_, _)] =
        found[..]
    else {
        panic!("{}", verdict.lines());
    };
    assert!((lower - 90.0).abs() < 1e-9 && (gaps - 20.0).abs() < 0.1, "{}", verdict.lines());
}

#[test]
fn a_trial_that_is_short_or_slow() {
    // The mark is half a second after the first frame.
    assert_reasons(&Made::of(&config(), 60 * 26), &[]);
    let verdict = assert_reasons(&Made::of(&config(), 60 * 25), &[("duration_s", Doubtful)]);
    assert!(verdict.lines().contains("ISPGR"), "{}", verdict.lines());
    let mut short = Made::good();
    short.each_pose(|packet| (packet.sequence < 60 * 5).then_some(packet));
    assert_reasons(&short, &[("duration_s", Unusable)]);

    // Ten frames a second, none of them lost: the camera did not give more.
    let slow = |packet: PosePacket| {
        let PosePacket { sequence, .. } = packet;
        let slower = PosePacket { sequence: sequence / 6, ..packet };
        (sequence % 6 == 0).then_some(slower)
    };
    let mut made = Made::good();
    made.each_pose(slow);
    let all = [("rate_percent", Unusable), ("rate_hz", Doubtful)];
    let verdict = assert_reasons(&made, &all);
    assert!(verdict.reasons[0].words.contains("of the 60 that were asked for: 16.7 %"));

    // A stall of six seconds without a lost frame, as of a recording that is replayed.
    let mut made = Made::good();
    made.each_pose(|mut packet| {
        if packet.sequence >= 900 {
            packet.capture_time_ns += 6 * SECOND_NS;
        }
        Some(packet)
    });
    let keys: Vec<String> = made.verdict().reasons.into_iter().map(|it| it.key).collect();
    for key in ["gap_s", "gaps_percent", "rate_percent"] {
        assert!(keys.iter().any(|it| it == key), "no {key} in {keys:?}");
    }
}

#[test]
fn packets_that_are_lost_or_damaged() {
    let lose = |every: u32| {
        let mut made = Made::good();
        made.each_pose(|packet| (packet.sequence % every != every - 1).then_some(packet));
        made
    };
    assert_reasons(&lose(150), &[]);
    assert_reasons(&lose(50), &[("lost_percent", Doubtful)]);
    // The camera was no slower for it; each frame lost is a gap of two periods in four.
    let gaps = ("gaps_percent", Doubtful);
    assert_reasons(&lose(4), &[("lost_percent", Unusable), gaps, gaps]);

    let mut made = Made::good();
    let host_ns = made.entries.last().unwrap().host_ns;
    let junk = Content::Raw(Raw::Datagram(vec![7; 40]));
    let junk = Entry { host_ns, content: junk };
    made.entries.extend(vec![junk; 40]);
    assert_reasons(&made, &[("corrupt_percent", Doubtful)]);
}

#[test]
fn a_damaged_file_or_one_that_was_cut_off() {
    let (folder, trial) = Made::good().trial();
    let path = folder.path().join("p01").join(names::JOURNAL);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
    let trial = crate::Trial::open(&trial.folder).unwrap();
    let reasons = trial.manifest.verdict().reasons;
    assert_eq!(reasons.len(), 1, "{reasons:?}");
    assert_eq!((&*reasons[0].key, reasons[0].is), ("damaged_bytes", Doubtful));
    let mut made = Made::good();
    made.manifest.state = State::Recording;
    assert_reasons(&made, &[("cut_off", Doubtful)]);
}

#[test]
fn a_box_that_restarted_and_another_box() {
    let mut made = Made::good();
    let restarted = Hello { boot_id: 8, ..hello(&config()) };
    made.push(&Message::Hello(restarted));
    assert_reasons(&made, &[("starts", Doubtful)]);

    let mut made = Made::good();
    let mut other = Hello { boot_id: 9, ..hello(&config()) };
    other.device = "ward 5".try_into().unwrap();
    other.serial_number = "PL-0005".try_into().unwrap();
    made.push(&Message::Hello(other));
    let verdict = assert_reasons(&made, &[("others", Doubtful)]);
    assert!(verdict.line().contains("ward 5"), "{}", verdict.line());
}

#[test]
fn what_the_box_was_not_told() {
    let without_scene = plumbline::config::Config { cam_from_scene_theta: None, ..config() };
    let verdict = assert_reasons(&Made::of(&without_scene, 1800), &[("no_scene", Unusable)]);
    let said = verdict.lines();
    assert!(said.contains("`plumb replay TRIAL --tables --scene scene.toml`"), "{said}");
    let mut made = Made::good();
    made.config = None;
    assert_reasons(&made, &[("no_configuration", Doubtful)]);
    let mut made = Made::good();
    made.push(&Message::Hello(Hello { config_crc: 1, ..hello(&config()) }));
    assert_reasons(&made, &[("configuration_changed", Unusable)]);
    // Even where none of them is in the trial.
    made.config = None;
    let all = [("configuration_changed", Unusable), ("no_configuration", Doubtful)];
    assert_reasons(&made, &all);
}

#[test]
fn a_beginning_that_is_not_marked() {
    let mut made = Made::good();
    made.entries.retain(|entry| !matches!(entry.content, Content::Mark(_)));
    assert_reasons(&made, &[("no_mark", Doubtful)]);
    made.manifest.zero = Zero::Start;
    assert_reasons(&made, &[]);
    made.manifest.zero = Zero::Onset;
    assert_reasons(&made, &[("no_onset", Unusable)]);
}

#[test]
fn targets_whose_roles_were_exchanged() {
    // Of a box that takes the print at the shoulder for the lower one.
    let mut made = Made::good();
    made.each_pose(|mut packet| {
        std::mem::swap(&mut packet.upper_trunk, &mut packet.lower_trunk);
        Some(packet)
    });
    let verdict = assert_reasons(&made, &[("upper_above_lower_mm", Unusable)]);
    assert!(verdict.lines().contains("--targets targets.toml"), "{}", verdict.lines());
    let mut made = Made::good();
    made.each_pose(|mut packet| {
        packet.upper_trunk.as_mut().unwrap().si_mm -= 350.0;
        Some(packet)
    });
    assert_reasons(&made, &[("upper_above_lower_mm", Doubtful)]);
}

#[test]
fn poor_light_and_poor_focus() {
    type Change = fn(&mut plumbline::view::TargetView);
    let cases: [(Change, &[(&str, Grade)]); 7] = [
        (|it| (it.light, it.dark) = (0.9, 0.7), &[("contrast", Doubtful)]),
        (|it| (it.light, it.dark) = (0.9, 0.8), &[("contrast", Unusable)]),
        (|it| (it.light, it.dark) = (0.3, 0.04), &[("light", Doubtful)]),
        (|it| it.saturated = 0.01, &[("saturated_percent", Doubtful)]),
        (|it| it.saturated = 0.6, &[("saturated_percent", Unusable)]),
        (|it| it.blur_px = [0.7, 1.2], &[("blur_px", Doubtful)]),
        (|it| it.blur_px = [3.5, 0.7], &[("blur_px", Unusable)]),
    ];
    for (change, wanted) in cases {
        let mut made = Made::good();
        each_view(&mut made, change);
        let verdict = assert_reasons(&made, wanted);
        assert!(verdict.reasons[0].words.starts_with("upper target"), "{}", verdict.line());
    }
    // Without a view nothing is known of it.
    let mut made = Made::good();
    made.each(|message| (!matches!(message, Message::View(View { .. }))).then_some(message));
    assert_reasons(&made, &[]);
    for (rms_px, wanted) in [(0.4, Doubtful), (0.7, Unusable)] {
        let mut made = Made::good();
        made.each_pose(|mut packet| {
            packet.targets.iter_mut().filter(|it| it.role == Role::Lower).for_each(|target| {
                target.pose.as_mut().unwrap().rms_px = rms_px;
            });
            Some(packet)
        });
        assert_reasons(&made, &[("rms_px", wanted)]);
    }
}

#[test]
fn power_and_clocks() {
    let of_health = |change: fn(&mut Health)| {
        let mut made = Made::good();
        made.each(|message| match message {
            Message::Health(mut health) => {
                assert_eq!(health.camera, CameraState::Running);
                change(&mut health);
                Some(Message::Health(health))
            }
            other => Some(other),
        });
        made
    };
    let weak = of_health(|health| health.undervoltage = Some(true));
    assert_reasons(&weak, &[("undervoltage", Doubtful)]);
    let hot = of_health(|health| health.throttled = Some(true));
    assert_reasons(&hot, &[("throttled", Doubtful)]);
    let mut made = Made::good();
    made.each(|message| (!matches!(message, Message::Reply(_))).then_some(message));
    assert_reasons(&made, &[("clock_unrelated", Doubtful)]);
    // Of two runs of the box, one is not enough.
    let mut made = Made::good();
    // The time between them is a gap, and no slowness of the camera.
    made.restart_at(1000);
    let gap = [("gap_s", Doubtful), ("gaps_percent", Doubtful)];
    let all = [&[("clock_unrelated", Doubtful), ("starts", Doubtful)], &gap[..], &gap].concat();
    assert_reasons(&made, &all);
    let mut made = Made::good();
    made.each(|message| (!matches!(message, Message::Reply(_))).then_some(message));
    // The times of a recording that is replayed are no clock's.
    made.each_pose(|mut packet| {
        packet.instant = plumbline::packet::MarkedInstant::Recording;
        Some(packet)
    });
    assert_reasons(&made, &[]);
}

#[test]
fn a_laboratory_has_its_own_criteria() {
    let mut made = Made::of(&config(), 60 * 20);
    assert_reasons(&made, &[("duration_s", Doubtful)]);
    let text = "[doubtful]\nduration_s_min = 10\n[unusable]\n";
    made.manifest.criteria = Criteria::parse(text, "").unwrap();
    assert_reasons(&made, &[]);
    let text = "[doubtful]\n[unusable]\nduration_s_min = 25\n";
    made.manifest.criteria = Criteria::parse(text, "").unwrap();
    assert_reasons(&made, &[("duration_s", Unusable)]);
}

/// 24.995 s are no 25 s, also where three digits would say so.
#[test]
fn a_figure_is_shown_with_the_digits_by_which_it_misses_its_bound() {
    let verdict = assert_reasons(&Made::of(&config(), 1530), &[("duration_s", Doubtful)]);
    let words = &verdict.reasons[0].words;
    assert_eq!(words, "from t = 0 to the last frame: 24.995 s (at least 25)");
}

#[test]
fn a_trial_that_saw_no_target_is_not_said_to_lack_a_scene() {
    let mut made = Made::good();
    without(&mut made, Role::Upper, 0, 1800);
    without(&mut made, Role::Lower, 0, 1800);
    let verdict = made.verdict();
    let said = verdict.lines();
    assert_eq!((verdict.is, &*verdict.reasons[0].key), (Unusable, "no_target"), "{said}");
    assert!(verdict.reasons.iter().all(|reason| reason.key != "no_scene"), "{said}");
    assert!(said.contains("neither trunk's target was seen"), "{said}");
    assert!(!said.contains("plumb scene") && said.contains("frames in which it is seen: 0 %"));
}

#[test]
fn a_person_overrules_and_says_why() {
    let mut made = Made::of(&config(), 60 * 20);
    let overruled = Verdict {
        overruled: Some(Grade::Good),
        by: Some("A. Smith".to_owned()),
        why: Some("stepped down".to_owned()),
        ..Verdict::default()
    };
    made.manifest.verdict = Some(overruled.clone());
    let verdict = assert_reasons(&made, &[("duration_s", Doubtful)]);
    assert_eq!(verdict.grade(), Grade::Good);
    let line = verdict.line();
    assert!(
        line.starts_with("good, overruled by A. Smith: stepped down (by the criteria doubtful")
    );
    // What the file says of the criteria's own verdict is not believed.
    assert_eq!(verdict.is, Doubtful);

    let (_folder, trial) = made.trial();
    let again = crate::derived::remake(&trial.folder, &Default::default()).unwrap();
    assert_eq!(again.manifest.verdict(), verdict);
    let text = std::fs::read_to_string(trial.folder.join(names::MANIFEST)).unwrap();
    let nameless = text.replace("by = \"A. Smith\"\n", "");
    assert_ne!(text, nameless);
    std::fs::write(trial.folder.join(names::MANIFEST), nameless).unwrap();
    let error = crate::Trial::open(&trial.folder).unwrap_err().to_string();
    assert!(error.contains("verdict.by") && error.contains("who overrules it"), "{error}");
}

#[test]
fn a_trial_of_one_frame_is_judged() {
    let verdict =
        Made::of(&config(), 31).each_pose(|it| (it.sequence == 30).then_some(it)).verdict();
    assert_eq!(verdict.is, Unusable, "{}", verdict.lines());
    let mut nothing = Made::good();
    nothing.each_pose(|_| None);
    assert_eq!(nothing.verdict().is, Unusable);
}
