//! Ten minutes at 200 Hz take no memory.

use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{hear, say};
use crate::camera::{Shown, TheBox};
use crate::stand::Stand;

const BOX: &str = "PL-0001";

/// The rate of the camera.
const RATE_HZ: usize = 200;

/// How long it goes on, after the history is full.
const LASTS: Duration = Duration::from_secs(600);

/// The history of frames is full after a minute.
const FILLED_AFTER: Duration = Duration::from_secs(90);

/// What the allocator may keep meanwhile, kilobytes.
const GROWTH_KB_MAX: u64 = 6_000;

#[test]
#[ignore = "takes twelve minutes: `cargo xtask test long`"]
fn ten_minutes_at_200_hz_take_no_memory() {
    let Some(stand) = Stand::new() else { return };
    let folder = stand.ready_box(BOX);
    let _the_box = TheBox::start(&folder, Shown::Person, RATE_HZ);
    let desk = stand.desk();
    let page = desk.page();
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let mut sockets: Vec<_> = (0..8).map(|_| page.socket()).collect();
    for socket in &mut sockets {
        say(socket, &json!({ "is": "watch", "box": it["id"] }));
    }
    let begun = Instant::now();
    let mut filled_kb = None;
    let mut told = Instant::now();
    while begun.elapsed() < FILLED_AFTER + LASTS {
        for socket in &mut sockets {
            let batch = hear(socket, "frames");
            say(socket, &json!({ "is": "ack", "batch": batch["batch"] }));
        }
        if filled_kb.is_none() && begun.elapsed() >= FILLED_AFTER {
            filled_kb = Some(desk.resident_kb());
        }
        if told.elapsed() >= Duration::from_secs(30) {
            told = Instant::now();
            println!("{} s: {} kB", begun.elapsed().as_secs(), desk.resident_kb());
        }
    }
    let (filled_kb, at_end_kb) = (filled_kb.unwrap(), desk.resident_kb());
    println!("{filled_kb} kB when the history was full, {at_end_kb} kB at the end");
    assert!(at_end_kb <= filled_kb + GROWTH_KB_MAX, "{filled_kb} kB, {at_end_kb} kB");
    desk.interrupt();
}
