//! The findings of a healthy box, for tests that change them.

use plumbline::config::Config;
use plumbline::packet::{Health, Message, PosePacket};
use plumbline::target::Role;
use plumbline_calibration::background::Motion;
use plumbline_stream::clock::Exchange;

pub use plumbline_stream::fixture::*;

use super::check::Check;
use super::findings::{Background, Findings};
use super::judge;
use crate::scale::Compared;

/// Five seconds of a healthy box.
pub fn healthy() -> Findings {
    let config = config();
    let mut findings = Findings { place: "UDP 0.0.0.0:4210".into(), ..Findings::default() };
    let mut take = |message| findings.take(&event(message), 0);
    take(Message::Hello(hello(&config)));
    take(Message::Health(health()));
    for sequence in 0..FRAMES {
        take(Message::Pose(standing(sequence)));
    }
    take(Message::View(view()));
    findings.config = Some(Ok(config));
    findings.background = Some(Background::Compared(Ok(Motion {
        shift_px: [0.02, -0.01],
        roll_rad: 0.0,
        scale: 1.0,
        blocks: 120,
        agreeing: 70,
    })));
    let date = "2026-11-24".to_owned();
    let compared = Compared { date, tape_mm: 1030.0, measured_mm: 1046.0 };
    findings.compared = vec![(Role::Lower, compared)];
    findings.pings = 50;
    findings.exchanges = (0..50)
        .map(|index| {
            let sent_ns = index * 100_000_000;
            Exchange {
                host_sent_ns: sent_ns,
                box_received_ns: sent_ns + 5_000_100_000,
                box_sent_ns: sent_ns + 5_000_110_000,
                host_received_ns: sent_ns + 210_000,
            }
        })
        .collect();
    findings
}

/// A frame of a person who stands before a level camera: the lower target is the lower one.
fn standing(sequence: u32) -> PosePacket {
    let mut packet = pose_packet(sequence);
    for target in packet.targets.iter_mut().filter(|target| target.role == Role::Lower) {
        target.pose.as_mut().expect("it is measured").translation_mm[1] += 300.0;
    }
    packet
}

/// The same with another Health.
pub fn with_health(change: impl FnOnce(&mut Health)) -> Findings {
    let mut findings = healthy();
    change(&mut findings.healths.as_mut().expect("it has one").1);
    findings
}

/// The same with another configuration, which the box says that it runs with.
pub fn with_config(change: impl FnOnce(&mut Config)) -> Findings {
    let mut findings = healthy();
    let config = findings.config.as_mut().expect("asked").as_mut().expect("told");
    change(config);
    findings.hello.as_mut().expect("it has one").config_crc = config.crc();
    findings
}

/// The one check of this subject.
#[track_caller]
pub fn check(findings: &Findings, subject: &str) -> Check {
    let checks = judge::all(findings);
    let mut found = checks.iter().filter(|check| check.subject == subject);
    let (Some(check), None) = (found.next(), found.next()) else {
        panic!("not one check of {subject}: {checks:#?}")
    };
    check.clone()
}

/// Checks the verdict, and that the check says all of these parts.
#[track_caller]
pub fn assert_says(check: &Check, verdict: super::check::Verdict, parts: &[&str]) {
    let text = format!("{}; {}", check.seen, check.remedy);
    assert_eq!(check.verdict, verdict, "{text}");
    for part in parts {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
}
