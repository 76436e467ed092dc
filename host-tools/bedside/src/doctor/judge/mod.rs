//! From figures to verdicts. Every bound is named here with its reason, and nothing here
//! listens or prints.

mod camera;
mod clock;
mod configuration;
mod light;
mod link;
mod machine;
mod order;
mod scale;
mod scene;
mod target;
mod trigger;

pub use scale::{SUBJECT as SCALE, TAPE_MM_MAX, TAPE_MM_MIN, Tape, comparison};

use super::check::Check;
use super::findings::Findings;

/// What is looked at once a box is heard, in this order.
const AFTER_LINK: [&str; 6] = ["box", "clock", "camera", "configuration", "targets", "light"];

/// Why something is skipped on a line without a way to the box.
const ONE_WAY: &str = "the box hears no questions";

/// Every check.
#[must_use]
pub fn all(findings: &Findings) -> Vec<Check> {
    let mut checks = link::checks(findings);
    let skipped = |from: usize, why: &'static str| {
        AFTER_LINK[from..].iter().map(move |subject| Check::skipped(*subject, why))
    };
    if findings.packets == 0 {
        checks.extend(skipped(0, "no box is heard"));
    } else if let Some(text) = &findings.refusing {
        checks.push(machine::refusing(text));
        checks.extend(skipped(1, "the box runs with no configuration"));
    } else {
        checks.extend(machine::checks(findings));
        checks.extend(clock::checks(findings));
        checks.extend(camera::checks(findings));
        checks.extend(configuration::checks(findings));
        checks.extend(target::checks(findings));
        checks.extend(order::check(findings));
        checks.extend(scale::check(findings));
        checks.extend(light::checks(findings));
        checks.extend(trigger::check(findings));
    }
    checks
}

/// A share of some, for people.
fn percent(part: f64) -> String {
    format!("{:.1} %", 100.0 * part)
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict;
    use super::super::fixture::{assert_says, check, healthy};
    use super::*;

    #[test]
    fn a_healthy_box_is_good_throughout_and_each_thing_is_looked_at_once() {
        let checks = all(&healthy());
        for check in &checks {
            assert_eq!(check.verdict, Verdict::Good, "{check:?}");
            assert!(check.remedy.is_empty() && !check.seen.is_empty(), "{check:?}");
        }
        let mut subjects: Vec<_> = checks.iter().map(|check| &check.subject).collect();
        subjects.sort();
        subjects.dedup();
        assert_eq!(subjects.len(), checks.len());
    }

    #[test]
    fn without_a_box_there_is_nothing_more_to_look_at() {
        let findings = Findings { place: "UDP 0.0.0.0:4210".into(), ..Findings::default() };
        let checks = all(&findings);
        assert_eq!(checks[0].verdict, Verdict::Fail);
        assert!(checks[1..].iter().all(|check| check.verdict == Verdict::Skipped));
        assert_eq!(checks.len(), 1 + AFTER_LINK.len());
        assert_says(&check(&findings, "camera"), Verdict::Skipped, &["no box is heard"]);
    }

    #[test]
    fn a_box_that_refuses_its_configuration_is_quoted() {
        let mut findings = Findings { packets: 3, ..Findings::default() };
        findings.refusing = Some("configuration refused: links.udp: the port may not be 0".into());
        let parts = ["links.udp: the port may not be 0", "plumb provision --send"];
        assert_says(&check(&findings, "box"), Verdict::Fail, &parts);
        assert_says(&check(&findings, "clock"), Verdict::Skipped, &["no configuration"]);
    }
}
