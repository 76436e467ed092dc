//! The sheets with the targets, and what is known of the prints.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The targets that are printed, and as which the boxes of this desk are told about them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prints {
    /// Where they are described on this computer: a targets.toml.
    pub path: String,
    /// Its text.
    pub text: String,
    /// What it says.
    pub targets: Vec<PrintedTarget>,
    /// What should be known of these targets; empty where all is well.
    pub warnings: Vec<String>,
    /// What can be printed.
    pub sheets: Vec<Sheet>,
}

/// A target, as it is described.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PrintedTarget {
    /// Its name.
    pub name: String,
    /// `upper`, `lower` or `scene`.
    pub role: String,
    /// Inner corners along both sides.
    pub size: [u8; 2],
    /// The side of a square, as it was measured; `null` where every corner was measured.
    pub pitch_mm: Option<f64>,
}

/// A file that can be printed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sheet {
    /// Its word in routes: `pair` or `board`.
    pub word: String,
    /// What is on it.
    pub title: String,
    /// The side of a square on it.
    pub pitch_mm: f64,
    /// The number of pages, on A4 and on Letter.
    pub pages: [usize; 2],
}

/// Another description of the prints.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PrintsChoice {
    /// `{"pitches_mm": {"board": 20.05}}`: what was measured, by the targets' names.
    PitchesMm(BTreeMap<String, f64>),
    /// `{"text": "..."}`: a targets.toml.
    Text(String),
}
