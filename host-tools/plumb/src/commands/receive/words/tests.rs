//! The words for a reception.

use std::time::{Duration, Instant};

use plumbline::packet::{Health, Log, LogLevel, Message};
use plumbline_bedside::recording::{check_heard, silence};
use plumbline_stream::fixture::adversity::hello_of;
use plumbline_stream::fixture::{self, take};
use plumbline_stream::transport::Event;

use super::*;

type Heard = Receiver<Vec<u8>>;

fn pose(sequence: u32) -> Message {
    Message::Pose(fixture::pose_packet(sequence))
}

fn hello() -> Message {
    Message::Hello(Hello { config_crc: 7, ..fixture::hello(&fixture::config()) })
}

fn health(camera: CameraState, uptime_ms: u64, frames: u32) -> Message {
    let camera_losses = u32::from(frames > 0 && camera == CameraState::Lost);
    Message::Health(Health { camera, uptime_ms, frames, camera_losses, ..fixture::health() })
}

fn log(uptime_ms: u64, text: &str) -> Message {
    let (target, text) = ("camera".try_into().unwrap(), text.try_into().unwrap());
    Message::Log(Log { uptime_ms, level: LogLevel::Error, target, text, cut: 0 })
}

#[test]
fn lost_frames_are_a_share_of_all() {
    let mut receiver = Heard::new(None);
    let frames = [0, 1, 2, 4, 5, 6, 8].map(pose);
    take(&mut receiver, Instant::now(), &[vec![hello()], frames.to_vec()].concat());
    let words = summary(&receiver, &Here::default());
    assert!(words.contains("2 (22.22 %)"), "{words}");
}

#[test]
fn a_box_without_a_camera_is_heard_and_says_why_it_sends_no_poses() {
    let mut receiver = Heard::new(None);
    let start = Instant::now();
    let error =
        check_heard(&receiver, &Here::default(), "UDP".into(), start).unwrap_err().to_string();
    assert!(error.contains("check that the box is on"), "{error}");

    let why = log(41_000, "camera: cannot be opened");
    let lost = health(CameraState::Lost, 42_000, 0);
    let now = take(&mut receiver, start, &[lost.clone(), hello(), why.clone(), lost, why]);
    let words = silence(&receiver, now);
    assert!(words.contains("the box is heard, no pose yet, camera lost: "), "{words}");
    assert!(words.contains("no frame since the box's start 42 s ago"), "{words}");
    let error =
        check_heard(&receiver, &Here::default(), "UDP".into(), now).unwrap_err().to_string();
    assert!(
        error.contains("it says: camera: cannot be opened; check the camera's plug"),
        "{error}"
    );
    let words = summary(&receiver, &Here::default());
    assert!(words.contains("never gave a frame"), "{words}");
    // The box repeats it for those who have not heard it.
    assert_eq!(receiver.take_notices(), ["box ERROR camera: camera: cannot be opened"]);

    // A box that refuses its configuration has no Health.
    let mut receiver = Heard::new(None);
    take(&mut receiver, start, &[log(10, "configuration refused: checksum")]);
    let error =
        check_heard(&receiver, &Here::default(), "UDP".into(), now).unwrap_err().to_string();
    assert!(error.contains("configuration refused: checksum; correct what"), "{error}");
}

#[test]
fn an_old_pose_is_not_shown_as_the_latest() {
    let mut receiver = Heard::new(None);
    let start = Instant::now();
    let running = health(CameraState::Running, 5000, 2);
    let now = take(&mut receiver, start, &[hello(), pose(0), pose(1), running]);
    assert!(receiver.latest(now).is_some());

    let now = take(&mut receiver, now, &[health(CameraState::Lost, 6000, 2)]);
    let later = now + Duration::from_secs(3);
    take(&mut receiver, later, &[health(CameraState::Lost, 9000, 2)]);
    assert_eq!(receiver.unheard(later), None);
    let words = silence(&receiver, later);
    assert_eq!(words, "no pose for 3 s, camera lost for 3 s");
    let words = summary(&receiver, &Here::default());
    assert!(words.contains("lost 1 time, absent at the end"), "{words}");

    // Whoever begins to listen now does not know since when.
    let mut receiver = Heard::new(None);
    take(&mut receiver, now, &[health(CameraState::Lost, 6000, 2)]);
    take(&mut receiver, later, &[health(CameraState::Lost, 9000, 2)]);
    let words = silence(&receiver, later);
    assert!(words.ends_with("camera lost for more than 3 s"), "{words}");
}

#[test]
fn a_box_that_fell_silent_is_not_said_to_run() {
    let mut receiver = Heard::new(None);
    let running = health(CameraState::Running, 5000, 2);
    let now = take(&mut receiver, Instant::now(), &[hello(), pose(0), running]);
    let words = silence(&receiver, now + Duration::from_secs(7));
    assert_eq!(words, "the box is no longer heard, for 7 s");
}

#[test]
fn frames_belong_to_the_start_that_sent_them() {
    let mut receiver = Heard::new(None);
    let now = take(&mut receiver, Instant::now(), &[hello(), pose(0), pose(1)]);
    // It restarts with another configuration, without a camera: what was measured is over.
    let mut restart = |start: u32, config_crc: u32, after_s: u64, then: Message| {
        let anew = Hello { boot_id: start, config_crc, ..fixture::hello(&fixture::config()) };
        let now = now + Duration::from_secs(after_s);
        for message in [Message::Hello(anew), then] {
            let packet = fixture::packet(start, message);
            receiver.handle(Event::Packet(packet), now).unwrap();
        }
        (silence(&receiver, now), summary(&receiver, &Here::default()))
    };
    let (words, table) = restart(8, 9, 5, health(CameraState::Lost, 3000, 0));
    assert!(words.contains("camera lost: no frame since the box's start 3 s ago"), "{words}");
    let firmware = fixture::hello(&fixture::config()).firmware;
    let box_with =
        |crc| format!("ward 3 (PL-0001), program {firmware}, configuration 0000000{crc}: ");
    for row in [box_with(7) + "2 frames", box_with(9) + "0 frames"] {
        assert!(table.contains(&row), "{row}: {table}");
    }
    // And once more with the first, with frames.
    let (_, table) = restart(10, 7, 9, pose(0));
    assert!(table.contains(&(box_with(7) + "3 frames")), "{table}");
}

#[test]
fn what_was_left_out_is_in_the_summary() {
    let mut receiver = Heard::new(None);
    let start = Instant::now();
    take(&mut receiver, start, &[hello(), pose(0)]);
    assert!(!summary(&receiver, &Here::default()).contains("another box"));
    for packet in [hello_of("ward 4", 9), fixture::packet(9, pose(0)), fixture::packet(5, pose(0))]
    {
        receiver.handle(Event::Packet(packet), start).unwrap();
    }
    receiver.finish(start).unwrap();
    let words = summary(&receiver, &Here::default());
    let rows: Vec<&str> = words.lines().collect();
    let has = |what: &str, count: &str| {
        rows.iter()
            .any(|row| row.contains(what) && row.trim_end_matches(['│', ' ']).ends_with(count))
    };
    assert!(has("of another box", "2") && has("of a start without a name", "1"), "{words}");
}

#[test]
fn what_was_wrong_with_the_power_is_in_the_summary() {
    let mut receiver = Heard::new(None);
    let power = |undervoltage, throttled| {
        Message::Health(Health { undervoltage, throttled, ..fixture::health() })
    };
    let now = take(&mut receiver, Instant::now(), &[power(Some(false), Some(false))]);
    assert!(!summary(&receiver, &Here::default()).contains("too weak"));
    take(&mut receiver, now, &[power(Some(true), Some(false)), power(Some(false), Some(true))]);
    let words = summary(&receiver, &Here::default());
    assert!(words.contains("too weak") && words.contains("slowed down"), "{words}");
}
