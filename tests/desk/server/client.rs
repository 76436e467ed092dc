//! A page, as the server sees it: requests, and a WebSocket.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

use crate::stand::{Desk, PATIENCE};

/// An answer.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// The value of a header.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(": ")?;
            key.eq_ignore_ascii_case(name).then_some(value)
        })
    }
}

impl Desk {
    /// A page that is signed in.
    pub fn page(&self) -> Page {
        Page::open(&self.url)
    }
}

/// Sends a request with these headers over a connection, which ends with it.
pub fn exchange(mut stream: impl Read + Write, head: &[String], body: &[u8]) -> Answer {
    let request = format!("{}\r\n\r\n", head.join("\r\n"));
    stream.write_all(request.as_bytes()).unwrap();
    // A server that refuses need not read the rest.
    let _ = stream.write_all(body);
    let _ = stream.flush();
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    let end = bytes.windows(4).position(|it| it == b"\r\n\r\n");
    let end = end.unwrap_or_else(|| panic!("no answer: {}", String::from_utf8_lossy(&bytes)));
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    let mut body = bytes.split_off(end + 4);
    let is_chunked = head.to_ascii_lowercase().contains("transfer-encoding: chunked");
    if is_chunked {
        body = unchunked(&body);
    }
    Answer { status, head, body }
}

fn unchunked(mut bytes: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    while let Some(end) = bytes.windows(2).position(|it| it == b"\r\n") {
        let length = std::str::from_utf8(&bytes[..end]).unwrap();
        let length = usize::from_str_radix(length.trim(), 16).unwrap();
        whole.extend_from_slice(&bytes[end + 2..end + 2 + length]);
        bytes = &bytes[end + 4 + length..];
    }
    whole
}

/// A page that is signed in.
#[derive(Debug, Clone)]
pub struct Page {
    pub port: u16,
    pub cookie: String,
}

impl Page {
    /// Opens the address that the desk has printed.
    pub fn open(url: &str) -> Self {
        let rest = url.strip_prefix("http://127.0.0.1:").unwrap();
        let (port, path) = rest.split_once('/').unwrap();
        let port = port.parse().unwrap();
        let head = [
            format!("GET /{path} HTTP/1.1"),
            format!("Host: 127.0.0.1:{port}"),
            "Connection: close".to_owned(),
        ];
        let answer = exchange(connect(port), &head, &[]);
        assert_eq!((answer.status, answer.header("location")), (303, Some("/")), "{answer:?}");
        let cookie = answer.header("set-cookie").unwrap();
        assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
        Self { port, cookie: cookie.split(';').next().unwrap().to_owned() }
    }

    /// The headers of a request of a page.
    pub fn head(&self, method: &str, path: &str, body: &[u8]) -> Vec<String> {
        vec![
            format!("{method} {path} HTTP/1.1"),
            format!("Host: 127.0.0.1:{}", self.port),
            format!("Origin: http://127.0.0.1:{}", self.port),
            format!("Cookie: {}", self.cookie),
            "Content-Type: application/json".to_owned(),
            format!("Content-Length: {}", body.len()),
            "Connection: close".to_owned(),
        ]
    }

    pub fn get(&self, path: &str) -> Answer {
        exchange(connect(self.port), &self.head("GET", path, &[]), &[])
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let body = body.to_string().into_bytes();
        let answer = exchange(connect(self.port), &self.head("POST", path, &body), &body);
        if answer.status >= 400 {
            assert_for_page(&answer.json());
        }
        answer
    }

    /// Posts what has to be accepted.
    #[track_caller]
    pub fn done(&self, path: &str, body: &Value) -> Value {
        let answer = self.post(path, body);
        assert_eq!(answer.status, 200, "{path} {body}: {}", answer.text());
        answer.json()
    }

    pub fn state(&self) -> Value {
        let state = self.get("/api/state").json();
        assert_for_page(&state);
        state
    }

    /// The box with this serial number.
    #[track_caller]
    pub fn the_box(&self, serial_number: &str) -> Value {
        let state = self.state();
        let boxes = state["boxes"].as_array().unwrap().iter();
        let mut boxes = boxes.filter(|it| it["serial_number"] == serial_number);
        boxes.next().unwrap_or_else(|| panic!("no {serial_number}: {state}")).clone()
    }

    /// Waits until the box is so.
    #[track_caller]
    pub fn wait(&self, serial_number: &str, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let it = self.the_box(serial_number);
            if is_so(&it) {
                return it;
            }
            assert!(start.elapsed() < PATIENCE, "{what}: waited in vain: {it:#}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until an action is possible, and asks for it.
    #[track_caller]
    pub fn act(&self, serial_number: &str, can: &str, action: &str, body: &Value) {
        let it = self.wait(serial_number, can, |it| has(&it["can"], can));
        self.done(&format!("/api/boxes/{}/{action}", it["id"].as_str().unwrap()), body);
    }

    /// Waits until an event of its session is possible, and lets it happen.
    #[track_caller]
    pub fn happen(&self, serial_number: &str, event: &str, why: Option<&str>) {
        let it = self.wait(serial_number, event, |it| has(&it["session"]["can"], event));
        let body = json!({ "step": it["session"]["step"], "event": event, "why": why });
        self.done(&format!("/api/boxes/{}/session/event", it["id"].as_str().unwrap()), &body);
    }

    /// Opens a WebSocket.
    pub fn socket(&self) -> WebSocket<TcpStream> {
        let origin = format!("http://127.0.0.1:{}", self.port);
        self.socket_with(&origin, Some(&self.cookie)).unwrap()
    }

    /// The same with another origin, and with or without a cookie.
    #[expect(clippy::result_large_err, reason = "the error is looked at and dropped")]
    pub fn socket_with(
        &self,
        origin: &str,
        cookie: Option<&str>,
    ) -> Result<
        WebSocket<TcpStream>,
        tungstenite::HandshakeError<tungstenite::ClientHandshake<TcpStream>>,
    > {
        let url = format!("ws://127.0.0.1:{}/ws", self.port);
        let mut request = url.into_client_request().unwrap();
        request.headers_mut().insert("origin", origin.parse().unwrap());
        if let Some(cookie) = cookie {
            request.headers_mut().insert("cookie", cookie.parse().unwrap());
        }
        tungstenite::client(request, connect(self.port)).map(|(socket, _)| socket)
    }
}

/// No text for the page names a command or an option: who reads it has no command line.
#[track_caller]
pub fn assert_for_page(said: &Value) {
    match said {
        Value::String(text) => {
            let is_for_terminals = ["plumb ", "--"].iter().any(|it| text.contains(it));
            assert!(!is_for_terminals, "for the command line: {text}");
        }
        Value::Array(list) => list.iter().for_each(assert_for_page),
        Value::Object(fields) => fields.values().for_each(assert_for_page),
        _ => {}
    }
}

/// Whether a list has this word.
pub fn has(list: &Value, word: &str) -> bool {
    list.as_array().is_some_and(|it| it.iter().any(|it| it == word))
}

pub fn connect(port: u16) -> TcpStream {
    let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// Sends a message.
pub fn say(socket: &mut WebSocket<TcpStream>, message: &Value) {
    socket.send(Message::text(message.to_string())).unwrap();
}

/// The next message, if it is one that is meant; others are passed over.
#[track_caller]
pub fn hear(socket: &mut WebSocket<TcpStream>, is: &str) -> Value {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < PATIENCE, "no {is}");
        let heard = match socket.read() {
            // The program was stopped, and goes on.
            Err(tungstenite::Error::Io(error)) if error.kind() == ErrorKind::Interrupted => {
                continue;
            }
            heard => heard.unwrap(),
        };
        if let Message::Text(text) = heard {
            let message: Value = serde_json::from_str(&text).unwrap();
            if message["is"] == is {
                return message;
            }
        }
    }
}
