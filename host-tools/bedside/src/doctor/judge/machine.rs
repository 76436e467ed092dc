//! The box's computer and its program.

use plumbline::packet::{Health, Hello, LogLevel, ResetReason};
use plumbline_files::counting::counted;
use plumbline_stream::power::PowerSeen;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;

/// The program that these checks are of.
const OWN: &str = plumbline::program_version!();

/// A Raspberry Pi slows its processor down from 80 degrees Celsius on; in a warmer room or
/// behind a curtain ten degrees are soon gone.
const HOT_WARN_C: f64 = 70.0;
const HOT_FAIL_C: f64 = 80.0;

/// A box that runs with no configuration.
pub fn refusing(text: &str) -> Check {
    let seen = format!("it tracks nothing; it says: {text}");
    Check::fail("box", seen, "correct what it names, and send it with `plumb provision --send`")
}

pub fn checks(findings: &Findings) -> Vec<Check> {
    let Some(hello) = &findings.hello else {
        return vec![Check::fail(
            "box",
            "it is heard, but does not say who it is",
            "check that packets reach the box too: no firewall, and a serial line with both of \
             its wires",
        )];
    };
    let name = format!("{} ({})", hello.device, hello.serial_number);
    let mut checks = vec![Check::good("box", name), program(hello), start(findings, hello)];
    match findings.health() {
        Some(health) => {
            checks.extend([temperature(health), power(findings), memory(health), set_up(health)]);
        }
        None => checks.push(Check::fail(
            "health",
            "it does not report its state",
            "watch for longer with --seconds; update the box's program if that does not help",
        )),
    }
    checks.push(log(findings));
    checks
}

fn program(hello: &Hello) -> Check {
    let firmware = hello.firmware.as_str();
    if is_of_one_release(firmware, OWN) {
        return Check::good("program", firmware);
    }
    let seen = format!("{firmware}, and this is plumb {OWN}");
    Check::warn("program", seen, "update the older of the two")
}

/// Whether two texts of [`ProgramVersion`](plumbline::packet::ProgramVersion) name the same version and
/// commit; where one of them does not name its commit, whether they name the same version.
fn is_of_one_release(one: &str, other: &str) -> bool {
    let parts = |text: &str| -> (String, Option<String>) {
        let (version, commit) = text.split_once('+').unwrap_or((text, "dev"));
        (version.to_owned(), (commit != "dev").then(|| commit.to_owned()))
    };
    let ((version, commit), (other_version, other_commit)) = (parts(one), parts(other));
    version == other_version
        && (commit.is_none() || other_commit.is_none() || commit == other_commit)
}

fn start(findings: &Findings, hello: &Hello) -> Check {
    let mut seen = match hello.reset_reason {
        ResetReason::Unknown => "started".to_owned(),
        ResetReason::PowerOn => "after power on or an orderly restart".to_owned(),
        ResetReason::Watchdog => "restarted by its watchdog".to_owned(),
    };
    if let Some(health) = findings.health() {
        seen = format!("{seen} {} ago", ago(health.uptime_ms));
    }
    if let Some(count) = hello.boot_count {
        seen = format!("{seen}, for the {count}. time");
    }
    if findings.starts > 0 {
        let seen =
            format!("restarted {} while it was watched: {seen}", counted(findings.starts, "time"));
        return Check::fail("start", seen, "check its power supply, and what it logs");
    }
    match hello.reset_reason {
        ResetReason::Watchdog => Check::warn(
            "start",
            seen,
            "no frame was processed for too long: see what it logs, its temperature and its \
             camera",
        ),
        _ => Check::good("start", seen),
    }
}

fn ago(uptime_ms: u64) -> String {
    let seconds = uptime_ms / 1000;
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        7200..172_800 => format!("{} h", seconds / 3600),
        _ => counted(seconds / 86_400, "day"),
    }
}

fn temperature(health: &Health) -> Check {
    let Some(tenths) = health.temperature_decicelsius else {
        return Check::good("temperature", "not measured by this computer");
    };
    let celsius = f64::from(tenths) / 10.0;
    Check::new(
        Verdict::at_most(celsius, HOT_WARN_C, HOT_FAIL_C),
        "temperature",
        format!("{celsius:.1} C (at most {HOT_WARN_C:.0}; from {HOT_FAIL_C:.0} on it slows down)"),
        "give it air, a cooler, or a place out of the sun",
    )
}

/// At its worst while it was watched: a voltage sags for moments.
fn power(findings: &Findings) -> Check {
    let PowerSeen { undervoltage, throttled } = findings.power;
    let slowed = "its processor is slowed down";
    if undervoltage == Some(true) {
        let and = if throttled == Some(true) { format!("; {slowed}") } else { String::new() };
        return Check::fail(
            "power",
            format!("its supply's voltage is too low{and}"),
            "give it the official supply of 5.1 V and 3 A, a shorter cable, and nothing but the \
             camera on its USB ports",
        );
    }
    if throttled == Some(true) {
        return Check::warn(
            "power",
            slowed,
            "see its temperature: cool it if it is warm, else give it the official supply of \
             5.1 V and 3 A",
        );
    }
    let unknown = "not measured by this computer";
    let seen = match (undervoltage, throttled) {
        (Some(_), Some(_)) => {
            "its supply holds its voltage; its processor is not slowed down".into()
        }
        (Some(_), None) => format!("its supply holds its voltage; its processor: {unknown}"),
        (None, Some(_)) => format!("its processor is not slowed down; its supply: {unknown}"),
        (None, None) => unknown.to_owned(),
    };
    Check::good("power", seen)
}

fn memory(health: &Health) -> Check {
    let (allocations, corners) = (health.heap_allocations.unwrap_or(0), health.corners_dropped);
    let seen = format!("{} while it tracks (none)", counted(allocations, "heap allocation"));
    if corners > 0 {
        let seen = format!("{seen}; {} found no room", counted(corners, "corner"));
        return Check::warn("memory", seen, "remove what looks like a checkerboard from its sight");
    }
    let remedy = "report it: its program should not need any";
    Check::new(Verdict::warn_if(allocations > 0), "memory", seen, remedy)
}

fn set_up(health: &Health) -> Check {
    if health.aiming_s == 0 {
        return Check::good("set-up mode", "off");
    }
    Check::warn(
        "set-up mode",
        format!("on for {} s more: pictures may leave the box", health.aiming_s),
        "end `plumb aim`, and check again with the exposure that is configured",
    )
}

fn log(findings: &Findings) -> Check {
    let texts: Vec<&str> = findings.logs.iter().map(|(_, text)| text.as_str()).collect();
    let dropped = findings.health().map_or(0, |health| health.logs_dropped);
    if findings.logs.iter().any(|(level, _)| *level == LogLevel::Error) {
        return Check::fail(
            "log",
            format!("it says: {}", texts.join(" ")),
            "correct what it names",
        );
    }
    if !texts.is_empty() {
        return Check::warn("log", format!("it says: {}", texts.join(" ")), "see what it names");
    }
    if dropped > 0 {
        let seen = format!("{} found no room since its start", counted(dropped, "record"));
        return Check::warn("log", seen, "read them on the box's own console");
    }
    Check::good("log", "no warnings and no errors meanwhile")
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{Log, Message};

    use super::super::super::fixture::{
        assert_says, check, event, health, healthy, hello, with_health,
    };
    use super::*;

    fn with_hello(change: impl FnOnce(&mut Hello)) -> Findings {
        let mut findings = healthy();
        change(findings.hello.as_mut().unwrap());
        findings
    }

    #[test]
    fn programs_of_one_release_have_the_same_version_and_where_it_is_known_the_same_commit() {
        let old = "plumbline 0.1.0";
        for (one, other, is_of_one) in [
            ("0.1.0+1a2b3c4d", "0.1.0+1a2b3c4d", true),
            ("0.1.0+1a2b3c4d", "0.1.0+dev", true),
            ("0.1.0+1a2b3c4d", "0.1.0+1a2b3c4d.changed", false),
            ("0.1.0+1a2b3c4d", "0.1.0+5e6f7a8b", false),
            ("0.1.0+dev", "0.2.0+dev", false),
            (old, "0.1.0+dev", false),
        ] {
            assert_eq!(is_of_one_release(one, other), is_of_one, "{one}, {other}");
            assert_eq!(is_of_one_release(other, one), is_of_one, "{one}, {other}");
        }
    }

    #[test]
    fn who_it_is_and_how_it_started() {
        let good = check(&healthy(), "start");
        assert_says(&good, Verdict::Good, &["power", "10 min ago", "for the 3. time"]);
        let nameless = Findings { packets: 1, ..Findings::default() };
        assert_says(&check(&nameless, "box"), Verdict::Fail, &["does not say", "firewall"]);
        let older = with_hello(|hello| hello.firmware = "plumbline 0.0.1".try_into().unwrap());
        assert_says(&check(&older, "program"), Verdict::Warn, &["plumbline 0.0.1", OWN, "update"]);
        let bitten = with_hello(|hello| hello.reset_reason = ResetReason::Watchdog);
        assert_says(&check(&bitten, "start"), Verdict::Warn, &["watchdog", "its camera"]);
        let mut restarted = healthy();
        let mut again = hello(restarted.config().unwrap());
        again.boot_id = 8;
        restarted.take(&event(Message::Hello(again)), 0);
        assert_says(
            &check(&restarted, "start"),
            Verdict::Fail,
            &["restarted 1 time", "power supply"],
        );
        assert_says(&check(&restarted, "health"), Verdict::Fail, &["does not report", "--seconds"]);
    }

    #[test]
    fn how_its_computer_is() {
        let warm = with_health(|health| health.temperature_decicelsius = Some(755));
        assert_says(&check(&warm, "temperature"), Verdict::Warn, &["75.5 C (at most 70", "air"]);
        let hot = with_health(|health| health.temperature_decicelsius = Some(812));
        assert_says(&check(&hot, "temperature"), Verdict::Fail, &["81.2 C", "slows down"]);
        let unknown = with_health(|health| health.temperature_decicelsius = None);
        assert_says(&check(&unknown, "temperature"), Verdict::Good, &["not measured"]);
        let hungry = with_health(|health| health.heap_allocations = Some(4));
        assert_says(&check(&hungry, "memory"), Verdict::Warn, &["4 heap", "report it"]);
        let patterned = with_health(|health| health.corners_dropped = 9);
        assert_says(&check(&patterned, "memory"), Verdict::Warn, &["9 corners", "remove"]);
        let aiming = with_health(|health| health.aiming_s = 40);
        assert_says(&check(&aiming, "set-up mode"), Verdict::Warn, &["40 s", "plumb aim"]);
    }

    #[test]
    fn how_its_power_is() {
        let of = |powers: &[(Option<bool>, Option<bool>)]| {
            let mut findings = Findings { power: PowerSeen::default(), ..healthy() };
            for (undervoltage, throttled) in powers.iter().copied() {
                let health = Health { undervoltage, throttled, ..health() };
                findings.take(&event(Message::Health(health)), 0);
            }
            check(&findings, "power")
        };
        let (yes, no) = (Some(true), Some(false));
        let good = of(&[(no, no)]);
        assert_says(&good, Verdict::Good, &["holds its voltage", "not slowed down"]);
        let supply = of(&[(no, None)]);
        assert_says(&supply, Verdict::Good, &["holds its voltage; its processor: not measured"]);
        let processor = of(&[(None, no)]);
        assert_says(&processor, Verdict::Good, &["not slowed down; its supply: not measured"]);
        let unknown = of(&[(None, None)]);
        assert_eq!(
            (unknown.verdict, &*unknown.seen),
            (Verdict::Good, "not measured by this computer")
        );
        let weak = of(&[(yes, no)]);
        assert_says(
            &weak,
            Verdict::Fail,
            &["voltage is too low;", "5.1 V and 3 A", "shorter cable"],
        );
        assert!(!weak.seen.contains("slowed"), "{}", weak.seen);
        let both = of(&[(yes, yes)]);
        assert_says(&both, Verdict::Fail, &["too low; its processor is slowed down", "USB"]);
        let slow = of(&[(None, yes)]);
        assert_says(&slow, Verdict::Warn, &["is slowed down", "temperature", "supply"]);
        // A moment in the middle of the watch.
        assert_says(&of(&[(no, no), (yes, no), (no, no)]), Verdict::Fail, &["too low"]);
    }

    #[test]
    fn what_it_logs() {
        let mut findings = with_health(|health| health.logs_dropped = 2);
        assert_says(&check(&findings, "log"), Verdict::Warn, &["2 records", "console"]);
        let mut say = |level, text: &str| {
            let text = text.try_into().unwrap();
            let target = heapless::String::new();
            let log = Log { uptime_ms: 1, level, target, text, cut: 0 };
            findings.take(&event(Message::Log(log)), 0);
            check(&findings, "log")
        };
        let dull = say(LogLevel::Info, "nothing");
        assert!(!dull.seen.contains("nothing"));
        let warning = say(LogLevel::Warn, "the clock is coarse");
        assert_says(&warning, Verdict::Warn, &["the clock is coarse"]);
        let failure = say(LogLevel::Error, "/dev/video0 is gone");
        assert_says(&failure, Verdict::Fail, &["/dev/video0 is gone", "correct what it names"]);
    }
}
