//! The camera, and how its frames are kept up with.

use plumbline::packet::{CameraState, Health};
use plumbline::report::NoPose;
use plumbline_analysis::standard::{RATE_ACCEPTED_HZ, RATE_MIN_HZ};
use plumbline_analysis::statistics::describe::median;
use plumbline_files::counting::counted;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;
use super::percent;

/// A camera's crystal is better than a thousandth; a rate that is off by more than a fiftieth
/// is not the one that was asked for.
const RATE_WARN: f64 = 0.02;

/// Off by a tenth: the exposure time or the light's flicker determines the rate.
const RATE_FAIL: f64 = 0.1;

/// A recording is replayed at its own pace; below this share of it, something holds it up.
const PACE_MIN: f64 = 0.9;

/// The share of frames that may be missing: with one gap in fifty an analysis fills more than it
/// should.
const MISSING_FAIL: f64 = 0.02;

/// A frame is exposed for up to one period, and read out and sent in another.
const LATENCY_WARN_PERIODS: f64 = 3.0;

/// Two frames wait for the one before them, and more are dropped.
const LATENCY_FAIL_PERIODS: f64 = 6.0;

pub fn checks(findings: &Findings) -> Vec<Check> {
    let Some((first, last)) = &findings.healths else {
        return vec![Check::skipped("camera", "the box does not report its state")];
    };
    let mut checks = vec![state(findings, first, last)];
    let Some(rate_hz) = findings.rate_hz() else {
        checks.push(Check::skipped("frames", "too few frames came"));
        return checks;
    };
    checks.extend(frame_size(findings));
    checks.push(rate(findings, rate_hz));
    checks.push(missing(first, last));
    checks.push(latency(findings, rate_hz));
    checks
}

fn state(findings: &Findings, first: &Health, last: &Health) -> Check {
    const SUBJECT: &str = "camera";
    let losses = last.camera_losses;
    let seen = match last.camera {
        CameraState::Starting => "it has not given a frame yet",
        CameraState::Stalled => "it is connected, but gives no frames",
        CameraState::Lost => "it is absent, or reports errors",
        CameraState::Ended => "the recording is over, or the box's program has ended",
        CameraState::Running => {
            if losses > first.camera_losses {
                let seen =
                    format!("lost {} meanwhile", counted(losses - first.camera_losses, "time"));
                return Check::fail(SUBJECT, seen, PLUG);
            }
            if losses > 0 {
                let seen =
                    format!("it runs; lost {} since the box's start", counted(losses, "time"));
                return Check::warn(SUBJECT, seen, PLUG);
            }
            let seen = if findings.is_replay() { "a recording runs" } else { "it runs" };
            return Check::good(SUBJECT, seen);
        }
    };
    let remedy = match last.camera {
        CameraState::Ended => "start the recording or the program again",
        _ => PLUG,
    };
    Check::fail(SUBJECT, seen, remedy)
}

const PLUG: &str = "check the camera's plug, cable and power, and [capture] of the box file";

/// A lens is calibrated for one size of frames.
fn frame_size(findings: &Findings) -> Option<Check> {
    const SUBJECT: &str = "frame size";
    const REMEDY: &str = "calibrate the camera with photographs of the frames' size, and send it with \
                          `plumb provision --send`";
    let (hello, lens) = (findings.hello.as_ref()?, &findings.config()?.lens);
    let file = format!("the camera file is for {} x {} px", lens.width_px, lens.height_px);
    if (hello.width_px, hello.height_px) != (lens.width_px, lens.height_px) {
        let seen = format!("frames of {} x {} px, and {file}", hello.width_px, hello.height_px);
        return Some(Check::fail(SUBJECT, seen, REMEDY));
    }
    let mut reasons = findings.targets.iter().flat_map(|target| &target.without);
    if reasons.any(|(reason, _)| *reason == NoPose::FrameSize) {
        let seen = format!("frames of another size come, and {file}");
        return Some(Check::fail(SUBJECT, seen, REMEDY));
    }
    Some(Check::good(SUBJECT, format!("{} x {} px, as calibrated", lens.width_px, lens.height_px)))
}

fn rate(findings: &Findings, rate_hz: f64) -> Check {
    if findings.is_replay() {
        return rate_of_replay(findings, rate_hz);
    }
    let configured = findings.config().and_then(|config| config.capture.as_ref());
    let Some(wanted_hz) = configured.map(|capture| f64::from(capture.rate_hz)) else {
        return by_standard(rate_hz, format!("{rate_hz:.2} Hz; none is configured"));
    };
    let off = rate_hz / wanted_hz - 1.0;
    let seen =
        format!("{rate_hz:.2} Hz of {wanted_hz:.2} configured (within {})", percent(RATE_WARN));
    let verdict = Verdict::at_most(off.abs(), RATE_WARN, RATE_FAIL);
    if verdict == Verdict::Good {
        return by_standard(rate_hz, seen);
    }
    let slow = "give exposure_us, no longer than the rate allows; more light; and a USB port that \
                no other device shares";
    Check::new(
        verdict,
        "rate",
        seen,
        if off < 0.0 { slow } else { "give a rate_hz that the camera has" },
    )
}

/// Its rate was decided when it was recorded; what can be wrong now is its pace.
fn rate_of_replay(findings: &Findings, rate_hz: f64) -> Check {
    let seen = format!("{rate_hz:.2} Hz, as recorded");
    match findings.arrivals_hz() {
        Some(pace_hz) if pace_hz < PACE_MIN * rate_hz => Check::warn(
            "rate",
            format!("{seen}, but {pace_hz:.1} frames come in a second: the replay stalls"),
            "replay from a faster disk, or on a computer that does nothing else",
        ),
        _ => by_standard(rate_hz, seen),
    }
}

fn by_standard(rate_hz: f64, seen: String) -> Check {
    let is_slow = rate_hz < RATE_ACCEPTED_HZ;
    Check::new(
        Verdict::warn_if(is_slow),
        "rate",
        if is_slow { format!("{seen}; ISPGR: at least {RATE_MIN_HZ:.0} Hz") } else { seen },
        "give rate_hz = 60 and a camera that has it: the posturography standard asks for 50 Hz",
    )
}

fn missing(first: &Health, last: &Health) -> Check {
    let since = |of: fn(&Health) -> u32| of(last).saturating_sub(of(first));
    let (missed, dropped) = (since(|it| it.frames_missed), since(|it| it.frames_dropped));
    let all = since(|it| it.frames) + missed + dropped;
    let share = f64::from(missed + dropped) / f64::from(all.max(1));
    Check::new(
        Verdict::at_most(share, 0.0, MISSING_FAIL),
        "frames",
        format!(
            "{missed} missed by the camera, {dropped} dropped by the box (none); {} and {} since \
             its start",
            last.frames_missed, last.frames_dropped
        ),
        if missed >= dropped {
            "give the camera a USB port or cable of its own"
        } else {
            "lower rate_hz; give the measurement a core with cpu and realtime_priority"
        },
    )
}

fn latency(findings: &Findings, rate_hz: f64) -> Check {
    let period_ms = 1e3 / rate_hz;
    let latencies = || findings.frames.iter().map(|frame| f64::from(frame.latency_us) / 1e3);
    let median_ms = median(latencies()).unwrap_or_default();
    let worst_ms = latencies().fold(0.0, f64::max);
    let [warn_ms, fail_ms] =
        [LATENCY_WARN_PERIODS, LATENCY_FAIL_PERIODS].map(|periods| periods * period_ms);
    Check::new(
        Verdict::at_most(median_ms, warn_ms, fail_ms),
        "latency",
        format!("median {median_ms:.1} ms (at most {warn_ms:.0}), worst {worst_ms:.1} ms"),
        "lower rate_hz, or give the measurement a core with cpu and realtime_priority",
    )
}

#[cfg(test)]
mod tests {
    use plumbline::packet::MarkedInstant;

    use super::super::super::fixture::{assert_says, check, healthy, with_config, with_health};
    use super::*;

    #[test]
    fn a_camera_that_does_not_run_is_a_fault() {
        for (camera, parts) in [
            (CameraState::Starting, ["not given a frame", "plug"]),
            (CameraState::Stalled, ["gives no frames", "plug"]),
            (CameraState::Lost, ["absent", "[capture]"]),
            (CameraState::Ended, ["is over", "again"]),
        ] {
            let findings = with_health(|health| health.camera = camera);
            assert_says(&check(&findings, "camera"), Verdict::Fail, &parts);
        }
        let lost = with_health(|health| health.camera_losses = 2);
        assert_says(&check(&lost, "camera"), Verdict::Fail, &["lost 2 times meanwhile", "plug"]);
        let mut once = lost;
        once.healths.as_mut().unwrap().0.camera_losses = 2;
        assert_says(&check(&once, "camera"), Verdict::Warn, &["2 times since", "plug"]);
        once.healths = None;
        assert_says(&check(&once, "camera"), Verdict::Skipped, &["does not report"]);
    }

    #[test]
    fn a_rate_other_than_the_configured_one_is_named() {
        let at = |rate_hz| {
            let mut findings = healthy();
            let config = findings.config.as_mut().unwrap().as_mut().unwrap();
            config.capture.as_mut().unwrap().rate_hz = rate_hz;
            check(&findings, "rate")
        };
        assert_says(&at(60.0), Verdict::Good, &["60.00 Hz of 60.00"]);
        assert_says(&at(62.0), Verdict::Warn, &["within 2.0 %", "exposure_us"]);
        assert_says(&at(90.0), Verdict::Fail, &["60.00 Hz of 90.00", "exposure_us"]);
        assert_says(&at(50.0), Verdict::Fail, &["give a rate_hz that the camera has"]);
        let mut replay = healthy();
        replay.config.as_mut().unwrap().as_mut().unwrap().capture = None;
        assert_says(&check(&replay, "rate"), Verdict::Good, &["none is configured"]);
        replay.frames.last_mut().unwrap().instant = MarkedInstant::Recording;
        assert_says(&check(&replay, "rate"), Verdict::Good, &["as recorded"]);
        replay.frames.truncate(1);
        assert_says(&check(&replay, "frames"), Verdict::Skipped, &["too few"]);
    }

    #[test]
    fn a_rate_below_the_standard_is_warned_of_wherever_it_comes_from() {
        let at = |rate_hz: f64, configured_hz: Option<f32>| {
            let mut findings = with_config(|config| match configured_hz {
                Some(hz) => config.capture.as_mut().unwrap().rate_hz = hz,
                None => config.capture = None,
            });
            for frame in &mut findings.frames {
                frame.capture_time_ns = (f64::from(frame.sequence) * 1e9 / rate_hz) as u64;
            }
            findings
        };
        for configured_hz in [Some(10.0), None] {
            let slow = check(&at(10.0, configured_hz), "rate");
            assert_says(&slow, Verdict::Warn, &["10.00 Hz", "ISPGR: at least 50 Hz", "rate_hz"]);
        }
        assert_eq!(check(&at(49.95, Some(50.0)), "rate").verdict, Verdict::Good);
        // As the verdict on a trial and the study's warnings have it: clocks differ by 1 %.
        for (rate_hz, verdict) in [(49.51, Verdict::Good), (49.49, Verdict::Warn)] {
            assert_eq!(check(&at(rate_hz, None), "rate").verdict, verdict, "{rate_hz}");
        }
        // One that is not what was asked for is named first.
        assert_says(&check(&at(10.0, Some(60.0)), "rate"), Verdict::Fail, &["10.00 Hz of 60.00"]);
    }

    #[test]
    fn a_replay_that_stalls_is_warned_of() {
        let mut replay = healthy();
        replay.frames.last_mut().unwrap().instant = MarkedInstant::Recording;
        let pace = |replay: &mut Findings, hz: f64| {
            for frame in &mut replay.frames {
                frame.arrived_ns = (f64::from(frame.sequence) * 1e9 / hz) as u64;
            }
        };
        pace(&mut replay, 59.0);
        assert_says(&check(&replay, "rate"), Verdict::Good, &["60.00 Hz, as recorded"]);
        pace(&mut replay, 10.0);
        assert_says(&check(&replay, "rate"), Verdict::Warn, &["10.0 frames come", "stalls"]);
        // A network that loses every other frame does not hold the replay up.
        pace(&mut replay, 60.0);
        replay
            .frames
            .retain(|frame| frame.sequence % 2 == 0 || frame.instant == MarkedInstant::Recording);
        assert_says(&check(&replay, "rate"), Verdict::Good, &["60.00 Hz, as recorded"]);
    }

    #[test]
    fn a_camera_file_of_another_size_is_a_failure() {
        let good = check(&healthy(), "frame size");
        assert_says(&good, Verdict::Good, &["1456 x 1088 px, as calibrated"]);
        let mut other = healthy();
        let hello = other.hello.as_mut().unwrap();
        (hello.width_px, hello.height_px) = (640, 480);
        let parts = ["frames of 640 x 480", "is for 1456 x 1088", "calibrate"];
        assert_says(&check(&other, "frame size"), Verdict::Fail, &parts);
        let mut refused = healthy();
        refused.targets[0].without = vec![(NoPose::FrameSize, 3)];
        let parts = ["another size", "is for 1456 x 1088", "plumb provision --send"];
        assert_says(&check(&refused, "frame size"), Verdict::Fail, &parts);
    }

    #[test]
    fn frames_that_are_missing_are_counted() {
        let missed = with_health(|health| {
            health.frames += 300;
            health.frames_missed = 2;
        });
        assert_says(&check(&missed, "frames"), Verdict::Warn, &["2 missed", "USB port"]);
        let dropped = with_health(|health| {
            health.frames += 200;
            health.frames_dropped = 100;
        });
        assert_says(&check(&dropped, "frames"), Verdict::Fail, &["100 dropped", "rate_hz"]);
    }

    #[test]
    fn latency_is_judged_in_frame_periods() {
        let late = |latency_us| {
            let mut findings = healthy();
            for frame in &mut findings.frames {
                frame.latency_us = latency_us;
            }
            check(&findings, "latency")
        };
        assert_says(&late(60_000), Verdict::Warn, &["60.0 ms", "at most 50", "rate_hz"]);
        assert_says(&late(120_000), Verdict::Fail, &["120.0 ms", "realtime_priority"]);
    }
}
