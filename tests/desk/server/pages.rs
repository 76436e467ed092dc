//! Pages that take nothing, and a desk that is killed: the trial is whole, the session goes on.

use std::time::Duration;

use plumbline_test_support::free_port;
use plumbline_trial::Trial;
use serde_json::{Value, json};

use super::client::{Page, hear, say};
use super::protocol::protocol;
use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::{Stand, lasted_s};

const BOX: &str = "PL-0001";

/// A study with a participant, and its session with the box.
fn begin(page: &Page, duration_s: u32) -> String {
    let text = protocol(duration_s);
    let create = json!({ "folder": "stances", "title": "T", "protocol": { "text": text } });
    page.done("/api/studies", &create);
    page.done("/api/studies/stances/participants", &json!({ "code": "P01" }));
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let begin = json!({ "study": "stances", "participant": "P01" });
    page.act(BOX, "session_begin", "session/begin", &begin);
    it["id"].as_str().unwrap().to_owned()
}

fn trial(stand: &Stand, name: &str) -> Trial {
    Trial::open(&stand.path("desk/stances/sessions/P01-1").join(name)).unwrap()
}

/// No frame between the first and the last is missing.
#[track_caller]
fn assert_whole(trial: &Trial) {
    let frames = &trial.frames;
    let span = frames.last().unwrap().sequence - frames[0].sequence;
    assert_eq!(frames.len(), span as usize + 1, "frames are missing");
}

/// When the frames were captured that a page gets now of the last minute, by the desk's clock.
fn frames_at_ms(page: &Page, of: &Value) -> Vec<f64> {
    let mut socket = page.socket();
    say(&mut socket, &json!({ "is": "watch", "box": of["id"], "after": 0 }));
    let mut at_ms = Vec::new();
    loop {
        let batch = hear(&mut socket, "frames");
        say(&mut socket, &json!({ "is": "ack", "batch": batch["batch"] }));
        let rows = batch["frames"].as_array().unwrap();
        at_ms.extend(rows.iter().map(|row| row["at_ms"].as_f64().unwrap()));
        // A batch of what has come since the one before is short.
        if rows.len() < RATE_HZ / 2 {
            return at_ms;
        }
    }
}

#[test]
fn eight_pages_cost_a_recording_nothing_and_each_gets_its_frames() {
    let Some(stand) = Stand::new() else { return };
    let folder = stand.ready_box(BOX);
    let _the_box = TheBox::start(&folder, Shown::Person, RATE_HZ);
    let desk = stand.desk();
    let page = desk.page();
    let id = begin(&page, 6);
    let watch = json!({ "is": "watch", "box": id });
    // They ask for frames, and read nothing any more.
    let mut stalled: Vec<_> = (0..5).map(|_| page.socket()).collect();
    stalled.iter_mut().for_each(|socket| say(socket, &watch));
    let mut reading: Vec<_> = (0..3).map(|_| page.socket()).collect();
    reading.iter_mut().for_each(|socket| say(socket, &watch));
    page.happen(BOX, "ready", None);
    let mut seen: Vec<Vec<u64>> = vec![Vec::new(); reading.len()];
    while page.the_box(BOX)["session"]["at"]["is"] != "deciding" {
        for (socket, seen) in reading.iter_mut().zip(&mut seen) {
            let batch = hear(socket, "frames");
            let rows = batch["frames"].as_array().unwrap();
            seen.extend(rows.iter().map(|row| row["number"].as_u64().unwrap()));
            assert_eq!(batch["dropped"], 0, "{batch}");
            let point = &rows[0]["upper"];
            assert!(point["p"][2].is_f64() && point["c"][0].as_f64() > Some(0.0), "{point}");
            say(socket, &json!({ "is": "ack", "batch": batch["batch"], "screen_ms": 20.0 }));
        }
    }
    for seen in &seen {
        assert!(seen.windows(2).all(|pair| pair[1] == pair[0] + 1), "{seen:?}");
        assert!(seen.len() > 100, "{} frames", seen.len());
    }
    let trial = trial(&stand, "01-eyes-open");
    assert_whole(&trial);
    assert!(lasted_s(&trial.folder) >= 6.0, "{} s", lasted_s(&trial.folder));
    // A page that was away gets what it has missed; one that was away too long hears of that.
    let mut back = page.socket();
    let last = *seen[0].last().unwrap();
    say(&mut back, &json!({ "is": "watch", "box": id, "after": last - 100 }));
    let batch = hear(&mut back, "frames");
    assert_eq!((&batch["dropped"], &batch["frames"][0]["number"]), (&json!(0), &json!(last - 99)));
    let live = page.wait(BOX, "reports", |it| !it["live"]["screen_ms"].is_null());
    assert_eq!(live["live"]["screen_ms"], json!([20.0, 20.0]));
    drop(stalled);
    desk.interrupt();
}

#[test]
fn a_desk_that_is_killed_in_a_trial_goes_on_where_it_was() {
    let Some(stand) = Stand::new() else { return };
    let folder = stand.ready_box(BOX);
    let the_box = TheBox::start(&folder, Shown::Person, RATE_HZ);
    let port = free_port();
    let desk = stand.desk_with(&format!("--port {port}"));
    let page = desk.page();
    begin(&page, 20);
    page.happen(BOX, "ready", None);
    let is_far = |it: &Value| {
        it["doing"] == "recording" && it["live"]["upper"]["figures"]["span_s"].as_f64() > Some(4.0)
    };
    let it = page.wait(BOX, "a recording", |it| is_far(it));
    let begun_ms = it["session"]["at"]["first_frame_at_ms"].as_f64().unwrap();
    let shown_ms = frames_at_ms(&page, &it);
    let killed_ms = page.state()["now_ms"].as_f64().unwrap();
    desk.kill();

    // Its page signs in by the cookie that it has.
    let desk = stand.desk_with(&format!("--port {port}"));
    let it = page.wait(BOX, "the session", |it| it["session"]["at"]["is"] == "deciding");
    assert_eq!(it["session"]["at"]["ended"], "the desk had been ended", "{it:#}");
    let cut_off = trial(&stand, "01-eyes-open");
    assert_whole(&cut_off);
    // Whatever a page has seen of it is recorded, but for the last second.
    let kept_ms = begun_ms..killed_ms - 1000.0;
    let seen = shown_ms.iter().filter(|it| kept_ms.contains(it)).count();
    let recorded = cut_off.frames.len();
    assert!(seen > 30 && recorded >= seen, "{recorded} frames of {seen} that were seen");
    page.happen(BOX, "repeat", Some("the power failed"));
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| is_far(it));

    // Ctrl-C keeps what was recorded.
    desk.interrupt();
    assert_whole(&trial(&stand, "01-eyes-open-2"));
    let desk = stand.desk_with(&format!("--port {port}"));
    page.wait(BOX, "the session", |it| it["session"]["at"]["is"] == "deciding");
    page.happen(BOX, "repeat", None);
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| is_far(it));

    // The box is lost, and the operator ends the recording.
    drop(the_box);
    page.wait(BOX, "the loss", |it| it["link"]["is"] == "silent");
    std::thread::sleep(Duration::from_millis(200));
    page.happen(BOX, "end", None);
    page.wait(BOX, "the verdict", |it| it["session"]["at"]["is"] == "deciding");
    let _again = TheBox::start(&folder, Shown::Person, RATE_HZ);
    page.happen(BOX, "repeat", None);
    page.wait(BOX, "the box", |it| it["link"]["is"] == "heard" && it["doing"] == "watching");
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| is_far(it));
    desk.interrupt();
}
