//! The gateway is ended, killed, and started again.

use plumbline_trial::Trial;
use plumbline_trial::manifest::State;

use crate::bench::{Bench, wait_for};
use crate::boxes::Boxes;

#[test]
fn a_trial_of_a_gateway_that_was_killed_has_its_verdict_after_the_next_start() {
    let Some(bench) = Bench::new(2) else { return };
    let reader = bench.broker.reader();
    let boxes = Boxes::switch_on(2, bench.host, 7);
    boxes.stream(u32::MAX);
    let gateway = bench.gateway("--record all");
    for level in ["PL-0000", "PL-0001"] {
        reader.wait(&format!("{level}/state"), |it| it["doing"] == "recording");
    }
    let sent = boxes.sent(0);
    wait_for("some frames", || boxes.sent(0) > sent + 120);
    gateway.kill();
    // The broker notices, and says so for the gateway.
    reader.wait("gateway/state", |it| it["is"] == "offline" && it["since"].is_null());
    let gateway = bench.gateway("");
    for (number, level) in ["PL-0000", "PL-0001"].into_iter().enumerate() {
        let verdict = reader.wait(&format!("{level}/verdict"), |it| it["was_cut_off"] == true);
        let folders = bench.trials(number);
        let [folder] = &folders[..] else { panic!("{folders:?}") };
        let trial = Trial::open(folder).unwrap();
        assert_eq!(trial.manifest.state, State::Recording);
        assert!(trial.frames.len() >= 100, "{}", trial.frames.len());
        assert_eq!(verdict["trial"], folder.file_name().unwrap().to_str().unwrap());
        reader.wait(&format!("{level}/summary"), |it| it["frames"] == trial.frames.len());
    }
    wait_for("nothing is due", || bench.path("ward/due").read_dir().unwrap().next().is_none());
    gateway.end();
}
