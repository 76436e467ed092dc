//! The page's own files, which are in this program.

use axum::extract::{Query, State};
use axum::http::header::{CONTENT_TYPE, LOCATION, SET_COOKIE};
use axum::http::{Method, StatusCode, Uri};
use axum::response::{IntoResponse as _, Response};
use rust_embed::Embed;
use serde::Deserialize;

use super::App;
use super::body::Failure;

/// The files of the page. While the desk is developed they are read from the disk.
#[derive(Embed)]
#[folder = "$CARGO_MANIFEST_DIR/page"]
struct Page;

/// What may stand behind the page's address.
#[derive(Deserialize)]
pub struct Asked {
    token: Option<String>,
}

/// A file; the page itself at `/`, where the token signs in.
pub async fn file(
    State(app): State<App>,
    method: Method,
    uri: Uri,
    Query(asked): Query<Asked>,
) -> Response {
    if method != Method::GET && method != Method::HEAD {
        return Failure::of(StatusCode::METHOD_NOT_ALLOWED, uri.path(), "it can only be read", "")
            .into_response();
    }
    if uri.path() == "/"
        && let Some(token) = asked.token
    {
        // Whether it is right or not: it does not stay in the address.
        let cookie = app.gate.sign_in_by_token(&token);
        let cookie = cookie.map(|it| [(SET_COOKIE, it)]);
        return (StatusCode::SEE_OTHER, cookie_or_none(cookie), [(LOCATION, "/")]).into_response();
    }
    let path = uri.path().trim_start_matches('/');
    let path = if path.is_empty() { "index.html" } else { path };
    match Page::get(path) {
        Some(file) => ([(CONTENT_TYPE, kind(path))], file.data.into_owned()).into_response(),
        None => Failure::not_found(uri.path()).into_response(),
    }
}

fn cookie_or_none(cookie: Option<[(axum::http::HeaderName, String); 1]>) -> axum::http::HeaderMap {
    let cookie = cookie.into_iter().flatten();
    cookie.filter_map(|(name, value)| Some((name, value.parse().ok()?))).collect()
}

/// The type of a file, by its name.
fn kind(path: &str) -> &'static str {
    match path.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "json" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        "webmanifest" => "application/manifest+json",
        _ => "text/plain; charset=utf-8",
    }
}
