//! What a trial is compared with, such as motion capture: options, and a trial and its reference on
//! one clock.

use std::path::PathBuf;

use clap::Args;
use plumbline_files::BadInput;
use plumbline_report::agreement::Validation;
use plumbline_trial::points::Points;

pub mod pair;

use pair::{How, Pair};

/// What a trial is compared with.
#[derive(Debug, Clone, Args)]
pub struct Against {
    /// The reference's recording: TRC, C3D, or a table with --columns (.gz is unpacked)
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,

    /// How trial and reference belong together.
    #[command(flatten)]
    pub how: How,

    /// Compare positions as they are, and do not take the means off
    #[arg(long)]
    pub keep_origins: bool,
}

impl Against {
    /// The first option that is given but those that a table of any kind has.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let Self { reference, how, keep_origins } = self;
        let reference = reference.as_ref().map(|_| "--reference");
        reference.or(how.given()).or(keep_origins.then_some("--keep-origins"))
    }

    /// The agreement of one trial's points with the reference; `None` where there is none.
    ///
    /// # Errors
    /// When the reference cannot be used, or is not given and something is said of it.
    pub fn validate(&self, points: &Points) -> Result<Option<Validation>, BadInput> {
        let Some(reference) = self.reference.clone() else {
            return match self.given().or(self.how.table.given()) {
                None => Ok(None),
                Some(option) => Err(BadInput::new(
                    &points.place,
                    option,
                    "an option of a reference, but no reference is given",
                    "name its file with --reference, or leave it out",
                )),
            };
        };
        let pair = Pair { trial: PathBuf::from(&points.place), reference, how: self.how.clone() };
        let mut warnings = Vec::new();
        let compared = pair.compare(points, !self.keep_origins, &mut warnings)?;
        Validation::of(vec![compared], !self.keep_origins, warnings).map(Some)
    }
}
