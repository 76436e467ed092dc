//! How well trials agree with a reference, such as motion capture.

use std::path::PathBuf;

use clap::Args;
use plumbline_analysis::agreement::pairs::Paired;
use plumbline_analysis::agreement::{AxisAgreement, agreement};
use plumbline_files::BadInput;
use plumbline_trial::points::Points;
use serde::Serialize;

pub mod pair;
pub mod plot;
pub mod print;

use pair::{How, Pair, Used};

/// With a smaller r² two movements are not the same.
const ALIKE_MIN: f64 = 0.25;

/// Slopes for which both are plausibly in the same unit.
const SLOPES: std::ops::RangeInclusive<f64> = 0.2..=5.0;

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

impl Validation {
    /// From trials and their references, already on one clock.
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
