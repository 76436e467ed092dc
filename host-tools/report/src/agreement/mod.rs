//! How well trials agree with a reference, such as motion capture: what was found, its tables, its
//! pictures, and its part of a trial's page.

use plumbline_analysis::agreement::pairs::Paired;
use plumbline_analysis::agreement::{AxisAgreement, agreement};
use plumbline_files::BadInput;
use plumbline_trial::frame::Trunk;
use serde::{Deserialize, Serialize};

mod plot;
mod print;
mod section;

pub use plot::svg;
pub use print::text;
pub(crate) use section::section;

/// With a smaller r² two movements are not the same.
const ALIKE_MIN: f64 = 0.25;

/// Slopes for which both are plausibly in the same unit.
const SLOPES: std::ops::RangeInclusive<f64> = 0.2..=5.0;

/// How clocks are brought together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// By the lag with the largest correlation of the positions.
    Lag,
    /// By an event that both have: the trial's t = 0 and --event.
    Events,
    /// Not at all: the reference's times are the trial's.
    None,
}

/// What was compared, as the JSON has it.
#[derive(Debug, Clone, Serialize)]
pub struct Used {
    /// The trial's folder.
    pub trial: String,
    /// The reference's file.
    pub reference: String,
    /// `lower` or `upper`.
    pub point: Trunk,
    /// How the clocks were brought together.
    pub align: Align,
    /// The trial's time of a movement less the reference's, seconds.
    pub lag_s: f64,
    /// Of the positions at that lag, where it was searched.
    pub correlation: Option<f64>,
    /// Samples that were compared.
    pub samples: usize,
    /// From the first of them to the last, seconds.
    pub length_s: f64,
    /// What was taken off measured less reference to align the origins, mm: AP, ML, SI.
    pub offset_mm: [Option<f64>; 3],
}

impl Used {
    /// How the clocks were brought together, for people.
    #[must_use]
    pub fn alignment(&self) -> String {
        let lag_s = self.lag_s;
        match (self.align, self.correlation) {
            (Align::Lag, Some(r)) => {
                format!(
                    "lag {lag_s:.4} s (the trial's time less the reference's), at which both \
                     correlate most (correlation {r:.4})"
                )
            }
            (Align::Lag, None) => format!("lag {lag_s:.4} s"),
            (Align::Events, _) => format!("lag {lag_s:.4} s, by an event that both have"),
            (Align::None, _) => "no lag: the reference's times are the trial's".to_owned(),
        }
    }
}

/// What was found, as the JSON has it.
#[derive(Debug, Clone, Serialize)]
pub struct Validation {
    /// The program that made it.
    pub program: &'static str,
    /// The trials with their references.
    pub pairs: Vec<Used>,
    /// Whether the means of both were taken off, trial by trial: then the bias is 0 by
    /// construction.
    pub origins_aligned: bool,
    /// The agreement of all of them together.
    pub axes: Vec<AxisAgreement>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
    /// The values that were compared, trial by trial.
    #[serde(skip)]
    pub paired: Vec<Paired>,
}

impl Validation {
    /// From trials and their references, already on one clock.
    ///
    /// # Errors
    /// When they are too short, or have no axis in common.
    pub fn of(
        compared: Vec<(Used, Paired)>,
        origins_aligned: bool,
        mut warnings: Vec<String>,
    ) -> Result<Self, BadInput> {
        let (pairs, paired): (Vec<Used>, Vec<Paired>) = compared.into_iter().unzip();
        let axes = agreement(&paired)
            .map_err(|error| BadInput::whole("the pairs", error, "give longer recordings"))?;
        if axes.is_empty() {
            let remedy = "give pairs with an axis in common, or validate them one by one";
            return Err(BadInput::whole("the pairs", "no axis is in all of them", remedy));
        }
        for axis in &axes {
            let Some(line) = axis.regression else { continue };
            // The slope of movements that have nothing in common means nothing.
            if line.correlation.is_none_or(|it| it.r_squared < ALIKE_MIN) {
                continue;
            }
            let (axis, slope) = (axis.axis, line.slope);
            if slope < 0.0 {
                warnings.push(format!("{axis} of the reference runs the other way: check --axes"));
            }
            if !SLOPES.contains(&slope.abs()) {
                warnings.push(format!(
                    "{axis} of the camera moves {slope:.4} times as far as that of the reference: \
                     check the reference's unit"
                ));
            }
        }
        let program = concat!("plumb ", env!("CARGO_PKG_VERSION"));
        Ok(Self { program, pairs, origins_aligned, axes, warnings, paired })
    }
}
