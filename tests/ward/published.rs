//! What is published, and what is not.

use crate::bench::Bench;
use crate::boxes::Boxes;

#[test]
fn a_trial_by_command_with_its_verdict_and_nothing_of_a_person() {
    let Some(bench) = Bench::new(1) else { return };
    let reader = bench.broker.reader();
    let gateway = bench.gateway("--commands");
    reader.wait("gateway/state", |it| it["is"] == "online");
    reader.wait("PL-0000/state", |it| it["is"] == "searching");
    let boxes = Boxes::switch_on(1, bench.host, 7);
    boxes.stream(u32::MAX);
    reader.wait("PL-0000/state", |it| it["is"] == "heard");
    let health = reader.wait("PL-0000/health", |it| it["rate_hz"].as_f64() > Some(50.0));
    println!("{health}");
    println!("{}", gateway.end());
}
