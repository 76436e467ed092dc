//! The causes of uncertainty, and how well each is known.

use serde::Serialize;

use crate::inputs::Inputs;
use crate::lens::LensUncertainty;

/// A cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum TermName {
    Scale,
    Stretch,
    Lens,
    Flatness,
    Tilt,
    Turn,
    Noise,
    NoiseCorrection,
    Jitter,
    Zero,
    Clock,
    Steps,
}

/// How its uncertainty was found, in the GUM's terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Kind {
    /// From repeated observations.
    A,
    /// By judgement.
    B,
}

/// What shares the same error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alike {
    /// All trials with these prints.
    Print,
    /// All trials with this calibration.
    Calibration,
    /// All trials with the targets glued as they are.
    Targets,
    /// All trials with this scene.
    Scene,
    /// All trials with this box.
    Device,
    /// This trial alone.
    Trial,
    /// No two frames.
    Frame,
}

impl Alike {
    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Print => "all trials with this print",
            Self::Calibration => "all trials with this calibration",
            Self::Targets => "all trials with these targets",
            Self::Scene => "all trials with this scene",
            Self::Device => "all trials with this box",
            Self::Trial => "this trial only",
            Self::Frame => "random, from frame to frame",
        }
    }

    /// Whether all trials of a session have the same error, so that it does not hide a difference
    /// between them.
    #[must_use]
    pub fn shifts_all_trials(self) -> bool {
        !matches!(self, Self::Trial | Self::Frame)
    }
}

/// The terms by which a short table adds up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Group {
    Print,
    Lens,
    Flatness,
    Axes,
    Noise,
    Timing,
    Steps,
}

impl Group {
    /// All, in the order of the table.
    pub const ALL: [Self; 7] = [
        Self::Print,
        Self::Lens,
        Self::Flatness,
        Self::Axes,
        Self::Noise,
        Self::Timing,
        Self::Steps,
    ];

    /// Its heading.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Print => "print",
            Self::Lens => "lens",
            Self::Flatness => "flatness",
            Self::Axes => "axes",
            Self::Noise => "noise",
            Self::Timing => "timing",
            Self::Steps => "steps",
        }
    }
}

impl TermName {
    /// Where the short table counts it.
    #[must_use]
    pub fn group(self) -> Group {
        match self {
            Self::Scale | Self::Stretch => Group::Print,
            Self::Lens => Group::Lens,
            Self::Flatness => Group::Flatness,
            Self::Tilt | Self::Turn => Group::Axes,
            Self::Noise | Self::NoiseCorrection => Group::Noise,
            Self::Jitter | Self::Zero | Self::Clock => Group::Timing,
            Self::Steps => Group::Steps,
        }
    }

    /// What it is.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Scale => "scale of the print",
            Self::Stretch => "print: rows against columns",
            Self::Lens => "calibration of the lens",
            Self::Flatness => "flatness of each target",
            Self::Tilt => "tilt of the scene's axes",
            Self::Turn => "turn of the scene's axes",
            Self::Noise => "noise of the poses",
            Self::NoiseCorrection => "correction for noise",
            Self::Jitter => "jitter of the time stamps",
            Self::Zero => "time of t = 0",
            Self::Clock => "rate of the box's clock",
            Self::Steps => "correction for the steps",
        }
    }
}

/// A cause and how well it is known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Term {
    /// Which.
    pub name: TermName,
    /// Its standard uncertainty, in words with its unit.
    pub u: String,
    /// How that was found.
    pub kind: Kind,
    /// Degrees of freedom; `None` where they are infinite.
    pub freedom: Option<f64>,
    /// What shares the same error.
    pub alike: Alike,
}

/// All terms, in the order of their contributions.
pub(crate) fn terms(
    inputs: &Inputs,
    lens: &LensUncertainty,
    zero_u_s: Option<f64>,
    copies: usize,
) -> Vec<Term> {
    let Inputs { print, targets, scene, timing, noise } = inputs;
    let kind = |freedom: Option<f64>| freedom.map_or(Kind::B, |_| Kind::A);
    let judged = |name, u, freedom, alike| Term { name, u, kind: kind(freedom), freedom, alike };
    let scale_percent = 100.0 * print.u_mm / print.measured_mm;
    let zero = zero_u_s.map_or("not known".to_owned(), |u_s| format!("{:.2} ms", 1e3 * u_s));
    // Estimated from this many copies of the trial.
    let of_copies = (copies > 1).then(|| (copies - 1) as f64);
    vec![
        judged(TermName::Scale, format!("{scale_percent:.3} %"), print.freedom, Alike::Print),
        judged(TermName::Stretch, format!("{:.3} %", print.stretch_u_percent), None, Alike::Print),
        Term {
            name: TermName::Lens,
            u: format!("covariance, fx ±{:.2} px", lens.sd_fx_px),
            kind: Kind::A,
            freedom: lens.freedom,
            alike: Alike::Calibration,
        },
        judged(
            TermName::Flatness,
            format!("{:.3} mm", targets.bow_u_mm),
            targets.freedom,
            Alike::Targets,
        ),
        judged(TermName::Tilt, format!("{:.2}°", scene.tilt_u_deg), scene.freedom, Alike::Scene),
        judged(TermName::Turn, format!("{:.2}°", scene.turn_u_deg), scene.freedom, Alike::Scene),
        Term {
            name: TermName::Noise,
            u: "covariance of each pose".to_owned(),
            kind: Kind::A,
            freedom: of_copies,
            alike: Alike::Frame,
        },
        judged(
            TermName::NoiseCorrection,
            format!("{:.0} % of the noise's SD", noise.u_percent),
            None,
            Alike::Device,
        ),
        Term {
            name: TermName::Jitter,
            u: format!("{:.2} ms", 1e3 * timing.jitter_u_s),
            kind: Kind::B,
            freedom: of_copies,
            alike: Alike::Frame,
        },
        judged(TermName::Zero, zero, None, Alike::Trial),
        judged(TermName::Clock, format!("{:.0} ppm", timing.clock_u_ppm), None, Alike::Device),
        judged(TermName::Steps, "of the extrapolation".to_owned(), None, Alike::Trial),
    ]
}
