//! How a box is, by its own word.

use serde::{Deserialize, Serialize};

/// How a box is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HealthState {
    /// Its camera: `starting`, `running`, `stalled`, `lost` or `ended`.
    pub camera: String,
    /// Degrees Celsius.
    pub temperature_c: Option<f64>,
    /// Time since its start.
    pub uptime_s: f64,
    /// What is amiss in plain words, such as a weak supply; empty where all is well.
    pub warnings: Vec<String>,
    /// Its wires to other devices; `null` where it has none.
    pub wires: Option<WiresState>,
}

/// How the wires of a box are; what is counted is counted from its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WiresState {
    /// The line whose edges are marks.
    pub input: WireState,
    /// The line that other devices may listen to.
    pub output: WireState,
    /// Edges that were sent as marks.
    pub sent: u32,
    /// Edges that do not count, because they came too soon after another one.
    pub bounces: u32,
    /// Edges that came faster than the box reads them, and are lost.
    pub dropped: u32,
    /// Pulses of the output line.
    pub pulses: u32,
}

/// How a wire is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WireState {
    /// The box has no such wire.
    Off,
    /// It can be used.
    Ready,
    /// It cannot be used: there is no such chip or line, or another program has it.
    Missing,
}
