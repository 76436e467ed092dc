//! How well a measurement agrees with a reference, such as motion capture: turns two recordings of
//! the same movement into a bias, limits of agreement and a regression line for each axis.
//!
//! ```text
//! measured  ─────────────────────┐
//! reference ─▶ axes ─▶ lag ──────┴─▶ pairs ─┐
//!                     ... other trials ─────┴─▶ Bland-Altman, regression
//! ```
//!
//! As in the paper, the reference is linearly interpolated at the camera's times, the origins are
//! aligned, and the trials are concatenated. Gaps are not interpolated.
//!
//! Aligning the origins makes the bias 0 by construction; only the limits are then informative.

pub mod axes;
pub mod effective;
pub mod lag;
pub mod pairs;

use serde::Serialize;

use crate::series::Axis;
use crate::statistics::Undefined;
use crate::statistics::bland_altman::{BlandAltman, bland_altman};
use crate::statistics::regression::{Line, line};

use effective::effective_samples;
use pairs::Paired;

/// The agreement along one axis, over all trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisAgreement {
    /// `AP`, `ML` or `SI`.
    pub axis: &'static str,
    /// Bias and limits, mm, of measured minus reference.
    pub bland_altman: BlandAltman,
    /// measured = intercept + slope reference; `None` where the reference does not move.
    pub regression: Option<Line>,
    /// Root mean square of the differences, mm.
    pub rms_mm: f64,
}

/// The agreement over trials, along each axis that all of them have. Its confidence intervals use
/// the [`effective_samples`] of the differences.
///
/// # Errors
/// When an axis has too few pairs.
pub fn agreement(trials: &[Paired]) -> Result<Vec<AxisAgreement>, Undefined> {
    let shared = Axis::ALL.into_iter().filter(|axis| {
        !trials.is_empty() && trials.iter().all(|trial| trial.along(*axis).is_some())
    });
    shared.map(|axis| along(trials, axis)).collect()
}

fn along(trials: &[Paired], axis: Axis) -> Result<AxisAgreement, Undefined> {
    let (mut reference, mut measured, mut runs) = (Vec::new(), Vec::new(), Vec::new());
    for trial in trials {
        let Some(pairs) = trial.along(axis) else { continue };
        let differences = pairs.differences();
        runs.extend(trial.runs().map(|run| differences[run].to_vec()));
        reference.extend_from_slice(&pairs.reference_mm);
        measured.extend_from_slice(&pairs.measured_mm);
    }
    let effective = effective_samples(&runs);
    let differences = || runs.iter().flatten();
    let mean_square = differences().map(|it| it * it).sum::<f64>() / differences().count() as f64;
    Ok(AxisAgreement {
        axis: axis.word(),
        bland_altman: bland_altman(&reference, &measured, effective)?,
        regression: match line(&reference, &measured, effective) {
            Ok(line) => Some(line),
            Err(Undefined::NoSpread) => None,
            Err(other) => return Err(other),
        },
        rms_mm: mean_square.sqrt(),
    })
}
