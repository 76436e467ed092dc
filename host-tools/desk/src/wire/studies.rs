//! Studies, their participants and their trials.

use serde::{Deserialize, Serialize};

use super::{Grade, Problem};

/// The studies in the desk's folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Studies {
    /// By their folders' names.
    pub list: Vec<StudyRow>,
}

/// A study.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StudyRow {
    /// Its folder, by which it is named in routes.
    pub folder: String,
    /// Its title.
    pub title: String,
    /// Why it cannot be read, if so.
    pub problem: Option<Problem>,
}

/// A study with everything in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StudyDetails {
    /// Its folder, by which it is named in routes.
    pub folder: String,
    /// Its title.
    pub title: String,
    /// Where it is on this computer.
    pub path: String,
    /// Its protocol.
    pub protocol: ProtocolView,
    /// Who is measured.
    pub participants: Vec<ParticipantRow>,
    /// The sessions, by participant and number.
    pub sessions: Vec<SessionRow>,
    /// The trials that the study reads.
    pub accepted: usize,
}

/// The supplied protocols.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Protocols {
    /// Each by its word and its text.
    pub supplied: Vec<SuppliedProtocol>,
}

/// A supplied protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuppliedProtocol {
    /// The word by which it is chosen: `mctsib`, `stand`, `eyes-open-closed`.
    pub word: String,
    /// What it is.
    pub protocol: ProtocolView,
}

/// A protocol, as its file has it, and what to show of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProtocolView {
    /// The file's text, TOML, to be edited.
    pub text: String,
    /// The same as JSON with the fields of the file: `name`, `about`, `order`, `repeats`, `rest_s`,
    /// `countdown_s`, `tones`, `zero`, `marks`, `bins_s` and `condition`, a list.
    pub fields: serde_json::Value,
    /// The trials of a session.
    pub trials: usize,
    /// How long a session takes at least: all countdowns, trials and rests.
    pub lasts_s: f64,
}

/// A check of a protocol's text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProtocolChecked {
    /// The protocol, if it is one.
    pub protocol: Option<ProtocolView>,
    /// Its first fault, otherwise.
    pub problem: Option<Problem>,
}

/// A participant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParticipantRow {
    /// A code such as `P01`, never a name.
    pub code: String,
    /// Years.
    #[serde(default)]
    pub age_years: Option<f64>,
    /// `female`, `male` or `other`.
    #[serde(default)]
    pub sex: Option<String>,
    /// Centimetres.
    #[serde(default)]
    pub height_cm: Option<f64>,
    /// Kilograms.
    #[serde(default)]
    pub mass_kg: Option<f64>,
}

/// A session of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SessionRow {
    /// Its name, `P01-1`.
    pub name: String,
    /// Who was measured.
    pub participant: String,
    /// When it began, UTC.
    pub started: String,
    /// `resting`, `instruct`, `deciding`, `stopped`, `over` and so on.
    pub state: String,
    /// Whether it can be resumed.
    pub can_resume: bool,
    /// The box with which it goes on on this desk, by its id.
    pub open_with: Option<String>,
    /// Planned trials that are accepted or skipped.
    pub done: usize,
    /// All planned trials.
    pub planned: usize,
    /// All recordings, in their order.
    pub trials: Vec<TrialRow>,
    /// Why it cannot be read, if so.
    pub problem: Option<Problem>,
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrialRow {
    /// Its folder's name, by which its report is fetched.
    pub folder: String,
    /// Its place in the plan, from 1.
    pub place: usize,
    /// The condition's name in files.
    pub condition: String,
    /// `open` (nobody has decided, or it is being recorded), `accepted`, `rejected` or `nothing`.
    pub outcome: String,
    /// Why.
    pub why: Option<String>,
    /// The verdict on it; `null` until it is judged.
    pub grade: Option<Grade>,
    /// Whether there is a report.
    pub has_report: bool,
}
