//! Whether the box is heard, and without losses.

use plumbline_files::counting::counted;
use plumbline_stream::link::NOT_HEARD_REMEDY;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;
use super::percent;

/// A lost frame is a gap that an analysis fills without harm; more than one in a thousand is
/// more than a healthy network loses.
const LOST_WARN: f64 = 0.001;

/// One frame in fifty: gaps follow each other more than once a second.
const LOST_FAIL: f64 = 0.02;

/// A healthy link damages no packet; one in a hundred means a wrong rate, or a line beside a
/// motor.
const CORRUPT_FAIL: f64 = 0.01;

/// A box says how it is once a second.
const SILENCE_MAX_S: f64 = 2.5;

const UPDATE: &str = "update the older of the two programs, here or on the box";

pub fn checks(findings: &Findings) -> Vec<Check> {
    let mut checks = vec![heard(findings)];
    if findings.packets > 0 {
        checks.push(losses(findings));
        checks.push(corrupt(findings));
    }
    if findings.is_one_way() {
        checks.push(Check::warn(
            "answers",
            "none: the line has no way to the box, and its clock, configuration and light cannot \
             be checked",
            "connect the line's second wire, or check the box with `plumb doctor` over its network",
        ));
    }
    checks
}

fn heard(findings: &Findings) -> Check {
    const SUBJECT: &str = "link";
    let (bad, place) = (findings.bad, &findings.place);
    let malformed = bad.malformed + bad.numbers;
    let other = bad.other_version + bad.other_schema;
    if findings.packets == 0 {
        return if other > 0 {
            let seen =
                format!("{place}: {} of another version of the protocol", counted(other, "packet"));
            Check::fail(SUBJECT, seen, UPDATE)
        } else if malformed > 0 {
            let seen = format!("{place}: {} without a message", counted(malformed, "packet"));
            Check::fail(SUBJECT, seen, UPDATE)
        } else if bad.corrupt + bad.fragments > 0 {
            let count = counted(bad.corrupt + bad.fragments, "damaged packet");
            let seen = format!("{place}: {count}, and no other");
            Check::fail(SUBJECT, seen, damage_remedy(findings))
        } else {
            let (why, remedy) = match &findings.other {
                Some((why, remedy)) => (why.as_str(), remedy.as_str()),
                None => ("no box is heard", NOT_HEARD_REMEDY),
            };
            Check::fail(SUBJECT, format!("{place}: {why}"), remedy)
        };
    }
    let count = counted(findings.packets, "packet");
    if findings.silence_s > SILENCE_MAX_S {
        let silence_s = findings.silence_s;
        let seen = format!("{place}: {count}, and none in the last {silence_s:.0} s");
        return Check::fail(SUBJECT, seen, NOT_HEARD_REMEDY);
    }
    if findings.bad.not_authentic > 0 {
        let strange = findings.bad.not_authentic;
        let seen = format!("{place}: {count}, and {strange} that no box with this key has sent");
        return Check::warn(SUBJECT, seen, damage_remedy(findings));
    }
    if other + malformed > 0 {
        let seen = format!(
            "{place}: {count}, and {} that this program does not understand",
            other + malformed
        );
        return Check::warn(SUBJECT, seen, UPDATE);
    }
    if findings.line_losses > 0 {
        let seen = format!("{place}: {count}; lost {}", counted(findings.line_losses, "time"));
        return Check::warn(SUBJECT, seen, "check the cable and its plugs");
    }
    Check::good(SUBJECT, format!("{place}: {count}"))
}

fn losses(findings: &Findings) -> Check {
    let counts = findings.counts();
    let all = counts.received + counts.lost;
    if all == 0 {
        return Check::skipped("losses", "no frame came");
    }
    let share = counts.lost as f64 / all as f64;
    Check::new(
        Verdict::at_most(share, LOST_WARN, LOST_FAIL),
        "losses",
        format!(
            "{} of {} lost ({}, at most {})",
            counts.lost,
            counted(all, "frame"),
            percent(share),
            percent(LOST_WARN)
        ),
        if findings.is_serial {
            "raise the line's rate on both sides (two targets at 60 Hz need 230400 baud), or lower \
             the camera's rate"
        } else {
            "use a cable in place of a wireless network, and look for what else loads the network"
        },
    )
}

fn corrupt(findings: &Findings) -> Check {
    // What is not authentic is damaged on a line, and somebody else's in a network.
    let on_line = if findings.is_serial { findings.bad.not_authentic } else { 0 };
    let corrupt = findings.bad.corrupt + on_line;
    let share = corrupt as f64 / (findings.packets + corrupt) as f64;
    let seen =
        format!("{corrupt} of {} damaged (none)", counted(findings.packets + corrupt, "packet"));
    let verdict = Verdict::at_most(share, 0.0, CORRUPT_FAIL);
    Check::new(verdict, "corrupt", seen, damage_remedy(findings))
}

fn damage_remedy(findings: &Findings) -> &'static str {
    if findings.is_serial {
        "check --baud against the box's rate, then the cable: its length, its ground, what runs \
         beside it"
    } else {
        "check the network's cables and switches; and that only a box sends to this port"
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{Message, PacketError};
    use plumbline_files::BadInput;

    use super::super::super::fixture::{assert_says, check, event, healthy, pose_packet};
    use super::*;
    use plumbline_stream::transport::Event;

    fn bad(findings: &mut Findings, error: PacketError, count: usize) {
        for _ in 0..count {
            findings.take(&Event::Bad(error), 0);
        }
    }

    #[test]
    fn what_is_not_heard_is_said_with_its_likely_cause() {
        let silent = || Findings { place: "UDP 0.0.0.0:4210".into(), ..Findings::default() };
        assert_says(
            &check(&silent(), "link"),
            Verdict::Fail,
            &["no box is heard", "check that the box is on", "another `plumb`"],
        );
        for (error, parts) in [
            (PacketError::OtherVersion { version: 9 }, ["another version", "update the older"]),
            (PacketError::OtherSchema { hash: 9 }, ["another version", "update the older"]),
            (PacketError::Body, ["without a message", "update the older"]),
            (PacketError::Checksum, ["3 damaged packets", "only a box sends"]),
        ] {
            let mut findings = silent();
            bad(&mut findings, error, 3);
            assert_says(&check(&findings, "link"), Verdict::Fail, &parts);
        }
        let mut serial = Findings { is_serial: true, ..silent() };
        bad(&mut serial, PacketError::Fragment, 1);
        assert_says(&check(&serial, "link"), Verdict::Fail, &["1 damaged", "--baud"]);
    }

    #[test]
    fn a_line_without_a_way_back_is_warned_of_and_what_needs_answers_is_skipped() {
        let mut findings = healthy();
        findings.is_serial = true;
        findings.exchanges.clear();
        findings.views.clear();
        findings.background = None;
        findings.config = Some(Err(BadInput::whole("ttyS0", "no answer", "")));
        assert_says(&check(&findings, "answers"), Verdict::Warn, &["no way to the box", "wire"]);
        for subject in ["clock", "configuration", "light"] {
            assert_eq!(check(&findings, subject).verdict, Verdict::Skipped, "{subject}");
        }
        let checks = super::super::all(&findings);
        assert!(checks.iter().all(|check| check.verdict != Verdict::Fail), "{checks:#?}");
        // A network that carries nothing to the box is broken.
        findings.is_serial = false;
        assert_eq!(check(&findings, "clock").verdict, Verdict::Fail);
        assert_eq!(check(&findings, "configuration").verdict, Verdict::Fail);
    }

    #[test]
    fn a_disturbed_link_is_warned_of() {
        let mut findings = healthy();
        findings.take(&Event::LineLost("gone".into()), 0);
        assert_says(&check(&findings, "link"), Verdict::Warn, &["lost 1 time", "cable"]);
        bad(&mut findings, PacketError::Body, 1);
        assert_says(&check(&findings, "link"), Verdict::Warn, &["and 1 that", "update"]);
        findings.take(&Event::NotAuthentic, 0);
        let said = ["1 that no box with this key has sent", "network"];
        assert_says(&check(&findings, "link"), Verdict::Warn, &said);
    }

    #[test]
    fn losses_and_damage_are_judged_by_their_share() {
        let mut findings = healthy();
        findings.take(&event(Message::Pose(pose_packet(301))), 0);
        let warning = check(&findings, "losses");
        assert_says(&warning, Verdict::Warn, &["1 of 302", "at most 0.1 %", "wireless"]);
        findings.is_serial = true;
        findings.take(&event(Message::Pose(pose_packet(320))), 0);
        let failure = check(&findings, "losses");
        assert_says(&failure, Verdict::Fail, &["19 of 321 frames lost (5.9 %", "baud"]);
        bad(&mut findings, PacketError::Checksum, 1);
        assert_says(&check(&findings, "corrupt"), Verdict::Warn, &["1 of 306", "--baud"]);
        bad(&mut findings, PacketError::Cobs, 9);
        assert_says(&check(&findings, "corrupt"), Verdict::Fail, &["10 of 315"]);
        findings = Findings { packets: 1, ..Findings::default() };
        assert_says(&check(&findings, "losses"), Verdict::Skipped, &["no frame"]);
    }
}
