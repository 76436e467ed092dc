//! The desk's list of boxes, as the gateway serves it.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

use crate::bench::{Bench, wait_for};
use crate::boxes::Boxes;

/// An answer of the page's server: its status, its cookie, and its body.
fn asked(host: &str, request: &str, headers: &str, body: &str) -> (String, Option<String>, String) {
    let mut stream = TcpStream::connect(host).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let length = body.len();
    let text = format!(
        "{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}Content-Length: {length}\r\n\
         \r\n{body}"
    );
    stream.write_all(text.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    let cookie = head.lines().find_map(|line| {
        let (name, value) = line.split_once(": ")?;
        let is_cookie = name.eq_ignore_ascii_case("set-cookie");
        is_cookie.then(|| value.split(';').next().unwrap().to_owned())
    });
    (head.lines().next().unwrap().to_owned(), cookie, body.to_owned())
}

#[test]
fn the_page_shows_the_boxes_and_does_nothing_with_them() {
    let Some(bench) = Bench::new(2) else { return };
    let boxes = Boxes::switch_on(1, bench.host, 7);
    boxes.stream(u32::MAX);
    let gateway = bench.gateway("--page --page-port 0");
    gateway.wait_until_it_says("?token=");
    let said = gateway.said();
    let url = said.lines().find_map(|it| it.strip_prefix("the ward's boxes: http://")).unwrap();
    let (host, path) = url.split_once('/').unwrap();
    let (status, _, _) = asked(host, "GET /api/state", "", "");
    assert!(status.contains("401"), "{status}");
    let (_, cookie, _) = asked(host, &format!("GET /{path}"), "", "");
    let cookie = format!("Cookie: {}\r\n", cookie.expect("a cookie"));
    let mut state = Value::Null;
    wait_for("the list", || {
        let (_, _, body) = asked(host, "GET /api/state", &cookie, "");
        // The body may come in chunks.
        let json = &body[body.find('{').unwrap()..=body.rfind('}').unwrap()];
        state = serde_json::from_str(json).unwrap();
        let first = &state["boxes"][0];
        first["link"]["is"] == "heard" && first["examination"].is_object()
    });
    let [heard, away] = [&state["boxes"][0], &state["boxes"][1]];
    assert_eq!((&heard["name"], &heard["serial_number"]), (&"bed 0".into(), &"PL-0000".into()));
    assert_eq!(heard["health"]["camera"], "running");
    assert!(heard["live"]["rate_hz"].as_f64() > Some(10.0), "{heard}");
    assert!(heard["examination"]["checks"].as_array().unwrap().len() > 5);
    assert_eq!(away["link"]["is"], "searching");
    assert!(away["link"]["problem"]["remedy"].is_string(), "{away}");
    assert_eq!(heard["can"], Value::Array(Vec::new()));
    // Whatever would do something is refused.
    let id = heard["id"].as_str().unwrap();
    let headers = format!("{cookie}Origin: http://{host}\r\nContent-Type: application/json\r\n");
    for route in
        [format!("/api/boxes/{id}/aim/begin"), "/api/new-box".into(), "/api/studies".into()]
    {
        let (status, _, body) = asked(host, &format!("POST {route}"), &headers, "{}");
        assert!(status.contains("409") && body.contains("gateway"), "{route}: {status} {body}");
    }
    gateway.end();
}
