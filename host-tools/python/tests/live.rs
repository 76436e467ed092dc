//! Live packets, from a box that is played.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::PermissionsExt as _;
use std::process::Stdio;
use std::time::{Duration, Instant};

use plumbline::packet::{AnatomicalPoint, Message, PosePacket};
use plumbline_stream::fixture::{START, config, hello, key, pose_packet};
use plumbline_stream::sealed_box::SealedBox;
use plumbline_test_support::free_address;
use serde_json::Value;

use crate::bench::Bench;

const FRAMES: u32 = 90;

/// This one never comes.
const LOST: u32 = 40;

/// A loaded machine is slow.
const PATIENCE: Duration = Duration::from_secs(120);

/// This computer knows the box's key.
fn know(bench: &Bench) {
    let folder = bench.data().join("plumbline/keys");
    fs::create_dir_all(&folder).unwrap();
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o700)).unwrap();
    let file = folder.join(format!("{}.toml", key().id()));
    let text = format!(
        "key = \"{}\"\nname = \"ward 3\"\nserial_number = \"PL-0001\"\n\
         made = \"2026-01-01T00:00:00Z\"\n",
        key().text().as_str()
    );
    fs::write(&file, text).unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
}

fn packet(sequence: u32) -> PosePacket {
    let at_mm = |ap_mm: f32| AnatomicalPoint { ap_mm, ml_mm: -1.5, si_mm: 1000.0 };
    PosePacket {
        lower_trunk: Some(at_mm(sequence as f32 / 7.0)),
        upper_trunk: Some(at_mm(-0.1)),
        ..pose_packet(sequence)
    }
}

#[test]
fn live_poses_come_one_by_one_with_what_is_missing() {
    let Some(bench) = Bench::new() else { return };
    know(&bench);
    let address = free_address();
    let mut script = bench.script("receive.py");
    script.args([address.to_string(), (FRAMES - 1).to_string()]).stdout(Stdio::piped());
    let mut python = script.current_dir(bench.folder.path()).spawn().unwrap();
    let printed = python.stdout.take().unwrap();
    let reader = std::thread::spawn(move || {
        let lines = BufReader::new(printed).lines();
        lines.map(|line| serde_json::from_str(&line.unwrap()).unwrap()).collect::<Vec<Value>>()
    });
    let mut the_box = SealedBox::new(address, START);
    the_box.meet();
    the_box.send(&Message::Hello(hello(&config())));
    let (mut next, give_up) = (0, Instant::now() + PATIENCE);
    let status = loop {
        if next < FRAMES {
            if next != LOST {
                the_box.send(&Message::Pose(packet(next)));
            }
            next += 1;
        }
        // Until Python has all.
        the_box.live(Duration::from_millis(10));
        if let Some(status) = python.try_wait().unwrap() {
            break status;
        }
        if Instant::now() > give_up {
            python.kill().unwrap();
            panic!("Python has not ended");
        }
    };
    assert!(status.success());
    let said = reader.join().unwrap();
    let of_kind =
        |kind: &str| -> Vec<&Value> { said.iter().filter(|it| it["kind"] == kind).collect() };
    assert_eq!(of_kind("stream")[0]["box"]["serial_number"], "PL-0001");
    let frames = of_kind("frame");
    let sent: Vec<u32> = (0..FRAMES).filter(|it| *it != LOST).collect();
    assert_eq!(frames.len(), sent.len());
    for (frame, sequence) in frames.iter().zip(sent) {
        assert_eq!(frame["frame"], sequence);
        assert_eq!(frame["late"], false);
        // Single precision, as it was sent.
        let ap_mm = frame["lower"]["trunk_mm"][0].as_f64().unwrap();
        assert_eq!(ap_mm as f32, sequence as f32 / 7.0);
        assert_eq!(frame["upper"]["state"], "tracking");
        assert!(frame["time_s"].as_f64().unwrap() >= 0.0 && frame["unix_s"].is_number());
    }
    let gap = of_kind("gap")[0];
    assert_eq!((&gap["first"], &gap["count"]), (&LOST.into(), &1.into()));
}
