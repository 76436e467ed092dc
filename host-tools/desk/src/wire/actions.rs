//! What a page asks for.

use serde::{Deserialize, Serialize};

use super::EventWord;

/// The password.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Login {
    /// As it was typed.
    pub password: String,
}

/// Begins set-up mode.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AimBegin {
    /// Pixels of the frame per pixel of the picture, either way, 1 to 16; `null`: as suits the link.
    #[serde(default)]
    pub reduction: Option<u8>,
    /// Even while another program records a trial with this box, which that spoils.
    #[serde(default)]
    pub force: bool,
}

/// Finds the exposure and the gain at which the targets are well exposed.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AimExpose {
    /// Puts what is found into the box's configuration; the box restarts, and is aimed on.
    #[serde(default)]
    pub store: bool,
}

/// Begins a set of photographs. The box is in set-up mode from then on.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographsBegin {
    /// Inner corners along both sides of the board; `null`: of the scene board that the box looks for.
    #[serde(default)]
    pub board: Option<[u8; 2]>,
    /// From corner to corner; `null`: of the scene board that the box looks for.
    #[serde(default)]
    pub pitch_mm: Option<f64>,
}

/// Takes photographs by itself.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographsAuto {
    /// How many, 1 to 60.
    pub count: u32,
    /// The time from one to the next, 1 to 60.
    pub every_s: f64,
}

/// Removes a photograph.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographRemove {
    /// Its number.
    pub number: u32,
}

/// Gives the box the camera that was calibrated. A scene that it has holds for the camera of before,
/// and is left out: it is measured next.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationDeliver {
    /// The targets that it looks for, as a targets.toml; `null`: those that it has or, where it looks for
    /// the board alone, the standard pair and that board.
    #[serde(default)]
    pub targets: Option<String>,
}

/// Measures the scene by the board that stands in it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneMeasure {
    /// How long the board is watched, 1 to 30; `null`: 2.
    #[serde(default)]
    pub seconds: Option<f64>,
    /// How far the camera looks down, -90 to 90; `null`: level.
    #[serde(default)]
    pub camera_pitch_deg: Option<f64>,
}

/// Makes a study.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyCreate {
    /// The name of its folder: small letters, digits and hyphens.
    pub folder: String,
    /// Its title.
    pub title: String,
    /// The word of a supplied protocol, or a text of one's own.
    pub protocol: ProtocolChoice,
}

/// A protocol for a study.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProtocolChoice {
    /// `{"supplied": "mctsib"}`.
    Supplied(String),
    /// `{"text": "..."}`, TOML.
    Text(String),
    /// `{"fields": {...}}`: the fields of the file as JSON.
    Fields(serde_json::Value),
}

/// A protocol to be checked or stored.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProtocolText {
    /// Which.
    pub protocol: ProtocolChoice,
}

/// Begins a session with a box.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionBegin {
    /// The study's folder.
    pub study: String,
    /// The participant's code.
    pub participant: String,
    /// Who measures.
    #[serde(default)]
    pub operator: Option<String>,
}

/// Continues a session with a box.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionResume {
    /// The study's folder.
    pub study: String,
    /// The session's name.
    pub session: String,
}

/// What the operator does.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionEvent {
    /// [`SessionState::step`](super::SessionState::step) as the page saw it.
    pub step: u64,
    /// Which.
    pub event: EventWord,
    /// The reason, for `accept`, `repeat`, `skip` and `give_up`.
    #[serde(default)]
    pub why: Option<String>,
}

/// A mark in the recording that goes on.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionMark {
    /// One of [`SessionState::marks`](super::SessionState::marks), or another word.
    pub label: String,
    /// When the key was pressed, by the desk's clock, no more than 5 s ago; `null`: now.
    #[serde(default)]
    pub at_ms: Option<f64>,
}
