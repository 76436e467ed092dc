//! What comes to the desk over a connection: one HTTP request after another, without a network.
//!
//! The first byte chooses a desk that works, or one that only shows the boxes of a ward; the rest are the
//! bytes of the connection, in which the words `$COOKIE` and `$TOKEN` stand for what a page of the desk
//! has.
//!
//! Laws:
//! - Every connection is answered to its end, within a time.
//! - An answer says what is not done, never that the desk has failed (500), and has the headers that
//!   protect the page.
//! - Without the cookie nothing inside is told or done.

use std::convert::Infallible;
use std::fs;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::extract::connect_info::MockConnectInfo;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use plumbline::seal::Key;
use plumbline_bedside::keys::KnownBox;
use plumbline_desk::desk::{Desk, Settings};
use plumbline_desk::http;
use plumbline_desk::wire::BODY_BYTES_MAX;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::runtime::Runtime;

/// A connection, all of whose bytes have come, is answered within this time, on a computer that is busy.
const ANSWERED_WITHIN: Duration = Duration::from_secs(20);

/// The port that the desk is asked at.
const PORT: u16 = 4270;

/// The headers that every answer has.
const HEADERS: [&str; 5] = [
    "content-security-policy",
    "x-content-type-options",
    "x-frame-options",
    "referrer-policy",
    "cache-control",
];

/// Checks the laws for an input.
///
/// # Panics
/// Also where `XDG_DATA_HOME` does not name a temporary folder: the desk keeps there what it remembers.
pub fn check(bytes: &[u8]) {
    thread_local! {
        static RUNTIME: Runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
    }
    let Some((way, bytes)) = bytes.split_first() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let home = home();
    // A new box is looked for in the network: only a desk that refuses to make it is asked.
    let only_shows = way % 2 == 1 || bytes.windows(7).any(|it| it == b"new-box");
    let settings = Settings { folder: folder.path().join("studies"), ..Settings::default() };
    let desk = if only_shows {
        Desk::showing(settings.folder, &[known_box()])
    } else {
        Desk::start(settings)
    };
    let (router, url) =
        http::answers(Arc::new(desk.expect("a desk")), SocketAddr::from(([127, 0, 0, 1], PORT)));
    RUNTIME.with(|runtime| runtime.block_on(connections(router, &url, bytes)));
    fs::remove_dir_all(home).expect("what the desk remembers can be removed");
}

/// Where the desk keeps what it remembers.
fn home() -> PathBuf {
    let home = std::env::var_os("XDG_DATA_HOME").map(PathBuf::from).unwrap_or_default();
    assert!(
        home.starts_with(std::env::temp_dir()),
        "XDG_DATA_HOME must lie in {}: `cargo xtask fuzz` sets it",
        std::env::temp_dir().display()
    );
    home.join("plumbline")
}

fn known_box() -> KnownBox {
    let key = Key::new(std::array::from_fn(|at| at as u8 ^ 0x5A)).expect("a key");
    KnownBox::new(key, Some("ward 3".to_owned()), Some("PL-0001".to_owned()))
}

async fn connections(router: Router, url: &str, bytes: &[u8]) {
    let token = url.rsplit_once('=').map_or("", |(_, token)| token);
    let greeting = format!(
        "GET /?token={token} HTTP/1.1\r\nHost: 127.0.0.1:{PORT}\r\nConnection: close\r\n\r\n"
    );
    let address = SocketAddr::from(([127, 0, 0, 1], 50_000));
    let router = router.layer(MockConnectInfo(address));
    let answer = exchange(router.clone(), greeting.into_bytes()).await;
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let cookie = answer.split("set-cookie: ").nth(1).and_then(|it| it.split(';').next());
    let cookie = cookie.expect("the token gives a cookie").to_owned();
    let bytes = replaced(bytes, b"$COOKIE", cookie.as_bytes());
    let bytes = replaced(&bytes, b"$TOKEN", token.as_bytes());
    let checked = router.layer(from_fn_with_state(Arc::<str>::from(cookie), law));
    exchange(checked, bytes).await;
}

/// The bytes with another word in the place of this one.
fn replaced(bytes: &[u8], word: &[u8], by: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        if bytes[at..].starts_with(word) {
            out.extend(by);
            at += word.len();
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    out
}

/// Sends the bytes over a connection, and returns what comes back until it is closed.
async fn exchange(router: Router, bytes: Vec<u8>) -> Vec<u8> {
    let (mut page, desk) = tokio::io::duplex(1 << 16);
    let mut builder = hyper::server::conn::http1::Builder::new();
    // The end of the bytes is no reason to leave a request unanswered.
    builder.half_close(true);
    let service = TowerToHyperService::new(router);
    let serve = builder.serve_connection(TokioIo::new(desk), service).with_upgrades();
    let talk = async move {
        let mut answer = Vec::new();
        let (mut reader, mut writer) = tokio::io::split(&mut page);
        let write = async move {
            // It may close the connection before everything was sent.
            let _ = writer.write_all(&bytes).await;
            let _ = writer.shutdown().await;
        };
        let read = reader.read_to_end(&mut answer);
        let (_, read) = tokio::join!(write, read);
        read.expect("memory can be read");
        answer
    };
    let both = async {
        // What cannot be understood is an error of the connection, after an answer that says so.
        let (_, answer) = tokio::join!(serve, talk);
        answer
    };
    tokio::time::timeout(ANSWERED_WITHIN, both).await.expect("it is answered within a time")
}

/// What holds for every request that was understood, and its answer.
async fn law(
    axum::extract::State(cookie): axum::extract::State<Arc<str>>,
    request: Request,
    next: Next,
) -> Result<Response, Infallible> {
    let path = request.uri().path().to_owned();
    let line = format!("{} {path}", request.method());
    let mut cookies = request.headers().get_all("cookie").iter();
    let has_cookie =
        cookies.any(|it| it.as_bytes().windows(cookie.len()).any(|it| it == cookie.as_bytes()));
    let response = next.run(request).await;
    let status = response.status();
    assert_ne!(status.as_u16(), 500, "{line}: the desk has failed");
    for name in HEADERS {
        assert!(response.headers().contains_key(name), "{line}: {status} without {name}");
    }
    let is_inside = path.starts_with("/api/") || path.starts_with("/reports/") || path == "/ws";
    let is_door = path == "/api/hello" || path == "/api/login";
    assert!(
        has_cookie || !is_inside || is_door || status.is_client_error(),
        "{line}: {status} without the cookie"
    );
    Ok(response)
}

/// Requests as the page sends them.
pub fn seeds() -> Vec<Vec<u8>> {
    let get = |path: &str| {
        format!("GET {path} HTTP/1.1\r\nHost: localhost:{PORT}\r\nCookie: $COOKIE\r\n\r\n")
    };
    let post = |path: &str, body: &str| {
        format!(
            "POST {path} HTTP/1.1\r\nHost: localhost:{PORT}\r\nOrigin: http://localhost:{PORT}\r\n\
             Cookie: $COOKIE\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        )
    };
    let id = known_box().key.id().to_string();
    let act = |action: &str, body: &str| post(&format!("/api/boxes/{id}/{action}"), body);
    let study = r#"{"folder": "a-study", "title": "A study", "protocol": {"supplied": "stand"}}"#;
    let text = r#"{"protocol": {"text": "title = \"x\"\n"}}"#;
    let fields = r#"{"protocol": {"fields": {"title": "x", "condition": []}}}"#;
    let row = r#"{"code": "P01", "group": "control"}"#;
    let settings = r#"{"settings": {"text": "[links]\nudp = \"10.0.0.1:4210\"\n"}}"#;
    let works = [
        get("/?token=$TOKEN"),
        get("/api/hello") + &get("/api/state") + &get("/api/studies") + &get("/api/protocols"),
        get("/") + &get("/app.js") + &get("/../x"),
        post("/api/login", r#"{"password": "x"}"#),
        post("/api/logout", "{}") + &get("/api/state"),
        post("/api/protocols/check", text) + &post("/api/protocols/check", fields),
        post("/api/settings/check", settings),
        post("/api/studies", study)
            + &get("/api/studies/a-study")
            + &post("/api/studies/a-study/participants", row)
            + &post("/api/studies/a-study/protocol", text)
            + &get("/reports/a-study"),
        get("/api/prints") + &get("/api/prints/targets.svg") + &get("/api/prints/board-a4.pdf"),
        post("/api/prints", r#"{"targets": null}"#),
        act("aim/begin", r#"{"reduction": 4}"#),
        act("session/mark", r#"{"label": "stands", "at_ms": 1e300}"#),
        get("/reports/a-study/P01-2026-01-02/01") + &act("card/config.plc", "{}"),
        format!(
            "GET /ws HTTP/1.1\r\nHost: localhost:{PORT}\r\nOrigin: http://localhost:{PORT}\r\n\
             Cookie: $COOKIE\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        ),
        format!("GET /api/state HTTP/1.1\r\nHost: elsewhere:{PORT}\r\n\r\n"),
        format!(
            "POST /api/studies HTTP/1.1\r\nHost: localhost:{PORT}\r\nOrigin: http://localhost:{PORT}\
             \r\nCookie: $COOKIE\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n\
             2\r\n{{}}\r\n0\r\n\r\n"
        ),
        format!(
            "POST /api/studies HTTP/1.1\r\nHost: localhost:{PORT}\r\nContent-Length: {}\r\n\r\n",
            BODY_BYTES_MAX + 1
        ),
    ];
    let shows = [
        get("/api/state") + &get("/api/new-box") + &post("/api/new-box", "{}"),
        get(&format!("/api/boxes/{id}/picture.jpeg?number=1"))
            + &get(&format!("/api/boxes/{id}/settings"))
            + &get(&format!("/api/boxes/{id}/card"))
            + &get(&format!("/api/boxes/{id}/photographs/1.png"))
            + &get(&format!("/api/boxes/{id}/calibration/plot.svg")),
        act("examine", "{}") + &act("reference", "{}") + &act("scene/store", "{}"),
        act("aim/begin", r#"{"reduction": 4, "force": true}"#)
            + &act("aim/expose", r#"{"store": true}"#)
            + &act("aim/cancel", "{}")
            + &act("aim/end", "{}"),
        act("photographs/begin", r#"{"board": [9, 8], "pitch_mm": 25.5}"#)
            + &act("photographs/take", "{}")
            + &act("photographs/auto", r#"{"count": 3, "every_s": 1.5}"#)
            + &act("photographs/pause", "{}")
            + &act("photographs/remove", r#"{"number": 1}"#),
        act("calibration/fit", "{}")
            + &act("calibration/deliver", r#"{"targets": "a.toml"}"#)
            + &act("scene/measure", r#"{"seconds": 2.5, "camera_pitch_deg": -5.0}"#)
            + &act("settings/send", settings),
        act("session/begin", r#"{"study": "a-study", "participant": "P01", "operator": "x"}"#)
            + &act("session/resume", r#"{"study": "a-study", "session": "P01-2026-01-02"}"#)
            + &act("session/event", r#"{"step": 1, "event": "accept", "why": "x"}"#)
            + &act("session/mark", r#"{"label": "stands"}"#)
            + &act("session/close", "{}"),
    ];
    let works = works.into_iter().map(|it| [&[0], it.as_bytes()].concat());
    works.chain(shows.into_iter().map(|it| [&[1], it.as_bytes()].concat())).collect()
}
