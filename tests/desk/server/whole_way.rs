//! From a new box to a study's report, by the routes alone.

use serde_json::json;

use super::client::has;
use super::new_box::new_box;
use super::protocol::protocol;
use crate::camera::{PHOTOGRAPHS, RATE_HZ, Shown, TheBox};
use crate::stand::Stand;

const BOX: &str = "PL-0001";

#[test]
fn from_a_new_box_to_a_report() {
    let Some(stand) = Stand::new() else { return };
    let desk = stand.desk();
    let page = desk.page();
    // What was measured on the print of the lower target.
    page.done("/api/prints", &json!({ "pitches_mm": { "lumbar": 12.01 } }));
    let folder = new_box(&stand, &page, "ward 1", BOX);
    let the_box = TheBox::start(&folder, Shown::Photograph(0), RATE_HZ);
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    assert_eq!(it["hello"]["next_step"], "calibrate", "{it:#}");
    let id = it["id"].as_str().unwrap().to_owned();

    // Photographs, which the camera sees one after the other.
    page.act(BOX, "photographs_begin", "photographs/begin", &json!({}));
    page.wait(BOX, "set-up mode", |it| it["aim"]["picture"].as_u64() > Some(0));
    let picture = page.get(&format!("/api/boxes/{id}/picture.jpeg?number=1"));
    assert_eq!(&picture.body[..2], [0xFF, 0xD8], "a JPEG");
    for number in 0..PHOTOGRAPHS {
        the_box.show(Shown::Photograph(number));
        // A picture with this pose of the board has been seen.
        let seen = page.the_box(BOX)["aim"]["picture"].as_u64();
        page.wait(BOX, "pictures", |it| it["aim"]["picture"].as_u64() > seen.map(|it| it + 1));
        page.act(BOX, "photographs_take", "photographs/take", &json!({}));
        page.wait(BOX, "a photograph", |it| {
            it["photographs"]["list"].as_array().is_some_and(|it| it.len() > number)
        });
    }
    let it = page.the_box(BOX);
    let photographs = &it["photographs"];
    let is_found = |it: &&serde_json::Value| it["is_found"] == true;
    let list = photographs["list"].as_array().unwrap();
    assert!(list.iter().filter(is_found).count() >= PHOTOGRAPHS - 2, "{photographs:#}");
    assert!(photographs["share"].as_f64() > Some(0.5), "{photographs:#}");
    let photograph = page.get(&format!("/api/boxes/{id}/photographs/1.png"));
    assert_eq!(&photograph.body[1..4], b"PNG");

    // The camera, and the box with it.
    page.act(BOX, "calibration_fit", "calibration/fit", &json!({}));
    let it =
        page.wait(BOX, "a camera", |it| !it["calibration"].is_null() || !it["failed"].is_null());
    let calibration = &it["calibration"];
    assert!(calibration["error_px"].as_f64() < Some(0.2), "{it:#}");
    assert!(page.get(&format!("/api/boxes/{id}/calibration/plot.svg")).text().contains("<svg"));
    page.act(BOX, "calibration_deliver", "calibration/deliver", &json!({}));
    page.wait(BOX, "a calibrated box", |it| it["hello"]["is_calibrated"] == true);
    let shown = stand.plumb(&format!("show {BOX}/box.plb")).output().unwrap();
    let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
    assert!(shown.contains("pitch_mm = 12.01"), "the box is told what was measured: {shown}");

    // The scene.
    the_box.show(Shown::Standing);
    page.act(BOX, "scene_measure", "scene/measure", &json!({ "seconds": 2 }));
    let it = page.wait(BOX, "a scene", |it| !it["scene"].is_null() || !it["failed"].is_null());
    assert!(it["scene"]["spread_mm"].as_f64() < Some(0.5), "{it:#}");
    page.act(BOX, "scene_store", "scene/store", &json!({}));
    let it = page.wait(BOX, "a box with a scene", |it| it["hello"]["has_scene"] == true);
    assert_eq!(it["hello"]["next_step"], "session");

    // The study and its session.
    the_box.show(Shown::Person);
    let supplied = page.get("/api/protocols").json();
    let words = supplied["supplied"].as_array().unwrap().iter().map(|it| &it["word"]);
    assert_eq!(words.collect::<Vec<_>>(), ["mctsib", "stand", "eyes-open-closed"]);
    let text = protocol(6);
    let wrong =
        json!({ "protocol": { "text": text.replace("countdown_s = 1", "countdown_s = -1") } });
    let checked = page.done("/api/protocols/check", &wrong);
    assert!(checked["problem"]["place"].as_str().unwrap().contains("countdown_s"), "{checked}");
    let create =
        json!({ "folder": "stances", "title": "Two stances", "protocol": { "text": text } });
    page.done("/api/studies", &create);
    assert_eq!(page.post("/api/studies", &create).status, 400, "it is there already");
    let named = json!({ "code": "Anna Smith" });
    let refused = page.post("/api/studies/stances/participants", &named);
    assert_eq!(refused.status, 400, "{}", refused.text());
    let participant = json!({ "code": "P01", "age_years": 40, "sex": "female" });
    page.done("/api/studies/stances/participants", &participant);
    page.act(BOX, "examine", "examine", &json!({}));
    page.wait(BOX, "the doctor", |it| !it["examination"].is_null());
    let begin = json!({ "study": "stances", "participant": "P01", "operator": "Op" });
    page.act(BOX, "session_begin", "session/begin", &begin);
    page.happen(BOX, "ready", None);
    page.wait(BOX, "a recording", |it| it["session"]["at"]["is"] == "recording");
    let it = page
        .wait(BOX, "figures", |it| it["live"]["upper"]["figures"]["path_mm"].as_f64() > Some(0.0));
    assert!(!has(&it["can"], "aim_begin"), "nothing else begins: {it:#}");
    let settings = page.get(&format!("/api/boxes/{id}/settings")).json();
    let send = json!({ "settings": { "text": settings["text"] } });
    assert_eq!(page.post(&format!("/api/boxes/{id}/settings/send"), &send).status, 409);
    let mark = json!({ "label": "cough", "at_ms": page.state()["now_ms"] });
    page.done(&format!("/api/boxes/{id}/session/mark"), &mark);
    page.wait(BOX, "the mark", |it| it["session"]["marked"][0]["label"] == "cough");
    // An event of a page that has not seen what happened.
    let outdated = json!({ "step": 0, "event": "end" });
    assert_eq!(page.post(&format!("/api/boxes/{id}/session/event"), &outdated).status, 409);
    page.happen(BOX, "repeat", None);
    for _ in 0..2 {
        page.happen(BOX, "ready", None);
        let it = page.wait(BOX, "a verdict", |it| has(&it["session"]["can"], "accept"));
        // On a busy computer a short trial may have lost its targets.
        let is_needed = it["session"]["at"]["needs_reason"] == true;
        page.happen(BOX, "accept", is_needed.then_some("it is a test"));
    }
    let it = page.wait(BOX, "the end", |it| it["session"]["at"]["is"] == "over");
    let outcomes = it["session"]["trials"].as_array().unwrap().iter().map(|it| &it["outcome"]);
    assert_eq!(outcomes.collect::<Vec<_>>(), ["rejected", "accepted", "accepted"]);
    page.act(BOX, "session_close", "session/close", &json!({}));

    // The reports.
    let details = page.get("/api/studies/stances").json();
    assert_eq!(
        (&details["accepted"], &details["sessions"][0]["state"]),
        (&json!(2), &json!("over"))
    );
    let none = page.get("/reports/stances/P01-1/99-nothing");
    assert!(none.status == 404 && none.text().contains("</html>"), "{}", none.text());
    for path in ["/reports/stances/P01-1/01-eyes-open-2", "/reports/stances"] {
        let report = page.get(path);
        assert!(report.status == 200 && report.text().contains("</html>"), "{}", report.text());
        assert!(report.header("content-security-policy").unwrap().contains("sandbox"));
        let folder = stand.path("desk").canonicalize().unwrap().display().to_string();
        assert!(
            !report.text().contains(&folder),
            "where this computer keeps it: {}",
            report.text()
        );
    }
    // What a session leaves is what `study` reads.
    let study = stand.plumb("study desk/stances/study.toml").output().unwrap();
    assert!(study.status.success(), "{}", String::from_utf8_lossy(&study.stderr));
    desk.interrupt();
}
