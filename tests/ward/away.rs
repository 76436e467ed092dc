//! The broker is away, or does not want the gateway.

use crate::bench::{Bench, wait_for};
use crate::boxes::{Boxes, serial_number};

/// The boxes, and the trials of each.
const BOXES: usize = 3;

#[test]
fn nothing_is_missing_when_the_broker_was_stopped_and_killed_and_started_again() {
    let Some(mut bench) = Bench::new(BOXES) else { return };
    let reader = bench.broker.reader();
    let boxes = Boxes::switch_on(BOXES, bench.host, 7);
    boxes.stream(u32::MAX);
    // One trial after the other.
    let gateway = bench.gateway("--record all --trial-seconds 1.5");
    for number in 0..BOXES {
        reader.wait(&format!("{}/verdict", serial_number(number)), |_| true);
    }
    let trials = |bench: &Bench| (0..BOXES).map(|it| bench.trials(it).len()).sum::<usize>();
    let kept = |bench: &Bench| bench.path("ward/outbox").read_dir().unwrap().count();
    for is_orderly in [true, false] {
        if is_orderly {
            bench.broker.stop()
        } else {
            bench.broker.kill()
        }
        let before = trials(&bench);
        wait_for("trials without a broker", || trials(&bench) >= before + 2 * BOXES);
        wait_for("what is kept", || kept(&bench) >= 2 * BOXES);
        bench.broker.restart();
        wait_for("it has everything", || kept(&bench) <= 2);
    }
    let said = gateway.end();
    assert!(said.contains("no connection to the broker at localhost"), "{said}");
    assert!(said.matches("the broker is there").count() >= 3, "{said}");
    assert_eq!(kept(&bench), 0, "{said}");
    // Every trial has its verdict and its summary, whatever came in between.
    for number in 0..BOXES {
        let level = serial_number(number);
        for folder in bench.trials(number) {
            let trial = folder.file_name().unwrap().to_str().unwrap().to_owned();
            for about in ["verdict", "summary"] {
                reader.wait(&format!("{level}/{about}"), |it| it["trial"] == trial.as_str());
            }
        }
    }
    // And every state is there, though a broker that was killed had forgotten them.
    let retained = bench.broker.retained();
    for number in 0..BOXES {
        for about in ["state", "examination", "verdict", "summary"] {
            let topic = format!("plumbline/1/ward/{}/{about}", serial_number(number));
            assert!(retained.iter().any(|(it, _)| *it == topic), "{topic}: {retained:?}");
        }
    }
}

#[test]
fn whoever_may_not_publish_is_told_why() {
    let Some(bench) = Bench::new(1) else { return };
    // Another authority, and another password.
    let gateway = bench.gateway_as("gateway", "broker/other.pem", "");
    gateway.wait_until_it_says("compare the broker's certificate");
    gateway.end();
    std::fs::write(bench.path("gateway.txt"), "guessed\n").unwrap();
    let gateway = bench.gateway("");
    gateway.wait_until_it_says("it does not know this user with this password");
    let said = gateway.end();
    assert!(!said.contains("guessed"), "{said}");
    // A user that may write one topic only.
    let boxes = Boxes::switch_on(1, bench.host, 7);
    boxes.stream(u32::MAX);
    let gateway = bench.gateway_as("narrow", "broker/ca.pem", "--commands");
    // Mosquitto 2.0.11 tells some clients that it does not take a message, and ends the connections of
    // others: its log says which user it was.
    let denied = "the broker does not take plumbline/1/ward/PL-0000/state";
    let ended = "the broker's log may say why";
    wait_for("it says so", || {
        let said = gateway.said();
        said.contains(denied) || said.contains(ended)
    });
    gateway.end();
}
