//! Reports: the pages that `plumb report` makes.

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE, X_FRAME_OPTIONS};
use axum::response::{IntoResponse as _, Response};
use plumbline_files::BadInput;
use plumbline_report::page;
use plumbline_report::trial::Beside;
use plumbline_session::names;
use plumbline_study::{figures, manifest};
use plumbline_trial::Trial;
use plumbline_trial::points::Points;

use super::App;
use super::body::Failure;
use super::guard::REPORT_POLICY;
use crate::studies;
use crate::wire::Problem;
use crate::words::on_page;

/// A study's.
pub async fn study(State(app): State<App>, Path(study): Path<String>) -> Response {
    made(move || {
        let study = studies::open(&app.desk.folder, &study)?;
        let mut figures = figures::analyze(&manifest::read(&study.path().join(names::STUDY))?)?;
        // Trials are named from the study's folder on: where that is, is this computer's affair.
        let folder = format!("{}/", study.path().display());
        let here = |warning: &String| on_page(&warning.replace(&folder, ""));
        figures.warnings = figures.warnings.iter().map(here).collect();
        Ok(plumbline_report::study::report(&figures)?)
    })
    .await
}

/// A trial's.
pub async fn trial(
    State(app): State<App>,
    Path((study, session, name)): Path<(String, String, String)>,
) -> Response {
    made(move || {
        let folder = studies::trial_folder(&app.desk.folder, &study, &session, &name)?;
        let trial = Trial::open(&folder)?;
        let mut points = Points::of(&trial, trial.manifest.zero)?;
        points.place = format!("{session}/{name}");
        points.warnings = points.warnings.iter().map(|it| on_page(it)).collect();
        let settings = plumbline_analysis::sway::Settings {
            span_s: points.usual_span_s(),
            ..plumbline_analysis::sway::Settings::default()
        };
        let beside = Beside::default();
        let (html, _) = plumbline_report::trial::report(Some(&trial), &points, &settings, &beside)?;
        Ok(html)
    })
    .await
}

/// Makes a page where it keeps nobody from being answered.
async fn made(make: impl FnOnce() -> Result<String, Failure> + Send + 'static) -> Response {
    let made = tokio::task::spawn_blocking(make).await.unwrap_or_else(|_| {
        Err(BadInput::whole("the report", "it could not be made", "report it").into())
    });
    // It is opened in a tab of its own, by a person.
    let (status, html) = match made {
        Ok(html) => (StatusCode::OK, html),
        Err(Failure { status, problem: Problem { place, found, remedy } }) => {
            (status, page::not_made(&place, &found, &remedy))
        }
    };
    let headers = [
        (CONTENT_TYPE, "text/html; charset=utf-8"),
        (CONTENT_SECURITY_POLICY, REPORT_POLICY),
        (X_FRAME_OPTIONS, "SAMEORIGIN"),
    ];
    (status, headers, html).into_response()
}
