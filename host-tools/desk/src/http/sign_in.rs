//! Who is signed in: by the token in the address, or by the password; and a cookie from then on.
//!
//! A cookie is 32 random bytes. Of it the desk keeps the digest, with the time until which it holds, from
//! one run to the next: a page comes back by itself when the desk was started again at the same port.
//! The token is new in each run.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::Json;
use axum::extract::{ConnectInfo, State};
use axum::http::header::{COOKIE, SET_COOKIE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};
use sha2::{Digest as _, Sha256};

use super::body::{Failure, Sent};
use super::password::Password;
use super::{App, guard};
use crate::memory::{Memory, SignedIn};
use crate::wire::{Done, Login, SignIn};

/// A cookie holds for this long: a day of work.
const HOLDS_S: i64 = 16 * 3600;

/// The most browsers that are signed in; the oldest has to sign in again.
const SIGNED_IN_MAX: usize = 64;

/// After this many wrong guesses from one address,
const GUESSES_MAX: u32 = 5;

/// none is looked at for this long.
const GUESSES_PAUSE: Duration = Duration::from_secs(60);

/// The most addresses whose guesses are counted.
const GUESSERS_MAX: usize = 1024;

/// The desk's door.
pub struct Gate {
    memory: Arc<Memory>,
    address: SocketAddr,
    names: Vec<String>,
    token: String,
    password: Option<Password>,
    cookie: String,
    guesses: Mutex<HashMap<IpAddr, (u32, Instant)>>,
    /// Passwords are compared one after the other: it takes memory and time.
    comparing: tokio::sync::Semaphore,
}

/// Random bytes as hexadecimal digits.
///
/// # Panics
/// When the operating system has none, without which nobody can be told from anybody else.
fn drawn() -> String {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).expect("the operating system gives random bytes");
    hex(&bytes)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What is kept of a secret; its comparison tells nothing of the secret by the time it takes.
fn digest(secret: &str) -> String {
    hex(&Sha256::digest(secret.as_bytes()))
}

fn now_s() -> i64 {
    jiff::Timestamp::now().as_second()
}

impl Gate {
    /// A door at this address; with a password, for others, by TLS.
    pub fn new(
        memory: Arc<Memory>,
        address: SocketAddr,
        password: Option<Password>,
        computer: &str,
    ) -> Self {
        let secure = if password.is_some() { "secure-" } else { "" };
        Self {
            memory,
            address,
            names: guard::names(computer, address.ip()),
            token: drawn(),
            password,
            // Cookies do not tell ports apart.
            cookie: format!("plumbline-desk-{secure}{}", address.port()),
            guesses: Mutex::default(),
            comparing: tokio::sync::Semaphore::new(1),
        }
    }

    /// Whether pages of other computers may come.
    pub fn is_for_others(&self) -> bool {
        self.password.is_some()
    }

    /// How one signs in.
    pub fn sign_in(&self) -> SignIn {
        if self.is_for_others() { SignIn::Password } else { SignIn::Token }
    }

    /// The same, as a remedy.
    pub fn how_to_sign_in(&self) -> &'static str {
        match self.sign_in() {
            SignIn::Password => "type the password",
            SignIn::Token => "open the address that `plumb desk` has printed",
        }
    }

    /// What a person opens.
    pub fn url(&self) -> String {
        let port = self.address.port();
        match self.sign_in() {
            SignIn::Token => format!("http://127.0.0.1:{port}/?token={}", self.token),
            SignIn::Password => {
                let address = self.address.ip();
                let name = self.names.get(1).map_or("localhost", String::as_str);
                let name =
                    if address.is_unspecified() { name.to_owned() } else { bracketed(address) };
                format!("https://{name}:{port}/")
            }
        }
    }

    /// Whether this is a name of the desk, and its port. A numeric address is nobody's name: it cannot be
    /// made to lead elsewhere.
    pub fn is_host(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.contains(']') => (name, port.parse().ok()),
            _ => (host, Some(if self.is_for_others() { 443 } else { 80 })),
        };
        let name = name.trim_start_matches('[').trim_end_matches(']').to_ascii_lowercase();
        let is_known = match name.parse::<IpAddr>() {
            Ok(address) if self.is_for_others() => !address.is_unspecified(),
            Ok(address) => address.is_loopback(),
            Err(_) if self.is_for_others() => self.names.contains(&name),
            Err(_) => name == "localhost",
        };
        is_known && port == Some(self.address.port())
    }

    /// The origin of the desk's own page at this host.
    pub fn origin(&self, host: &str) -> String {
        let scheme = if self.is_for_others() { "https" } else { "http" };
        format!("{scheme}://{host}")
    }

    /// Whether the token is right: the cookie that a browser gets then.
    pub fn sign_in_by_token(&self, token: &str) -> Option<String> {
        let is_right = !self.is_for_others() && digest(token) == digest(&self.token);
        is_right.then(|| self.new_cookie())
    }

    fn new_cookie(&self) -> String {
        let value = drawn();
        let now_s = now_s();
        self.memory.change_signed_in(|list| {
            list.retain(|it| it.until_s > now_s);
            if list.len() >= SIGNED_IN_MAX {
                list.remove(0);
            }
            list.push(SignedIn { digest: digest(&value), until_s: now_s + HOLDS_S });
        });
        self.header(&value, HOLDS_S)
    }

    fn header(&self, value: &str, holds_s: i64) -> String {
        let secure = if self.is_for_others() { "; Secure" } else { "" };
        let name = &self.cookie;
        format!("{name}={value}; Path=/; Max-Age={holds_s}; HttpOnly; SameSite=Strict{secure}")
    }

    /// The digest of the cookie that a request has.
    fn cookie_of(&self, headers: &HeaderMap) -> Option<String> {
        let all = headers.get_all(COOKIE).iter().filter_map(|it| it.to_str().ok());
        let mut each = all.flat_map(|it| it.split(';')).filter_map(|it| it.trim().split_once('='));
        each.find(|(name, _)| *name == self.cookie).map(|(_, value)| digest(value))
    }

    /// Whether a request has a cookie that holds.
    pub fn is_signed_in(&self, headers: &HeaderMap) -> bool {
        let Some(digest) = self.cookie_of(headers) else { return false };
        let now_s = now_s();
        self.memory.signed_in().iter().any(|it| it.digest == digest && it.until_s > now_s)
    }

    /// Whether a guess from this address is looked at.
    fn may_guess(&self, from: IpAddr) -> bool {
        let mut guesses = self.guesses.lock().unwrap_or_else(PoisonError::into_inner);
        guesses.retain(|_, (_, at)| at.elapsed() < GUESSES_PAUSE);
        let is_free = guesses.get(&from).is_none_or(|(count, _)| *count < GUESSES_MAX);
        if !is_free || (guesses.len() >= GUESSERS_MAX && !guesses.contains_key(&from)) {
            return false;
        }
        // It counts before it is looked at: many at once count, too.
        let (count, at) = guesses.entry(from).or_insert((0, Instant::now()));
        *count += 1;
        *at = Instant::now();
        true
    }

    fn guessed_right(&self, from: IpAddr) {
        self.guesses.lock().unwrap_or_else(PoisonError::into_inner).remove(&from);
    }
}

fn bracketed(address: IpAddr) -> String {
    match address {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => format!("[{address}]"),
    }
}

/// Signs in by the password.
pub async fn login(
    State(app): State<App>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    Sent(login): Sent<Login>,
) -> Response {
    let gate = &app.gate;
    let Some(password) = &gate.password else {
        return Failure::of(
            StatusCode::UNAUTHORIZED,
            "the password",
            "this desk has none",
            gate.how_to_sign_in(),
        )
        .into_response();
    };
    let too_often = || {
        Failure::of(
            StatusCode::TOO_MANY_REQUESTS,
            "the password",
            "too many wrong ones",
            format!("wait for {} s", GUESSES_PAUSE.as_secs()),
        )
        .into_response()
    };
    if !gate.may_guess(from.ip()) {
        return too_often();
    }
    let Ok(_one) = gate.comparing.acquire().await else { return too_often() };
    let password = password.clone();
    let is_right = tokio::task::spawn_blocking(move || password.is(&login.password)).await;
    if !is_right.unwrap_or(false) {
        return Failure::of(
            StatusCode::UNAUTHORIZED,
            "the password",
            "it is wrong",
            "ask whoever has started the desk",
        )
        .into_response();
    }
    gate.guessed_right(from.ip());
    ([(SET_COOKIE, gate.new_cookie())], Json(Done {})).into_response()
}

/// The cookie is void from now on.
pub async fn logout(State(app): State<App>, headers: HeaderMap, _: Sent<Done>) -> Response {
    if let Some(digest) = app.gate.cookie_of(&headers) {
        app.gate.memory.change_signed_in(|list| list.retain(|it| it.digest != digest));
    }
    ([(SET_COOKIE, app.gate.header("", 0))], Json(Done {})).into_response()
}
