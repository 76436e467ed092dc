//! Another receiver, written from LINK.md in another language.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use plumbline::packet::PosePacket;
use plumbline::seal::KEY_FILE_NAME;
use plumbline::target::Role;
use plumbline_test_support::{python, root};

use crate::bench::{Bench, sorted};
use crate::relay::{Faults, Relay};
use crate::vectors;

fn script(name: &str) -> PathBuf {
    root().join("tests/link").join(name)
}

/// Runs a script; what it prints.
fn run(command: &mut Command) -> String {
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn another_program_makes_and_opens_the_published_packets() {
    let Some(python) = python() else { return };
    let said = run(Command::new(python).arg(script("check_vectors.py")).arg(vectors::file()));
    assert_eq!(said.trim(), "the vectors are right");
}

/// The script is meant to be read.
#[test]
fn the_other_receiver_is_short() {
    let text = std::fs::read_to_string(script("receiver.py")).unwrap();
    let count = text.lines().filter(|line| !line.is_empty()).count();
    assert!(count <= 200, "{count} lines besides empty ones");
    let widest = text.lines().map(str::len).max().unwrap();
    assert!(widest <= 100, "{widest}");
}

/// Poses of two seconds, of which a fifth is lost on the way: each comes, in order, and with the
/// numbers that `plumb receive` records.
#[test]
fn another_program_receives_the_same_poses() {
    const FRAMES: usize = 120;
    let Some(python) = python() else { return };
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts, 7);
    let mut trial = bench.receive(0, "trial", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 10);
    relay.set(1, Faults::lost(0.2));
    let mut receiver = Command::new(python);
    receiver.arg(script("receiver.py")).arg(bench.path(KEY_FILE_NAME));
    receiver.arg(bench.hosts[1].port().to_string());
    receiver.args([&FRAMES.to_string(), "40"]);
    let printed = run(&mut receiver);
    let rows: Vec<Vec<&str>> =
        printed.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let number = |text: &str| text.parse::<f64>().unwrap();
    let first = number(rows[0][0]) as usize;
    bench.wait_for_poses("trial", first + FRAMES);
    trial.interrupt();
    trial.succeeds();
    the_box.end();
    let recorded = sorted(bench.recorded("trial"));
    assert_eq!(rows.len(), 2 * FRAMES);
    for (index, row) in rows.iter().enumerate() {
        let pose: &PosePacket = &recorded[first + index / 2];
        let role = if row[2] == "upper" { Role::Upper } else { Role::Lower };
        assert_eq!(number(row[0]) as u32, pose.sequence);
        assert_eq!(row[1], pose.capture_time_ns.to_string());
        let measured = pose.pose(role).expect("a pose in every frame");
        let expected = [measured.translation_mm, measured.theta_rad, measured.sd_mm].concat();
        for (printed, expected) in row[3..].iter().zip(&expected) {
            // Single precision in both.
            assert_eq!(number(printed) as f32, *expected, "{row:?}");
        }
    }
    assert!(relay.seen().iter().any(|it| it.way == 1 && it.is_lost));
}
