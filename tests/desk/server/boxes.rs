//! Three boxes on one desk, each recorded: one is unplugged, and the others do not notice.

use plumbline_trial::Trial;
use serde_json::json;

use super::protocol::protocol;
use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::{Stand, lasted_s};

const BOXES: [&str; 3] = ["PL-0001", "PL-0002", "PL-0003"];

#[test]
fn of_three_boxes_one_is_unplugged() {
    let Some(stand) = Stand::new() else { return };
    let folders = BOXES.map(|it| stand.ready_box(it));
    let mut boxes: Vec<_> =
        folders.iter().map(|it| TheBox::start(it, Shown::Person, RATE_HZ)).collect();
    let desk = stand.desk();
    let page = desk.page();
    let create =
        json!({ "folder": "three", "title": "Three", "protocol": { "text": protocol(8) } });
    page.done("/api/studies", &create);
    for (at, serial_number) in BOXES.iter().enumerate() {
        let code = format!("P0{}", at + 1);
        page.done("/api/studies/three/participants", &json!({ "code": code }));
        page.wait(serial_number, "the box", |it| it["doing"] == "watching");
        let begin = json!({ "study": "three", "participant": code });
        page.act(serial_number, "session_begin", "session/begin", &begin);
    }
    for serial_number in BOXES {
        page.happen(serial_number, "ready", None);
    }
    for serial_number in BOXES {
        page.wait(serial_number, "figures", |it| {
            it["live"]["upper"]["figures"]["span_s"].as_f64() > Some(1.5)
                && it["doing"] == "recording"
        });
    }
    drop(boxes.remove(1));
    for (at, serial_number) in BOXES.iter().enumerate() {
        page.wait(serial_number, "a verdict", |it| it["session"]["at"]["is"] == "deciding");
        let name = format!("desk/three/sessions/P0{}-1/01-eyes-open", at + 1);
        let trial = Trial::open(&stand.path(&name)).unwrap();
        let frames = &trial.frames;
        let span = frames.last().unwrap().sequence - frames[0].sequence;
        assert_eq!(frames.len(), span as usize + 1, "{serial_number}: frames are missing");
        let lasted_s = lasted_s(&trial.folder);
        assert_eq!(lasted_s < 8.0, at == 1, "{serial_number}: {lasted_s} s");
        let id = trial.manifest.the_box.as_ref().map(|it| it.serial_number.clone());
        assert_eq!(id.as_deref(), Some(*serial_number));
    }
    desk.interrupt();
}
