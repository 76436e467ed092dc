//! Actions, and what is asked for.

use std::time::{Duration, Instant};

use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};
use serde::de::DeserializeOwned;

use super::App;
use super::body::{Failure, Sent, parse, whole};
use crate::station::{Order, Refusal};
use crate::wire::{
    Done, Greeting, ParticipantRow, ProtocolChecked, ProtocolText, Protocols, SettingsText,
    Studies, StudyCreate, StudyDetails,
};
use crate::{settings, studies};

/// An order is answered within this time, or not at all.
const ANSWERED_WITHIN: Duration = Duration::from_secs(20);

/// What a page may know before anybody has signed in.
pub async fn hello(State(app): State<App>, headers: HeaderMap) -> Json<Greeting> {
    Json(Greeting {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        signed_in: app.gate.is_signed_in(&headers),
        sign_in: app.gate.sign_in(),
    })
}

/// The whole state.
pub async fn state(State(app): State<App>) -> Json<crate::wire::State> {
    Json(app.desk.state())
}

/// What is done on the disk keeps nobody from being answered.
pub async fn on_disk<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Failure> + Send + 'static,
) -> Result<Json<T>, Failure> {
    beside(work).await.map(Json)
}

/// Does some work where it keeps nobody from being answered.
pub async fn beside<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Failure> + Send + 'static,
) -> Result<T, Failure> {
    let done = tokio::task::spawn_blocking(work).await;
    let failed = || {
        Failure::of(
            StatusCode::INTERNAL_SERVER_ERROR,
            "the desk",
            "the request has failed without a word",
            "report it",
        )
    };
    done.unwrap_or_else(|_| Err(failed()))
}

/// The supplied protocols.
pub async fn protocols() -> Json<Protocols> {
    Json(studies::protocols())
}

/// Checks a protocol.
pub async fn check_protocol(Sent(text): Sent<ProtocolText>) -> Json<ProtocolChecked> {
    Json(match studies::chosen(&text.protocol) {
        Ok(protocol) => {
            ProtocolChecked { protocol: Some(studies::protocol_view(&protocol)), problem: None }
        }
        Err(Refusal { problem, .. }) => ProtocolChecked { protocol: None, problem: Some(problem) },
    })
}

/// The studies that are there.
pub async fn studies(State(app): State<App>) -> Result<Json<Studies>, Failure> {
    on_disk(move || Ok(studies::list(&app.desk.folder)?)).await
}

fn details(app: &App, study: &str) -> Result<StudyDetails, Failure> {
    let opened = studies::open(&app.desk.folder, study)?;
    Ok(studies::details(&opened, |session| app.desk.box_of_session(study, session))?)
}

/// Makes a study.
pub async fn create_study(
    State(app): State<App>,
    Sent(create): Sent<StudyCreate>,
) -> Result<Json<StudyDetails>, Failure> {
    on_disk(move || {
        studies::create(&app.desk.folder, &create)?;
        app.desk.memory.note_study(&create.folder);
        app.desk.hub.study_changed();
        details(&app, &create.folder)
    })
    .await
}

/// A study.
pub async fn study(
    State(app): State<App>,
    Path(study): Path<String>,
) -> Result<Json<StudyDetails>, Failure> {
    on_disk(move || details(&app, &study)).await
}

/// Another protocol for a study.
pub async fn set_protocol(
    State(app): State<App>,
    Path(study): Path<String>,
    Sent(text): Sent<ProtocolText>,
) -> Result<Json<StudyDetails>, Failure> {
    on_disk(move || {
        let opened = studies::open(&app.desk.folder, &study)?;
        opened.set_protocol(&studies::chosen(&text.protocol)?)?;
        app.desk.hub.study_changed();
        details(&app, &study)
    })
    .await
}

/// A participant of a study.
pub async fn set_participant(
    State(app): State<App>,
    Path(study): Path<String>,
    Sent(row): Sent<ParticipantRow>,
) -> Result<Json<StudyDetails>, Failure> {
    on_disk(move || {
        studies::set_participant(&studies::open(&app.desk.folder, &study)?, row)?;
        app.desk.hub.study_changed();
        details(&app, &study)
    })
    .await
}

/// A body that says what an order needs.
fn with<T: DeserializeOwned>(
    body: &[u8],
    order: impl FnOnce(T) -> Order,
) -> Result<Order, Failure> {
    parse(body).map(order)
}

/// An action on a box.
pub async fn act(
    State(app): State<App>,
    Path((id, action)): Path<(String, String)>,
    request: Request,
) -> Result<Json<Done>, Failure> {
    let came = Instant::now();
    let body = whole(request).await?;
    let plain = |order| with(&body, |Done {}| order);
    let order = match &*action {
        "examine" => plain(Order::Examine),
        "reference" => plain(Order::Reference),
        "aim/begin" => with(&body, Order::AimBegin),
        "aim/expose" => with(&body, Order::AimExpose),
        "aim/cancel" => plain(Order::AimCancel),
        "aim/end" => plain(Order::AimEnd),
        "photographs/begin" => with(&body, Order::PhotographsBegin),
        "photographs/take" => plain(Order::PhotographsTake),
        "photographs/auto" => with(&body, Order::PhotographsAuto),
        "photographs/pause" => plain(Order::PhotographsPause),
        "photographs/remove" => with(&body, Order::PhotographsRemove),
        "calibration/fit" => plain(Order::CalibrationFit),
        "calibration/deliver" => with(&body, Order::CalibrationDeliver),
        "scene/measure" => with(&body, Order::SceneMeasure),
        "scene/store" => plain(Order::SceneStore),
        "settings/send" => {
            let SettingsText { settings } = parse(&body)?;
            let checked = beside(move || {
                let settings = settings::chosen(&settings)?;
                settings::check(&settings)?;
                Ok(settings)
            });
            checked.await.map(Order::SettingsSend)
        }
        "session/begin" => with(&body, Order::SessionBegin),
        "session/resume" => with(&body, Order::SessionResume),
        "session/event" => with(&body, Order::SessionEvent),
        "session/mark" => with(&body, |mark| Order::SessionMark(mark, came)),
        "session/close" => plain(Order::SessionClose),
        _ => Err(Failure::not_found(format!("the action {:?}", shown(&action)))),
    }?;
    let station = app.desk.station(&id).ok_or_else(|| Failure::not_found("the box"))?;
    let answered = station.order(order)?;
    match tokio::time::timeout(ANSWERED_WITHIN, answered).await {
        Ok(Ok(result)) => result.map(|()| Json(Done {})).map_err(Failure::from),
        Ok(Err(_)) | Err(_) => Err(Failure::of(
            StatusCode::SERVICE_UNAVAILABLE,
            "the box",
            "it is busy, and has not taken the order",
            "try again in a moment",
        )),
    }
}

fn shown(text: &str) -> String {
    plumbline_files::text::printable(text).chars().take(80).collect()
}

/// A picture of a box, or what it runs with.
pub async fn look(
    State(app): State<App>,
    Path((id, what)): Path<(String, String)>,
) -> Result<Response, Failure> {
    let station = app.desk.station(&id).ok_or_else(|| Failure::not_found("the box"))?;
    if what == "picture.jpeg" {
        let file = station.shared.picture().map(|(_, file)| file).filter(|it| !it.is_empty());
        return Ok(match file {
            Some(file) => ([(CONTENT_TYPE, "image/jpeg")], file.to_vec()).into_response(),
            // Set-up mode may have ended since the page asked.
            None => StatusCode::NO_CONTENT.into_response(),
        });
    }
    if what == "settings" {
        let settings = station.shared.settings();
        let settings = settings.ok_or_else(|| {
            Failure::from(Refusal::not_now(
                station.shared.state().name,
                "the box has not told its settings yet",
                "switch it on, and wait until it is heard",
            ))
        })?;
        return Ok(Json(settings).into_response());
    }
    let photographs = station.shared.state().photographs;
    let photographs = photographs.ok_or_else(|| Failure::not_found("a photograph"))?;
    let folder = std::path::PathBuf::from(&photographs.folder);
    let (path, kind) = if what == "calibration/plot.svg" {
        (folder.join(crate::station::PLOT), "image/svg+xml")
    } else {
        let number = what.strip_prefix("photographs/").and_then(|it| it.strip_suffix(".png"));
        let number = number.and_then(|it| it.parse::<u32>().ok());
        let found = photographs.list.iter().find(|it| Some(it.number) == number);
        let file = found.map(|it| &it.file).ok_or_else(|| Failure::not_found("a photograph"))?;
        (folder.join(file), "image/png")
    };
    let read = tokio::task::spawn_blocking(move || std::fs::read(path)).await;
    match read {
        Ok(Ok(bytes)) => Ok(([(CONTENT_TYPE, kind)], bytes).into_response()),
        _ => Err(Failure::not_found("the picture")),
    }
}
