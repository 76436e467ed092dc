//! How a box is, by its own word.

use plumbline::packet::{CameraState, Health, TriggerState};
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
    /// Edges that came too fast for the box, and are lost.
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

impl HealthState {
    /// As a box tells it.
    #[must_use]
    pub fn of(health: &Health) -> Self {
        let camera = match health.camera {
            CameraState::Starting => "starting",
            CameraState::Running => "running",
            CameraState::Stalled => "stalled",
            CameraState::Lost => "lost",
            CameraState::Ended => "ended",
        };
        let mut warnings = Vec::new();
        if health.undervoltage == Some(true) {
            warnings.push("its supply is too weak: use the one that came with it".to_owned());
        }
        if health.throttled == Some(true) {
            warnings.push("it is slowed down by heat or a weak supply: let air to it".to_owned());
        }
        match health.camera {
            CameraState::Stalled => warnings.push("its camera gives no frames".to_owned()),
            CameraState::Lost => {
                warnings.push("its camera is absent or reports errors".to_owned());
            }
            _ => {}
        }
        Self {
            camera: camera.to_owned(),
            temperature_c: health.temperature_decicelsius.map(|it| f64::from(it) / 10.0),
            // Whole minutes: the state does not change with every word of the box.
            uptime_s: (health.uptime_ms / 60_000 * 60) as f64,
            warnings,
            wires: WiresState::of(health),
        }
    }
}

impl WiresState {
    /// The wires of a box that has some.
    fn of(health: &Health) -> Option<Self> {
        let state = |state: TriggerState| match state {
            TriggerState::Off => WireState::Off,
            TriggerState::Ready => WireState::Ready,
            TriggerState::Missing => WireState::Missing,
        };
        let it = health.trigger;
        let (input, output) = (state(it.input), state(it.output));
        let (sent, bounces, dropped, pulses) = (it.sent, it.bounces, it.dropped, it.pulses);
        let has_some = input != WireState::Off || output != WireState::Off;
        has_some.then_some(Self { input, output, sent, bounces, dropped, pulses })
    }
}
