//! The way to a box that is there: sheets to print, new boxes and their cards, settings.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::response::{IntoResponse as _, Response};
use plumbline::seal::KEY_FILE_NAME;
use plumbline_render::sheet::Paper;

use super::App;
use super::api::{beside, on_disk};
use super::body::{Failure, Sent};
use crate::prints::What;
use crate::wire::{
    Card, Done, Made, NewBox, NewBoxForm, Prints, PrintsChoice, SettingsChecked, SettingsText,
};
use crate::{cards, prints, settings};

/// What can be printed, and how it is described.
pub async fn prints(State(app): State<App>) -> Result<Json<Prints>, Failure> {
    on_disk(move || Ok(prints::view(&app.desk.folder)?)).await
}

/// Another description.
pub async fn describe(
    State(app): State<App>,
    Sent(choice): Sent<PrintsChoice>,
) -> Result<Json<Prints>, Failure> {
    on_disk(move || {
        prints::describe(&app.desk.folder, &choice)?;
        Ok(prints::view(&app.desk.folder)?)
    })
    .await
}

/// A sheet: `pair-a4.pdf`, or `pair.svg`.
pub async fn sheet(Path(name): Path<String>) -> Result<Response, Failure> {
    let none = || Failure::not_found("the sheet");
    let (stem, kind) = name.rsplit_once('.').ok_or_else(none)?;
    let (word, paper) = match (kind, stem.rsplit_once('-')) {
        ("pdf", Some((word, "a4"))) => (word, Paper::A4),
        ("pdf", Some((word, "letter"))) => (word, Paper::Letter),
        ("svg", None) => (stem, Paper::A4),
        _ => return Err(none()),
    };
    let what = What::ALL.into_iter().find(|it| it.word() == word).ok_or_else(none)?;
    if kind == "svg" {
        let first = beside(move || Ok(what.print(paper).svgs().next())).await?;
        let first = first.ok_or_else(none)?;
        return Ok(([(CONTENT_TYPE, "image/svg+xml")], first).into_response());
    }
    let bytes = beside(move || Ok(what.print(paper).pdf())).await?;
    Ok(download("application/pdf", &format!("plumbline-{stem}.pdf"), bytes))
}

/// A file that the browser keeps under this name.
fn download(kind: &'static str, name: &str, bytes: Vec<u8>) -> Response {
    let kept = format!("attachment; filename=\"{name}\"");
    ([(CONTENT_TYPE, kind.to_owned()), (CONTENT_DISPOSITION, kept)], bytes).into_response()
}

/// Checks settings.
pub async fn check_settings(
    Sent(sent): Sent<SettingsText>,
) -> Result<Json<SettingsChecked>, Failure> {
    // The name of a computer that boxes send to is looked up.
    on_disk(move || {
        let settings = settings::chosen(&sent.settings);
        let checked = settings.and_then(|it| settings::check(&it).map(|()| settings::view(&it)));
        Ok(match checked {
            Ok(settings) => SettingsChecked { settings: Some(settings), problem: None },
            Err(error) => SettingsChecked { settings: None, problem: Some(error.into()) },
        })
    })
    .await
}

/// What a form for a new box begins with.
pub async fn new_box(State(app): State<App>) -> Result<Json<NewBoxForm>, Failure> {
    on_disk(move || Ok(cards::form(&app.desk.udp)?)).await
}

/// Makes a new box.
pub async fn make_box(
    State(app): State<App>,
    Sent(asked): Sent<NewBox>,
) -> Result<Json<Made>, Failure> {
    on_disk(move || Ok(Made { id: app.desk.make_box(&asked)? })).await
}

/// The card of a box that was never heard.
pub async fn card(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Card>, Failure> {
    on_disk(move || Ok(cards::card(&app.desk.folder, &id)?)).await
}

/// A file for that card. Whoever has the key can read and command the box: it is given to the desk's own
/// page alone, and only on this computer, because no key goes over a network; no browser keeps a copy of
/// the answer (`no-store`). A `POST`, because only such a request always says from which page it comes.
pub async fn card_file(
    State(app): State<App>,
    Path((id, name)): Path<(String, String)>,
    _: Sent<Done>,
) -> Result<Response, Failure> {
    if name == KEY_FILE_NAME && app.gate.is_for_others() {
        return Err(Failure::of(
            StatusCode::FORBIDDEN,
            KEY_FILE_NAME,
            "no key goes over a network, and this desk is open to other computers",
            "start the desk without --listen, and take the key from its page on that computer",
        ));
    }
    let (name, bytes) = beside(move || Ok(cards::file(&app.desk.folder, &id, &name)?)).await?;
    Ok(download("application/octet-stream", name, bytes))
}
