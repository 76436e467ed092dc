//! A box at the end of a serial cable: it is aimed and recorded, and missed when the cable is pulled out.

use plumbline_stream::fixture::Cable;
use plumbline_test_support::{free_address, free_port, serial_lines};
use plumbline_trial::Trial;
use serde_json::json;

use super::protocol::protocol;
use crate::camera::{Shown, TheBox};
use crate::stand::Stand;

const BOX: &str = "PL-0001";

/// The line carries so many frames a second beside a picture.
const RATE_HZ: usize = 20;

#[test]
fn a_box_on_a_serial_line_is_aimed_and_recorded() {
    if !serial_lines() {
        return;
    }
    let Some(mut stand) = Stand::new() else { return };
    let folder = stand.ready_box(BOX);
    // The desk does not hear it over the network.
    stand.udp = free_address();
    let cable = Cable::new();
    let _the_box = TheBox::start_on(&folder, Shown::Person, RATE_HZ, Some(&cable.at_box));
    let desk = stand.desk_with(&format!("--port {} --serial {}", free_port(), cable.at_host));
    let page = desk.page();
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    assert_eq!(it["link"], json!({ "is": "heard", "by": cable.at_host }));
    let id = it["id"].as_str().unwrap().to_owned();
    // Its key is known here, and yet it is not looked for in the network as well.
    assert_eq!(page.state()["boxes"].as_array().unwrap().len(), 1, "{:#}", page.state());

    page.act(BOX, "aim_begin", "aim/begin", &json!({ "reduction": 8 }));
    page.wait(BOX, "a picture", |it| it["aim"]["picture"].as_u64() > Some(0));
    let picture = page.get(&format!("/api/boxes/{id}/picture.jpeg?number=1"));
    assert_eq!(&picture.body[..2], [0xFF, 0xD8], "a JPEG");
    page.act(BOX, "aim_end", "aim/end", &json!({}));

    let create = json!({ "folder": "cable", "title": "C", "protocol": { "text": protocol(2) } });
    page.done("/api/studies", &create);
    page.done("/api/studies/cable/participants", &json!({ "code": "P01" }));
    let begin = json!({ "study": "cable", "participant": "P01" });
    page.act(BOX, "session_begin", "session/begin", &begin);
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a verdict", |it| it["session"]["at"]["is"] == "deciding");
    let trial = Trial::open(&stand.path("desk/cable/sessions/P01-1/01-eyes-open")).unwrap();
    let (first, last) = (trial.frames[0].sequence, trial.frames.last().unwrap().sequence);
    assert_eq!(trial.frames.len(), (last - first) as usize + 1, "frames are missing");
    assert!(trial.frames.len() > RATE_HZ, "{} frames", trial.frames.len());

    drop(cable);
    page.wait(BOX, "the loss", |it| it["link"]["is"] != "heard");
    desk.interrupt();
}
