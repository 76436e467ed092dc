//! The wires to other devices.

use plumbline::packet::{Health, TriggerHealth, TriggerState};
use plumbline_files::counting::counted;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;

const SUBJECT: &str = "trigger";

/// `None` for a box without wires.
pub fn check(findings: &Findings) -> Option<Check> {
    let Health { trigger, .. } = findings.health()?;
    let TriggerHealth { input, output, sent, bounces, dropped, pulses } = *trigger;
    if (input, output) == (TriggerState::Off, TriggerState::Off) {
        return None;
    }
    let missing = [("line", input), ("output_line", output)]
        .into_iter()
        .filter(|(_, state)| *state == TriggerState::Missing)
        .map(|(name, _)| name)
        .collect::<Vec<_>>();
    if !missing.is_empty() {
        return Some(Check::fail(
            SUBJECT,
            format!("{} cannot be used", missing.join(" and ")),
            "see what the box logs; check [trigger] in its box file: the chip's label, the number of \
             the line, and that nothing else uses it",
        ));
    }
    let mut seen = Vec::new();
    if input == TriggerState::Ready {
        seen.push(format!("{} since its start", counted(u64::from(sent), "trigger")));
    }
    if bounces > 0 {
        seen.push(format!("{} left out as bouncing", counted(u64::from(bounces), "edge")));
    }
    if dropped > 0 {
        seen.push(format!("{} lost", counted(u64::from(dropped), "edge")));
    }
    if output == TriggerState::Ready {
        seen.push(format!("{} given", counted(u64::from(pulses), "pulse")));
    }
    Some(Check::new(
        Verdict::warn_if(dropped > 0),
        SUBJECT,
        seen.join(", "),
        "edges come faster than the box reads them: check the wire and its ground, and give \
         debounce_us for a contact",
    ))
}

#[cfg(test)]
mod tests {
    use plumbline::packet::Message;

    use super::super::super::fixture::{assert_says, check, event, health, healthy};
    use super::*;

    fn with(trigger: TriggerHealth) -> Findings {
        let mut findings = healthy();
        findings.take(&event(Message::Health(Health { trigger, ..health() })), 0);
        findings
    }

    #[test]
    fn the_state_of_each_line_is_told() {
        assert_eq!(super::check(&healthy()), None);
        let ready = TriggerHealth {
            input: TriggerState::Ready,
            output: TriggerState::Ready,
            sent: 3,
            bounces: 4,
            dropped: 0,
            pulses: 600,
        };
        let parts = ["3 triggers", "4 edges left out as bouncing", "600 pulses"];
        assert_says(&check(&with(ready), SUBJECT), Verdict::Good, &parts);
        let lossy = TriggerHealth { dropped: 1, ..ready };
        assert_says(&check(&with(lossy), SUBJECT), Verdict::Warn, &["1 edge lost", "debounce_us"]);
        let missing = TriggerHealth { input: TriggerState::Missing, ..ready };
        let parts = ["line cannot be used", "[trigger]", "chip's label"];
        assert_says(&check(&with(missing), SUBJECT), Verdict::Fail, &parts);
        let both = TriggerHealth { output: TriggerState::Missing, ..missing };
        let parts = ["line and output_line cannot be used"];
        assert_says(&check(&with(both), SUBJECT), Verdict::Fail, &parts);
    }
}
