//! Several hosts at one box: what one of them does to it while another records.

use crate::bench::{Bench, assert_whole, described};
use crate::relay::Relay;

/// Two that a box can run with, and that are heard where the box's first one is.
const SETTINGS: &str = "device = \"ward 3\"\nserial_number = \"PL-0001\"\n[capture]\n\
                        driver = \"v4l2\"\npixel_format = \"grey\"\nrate_hz = 60.0\n\
                        exposure_us = EXPOSURE\n[links]\nudp = \"127.0.0.1:4210\"\n";

/// Another configuration would end the trial of the one who records: he is named to the other, who
/// may force it. Afterwards it need not be forced.
#[test]
fn a_box_that_is_recorded_gets_another_configuration_by_force_alone() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts, 18);
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 30);
    let provision = |exposure_us: &str, more: &str| {
        bench.write("other.toml", &SETTINGS.replace("EXPOSURE", exposure_us));
        let output = bench.plumb(&format!(
            "provision --box other.toml {} --send --no-restart --via-udp {} {more}",
            described(),
            bench.hosts[1]
        ));
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let before = bench.read("box.plb");
    let (code, said) = provision("4000", "");
    let computer = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    let who = format!("receive on {} records a trial, which it would disturb", computer.trim());
    assert_eq!(code, Some(2), "{said}");
    // A name is cut where the box has no room for it.
    for part in [&who[..30.min(who.len())], "records a trial, which it would disturb", "--force"] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    assert_eq!(bench.read("box.plb"), before);

    let (code, said) = provision("4000", "--force");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("stored, checksum"), "{said}");
    let forced = bench.read("box.plb");
    assert_ne!(forced, before);
    // Until its next start the box goes on as before, and so does the trial.
    let poses = bench.recorded("trial").len();
    bench.wait_for_poses("trial", poses + 60);
    host.interrupt();
    host.succeeds();
    let (code, said) = provision("5000", "");
    assert_eq!(code, Some(0), "{said}");
    assert_ne!(bench.read("box.plb"), forced);
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");
}
