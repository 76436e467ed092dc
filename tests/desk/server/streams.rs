//! Other programs beside the desk: lines of JSON while a trial is recorded and while none is, and a mark
//! that becomes t = 0.

use std::io::{BufRead as _, BufReader};
use std::net::{TcpStream, UdpSocket};

use plumbline_test_support::{free_address, free_port};
use plumbline_trial::Trial;
use serde_json::{Value, json};

use super::client::connect;
use super::protocol::marked;
use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::Stand;

const BOX: &str = "PL-0001";

/// The numbers of the next frames.
fn frames(lines: &mut BufReader<TcpStream>, count: usize) -> Vec<u64> {
    let mut numbers = Vec::new();
    while numbers.len() < count {
        let mut line = String::new();
        assert!(lines.read_line(&mut line).unwrap() > 0, "the stream has ended");
        let line: Value = serde_json::from_str(&line).unwrap();
        numbers.extend(line["frame"].as_u64());
    }
    numbers
}

#[test]
fn other_programs_get_every_frame_and_their_marks_count() {
    let Some(stand) = Stand::new() else { return };
    let folder = stand.ready_box(BOX);
    let _the_box = TheBox::start(&folder, Shown::Person, RATE_HZ);
    let json_port = free_port();
    let marks = free_address();
    let options = format!("--port {} --json {json_port} --mark-udp {marks}", free_port());
    let desk = stand.desk_with(&options);
    let page = desk.page();
    let streams = page.state()["desk"]["streams"].to_string();
    assert!(streams.contains(&json_port.to_string()), "{streams}");
    let create = json!({ "folder": "marked", "title": "M", "protocol": { "text": marked(3) } });
    page.done("/api/studies", &create);
    page.done("/api/studies/marked/participants", &json!({ "code": "P01" }));
    page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let mut lines = BufReader::new(connect(json_port));
    let mut numbers = frames(&mut lines, 30);
    let begin = json!({ "study": "marked", "participant": "P01" });
    page.act(BOX, "session_begin", "session/begin", &begin);
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| !it["session"]["at"]["first_frame_at_ms"].is_null());
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(b"stands", marks).unwrap();
    let it = page.wait(BOX, "t = 0", |it| !it["session"]["at"]["zero_at_ms"].is_null());
    let mark = &it["session"]["marked"][0];
    assert_eq!((&mark["label"], &mark["source"]), (&json!("stands"), &json!("udp")));
    page.wait(BOX, "a verdict", |it| it["session"]["at"]["is"] == "deciding");
    // The examination, the recording and what came before are one stream without a gap.
    let trial = Trial::open(&stand.path("desk/marked/sessions/P01-1/01-stance")).unwrap();
    let last = u64::from(trial.frames.last().unwrap().sequence);
    while numbers.last().is_none_or(|number| *number < last) {
        numbers.extend(frames(&mut lines, 1));
    }
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{numbers:?}");
    assert_eq!(trial.manifest.zero_mark().map(|it| it.label.as_str()), Some("stands"));
    desk.interrupt();
}
