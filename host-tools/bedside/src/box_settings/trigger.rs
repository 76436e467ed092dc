//! `[trigger]` of `box.toml`: the wires to other devices.

use plumbline::config::{Edges, Marked, TriggerError, TriggerInput, TriggerLines, TriggerOutput};
use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};

use super::text;

const CHIP_WANTED: &str =
    "give the label of a GPIO chip, for example \"pinctrl-bcm2711\", or its device";

const LINE_WANTED: &str = "give the number of a line of the chip, from 0; left out, there is none";

const DEBOUNCE_WANTED: &str = "give 0 to 1000000 microseconds";

/// What a field takes, for whoever gave it something of another kind.
pub(super) fn wanted(name: &str) -> Option<&'static str> {
    Some(match name {
        "chip" => CHIP_WANTED,
        "line" | "output_line" => LINE_WANTED,
        "edge" => "give \"rising\", \"falling\" or \"both\"",
        "debounce_us" => DEBOUNCE_WANTED,
        "output_marks" => "give \"exposures\" or \"recording\"",
        _ => return None,
    })
}

/// The settings of the wires, as a file gives them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TriggerFields {
    chip: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<u16>,
    #[serde(default = "default_edge", with = "EdgeName")]
    edge: Edges,
    #[serde(default)]
    debounce_us: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    output_line: Option<u16>,
    #[serde(default = "default_marks", with = "MarkedName")]
    output_marks: Marked,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Edges", rename_all = "snake_case")]
enum EdgeName {
    Rising,
    Falling,
    Both,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Marked", rename_all = "snake_case")]
enum MarkedName {
    Exposures,
    Recording,
}

impl TriggerFields {
    /// The settings that a configuration has.
    pub(super) fn of(lines: &TriggerLines) -> Self {
        Self {
            chip: lines.chip.to_string(),
            line: lines.input.map(|it| it.line),
            edge: lines.input.map_or(default_edge(), |it| it.edges),
            debounce_us: lines.input.map_or(0, |it| it.debounce_us),
            output_line: lines.output.map(|it| it.line),
            output_marks: lines.output.map_or(default_marks(), |it| it.marks),
        }
    }

    /// The lines of a configuration; `place` names the file in errors.
    ///
    /// # Errors
    /// The first field that is out of range.
    pub(super) fn lines(&self, place: &str) -> Result<TriggerLines, BadInput> {
        let Self { line, edge, debounce_us, output_line, output_marks, .. } = *self;
        let lines = TriggerLines {
            chip: text(place, "trigger.chip", &self.chip)?,
            input: line.map(|line| TriggerInput { line, edges: edge, debounce_us }),
            output: output_line.map(|line| TriggerOutput { line, marks: output_marks }),
        };
        let bad = |field: &str, found: String, wanted: &str| {
            Err(BadInput::new(place, format!("trigger.{field}"), found, wanted))
        };
        match lines.check() {
            Ok(()) => Ok(lines),
            Err(TriggerError::Chip) => bad("chip", "\"\"".into(), CHIP_WANTED),
            Err(TriggerError::NoLine) => {
                bad("line", "neither it nor output_line is given".into(), LINE_WANTED)
            }
            Err(TriggerError::Line) => {
                bad("line", line.unwrap_or_default().to_string(), LINE_WANTED)
            }
            Err(TriggerError::OutputLine) => bad(
                "output_line",
                output_line.unwrap_or_default().to_string(),
                "give the number of another line of the chip, from 0",
            ),
            Err(TriggerError::Debounce) => {
                bad("debounce_us", debounce_us.to_string(), DEBOUNCE_WANTED)
            }
        }
    }
}

fn default_edge() -> Edges {
    Edges::Rising
}

fn default_marks() -> Marked {
    Marked::Exposures
}
