//! Requests that are not the page's: nothing is told, and nothing begins.

use std::io::{Read as _, Write as _};

use serde_json::json;

use super::client::{Answer, Page, connect, exchange, hear, say};
use crate::stand::{PATIENCE, Stand};

/// Headers and their values.
type Others<'a> = &'a [(&'a str, &'a str)];

/// A request like the page's, in which these headers are others; an empty one is left out.
fn with(page: &Page, method: &str, path: &str, body: &[u8], others: Others<'_>) -> Answer {
    let mut head = page.head(method, path, body);
    for (name, value) in others {
        head.retain(|line| !line.starts_with(&format!("{name}: ")));
        if !value.is_empty() {
            head.push(format!("{name}: {value}"));
        }
    }
    exchange(connect(page.port), &head, body)
}

#[test]
fn whoever_is_not_the_page_gets_nothing_and_begins_nothing() {
    let Some(stand) = Stand::new() else { return };
    stand.ready_box("PL-0001");
    let desk = stand.desk();
    let page = desk.page();
    let port = page.port;
    let create = json!({ "folder": "forged", "title": "F", "protocol": { "supplied": "mctsib" } });
    let create = create.to_string().into_bytes();
    let (local, named) = (format!("localhost:{port}"), format!("http://localhost:{port}"));
    let rebound = format!("evil.example:{port}");
    let other_port = format!("http://127.0.0.1:{}", port - 1);
    let cases: [(&str, Others<'_>, u16); 13] = [
        ("another origin", &[("Origin", "https://evil.example")], 403),
        ("another port of this computer", &[("Origin", &other_port)], 403),
        ("an origin that is not told", &[("Origin", "null")], 403),
        ("no origin", &[("Origin", "")], 403),
        ("DNS rebinding", &[("Host", &rebound)], 421),
        (
            "rebinding with its own origin",
            &[("Host", &rebound), ("Origin", "http://evil.example")],
            421,
        ),
        ("another port", &[("Host", "127.0.0.1:1")], 421),
        ("no cookie", &[("Cookie", "")], 401),
        ("another cookie", &[("Cookie", "plumbline-desk=0000")], 401),
        ("a form", &[("Content-Type", "application/x-www-form-urlencoded")], 415),
        ("a form of text", &[("Content-Type", "text/plain")], 415),
        ("no type", &[("Content-Type", "")], 415),
        ("a page of the same site", &[("Sec-Fetch-Site", "same-site")], 403),
    ];
    for (what, others, status) in cases {
        let answer = with(&page, "POST", "/api/studies", &create, others);
        assert_eq!(answer.status, status, "{what}: {}", answer.text());
        assert!(answer.header("access-control-allow-origin").is_none());
    }
    for path in ["/api/state", "/reports/x", "/api/studies", "/ws", "/api/boxes/x/picture.jpeg"] {
        let answer = with(&page, "GET", path, &[], &[("Cookie", "")]);
        assert_eq!(answer.status, 401, "{path}: {}", answer.text());
        let answer = with(&page, "GET", path, &[], &[("Host", &rebound), ("Origin", "")]);
        assert_eq!(answer.status, 421, "{path}: {}", answer.text());
    }
    // A wrong token signs nobody in.
    let answer = with(&page, "GET", "/?token=0123", &[], &[("Cookie", ""), ("Origin", "")]);
    assert_eq!((answer.status, answer.header("set-cookie")), (303, None));
    // Nothing has begun; the page itself, under the desk's other name, may begin it.
    assert_eq!(page.get("/api/studies").json()["list"], json!([]));
    let own = [("Host", &*local), ("Origin", &*named)];
    let answer = with(&page, "POST", "/api/studies", &create, &own);
    assert_eq!(answer.status, 200, "{}", answer.text());

    // Every answer keeps scripts and frames of others out.
    let index = page.get("/");
    let policy = index.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"));
    assert!(!policy.contains("unsafe") && index.header("x-frame-options") == Some("DENY"));
    assert!(!index.text().contains("<script>"), "no script within the page");
}

#[test]
fn what_makes_no_sense_is_refused_with_its_place() {
    let Some(stand) = Stand::new() else { return };
    stand.ready_box("PL-0001");
    let desk = stand.desk();
    let page = desk.page();
    for (body, status) in [
        (&b""[..], 400),
        (b"{", 400),
        (b"[]", 400),
        (b"{\"folder\": 3}", 400),
        (b"{\"folder\": \"a\", \"title\": \"T\", \"protocol\": {\"supplied\": \"no\"}}", 400),
        (b"{\"folder\": \"../a\", \"title\": \"T\", \"protocol\": {\"supplied\": \"stand\"}}", 400),
        (b"{\"folder\": \"a\", \"title\": \"T\", \"protocol\": {\"supplied\": \"stand\"}, \"x\": 1}", 400),
        (b"\xff\xfe", 400),
    ] {
        let answer = with(&page, "POST", "/api/studies", body, &[]);
        assert_eq!(answer.status, status, "{}", answer.text());
        let problem = answer.json();
        assert!(problem["place"].is_string() && problem["remedy"].is_string(), "{problem}");
    }
    let long = vec![b' '; 300 * 1024];
    assert_eq!(with(&page, "POST", "/api/studies", &long, &[]).status, 413);
    for path in ["..%2f..%2fetc", "%2e%2e", ".hidden", "a%00b", "none"] {
        for route in [format!("/api/studies/{path}"), format!("/reports/{path}")] {
            let answer = page.get(&route);
            assert!(matches!(answer.status, 400 | 404), "{route}: {}", answer.text());
        }
    }
    assert_eq!(page.get("/..%2fCargo.toml").status, 404);
    assert_eq!(page.get("/../Cargo.toml").status, 404);
    assert_eq!(page.post("/api/boxes/none/examine", &json!({})).status, 404);
    let id = page.the_box("PL-0001")["id"].as_str().unwrap().to_owned();
    assert_eq!(page.post(&format!("/api/boxes/{id}/explode"), &json!({})).status, 404);
    // The box is not there.
    let answer = page.post(&format!("/api/boxes/{id}/aim/begin"), &json!({}));
    assert!(answer.status == 409 && answer.text().contains("not heard"), "{}", answer.text());

    // Messages.
    let foreign = page.socket_with("https://evil.example", Some(&page.cookie));
    assert!(foreign.is_err(), "a socket of another page");
    let origin = format!("http://127.0.0.1:{}", page.port);
    assert!(page.socket_with(&origin, None).is_err(), "a socket without a cookie");
    let mut socket = page.socket();
    hear(&mut socket, "state");
    say(&mut socket, &json!({ "is": "ping", "page_ms": 1.5 }));
    assert_eq!(hear(&mut socket, "pong")["page_ms"], 1.5);
    for wrong in [
        json!({}),
        json!({ "is": "explode" }),
        json!({ "is": "watch", "box": 3 }),
        json!({ "is": "watch", "box": "none" }),
        json!({ "is": "ack", "batch": 77 }),
        json!({ "is": "ping", "page_ms": 1, "more": true }),
    ] {
        say(&mut socket, &wrong);
        let refused = hear(&mut socket, "refused");
        assert!(refused["problem"]["found"].is_string(), "{wrong}: {refused}");
    }
    // A page that says nothing else is disconnected.
    for _ in 0..10 {
        let _ = socket.send(tungstenite::Message::text("?"));
    }
    while socket.read().is_ok() {}
    let mut socket = page.socket();
    let _ = socket.send(tungstenite::Message::text("x".repeat(100_000)));
    while socket.read().is_ok() {}
    // It still answers.
    assert_eq!(page.get("/api/hello").json()["signed_in"], true);
    // No more pages than there is room for; a place is free again at once.
    let sockets: Vec<_> = (0..16).map(|_| page.socket()).collect();
    assert!(page.socket_with(&origin, Some(&page.cookie)).is_err(), "a page too many");
    drop(sockets);
    let start = std::time::Instant::now();
    while page.socket_with(&origin, Some(&page.cookie)).is_err() {
        assert!(start.elapsed() < PATIENCE, "no place becomes free");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    desk.interrupt();
}

#[test]
fn whoever_connects_and_asks_nothing_keeps_no_page_out_and_is_shut_out() {
    let Some(stand) = Stand::new() else { return };
    stand.ready_box("PL-0001");
    let desk = stand.desk();
    let page = desk.page();
    let mut socket = page.socket();
    hear(&mut socket, "state");
    // Many more than there is room for; half of them have begun to ask.
    let mut idle: Vec<_> = (0..300).map(|_| connect(page.port)).collect();
    for stream in idle.iter_mut().step_by(2) {
        // It may have been closed already.
        let _ = stream.write_all(b"GET /api/hello HTTP/1.1\r\nHost: ");
    }
    for _ in 0..50 {
        assert_eq!(page.get("/api/state").status, 200);
        idle.push(connect(page.port));
    }
    say(&mut socket, &json!({ "is": "ping", "page_ms": 1.5 }));
    assert_eq!(hear(&mut socket, "pong")["page_ms"], 1.5);
    let is_closed = |stream: &mut std::net::TcpStream| {
        let mut nothing = Vec::new();
        let _ = stream.read_to_end(&mut nothing);
        nothing.is_empty()
    };
    assert!(is_closed(&mut idle[0]), "the first has given way");
    idle.clear();
    // One that says nothing, one that begins to ask, and one that was answered and begins to ask.
    let [mut silent, mut slow, mut answered] = [(); 3].map(|()| connect(page.port));
    slow.write_all(b"GET /api/hello HTTP/1.1\r\n").unwrap();
    let head = format!("GET /api/hello HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", page.port);
    answered.write_all(head.as_bytes()).unwrap();
    let mut bytes = [0; 4096];
    assert!(answered.read(&mut bytes).unwrap() > 0 && bytes.starts_with(b"HTTP/1.1 200"));
    answered.write_all(b"GET /api/hello HTTP/1.1\r\n").unwrap();
    assert!(is_closed(&mut silent), "a silent connection is closed");
    for slow in [&mut slow, &mut answered] {
        let mut more = Vec::new();
        let _ = slow.read_to_end(&mut more);
        assert!(!String::from_utf8_lossy(&more).contains(" 200 "), "a slow connection is closed");
    }
    let said = desk.interrupt();
    assert!(said.contains("connections had to give way to others: 64 are open"), "{said}");
}
