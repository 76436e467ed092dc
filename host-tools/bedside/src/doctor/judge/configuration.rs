//! The box's configuration: that it is the intended one, and complete.

use plumbline::config::Config;
use plumbline::target::Role;
use plumbline_files::camera;

use super::super::check::Check;
use super::super::findings::Findings;
use super::{ONE_WAY, scene};
use crate::setup::not_calibrated;

pub fn checks(findings: &Findings) -> Vec<Check> {
    let Some(config) = &findings.config else {
        return vec![Check::skipped("configuration", "it was not asked for")];
    };
    match config {
        Ok(config) if camera::is_stand_in(&config.lens) => {
            let why = "not before the camera is calibrated";
            let later = ["scene", "exposure", "watchdog", "targets"];
            let later = later.map(|subject| Check::skipped(subject, why));
            [identical(findings, config), calibration(config)].into_iter().chain(later).collect()
        }
        Ok(config) => {
            let mut checks = vec![identical(findings, config), calibration(config)];
            checks.extend(scene::checks(findings, config));
            checks.extend([exposure(config), watchdog(config), targets(config)]);
            checks
        }
        Err(_) if findings.is_one_way() => vec![Check::skipped("configuration", ONE_WAY)],
        Err(error) => vec![Check::fail(
            "configuration",
            format!("it cannot be read back: {}", error.found),
            error.remedy.clone(),
        )],
    }
}

fn identical(findings: &Findings, config: &Config) -> Check {
    const SUBJECT: &str = "configuration";
    let crc = config.crc();
    let told = findings.hello.as_ref().map(|hello| hello.config_crc);
    if let Some(told) = told.filter(|told| *told != crc) {
        let seen = format!("{crc:08x} is read back, and it says that it runs with {told:08x}");
        return Check::fail(SUBJECT, seen, "restart the box; if that does not help, update it");
    }
    // One that was sent, and that a box started by hand has perhaps written over the very file.
    if let Some(next_crc) = findings.next_crc.filter(|next_crc| *next_crc != crc) {
        const RESTART: &str = "restart the box: switch it off and on, or start its program again";
        let expected = findings.expected.as_ref();
        let named = match expected.filter(|it| [crc, next_crc].contains(&it.crc)) {
            Some(it) => format!(" ({} is {:08x})", it.name, it.crc),
            None => String::new(),
        };
        let seen = format!(
            "it runs with {crc:08x}, and has stored {next_crc:08x}, which it uses from its next \
             start on{named}"
        );
        // What is asked for runs already, or nothing is asked for.
        return match expected {
            Some(it) if it.crc != crc => Check::fail(SUBJECT, seen, RESTART),
            _ => Check::warn(SUBJECT, seen, RESTART),
        };
    }
    let Some(expected) = &findings.expected else {
        return Check::good(SUBJECT, format!("{crc:08x}, whole"));
    };
    if expected.crc == crc {
        return Check::good(SUBJECT, format!("{crc:08x}, that of {}", expected.name));
    }
    let seen =
        format!("the box runs with {crc:08x}, and {} is {:08x}", expected.name, expected.crc);
    Check::fail(
        SUBJECT,
        seen,
        "compare them with `plumb show`, and send the right one with `plumb provision --send`",
    )
}

fn calibration(config: &Config) -> Check {
    if camera::is_stand_in(&config.lens) {
        let error = not_calibrated("");
        return Check::fail("calibration", error.found, error.remedy);
    }
    Check::good("calibration", format!("there, fx {:.1} px", config.lens.fx_px))
}

fn exposure(config: &Config) -> Check {
    let Some(capture) = &config.capture else {
        return Check::skipped("exposure", "no camera is configured");
    };
    if let Some(exposure_us) = capture.exposure_us {
        return Check::good("exposure", format!("fixed, {exposure_us} us"));
    }
    Check::warn(
        "exposure",
        "left to the camera, which changes it with the light",
        "fix it with `plumb aim --expose --store`, or give exposure_us in the box file",
    )
}

fn watchdog(config: &Config) -> Check {
    match (&config.capture, config.machine.watchdog_s) {
        (None, _) => Check::skipped("watchdog", "no camera is configured"),
        (Some(_), Some(seconds)) => Check::good("watchdog", format!("after {seconds} s")),
        (Some(_), None) => Check::warn(
            "watchdog",
            "off: a program that hangs is not restarted",
            "give watchdog_s in the box file",
        ),
    }
}

fn targets(config: &Config) -> Check {
    let names = |roles: &[Role]| {
        let targets = roles.iter().filter_map(|role| config.target(*role));
        targets.map(|target| target.name.as_str()).collect::<Vec<_>>().join(" and ")
    };
    let has = |role| config.target(role).is_some();
    let [lower, upper] = [has(Role::Lower), has(Role::Upper)];
    if lower && upper {
        return Check::good("targets", format!("both: {}", names(&[Role::Lower, Role::Upper])));
    }
    const REMEDY: &str = "add the missing role (\"lower\" or \"upper\") to the targets file";
    if lower || upper {
        let seen = format!("{} only", names(&[Role::Lower, Role::Upper]));
        return Check::warn("targets", seen, REMEDY);
    }
    Check::fail("targets", "neither of the trunk's two", REMEDY)
}

#[cfg(test)]
mod tests {
    use super::super::super::check::Verdict;
    use super::super::super::findings::Expected;
    use super::super::super::fixture::{assert_says, check, healthy, with_config};
    use plumbline_files::BadInput;

    #[test]
    fn the_configuration_is_the_one_it_should_be() {
        let mut findings = healthy();
        let crc = findings.config().unwrap().crc();
        findings.expected = Some(Expected { name: "box.plb".into(), crc });
        let good = check(&findings, "configuration");
        assert_says(&good, Verdict::Good, &[&format!("{crc:08x}"), "that of box.plb"]);
        findings.expected = Some(Expected { name: "box.plb".into(), crc: 7 });
        let other = check(&findings, "configuration");
        assert_says(&other, Verdict::Fail, &["box.plb is 00000007", "plumb show"]);
        // A box that was started with a file, and has stored another configuration in it since.
        findings.next_crc = Some(7);
        let stored = check(&findings, "configuration");
        let told = [&*format!("runs with {crc:08x}"), "stored 00000007", "box.plb is 00000007"];
        assert_says(&stored, Verdict::Fail, &[&told[..], &["next start", "restart"]].concat());
        findings.expected = Some(Expected { name: "old.plb".into(), crc });
        let runs = check(&findings, "configuration");
        assert_says(&runs, Verdict::Warn, &["stored 00000007", &format!("old.plb is {crc:08x}")]);
        findings.expected = None;
        assert_says(&check(&findings, "configuration"), Verdict::Warn, &["stored 00000007"]);
        findings.next_crc = Some(crc);
        assert_eq!(check(&findings, "configuration").verdict, Verdict::Good);
        findings.hello.as_mut().unwrap().config_crc = 9;
        let torn = check(&findings, "configuration");
        assert_says(&torn, Verdict::Fail, &["runs with 00000009", "restart"]);
        findings.config = Some(Err(BadInput::whole("UDP", "no answer", "check the firewall")));
        let unread = check(&findings, "configuration");
        assert_says(&unread, Verdict::Fail, &["read back: no answer", "firewall"]);
        findings.config = None;
        assert_eq!(check(&findings, "configuration").verdict, Verdict::Skipped);
    }

    #[test]
    fn what_is_left_open_is_warned_of() {
        let auto = with_config(|config| config.capture.as_mut().unwrap().exposure_us = None);
        assert_says(&check(&auto, "exposure"), Verdict::Warn, &["the light", "exposure_us"]);
        let unwatched = with_config(|config| config.machine.watchdog_s = None);
        assert_says(&check(&unwatched, "watchdog"), Verdict::Warn, &["hangs", "watchdog_s"]);
        let replay = with_config(|config| {
            config.capture = None;
            config.machine.watchdog_s = None;
        });
        assert_eq!(check(&replay, "watchdog").verdict, Verdict::Skipped);
        assert_eq!(check(&replay, "exposure").verdict, Verdict::Skipped);
        let one = with_config(|config| {
            config.targets.pop();
        });
        assert_says(&check(&one, "targets"), Verdict::Warn, &["lumbar only", "add"]);
        let none = with_config(|config| config.targets.clear());
        assert_says(&check(&none, "targets"), Verdict::Fail, &["neither", "add"]);
    }
}
