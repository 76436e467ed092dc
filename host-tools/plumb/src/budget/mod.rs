//! The uncertainty budget of a trial: what is known of its conditions, and how it is shown.

use std::path::PathBuf;

use clap::Args;
use plumbline_analysis::filter::Design;
use plumbline_analysis::sway::Settings;
use plumbline_files::{BadInput, camera};
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_uncertainty::inputs::{self, Inputs};
use plumbline_uncertainty::{Budget, COVERAGE_FACTOR, Group, Measured};
use serde::Serialize;

pub mod tables;

/// Where it is said how well a trial's conditions are known.
#[derive(Debug, Clone, Args)]
pub struct Conditions {
    /// The camera.toml that the box had, as `plumb calibrate` wrote it: for the uncertainty budget
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,

    /// How well print, targets, scene and times are known, as `plumb budget --new` writes it
    /// [default: the values in that file]
    #[arg(long, value_name = "FILE", requires = "camera")]
    pub budget: Option<PathBuf>,
}

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

impl Conditions {
    /// The first option that is given: none is without the camera.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        self.camera.as_ref().map(|_| "--camera")
    }

    /// A trial and how well its conditions are known; `None` where no camera is given.
    ///
    /// # Errors
    /// When a file cannot be used, or does not belong to the trial.
    pub fn of(
        &self,
        trial: &Trial,
        points: &Points,
        zero: Zero,
    ) -> Result<Option<Conditioned>, BadInput> {
        let Some(path) = &self.camera else { return Ok(None) };
        let camera = camera::read(path)?;
        let inputs = self.budget.as_deref().map(inputs::read).transpose()?.unwrap_or_default();
        let measured = Measured::of(trial, points, zero, &camera, &path.display().to_string())?;
        let (source, zero) = (points.place.clone(), points.zero.clone());
        Ok(Some(Conditioned { source, zero, inputs, measured }))
    }
}

/// A trial under known conditions.
pub struct Conditioned {
    source: String,
    zero: String,
    inputs: Inputs,
    measured: Measured,
}

impl Conditioned {
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
