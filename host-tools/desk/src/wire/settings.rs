//! The settings of a box, and the card of a new one.

use serde::{Deserialize, Serialize};

use super::Problem;

/// Settings of a box.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SettingsChoice {
    /// `{"fields": {...}}`: the fields of box.toml as JSON; `null` where one is left out.
    Fields(serde_json::Value),
    /// `{"text": "..."}`: a box.toml.
    Text(String),
}

/// Settings to be checked, or sent to a box.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingsText {
    /// Which.
    pub settings: SettingsChoice,
}

/// The settings of a box, as its file has them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SettingsView {
    /// The file's text, box.toml, to be edited.
    pub text: String,
    /// The same as JSON with the fields of the file: `device`, `serial_number` and the objects `capture`,
    /// `links`, `network`, `machine` and `trigger`. What is left out is not there.
    pub fields: serde_json::Value,
}

/// A check of settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SettingsChecked {
    /// The settings, if they are some.
    pub settings: Option<SettingsView>,
    /// Their first fault, otherwise.
    pub problem: Option<Problem>,
}

/// What a form for a new box begins with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NewBoxForm {
    /// Its settings: a number that no box here has, sent to this computer.
    pub settings: SettingsView,
    /// Width and height of its camera's frames.
    pub size_px: [u16; 2],
    /// Where boxes can send to: the addresses of this computer, with the port.
    pub addresses: Vec<String>,
}

/// A new box, or other files for one that was never heard.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewBox {
    /// Its settings.
    pub settings: SettingsChoice,
    /// Width and height of its camera's frames.
    pub size_px: [u16; 2],
    /// The box whose files these replace, by its id: one that was made on this desk, and was never heard.
    /// It keeps its number and its key.
    #[serde(default)]
    pub replaces: Option<String>,
}

/// The box that was made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Made {
    /// [`BoxState::id`](super::BoxState::id).
    pub id: String,
}

/// The files for the card of a box that was made on this desk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// Its settings.
    pub settings: SettingsView,
    /// Width and height of its camera's frames.
    pub size_px: [u16; 2],
    /// Where the files are kept on this computer; its key is not among them.
    pub folder: String,
}
