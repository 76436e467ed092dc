//! The uncertainty budget of a trial: what is known of its conditions, its tables, and its part of a
//! trial's page.

use std::path::Path;

use plumbline_analysis::filter::Design;
use plumbline_analysis::sway::Settings;
use plumbline_files::{BadInput, camera};
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_uncertainty::inputs::{self, Inputs};
use plumbline_uncertainty::{Budget, COVERAGE_FACTOR, Group, Measured};
use serde::Serialize;

mod section;
mod tables;

pub(crate) use section::section;
pub use tables::text;

/// The budget of one trial, as the JSON has it.
#[derive(Debug, Clone, Serialize)]
pub struct TrialBudget {
    /// The program that made it.
    pub program: &'static str,
    /// The trial.
    pub source: String,
    /// What t = 0 is.
    pub zero: String,
    /// The filter.
    pub filter: Design,
    /// The time that the figures are of, seconds from t = 0; absent for the whole trial, and
    /// without an end up to the trial's.
    pub span_s: Option<[Option<f64>; 2]>,
    /// The groups of causes that are in each uncertainty.
    pub uncertainty_contains: Vec<&'static str>,
    /// How well the conditions are known.
    pub inputs: Inputs,
    /// From the standard to the expanded uncertainty.
    pub coverage_factor: f64,
    /// What was found.
    #[serde(flatten)]
    pub budget: Budget,
}

/// A trial under known conditions.
pub struct Conditioned {
    source: String,
    zero: String,
    inputs: Inputs,
    measured: Measured,
}

impl Conditioned {
    /// A trial that was recorded with the camera of this file, and how well its conditions are known:
    /// as that of `budget` says, otherwise as usual.
    ///
    /// # Errors
    /// When a file cannot be used, or does not belong to the trial.
    pub fn of(
        trial: &Trial,
        points: &Points,
        zero: Zero,
        camera: &Path,
        budget: Option<&Path>,
    ) -> Result<Self, BadInput> {
        let place = camera.display().to_string();
        let camera = camera::read(camera)?;
        let inputs = budget.map(inputs::read).transpose()?.unwrap_or_default();
        let measured = Measured::of(trial, points, zero, &camera, &place)?;
        let (source, zero) = (points.place.clone(), points.zero.clone());
        Ok(Self { source, zero, inputs, measured })
    }

    /// The budget of the trial's figures.
    ///
    /// # Errors
    /// When the settings do not suit the trial.
    pub fn budget(self, settings: &Settings) -> Result<TrialBudget, BadInput> {
        let Self { source, zero, inputs, measured } = self;
        let budget = Budget::of(&measured, &inputs, settings, &source)?;
        Ok(TrialBudget {
            program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
            source,
            zero,
            filter: settings.filter,
            span_s: settings.span_s.as_ref().map(|it| {
                [it.start, it.end].map(|time_s| Some(time_s).filter(|it| it.is_finite()))
            }),
            uncertainty_contains: Group::ALL
                .into_iter()
                .filter(|group| budget.terms.iter().any(|term| term.name.group() == *group))
                .map(Group::word)
                .collect(),
            inputs,
            coverage_factor: COVERAGE_FACTOR,
            budget,
        })
    }
}
