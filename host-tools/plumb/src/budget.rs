//! Where it is said how well a trial's conditions are known, as options.

use std::path::PathBuf;

use clap::Args;
use plumbline_files::BadInput;
use plumbline_report::budget::Conditioned;
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;

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
        let Some(camera) = &self.camera else { return Ok(None) };
        Conditioned::of(trial, points, zero, camera, self.budget.as_deref()).map(Some)
    }
}
