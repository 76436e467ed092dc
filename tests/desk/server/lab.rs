//! The Lab Streaming Layer beside the desk: pylsl takes every frame before, during and after a trial, and
//! its marker becomes the trial's t = 0.

use common::lsl::Lab;
use plumbline::packet::PosePacket;
use plumbline::target::Role;
use plumbline_test_support::free_port;
use plumbline_trial::Trial;
use plumbline_trial::frame::Frame;
use serde_json::json;

use super::client::{Page, hear, say};
use super::protocol::marked;
use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::{Stand, packets_of};

const BOX: &str = "PL-0001";

/// How true the marker's time must be.
const WITHIN_S: f64 = 1e-3;

/// The frames that come before the session, and after the trial.
const BESIDE: usize = 30;

#[test]
fn a_laboratory_gets_every_frame_and_its_marker_is_t_zero() {
    let Some(mut stand) = Stand::new() else { return };
    let Some(lab) = Lab::new(&stand.path("")) else { return };
    stand.environment = lab.environment.clone();
    let folder = stand.ready_box(BOX);
    let _the_box = TheBox::start(&folder, Shown::Person, RATE_HZ);
    let desk = stand.desk_with(&format!("--port {} --lsl --mark-lsl Stimuli", free_port()));
    let page = desk.page();
    let streams = page.state()["desk"]["streams"].to_string();
    assert!(streams.contains("Lab Streaming Layer"), "{streams}");
    let create = json!({ "folder": "marked", "title": "M", "protocol": { "text": marked(2) } });
    page.done("/api/studies", &create);
    page.done("/api/studies/marked/participants", &json!({ "code": "P01" }));
    page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let mut taking = lab.take(&["mark"]);
    see_frames(&page);
    let begin = json!({ "study": "marked", "participant": "P01" });
    page.act(BOX, "session_begin", "session/begin", &begin);
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| !it["session"]["at"]["first_frame_at_ms"].is_null());
    taking.mark("stands");
    page.wait(BOX, "t = 0", |it| !it["session"]["at"]["zero_at_ms"].is_null());
    page.wait(BOX, "a verdict", |it| it["session"]["at"]["is"] == "deciding");
    see_frames(&page);
    let taken = taking.end();
    let said = desk.interrupt();

    // Before, during and after the trial there is no gap.
    let numbers = taken.frames();
    let trial = Trial::open(&stand.path("desk/marked/sessions/P01-1/01-stance")).unwrap();
    let (first, last) = (trial.frames[0].sequence, trial.frames.last().unwrap().sequence);
    assert_eq!(trial.frames.len(), (last - first) as usize + 1, "frames are missing");
    assert!(numbers[0] < f64::from(first) && numbers.last().unwrap() > &f64::from(last));
    // The numbers are those that were recorded; single precision, as the box sends them.
    let at = |sequence: u32| (f64::from(sequence) - numbers[0]) as usize;
    let (depth_mm, ap_mm) = (taken.column("lower_cam_z"), taken.column("upper_ap"));
    let recorded = packets_of(&trial.folder);
    assert!(recorded.len() >= trial.frames.len());
    for (_, packet) in &recorded {
        let lower_mm = packet.pose(Role::Lower).map_or(f32::NAN, |it| it.translation_mm[2]);
        let upper_mm = packet.upper_trunk.map_or(f32::NAN, |it| it.ap_mm);
        for (taken_mm, mm) in [(&depth_mm, lower_mm), (&ap_mm, upper_mm)]
            .map(|(it, mm)| (it[at(packet.sequence)], mm))
        {
            assert_eq!((taken_mm as f32).to_bits(), mm.to_bits(), "frame {}", packet.sequence);
        }
    }
    assert!(trial.frames.iter().any(|it| it.upper.is_some()), "nothing was seen");

    // t = 0. The frames of the trial have times of LSL's clock, too.
    let mark_s = taken.marks_s()[0];
    let event = trial.manifest.zero_mark().unwrap();
    assert_eq!((&*event.label, event.source.word()), ("stands", "lsl"));
    let nearest = trial.frames.iter().min_by(|one, other| {
        let from = |it: &Frame| (taken.times_s[at(it.sequence)] - mark_s).abs();
        from(one).total_cmp(&from(other))
    });
    let nearest = nearest.unwrap();
    let wanted_s = nearest.time_s + mark_s - taken.times_s[at(nearest.sequence)];
    let error_s = event.time_s - wanted_s;
    // What a box replays has times of a recording, which only the frames' arrival relates to others: where
    // even the least delayed waited for a busy computer, nobody knows better.
    let differ_s = waits_differ_s(&recorded);
    println!("t = 0 is off by {:.3} ms; waits differ by {:.3} ms", 1e3 * error_s, 1e3 * differ_s);
    assert!(error_s.abs() < WITHIN_S + differ_s, "{error_s}, and waits differ by {differ_s}");
    assert!(!said.contains("warning"), "{said}");
}

/// Waits until some frames have come that belong to no trial.
fn see_frames(page: &Page) {
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let mut socket = page.socket();
    say(&mut socket, &json!({ "is": "watch", "box": it["id"] }));
    let mut seen = 0;
    while seen < BESIDE {
        let batch = hear(&mut socket, "frames");
        seen += batch["frames"].as_array().unwrap().len();
        say(&mut socket, &json!({ "is": "ack", "batch": batch["batch"] }));
    }
}

/// By how much the least times under way may differ from some seconds to others. The least of a few is taken
/// for no wait at all, by the desk over seconds that also lie before the trial: so by how much those of the
/// trial's own seconds differ, as where a computer stood still in between, or the quicker half of its frames,
/// where most of them wait.
fn waits_differ_s(packets: &[(u64, PosePacket)]) -> f64 {
    let way_ns = |(arrival_ns, packet): &(u64, PosePacket)| {
        arrival_ns.wrapping_sub(packet.handed_over_ns()).cast_signed()
    };
    let seconds = packets.chunks(RATE_HZ).filter(|it| it.len() == RATE_HZ);
    let least: Vec<i64> = seconds.map(|it| it.iter().map(way_ns).min().unwrap()).collect();
    let between_ns = least.iter().max().unwrap() - least.iter().min().unwrap();
    let mut ways: Vec<i64> = packets.iter().map(way_ns).collect();
    ways.sort_unstable();
    1e-9 * between_ns.max(ways[ways.len() / 2] - ways[0]) as f64
}
