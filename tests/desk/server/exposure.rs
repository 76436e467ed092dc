//! The exposure is sought and kept, by the routes. The box is played: what a recording shows does not
//! depend on an exposure.

use std::time::{Duration, Instant};

use plumbline_stream::fixture::key;
use plumbline_stream::fixture::lit_box::LitBox;
use serde_json::json;

use crate::stand::{PATIENCE, Stand};

/// The serial number of the played box.
const BOX: &str = "0";

/// Its lamp, which is so weak that an exposure of half a frame needs gain.
const LIGHT_PER_US: f32 = 3e-5;

#[test]
fn the_exposure_is_found_kept_and_aimed_on_with() {
    let Some(stand) = Stand::new() else { return };
    common::keys::know(&stand.path(""), &key());
    let playing = LitBox::new(stand.udp, LIGHT_PER_US, true).play();
    let desk = stand.desk();
    let page = desk.page();
    // Of its key alone it is not known what it is called.
    let start = Instant::now();
    while page.state()["boxes"][0]["doing"] != "watching" {
        assert!(start.elapsed() < PATIENCE, "{:#}", page.state());
        std::thread::sleep(Duration::from_millis(50));
    }
    page.act(BOX, "aim_begin", "aim/begin", &json!({}));
    page.act(BOX, "aim_expose", "aim/expose", &json!({ "store": true }));
    // It is stopped, and sought anew.
    page.wait(BOX, "a try", |it| it["aim"]["exposure"]["tried"][0].is_string());
    page.act(BOX, "aim_cancel", "aim/cancel", &json!({}));
    let it = page.wait(BOX, "aiming", |it| it["doing"] == "aiming");
    assert_eq!(it["aim"]["exposure"]["is_running"], false, "{it:#}");
    assert!(it["aim"]["exposure"]["found"].is_null() && it["failed"].is_null(), "{it:#}");
    page.act(BOX, "aim_expose", "aim/expose", &json!({ "store": true }));
    let it = page.wait(BOX, "an exposure", |it| {
        it["doing"] == "aiming" && it["aim"]["exposure"]["found"].is_string()
            || !it["failed"].is_null()
    });
    let found = it["aim"]["exposure"]["found"].as_str().unwrap_or_else(|| panic!("{it:#}"));
    page.act(BOX, "aim_end", "aim/end", &json!({}));
    page.wait(BOX, "the end", |it| it["doing"] == "watching");
    desk.interrupt();
    let left = playing.join().unwrap();
    let (exposure_us, gain, light) = left.exposed(LIGHT_PER_US);
    assert!((0.7..=0.8).contains(&light), "{exposure_us} us: {light}");
    assert_eq!(found, format!("exposure {exposure_us} us, gain {}", gain.unwrap()));
    assert_eq!((left.starts, left.is_aiming), (2, false));
}
