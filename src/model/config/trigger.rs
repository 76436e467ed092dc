//! The wires beside the camera: a line at which other devices tell the box that something happens,
//! and one at which the box tells them.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::DEVICE_PATH_BYTES_MAX;

/// No chip has so many lines.
pub const LINE_MAX: u16 = 1023;

/// The longest time for which a contact may bounce.
pub const DEBOUNCE_US_MAX: u32 = 1_000_000;

/// Which way a line goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Edge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

impl Edge {
    /// The words for it, in tables and streams.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Rising => "rising edge",
            Self::Falling => "falling edge",
        }
    }
}

/// Which edges are triggers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Edges {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
    /// Either.
    Both,
}

impl Edges {
    /// Whether an edge is one of them.
    #[must_use]
    pub fn contain(self, edge: Edge) -> bool {
        match self {
            Self::Rising => edge == Edge::Rising,
            Self::Falling => edge == Edge::Falling,
            Self::Both => true,
        }
    }
}

/// What the output line marks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Marked {
    /// A pulse for each frame.
    Exposures,
    /// High for as long as a listener records a trial.
    Recording,
}

/// The line that is listened to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerInput {
    /// Its number on the chip.
    pub line: u16,
    /// Which of its edges count.
    pub edges: Edges,
    /// After an edge of either kind, others do not count for this long; 0 for a line that does not
    /// bounce.
    pub debounce_us: u32,
}

/// The line that is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerOutput {
    /// Its number on the chip.
    pub line: u16,
    /// What it marks.
    pub marks: Marked,
}

/// The trigger's lines, on one chip.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerLines {
    /// The chip: a device such as `/dev/gpiochip0`, or its label, such as `pinctrl-bcm2711`.
    pub chip: String<DEVICE_PATH_BYTES_MAX>,
    /// The line that is listened to.
    pub input: Option<TriggerInput>,
    /// The line that is driven.
    pub output: Option<TriggerOutput>,
}

/// Which field of [`TriggerLines`] is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriggerError {
    /// There is no chip.
    Chip,
    /// There is no line.
    NoLine,
    /// The input's number is above [`LINE_MAX`].
    Line,
    /// The output's number is above [`LINE_MAX`], or is the input's.
    OutputLine,
    /// The debouncing takes longer than [`DEBOUNCE_US_MAX`].
    Debounce,
}

impl core::fmt::Display for TriggerError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Chip => formatter.write_str("chip: must not be empty"),
            Self::NoLine => formatter.write_str("line: neither it nor output_line is given"),
            Self::Line => write!(formatter, "line: must be within 0 to {LINE_MAX}"),
            Self::OutputLine => {
                write!(formatter, "output_line: must be within 0 to {LINE_MAX}, and not be line")
            }
            Self::Debounce => {
                write!(formatter, "debounce_us: must be within 0 to {DEBOUNCE_US_MAX}")
            }
        }
    }
}

impl TriggerLines {
    /// Checks every value.
    ///
    /// # Errors
    /// The first field that is out of range.
    pub fn check(&self) -> Result<(), TriggerError> {
        if self.chip.is_empty() {
            return Err(TriggerError::Chip);
        }
        if self.input.is_none() && self.output.is_none() {
            return Err(TriggerError::NoLine);
        }
        if let Some(input) = self.input {
            if input.line > LINE_MAX {
                return Err(TriggerError::Line);
            }
            if input.debounce_us > DEBOUNCE_US_MAX {
                return Err(TriggerError::Debounce);
            }
        }
        let input = self.input.map(|input| input.line);
        if self.output.is_some_and(|it| it.line > LINE_MAX || Some(it.line) == input) {
            return Err(TriggerError::OutputLine);
        }
        Ok(())
    }
}
