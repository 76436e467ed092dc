//! From paper to a box that is heard, and its settings: the sheets, a new box and its card, what is
//! refused.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::client::{Page, connect, exchange, has};
use crate::camera::{RATE_HZ, Shown, TheBox};
use crate::stand::Stand;

const BOX: &str = "PL-0001";

/// The fields of a new box, as the page fills them in.
fn fields(page: &Page, name: &str, serial_number: &str) -> Value {
    let form = page.get("/api/new-box").json();
    let mut fields = form["settings"]["fields"].clone();
    fields["device"] = json!(name);
    fields["serial_number"] = json!(serial_number);
    fields["capture"]["rate_hz"] = json!(RATE_HZ);
    fields["links"]["udp"] = form["addresses"][0].clone();
    fields
}

fn request(fields: &Value) -> Value {
    json!({ "settings": { "fields": fields }, "size_px": [640, 480] })
}

/// Makes a new box, and puts its two files where the box's program takes them from.
#[track_caller]
pub fn new_box(stand: &Stand, page: &Page, name: &str, serial_number: &str) -> PathBuf {
    let made = page.done("/api/new-box", &request(&fields(page, name, serial_number)));
    let folder = stand.path(serial_number);
    std::fs::create_dir(&folder).unwrap();
    fetch_card(page, made["id"].as_str().unwrap(), &folder);
    folder
}

/// Downloads the files of a card.
#[track_caller]
fn fetch_card(page: &Page, id: &str, folder: &Path) {
    for (name, kept) in [("config.plb", "box.plb"), ("box.key", "box.key")] {
        let answer = page.post(&format!("/api/boxes/{id}/card/{name}"), &json!({}));
        assert_eq!(answer.status, 200, "{name}: {}", answer.text());
        assert_eq!(answer.header("cache-control"), Some("no-store"));
        let kept_as = answer.header("content-disposition").unwrap();
        assert!(kept_as.contains("attachment") && kept_as.contains(name), "{kept_as}");
        std::fs::write(folder.join(kept), &answer.body).unwrap();
    }
}

#[test]
fn the_sheets_are_those_of_the_command_line_and_what_was_measured_is_kept() {
    let Some(stand) = Stand::new() else { return };
    let desk = stand.desk();
    let page = desk.page();
    for (arguments, file) in [
        ("--standard", "pair-a4.pdf"),
        ("--standard --paper letter", "pair-letter.pdf"),
        ("--grid 9x6 --pitch-mm 20 --name board --role scene", "board-a4.pdf"),
    ] {
        let rest = format!("--out {file} --targets {file}.toml");
        let output = stand.plumb(&format!("target {arguments} {rest}")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let answer = page.get(&format!("/api/prints/{file}"));
        assert_eq!(answer.header("content-type"), Some("application/pdf"));
        assert!(answer.body == std::fs::read(stand.path(file)).unwrap(), "{file}");
    }
    assert!(page.get("/api/prints/board.svg").text().starts_with("<svg"));
    for none in ["none-a4.pdf", "pair-a3.pdf", "pair.png", "pair", "..%2ftargets.toml"] {
        assert_eq!(page.get(&format!("/api/prints/{none}")).status, 404, "{none}");
    }

    let prints = page.get("/api/prints").json();
    let text = |file: &str| std::fs::read_to_string(stand.path(file)).unwrap();
    let same = format!("{}\n{}", text("pair-a4.pdf.toml"), text("board-a4.pdf.toml"));
    assert_eq!(prints["text"].as_str().unwrap().trim(), same.trim());
    let names = prints["targets"].as_array().unwrap().iter().map(|it| &it["name"]);
    assert_eq!(names.collect::<Vec<_>>(), ["lumbar", "shoulder", "board"]);
    for (choice, place) in [
        (json!({ "pitches_mm": { "board": 0 } }), "pitch_mm"),
        (json!({ "pitches_mm": { "back": 12 } }), "pitches_mm"),
        (json!({ "text": "[[target]]\nname = \"a\"" }), "the targets"),
        (json!({ "text": "" }), "target"),
    ] {
        let refused = page.post("/api/prints", &choice);
        assert_eq!(refused.status, 400, "{choice}");
        let problem = refused.json();
        assert!(problem["place"].as_str().unwrap().contains(place), "{problem}");
        assert!(!problem["remedy"].as_str().unwrap().is_empty(), "{problem}");
    }
    assert_eq!(page.get("/api/prints").json(), prints, "nothing has changed");
    let measured = page.done("/api/prints", &json!({ "pitches_mm": { "board": 20.05 } }));
    assert_eq!(measured["targets"][2]["pitch_mm"], json!(20.05), "{measured}");
    assert!(text("desk/targets.toml").contains("20.05"));
    desk.interrupt();
}

#[test]
fn a_new_box_is_made_whole_or_not_at_all() {
    let Some(stand) = Stand::new() else { return };
    let desk = stand.desk();
    let page = desk.page();
    let keys = || {
        let output = stand.plumb("keys list").output().unwrap();
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let good = fields(&page, "ward 1", BOX);
    for (path, value, place) in [
        ("/device", json!(""), "device"),
        ("/device", json!("a name of more than 24 bytes"), "device"),
        ("/serial_number", json!("0"), "serial_number"),
        ("/capture/rate_hz", json!("sixty"), "rate_hz"),
        ("/capture", Value::Null, "capture"),
        ("/links/udp", json!("192.168.1.20"), "links.udp"),
        ("/links/udp", Value::Null, "links"),
        ("/machine/watchdog_s", json!(601), "watchdog_s"),
    ] {
        let mut bad = good.clone();
        *bad.pointer_mut(path).unwrap() = value;
        let refused = page.post("/api/new-box", &request(&bad));
        assert_eq!(refused.status, 400, "{path}: {}", refused.text());
        let problem = refused.json();
        assert!(problem["place"].as_str().unwrap().ends_with(place), "{path}: {problem}");
        assert!(!problem["remedy"].as_str().unwrap().is_empty(), "{problem}");
    }
    let mut no_size = request(&good);
    no_size["size_px"] = json!([0, 480]);
    let refused = page.post("/api/new-box", &no_size);
    assert!(refused.status == 400 && refused.text().contains("size of the frames"), "{refused:?}");
    assert_eq!(page.state()["boxes"], json!([]), "nothing is half made");
    assert!(!keys().contains("PL-"), "{}", keys());
    assert!(!stand.path("desk/boxes").exists());

    let id = page.done("/api/new-box", &request(&good))["id"].as_str().unwrap().to_owned();
    let it = page.the_box(BOX);
    assert_eq!((&it["id"], &it["has_card"]), (&json!(id), &json!(true)), "{it:#}");
    assert_eq!(it["link"]["is"], "searching");
    for (name, number, place) in [
        ("ward 1", BOX, "serial_number"),
        ("ward 2", BOX, "serial_number"),
        ("ward 1", "PL-2", "device"),
    ] {
        let refused = page.post("/api/new-box", &request(&fields(&page, name, number)));
        assert_eq!(refused.status, 409, "{name} {number}: {}", refused.text());
        let problem = refused.json();
        assert!(problem["place"].as_str().unwrap().ends_with(place), "{problem}");
    }
    assert_eq!(page.state()["boxes"].as_array().unwrap().len(), 1);

    // The key, to nobody but the desk's own page.
    let path = format!("/api/boxes/{id}/card/box.key");
    for (name, value, status) in [
        ("Cookie", "", 401),
        ("Origin", "", 403),
        ("Origin", "https://evil.example", 403),
        ("Host", "evil.example", 421),
        ("Content-Type", "text/plain", 415),
        ("Sec-Fetch-Site", "same-site", 403),
    ] {
        let mut head = page.head("POST", &path, b"{}");
        head.retain(|line| !line.starts_with(&format!("{name}: ")));
        if !value.is_empty() {
            head.push(format!("{name}: {value}"));
        }
        let answer = exchange(connect(page.port), &head, b"{}");
        assert_eq!(answer.status, status, "{name}: {}", answer.text());
        assert!(!answer.text().contains("PLUMBLINE-KEY"));
    }
    assert_eq!(page.get(&path).status, 405);
    assert_eq!(page.post(&path.replace("box.key", "box.toml"), &json!({})).status, 404);
    assert_eq!(page.post(&path.replace(&id, "0000000000000000"), &json!({})).status, 404);
    let key = page.post(&path, &json!({})).text();
    let exported = stand.plumb(&format!("keys export {BOX} --anyway")).output().unwrap();
    assert_eq!(key, String::from_utf8_lossy(&exported.stdout));

    // A box that was never heard can be corrected: it keeps its number and its key.
    let card = page.get(&format!("/api/boxes/{id}/card")).json();
    let mut again = card["settings"]["fields"].clone();
    assert_eq!((&again["device"], &card["size_px"]), (&json!("ward 1"), &json!([640, 480])));
    again["device"] = json!("ward 7");
    let mut corrected = request(&again);
    corrected["replaces"] = json!(id);
    assert_eq!(page.done("/api/new-box", &corrected)["id"], json!(id));
    assert!(page.the_box(BOX)["name"].as_str().unwrap().contains("ward 7"));
    assert!(keys().contains("ward 7") && !keys().contains("ward 1"), "{}", keys());
    assert_eq!(page.post(&path, &json!({})).text(), key);
    corrected["settings"]["fields"]["serial_number"] = json!("PL-0009");
    assert_eq!(page.post("/api/new-box", &corrected).status, 400);
    desk.interrupt();
    // It is looked for in the next run, too.
    let desk = stand.desk();
    assert_eq!(desk.page().the_box(BOX)["has_card"], true);
    desk.interrupt();
}

#[test]
fn a_box_that_is_there_gets_other_settings() {
    let Some(stand) = Stand::new() else { return };
    let desk = stand.desk();
    let page = desk.page();
    let folder = new_box(&stand, &page, "ward 1", BOX);
    let _the_box = TheBox::start(&folder, Shown::Standing, RATE_HZ);
    let it = page.wait(BOX, "the box", |it| it["doing"] == "watching");
    let id = it["id"].as_str().unwrap().to_owned();
    assert_eq!(it["has_card"], false, "{it:#}");
    let refused = page.post(&format!("/api/boxes/{id}/card/box.key"), &json!({}));
    assert_eq!(refused.status, 409, "{}", refused.text());
    assert!(!refused.text().contains("PLUMBLINE-KEY"), "the key is not given away any more");

    // What it runs with is what it was made with.
    let view = page.get(&format!("/api/boxes/{id}/settings")).json();
    let (text, mut fields) = (view["text"].as_str().unwrap(), view["fields"].clone());
    let shown = stand.plumb("show PL-0001/box.plb").output().unwrap();
    assert!(String::from_utf8_lossy(&shown.stdout).contains(text), "{text}");
    fields["capture"]["exposure_us"] = json!(-4);
    let checked = page.done("/api/settings/check", &json!({ "settings": { "fields": fields } }));
    assert!(checked["problem"]["place"].as_str().unwrap().ends_with("exposure_us"), "{checked}");
    let send = format!("/api/boxes/{id}/settings/send");
    let refused = page.post(&send, &json!({ "settings": { "fields": fields } }));
    assert_eq!(refused.status, 400, "{}", refused.text());

    // Another number, or an address at which nobody would hear it, is refused before anything is sent.
    fields["capture"]["exposure_us"] = json!(3500);
    for (path, value, place) in [
        ("/serial_number", json!("PL-0009"), "serial_number"),
        ("/links/udp", json!("127.0.0.1:9"), "links"),
    ] {
        let mut bad = fields.clone();
        *bad.pointer_mut(path).unwrap() = value;
        let body = json!({ "settings": { "fields": bad } });
        page.act(BOX, "settings_send", "settings/send", &body);
        let it = page.wait(BOX, "the refusal", |it| !it["failed"].is_null());
        assert!(it["failed"]["place"].as_str().unwrap().ends_with(place), "{it:#}");
        page.wait(BOX, "the box", |it| it["doing"] == "watching");
    }
    let before = page.the_box(BOX)["hello"]["configuration"].clone();
    fields["device"] = json!("ward 2");
    fields["trigger"] = json!({ "chip": "pinctrl-bcm2711", "line": 17, "debounce_us": 5000 });
    let body = json!({ "settings": { "fields": fields } });
    page.act(BOX, "settings_send", "settings/send", &body);
    let it = page.wait(BOX, "a box that has restarted", |it| {
        it["hello"]["configuration"] != before && has(&it["can"], "settings_send")
    });
    assert_eq!(it["hello"]["device"], "ward 2", "{it:#}");
    let view = page.get(&format!("/api/boxes/{id}/settings")).json();
    assert_eq!(view["fields"]["capture"]["exposure_us"], 3500);
    assert_eq!(view["fields"]["trigger"]["debounce_us"], 5000);
    let list = stand.plumb("keys list").output().unwrap();
    assert!(String::from_utf8_lossy(&list.stdout).contains("ward 2"));
    desk.interrupt();
}
