//! What the server and its page say to each other.
//!
//! Everything is JSON, with the names of the types here in `snake_case`; an enum with data is an
//! object whose field `is` names the variant. What is absent is `null`. Lengths are millimetres,
//! angles degrees, times seconds; a name that ends otherwise says so (`_ms`, `_us`, `_px`).
//!
//! **The desk's clock.** Every time called `..._at_ms` is milliseconds since the desk was started, with
//! fractions. A page learns what it is now from [`FromDesk::Pong`] and [`State::now_ms`].
//!
//! # Signing in
//!
//! A page is signed in by a cookie, which scripts cannot read. On this computer the address that
//! `plumb desk` prints holds a token: `GET /?token=...` sets the cookie and leads to `/`. With
//! `--listen` a person types the password, and the page posts it to `/api/login`. Files of the page
//! itself need no cookie; everything else answers 401 without one. Every request whose `Host` is not
//! the desk's is answered 421, every `POST` and every WebSocket whose `Origin` is not the desk's 403,
//! and every `POST` whose `Content-Type` is not `application/json` 415.
//!
//! # Routes
//!
//! | route | body | answer |
//! |---|---|---|
//! | `GET /`, `GET /<file>` | | the page |
//! | `GET /api/hello` | | [`Greeting`], signed in or not |
//! | `POST /api/login` | [`Login`] | [`Done`] and the cookie; 401 with a [`Problem`], 429 after too many guesses |
//! | `POST /api/logout` | `{}` | [`Done`]; the cookie is void |
//! | `GET /api/state` | | [`State`] |
//! | `GET /ws` | | the WebSocket: [`FromPage`], [`FromDesk`] |
//! | `POST /api/boxes/BOX/examine` | `{}` | [`Done`]; then [`BoxState::examination`] |
//! | `POST /api/boxes/BOX/reference` | `{}` | [`Done`]; then [`BoxState::reference`] |
//! | `POST /api/boxes/BOX/aim/begin` | [`AimBegin`] | [`Done`]; then [`BoxState::aim`] |
//! | `POST /api/boxes/BOX/aim/expose` | [`AimExpose`] | [`Done`]; then [`Aim::exposure`] |
//! | `POST /api/boxes/BOX/aim/cancel` | `{}` | [`Done`]; the search for an exposure ends |
//! | `POST /api/boxes/BOX/aim/end` | `{}` | [`Done`]; photographs stay |
//! | `GET /api/boxes/BOX/picture.jpeg?number=N` | | the live picture of that number, or a later one; 204 if there is none any more |
//! | `POST /api/boxes/BOX/photographs/begin` | [`PhotographsBegin`] | [`Done`]; a new set: [`BoxState::photographs`] |
//! | `POST /api/boxes/BOX/photographs/take` | `{}` | [`Done`]; one now |
//! | `POST /api/boxes/BOX/photographs/auto` | [`PhotographsAuto`] | [`Done`]; one every few seconds |
//! | `POST /api/boxes/BOX/photographs/pause` | `{}` | [`Done`]; none by itself any more |
//! | `POST /api/boxes/BOX/photographs/remove` | [`PhotographRemove`] | [`Done`] |
//! | `GET /api/boxes/BOX/photographs/NUMBER.png` | | the photograph |
//! | `POST /api/boxes/BOX/calibration/fit` | `{}` | [`Done`]; then [`BoxState::calibration`] |
//! | `GET /api/boxes/BOX/calibration/plot.svg` | | where each corner was, and its error |
//! | `POST /api/boxes/BOX/calibration/deliver` | [`CalibrationDeliver`] | [`Done`]; the box restarts with it |
//! | `POST /api/boxes/BOX/scene/measure` | [`SceneMeasure`] | [`Done`]; then [`BoxState::scene`] |
//! | `POST /api/boxes/BOX/scene/store` | `{}` | [`Done`]; the box restarts with it |
//! | `GET /api/boxes/BOX/settings` | | [`SettingsView`]: those of the configuration that the box runs with |
//! | `POST /api/boxes/BOX/settings/send` | [`SettingsText`] | [`Done`]; the box restarts with them |
//! | `POST /api/settings/check` | [`SettingsText`] | [`SettingsChecked`], also where they have a fault |
//! | `GET /api/prints` | | [`Prints`] |
//! | `POST /api/prints` | [`PrintsChoice`] | [`Prints`]; new boxes are told so, and those that get a camera |
//! | `GET /api/prints/SHEET-a4.pdf`, `SHEET-letter.pdf` | | the sheets, to be printed; `SHEET` is [`Sheet::word`] |
//! | `GET /api/prints/SHEET.svg` | | the first of them, on A4, to be shown |
//! | `GET /api/new-box` | | [`NewBoxForm`] |
//! | `POST /api/new-box` | [`NewBox`] | [`Made`]: its key is kept here, and it is looked for; 409 if its name or its number is that of another |
//! | `GET /api/boxes/BOX/card` | | [`Card`], while [`BoxState::has_card`] |
//! | `POST /api/boxes/BOX/card/config.plb`, `card/box.key` | `{}` | the files for its card, likewise; `box.key` is secret |
//! | `GET /api/protocols` | | [`Protocols`]: the supplied ones |
//! | `POST /api/protocols/check` | [`ProtocolText`] | [`ProtocolChecked`], also where it has a fault |
//! | `GET /api/studies` | | [`Studies`] |
//! | `POST /api/studies` | [`StudyCreate`] | [`StudyDetails`] |
//! | `GET /api/studies/STUDY` | | [`StudyDetails`] |
//! | `POST /api/studies/STUDY/protocol` | [`ProtocolText`] | [`StudyDetails`]; for sessions that begin from now on |
//! | `POST /api/studies/STUDY/participants` | [`ParticipantRow`] | [`StudyDetails`]; a new code adds one, a known one is changed |
//! | `POST /api/boxes/BOX/session/begin` | [`SessionBegin`] | [`Done`]; then [`BoxState::session`] |
//! | `POST /api/boxes/BOX/session/resume` | [`SessionResume`] | [`Done`] |
//! | `POST /api/boxes/BOX/session/event` | [`SessionEvent`] | [`Done`]; 409 if `step` is outdated |
//! | `POST /api/boxes/BOX/session/mark` | [`SessionMark`] | [`Done`] |
//! | `POST /api/boxes/BOX/session/close` | `{}` | [`Done`]; it can be resumed |
//! | `GET /reports/STUDY` | | the study's report: a whole HTML page |
//! | `GET /reports/STUDY/SESSION/TRIAL` | | a trial's report: a whole HTML page |
//!
//! `BOX` is [`BoxState::id`], `STUDY` [`StudyRow::folder`], `SESSION` [`SessionRow::name`], `TRIAL`
//! [`TrialRow::folder`]. A `POST` without anything to say has the body `{}`. An unknown field is an
//! error. Bodies have at most [`BODY_BYTES_MAX`] bytes.
//!
//! # What is possible when
//!
//! [`BoxState::can`] lists the actions of a box that are possible now, by [`Can`]: a page shows its
//! buttons by that list alone. What is not possible is refused with 409. An action that takes long is
//! answered when it has begun; its course is in [`BoxState::job`], and how it failed in
//! [`BoxState::failed`].
//!
//! # Failures
//!
//! Whatever fails answers with a [`Problem`]: 400 what was sent cannot be used, 401 not signed in, 403
//! a foreign page, 404 there is no such thing, 409 not now, 413 too long, 415 no JSON, 421 a foreign
//! host, 429 too often, 500 the disk or the system, 503 the box does not answer, or too many pages.

mod actions;
mod boxes;
mod health;
mod prints;
mod session;
mod settings;
mod socket;
mod studies;

use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};

pub use actions::*;
pub use boxes::*;
pub use health::*;
pub use prints::*;
pub use session::*;
pub use settings::*;
pub use socket::*;
pub use studies::*;

use crate::words::on_page;

/// The most bytes of a request's body.
pub const BODY_BYTES_MAX: usize = 256 * 1024;

/// The most pages that are open at once.
pub const PAGES_MAX: usize = 16;

/// Something that went wrong: where, what, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// The file, the box or the field.
    pub place: String,
    /// What was found.
    pub found: String,
    /// What to do.
    pub remedy: String,
}

impl Problem {
    /// Of these words, as the page says them.
    pub fn new(
        place: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let place = place.into();
        // A path is left as it is.
        let place = if place.starts_with("--") { on_page(&place) } else { place };
        Self { place, found: on_page(&found.into()), remedy: on_page(&remedy.into()) }
    }
}

impl From<BadInput> for Problem {
    fn from(error: BadInput) -> Self {
        let BadInput { place, field, found, remedy, .. } = error;
        let place = if field.is_empty() { place } else { format!("{place}: {field}") };
        Self::new(place, found, remedy)
    }
}

/// An action that was done, or has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Done {}

/// What a page may know before anybody has signed in.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Greeting {
    /// Version of the desk.
    pub version: String,
    /// Whether this page is signed in.
    pub signed_in: bool,
    /// How one signs in.
    pub sign_in: SignIn,
}

/// How one signs in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignIn {
    /// By the address that `plumb desk` has printed: there is nothing to type.
    Token,
    /// By the password.
    Password,
}

/// The whole state. A page draws what this says, and keeps nothing of an earlier one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Rises with every change.
    pub version: u64,
    /// The desk's clock when this was made.
    pub now_ms: f64,
    /// The desk as a whole.
    pub desk: DeskState,
    /// The boxes whose keys are known here, by name: those that are here first.
    pub boxes: Vec<BoxState>,
    /// Boxes that announce themselves here and cannot be used.
    pub strangers: Vec<Stranger>,
}

/// The desk as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeskState {
    /// Its version.
    pub version: String,
    /// The folder in which studies and photographs are kept.
    pub folder: String,
    /// The name of this computer.
    pub computer: String,
    /// The open pages.
    pub pages: usize,
    /// What is amiss of the desk as a whole; the worst first.
    pub problems: Vec<Problem>,
    /// Streams for other programs, in words: `lines of JSON at 127.0.0.1:4217`.
    pub streams: Vec<String>,
    /// Rises when a study, its participants or one of its trials has changed: details that were fetched
    /// before are outdated.
    pub studies_version: u64,
    /// The study in which was worked last, if it is still there.
    pub latest_study: Option<String>,
}

/// A box that announces itself and cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stranger {
    /// Where it is.
    pub address: String,
    /// Who it is, as far as it says.
    pub name: String,
    /// Why it cannot be used, and what to do.
    pub problem: Problem,
}
