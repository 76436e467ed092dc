//! What is published, and what is not.

use std::time::{Duration, Instant};

use plumbline_trial::Trial;

use crate::bench::{Bench, wait_for};
use crate::boxes::Boxes;
use crate::broker::Got;

/// What must not be published: codes, names and places that only this computer knows.
const SECRETS: [&str; 5] = ["stance-secret", "samples", "packets.bin", "ward/trials", "theta"];

/// The topics that there are.
fn is_known(topic: &str) -> bool {
    let Some(rest) = topic.strip_prefix("plumbline/1/ward/") else { return false };
    match rest.split('/').collect::<Vec<_>>()[..] {
        ["gateway", "state" | "health"] => true,
        ["reply", ..] => true,
        [level, about] => {
            level.starts_with("PL-")
                && ["state", "health", "examination", "verdict", "summary", "command"]
                    .contains(&about)
        }
        _ => false,
    }
}

/// Goes through everything that was published: only known topics, only JSON, no pose stream, nothing of a
/// person.
pub fn assert_discreet(got: &[Got], lasted: Duration) {
    for it in got {
        assert!(is_known(&it.topic), "{it:?}");
        if it.topic.ends_with("/command") {
            continue;
        }
        let json = it.json();
        for secret in SECRETS {
            assert!(!it.text.contains(secret), "{secret}: {it:?}");
        }
        for field in ["participant", "condition", "note", "operator", "poses", "samples"] {
            assert!(!has_field(&json, field), "{field}: {it:?}");
        }
    }
    // Nothing comes as often as poses do.
    let of_boxes = got.iter().filter(|it| it.topic.ends_with("/health")).count();
    assert!(of_boxes as f64 <= 4.0 * (lasted.as_secs_f64() + 5.0), "{of_boxes} healths");
}

fn has_field(json: &serde_json::Value, name: &str) -> bool {
    match json {
        serde_json::Value::Object(fields) => {
            fields.iter().any(|(field, value)| field == name || has_field(value, name))
        }
        serde_json::Value::Array(values) => values.iter().any(|it| has_field(it, name)),
        _ => false,
    }
}

#[test]
fn a_trial_by_command_has_a_verdict_and_a_summary_and_nothing_of_a_person() {
    let Some(bench) = Bench::new(1) else { return };
    let begun = Instant::now();
    let reader = bench.broker.reader();
    let gateway = bench.gateway("--commands");
    reader.wait("gateway/state", |it| it["is"] == "online");
    reader.wait("PL-0000/state", |it| it["is"] == "searching" && it["remedy"].is_string());
    let command = |payload: &str| -> serde_json::Value {
        let answer = bench.broker.command("nurse", "PL-0000", payload);
        serde_json::from_str(&answer).unwrap_or_else(|_| panic!("{answer}"))
    };
    let refused = command("{\"do\":\"start\"}");
    assert_eq!(
        (&refused["done"], &refused["found"]),
        (&false.into(), &"the box is not heard".into())
    );

    let boxes = Boxes::switch_on(1, bench.host, 7);
    boxes.stream(u32::MAX);
    reader.wait("PL-0000/state", |it| it["is"] == "heard" && it["name"] == "bed 0");
    reader.wait("PL-0000/health", |it| {
        it["rate_hz"].as_f64() > Some(10.0) && it["camera"] == "running"
    });
    reader.wait("PL-0000/examination", |it| it["good"].as_u64() > Some(5));
    // A retained command may be of another day.
    let topic = "plumbline/1/ward/PL-0000/command";
    bench.broker.publish("nurse", topic, "{\"do\":\"start\"}", &["-r"]);
    gateway.wait_until_it_says("one for PL-0000 is retained");
    assert!(bench.trials(0).is_empty());

    let begins = command("{\"do\":\"start\",\"name\":\"stance-secret\",\"seconds\":600}");
    let trial = begins["trial"].as_str().unwrap().to_owned();
    reader.wait("PL-0000/state", |it| it["doing"] == "recording" && it["trial"] == trial.as_str());
    let again = command("{\"do\":\"start\",\"seconds\":5}");
    assert!(again["found"].as_str().unwrap().contains(&trial), "{again}");
    let other = command("{\"do\":\"stop\",\"trial\":\"20200101T000000Z\"}");
    assert_eq!(other["done"], false);
    for wrong in ["{\"do\":\"start\",\"name\":\"../x\"}", "{\"do\":\"reboot\"}", "start"] {
        assert_eq!(command(wrong)["done"], false, "{wrong}");
    }
    let sent = boxes.sent(0);
    wait_for("some frames", || boxes.sent(0) > sent + 200);
    assert_eq!(command("{\"do\":\"stop\"}")["trial"], trial.as_str());
    let verdict = reader.wait("PL-0000/verdict", |it| it["trial"] == trial.as_str());
    let summary = reader.wait("PL-0000/summary", |it| it["trial"] == trial.as_str());
    reader.wait("PL-0000/state", |it| it["doing"] == "watching" && it["is"] == "heard");

    // The trial is what `plumb receive` would have recorded, and what was published is what is in it.
    let folders = bench.trials(0);
    let [folder] = &folders[..] else { panic!("{folders:?}") };
    assert!(folder.ends_with(format!("{trial}-stance-secret")));
    let recorded = Trial::open(folder).unwrap();
    assert_eq!(verdict["is"], recorded.manifest.verdict().grade().word());
    assert_eq!(summary["frames"], recorded.frames.len());
    assert_eq!(summary["frames_lost"], 0);
    assert!(recorded.frames.len() > 150 && recorded.config.is_some());
    assert!(folder.join("samples.parquet").exists());
    let path_mm = &summary["figures"]["upper"]["path_length_mm"]["APML"];
    assert!(path_mm.is_number() || summary["no_figures"].is_string(), "{summary}");

    let said = gateway.end();
    for part in ["cannot be part of a folder", "by command", "1 trials, 1 of them judged"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    reader.wait("gateway/state", |it| it["is"] == "offline" && it["since"].is_string());
    reader.wait("PL-0000/state", |it| it["is"] == "unknown");
    assert_discreet(&reader.got(), begun.elapsed());
    let states = bench.broker.retained();
    assert!(states.iter().any(|(topic, _)| topic.ends_with("PL-0000/verdict")), "{states:?}");
}
