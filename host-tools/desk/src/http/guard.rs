//! Who may ask: a page of the desk's own, by the desk's own name, that is signed in.
//!
//! A page of another origin in the same browser can send requests here. It cannot read what comes back,
//! and its requests are refused by their `Origin` before anything is done. One that makes its own name
//! lead to this computer (DNS rebinding) is refused by `Host`.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, HeaderValue, ORIGIN, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

use super::App;
use super::body::Failure;

/// The page: its own files, and nothing from elsewhere; no script or style within it.
const PAGE_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; frame-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A report has its style within it, and no script.
pub const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'self'; sandbox allow-modals";

/// The names by which the desk may be called.
#[must_use]
pub fn names(computer: &str, address: IpAddr) -> Vec<String> {
    let mut names = vec!["localhost".to_owned()];
    if !computer.is_empty() {
        names.extend([
            computer.to_ascii_lowercase(),
            format!("{computer}.local").to_ascii_lowercase(),
        ]);
    }
    if !address.is_unspecified() {
        names.push(address.to_string());
    }
    names
}

/// Host, Origin and who is signed in.
pub async fn guard(State(app): State<App>, request: Request, next: Next) -> Response {
    match admitted(&app, &request) {
        Ok(()) => next.run(request).await,
        Err(failure) => failure.into_response(),
    }
}

fn admitted(app: &App, request: &Request) -> Result<(), Failure> {
    let headers = request.headers();
    let text = |name: HeaderName| headers.get(name).and_then(|it| it.to_str().ok());
    let host = text(HOST).filter(|host| app.gate.is_host(host)).ok_or_else(|| {
        Failure::of(
            StatusCode::MISDIRECTED_REQUEST,
            "the request",
            "it is for another host",
            "open the address that `plumb desk` has printed",
        )
    })?;
    let foreign = || {
        Failure::of(
            StatusCode::FORBIDDEN,
            "the request",
            "it comes from another page",
            "open the address that `plumb desk` has printed",
        )
    };
    let path = request.uri().path();
    let changes = request.method() != Method::GET && request.method() != Method::HEAD;
    match headers.get(ORIGIN) {
        Some(origin) if origin.to_str().ok() != Some(&app.gate.origin(host)) => {
            return Err(foreign());
        }
        Some(_) => {}
        // A browser says where a request that changes something comes from.
        None if changes || path == "/ws" => return Err(foreign()),
        None => {}
    }
    let site = text(HeaderName::from_static("sec-fetch-site"));
    let is_own = matches!(site, None | Some("same-origin" | "none"));
    // Anybody may lead to the page; what is in it only the page itself gets.
    let leads = path == "/" && text(HeaderName::from_static("sec-fetch-mode")) == Some("navigate");
    if !is_own && !leads {
        return Err(foreign());
    }
    let is_inside = path.starts_with("/api/") || path.starts_with("/reports/") || path == "/ws";
    let is_door = path == "/api/hello" || path == "/api/login";
    if is_inside && !is_door && !app.gate.is_signed_in(headers) {
        return Err(Failure::of(
            StatusCode::UNAUTHORIZED,
            "this page",
            "it is not signed in",
            app.gate.how_to_sign_in(),
        ));
    }
    if changes && is_inside && !is_door && path != "/api/logout" && app.desk.only_shows() {
        return Err(Failure::of(
            StatusCode::CONFLICT,
            "this page",
            "it shows the boxes of a ward, which its gateway has: nothing is done with them from here",
            "end the gateway, and open the desk",
        ));
    }
    Ok(())
}

/// What every answer tells the browser.
pub async fn headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let mut set = |name: HeaderName, value: &'static str| {
        if !headers.contains_key(&name) {
            headers.insert(name, HeaderValue::from_static(value));
        }
    };
    set(CONTENT_SECURITY_POLICY, PAGE_POLICY);
    set(X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(X_FRAME_OPTIONS, "DENY");
    set(REFERRER_POLICY, "no-referrer");
    set(CACHE_CONTROL, "no-store");
    set(HeaderName::from_static("cross-origin-opener-policy"), "same-origin");
    set(HeaderName::from_static("cross-origin-resource-policy"), "same-origin");
    set(
        HeaderName::from_static("permissions-policy"),
        "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
    );
    response
}
