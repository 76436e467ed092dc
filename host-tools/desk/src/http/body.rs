//! Bodies of requests, and failures as answers.

use std::time::Duration;

use axum::Json;
use axum::extract::{FromRequest, Request};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;

use crate::station::Refusal;
use crate::wire::{BODY_BYTES_MAX, Problem};

/// A body that has not come by then does not.
const BODY_WITHIN: Duration = Duration::from_secs(10);

/// Why a request has failed.
#[derive(Debug)]
pub struct Failure {
    /// The status of the answer.
    pub status: StatusCode,
    /// What is said.
    pub problem: Problem,
}

impl Failure {
    /// Of these words.
    pub fn of(
        status: StatusCode,
        place: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { status, problem: Problem::new(place, found, remedy) }
    }

    /// There is no such thing.
    pub fn not_found(place: impl Into<String>) -> Self {
        Self::of(
            StatusCode::NOT_FOUND,
            place,
            "there is no such thing",
            "choose one that is listed",
        )
    }
}

impl From<Refusal> for Failure {
    fn from(Refusal { status, problem }: Refusal) -> Self {
        let status = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        Self { status, problem }
    }
}

impl From<plumbline_files::BadInput> for Failure {
    fn from(error: plumbline_files::BadInput) -> Self {
        Refusal::from(error).into()
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        (self.status, Json(self.problem)).into_response()
    }
}

/// A body of JSON.
pub struct Sent<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Sent<T> {
    type Rejection = Failure;

    async fn from_request(request: Request, _: &S) -> Result<Self, Failure> {
        parse(&whole(request).await?).map(Self)
    }
}

/// The bytes of a body of JSON.
pub async fn whole(request: Request) -> Result<axum::body::Bytes, Failure> {
    let kind = request.headers().get(CONTENT_TYPE).and_then(|it| it.to_str().ok());
    let kind = kind.map(|it| it.split(';').next().unwrap_or_default().trim());
    // A form of another page cannot have this type.
    if kind != Some("application/json") {
        return Err(Failure::of(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "the request",
            "its body is no JSON",
            "send application/json",
        ));
    }
    let coming = axum::body::to_bytes(request.into_body(), BODY_BYTES_MAX);
    match tokio::time::timeout(BODY_WITHIN, coming).await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(_)) => Err(Failure::of(
            StatusCode::PAYLOAD_TOO_LARGE,
            "the request",
            format!("its body is longer than {BODY_BYTES_MAX} bytes, or was cut off"),
            "send less",
        )),
        Err(_) => Err(Failure::of(
            StatusCode::REQUEST_TIMEOUT,
            "the request",
            "its body does not come",
            "send it at once",
        )),
    }
}

/// What a body says.
pub fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Failure> {
    serde_json::from_slice(bytes).map_err(|error| {
        let found = plumbline_files::text::printable(&error.to_string()).to_string();
        let remedy = "send what wire.rs describes";
        Failure::of(StatusCode::BAD_REQUEST, "the request's body", found, remedy)
    })
}
