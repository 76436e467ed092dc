//! The box's clock, by which its frames are dated.

use plumbline::packet::MarkedInstant;
use plumbline_analysis::statistics::describe::median;
use plumbline_stream::clock::{drift_ppm, surest};

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;

/// A box looks for questions at least every 20 ms, and a healthy network takes a few; a
/// question that takes five times as long waits behind something.
const ROUND_TRIP_WARN_MS: f64 = 100.0;

/// The share of questions that may be lost: they are lost as easily as frames.
const UNANSWERED_WARN: f64 = 0.05;

/// Two crystals differ by 100 ppm at most, 50 each; more than twice that is not a
/// crystal's. Against another instrument, a trial of a minute would be off by a frame.
const DRIFT_WARN_PPM: f64 = 200.0;

pub fn checks(findings: &Findings) -> Vec<Check> {
    if findings.is_one_way() {
        return vec![Check::skipped("clock", super::ONE_WAY), capture_times(findings)];
    }
    if findings.pings == 0 {
        return vec![Check::skipped("clock", "it was not asked"), capture_times(findings)];
    }
    let Some(best) = surest(&findings.exchanges) else {
        return vec![
            Check::fail(
                "clock",
                format!("none of {} questions is answered", findings.pings),
                "check that packets reach the box too: no firewall, a serial line with both of \
                 its wires, and no other `plumb` that asks it",
            ),
            capture_times(findings),
        ];
    };
    let best_ms = best.round_trip_ns() as f64 * 1e-6;
    let trips = findings.exchanges.iter().map(|exchange| exchange.round_trip_ns() as f64 * 1e-6);
    let median_ms = median(trips).unwrap_or(best_ms);
    let answered = findings.exchanges.len();
    let unanswered = 1.0 - (answered as f64 / findings.pings.max(1) as f64).min(1.0);
    let answers = Check::new(
        Verdict::warn_if(median_ms > ROUND_TRIP_WARN_MS || unanswered > UNANSWERED_WARN),
        "answers",
        format!(
            "{answered} of {} questions answered, in {median_ms:.1} ms, the soonest in {best_ms:.1} \
             (at most {ROUND_TRIP_WARN_MS:.0})",
            findings.pings
        ),
        "look for what loads the network or the line; two targets at 60 Hz need 230400 baud",
    );
    vec![answers, clock(findings, best_ms), capture_times(findings)]
}

fn clock(findings: &Findings, best_ms: f64) -> Check {
    let known = format!("known to {:.1} ms", 0.5 * best_ms);
    let drift = drift_ppm(&findings.exchanges);
    let is_fast = |(drift, uncertain): (f64, f64)| drift.abs() - uncertain > DRIFT_WARN_PPM;
    let Some((drift, uncertain)) = drift.filter(|it| it.1 <= DRIFT_WARN_PPM || is_fast(*it)) else {
        return Check::good("clock", format!("{known}; its drift needs a longer watch"));
    };
    let seen =
        format!("{known}; drift {drift:+.0} +-{uncertain:.0} ppm (at most {DRIFT_WARN_PPM:.0})");
    let verdict = Verdict::warn_if(is_fast((drift, uncertain)));
    Check::new(verdict, "clock", seen, "use one clock only, the box's or this computer's")
}

fn capture_times(findings: &Findings) -> Check {
    let Some(last) = findings.frames.last() else {
        return Check::skipped("capture times", "no frame came");
    };
    let backward = findings.backward_times;
    if backward == 0 {
        let instant = match last.instant {
            MarkedInstant::ExposureMiddle => "the middle of the exposure",
            MarkedInstant::ExposureStart => "the start of the exposure",
            MarkedInstant::ExposureEnd => "the end of the exposure",
            MarkedInstant::FrameArrival => "the frame's arrival",
            MarkedInstant::Recording => "its time in a recording",
        };
        return Check::good("capture times", format!("each after the one before; {instant}"));
    }
    Check::fail(
        "capture times",
        format!("{backward} of {} not after the one before", findings.frames.len()),
        "update the camera's driver: its clock goes back",
    )
}

#[cfg(test)]
mod tests {
    use plumbline::packet::Message;

    use super::super::super::fixture::{assert_says, check, event, healthy, pose_packet};
    use super::*;

    #[test]
    fn questions_without_or_with_late_answers() {
        let mut findings = healthy();
        findings.exchanges.truncate(40);
        let some = check(&findings, "answers");
        assert_says(&some, Verdict::Warn, &["40 of 50", "loads the network"]);
        for exchange in &mut findings.exchanges {
            exchange.host_received_ns += 150_000_000;
        }
        findings.pings = 40;
        let late = check(&findings, "answers");
        assert_says(&late, Verdict::Warn, &["in 150.2 ms", "at most 100"]);
        findings.exchanges.clear();
        let none = check(&findings, "clock");
        assert_says(&none, Verdict::Fail, &["none of 40", "firewall"]);
        assert_eq!(check(&findings, "capture times").verdict, Verdict::Good);
        findings.pings = 0;
        assert_says(&check(&findings, "clock"), Verdict::Skipped, &["not asked"]);
    }

    #[test]
    fn a_clock_that_drifts_is_warned_of_only_where_that_is_certain() {
        let mut findings = healthy();
        let good = check(&findings, "clock");
        assert_says(&good, Verdict::Good, &["known to 0.1 ms", "drift +0 +-", "at most 200"]);
        for exchange in &mut findings.exchanges {
            let gained = exchange.host_sent_ns / 1000;
            exchange.box_received_ns += gained;
            exchange.box_sent_ns += gained;
        }
        assert_says(&check(&findings, "clock"), Verdict::Warn, &["drift +1000", "one clock"]);
        for exchange in &mut findings.exchanges {
            exchange.host_received_ns += 10_000_000;
        }
        assert_eq!(check(&findings, "clock").verdict, Verdict::Good);
        findings.exchanges.truncate(3);
        assert_says(&check(&findings, "clock"), Verdict::Good, &["needs a longer watch"]);
    }

    #[test]
    fn a_capture_time_that_goes_back_is_a_fault() {
        let mut findings = healthy();
        let mut back = pose_packet(300);
        back.capture_time_ns = 5;
        findings.take(&event(Message::Pose(back)), 0);
        let failure = check(&findings, "capture times");
        assert_says(&failure, Verdict::Fail, &["1 of 301", "driver"]);
        findings.frames.clear();
        assert_says(&check(&findings, "capture times"), Verdict::Skipped, &["no frame"]);
    }
}
