//! `plumb validate`: how well trials agree with motion capture.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_analysis::agreement::pairs::Paired;
use plumbline_analysis::agreement::{AxisAgreement, agreement};
use plumbline_files::BadInput;
use plumbline_files::write_all;
use serde::Serialize;

mod pair;
pub mod plot;
pub mod print;

pub use pair::{How, Used};

use pair::Pair;
use plumbline_trial::points::Points;

/// How well trials agree with a reference, such as motion capture.
///
/// The reference is brought to the camera's clock and, by linear interpolation, to its times; the
/// means of both are taken off, trials are joined, and each axis gets bias and 95 % limits of
/// agreement (Bland and Altman), the proportional error, and a regression line. Nothing is
/// interpolated over gaps. Confidence intervals go by the effective number of samples: samples of
/// a movement taken many times per second are not independent.
///
/// With its origins aligned the bias is 0 by construction. --keep-origins compares positions as
/// they are.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["trial", "manifest"])))]
#[command(after_help = "Examples:\n  \
    plumb validate --trial trials/p01 --reference p01.trc --marker LPSI --marker RPSI\n  \
    plumb validate --trial trials/p01 --reference plate.csv --columns time=t,ap=x,ml=y --unit m\n  \
    plumb validate --manifest validate.toml --json agreement.json --plot agreement.svg\n\n\
    The manifest has one [[pair]] for each trial, with trial and reference, whose paths are \
    relative to it, and any of the options below that differ: point, markers, axes, unit, columns, \
    delimiter, align, event, lag_max.")]
pub struct Arguments {
    /// The trial's folder
    #[arg(long, value_name = "FOLDER", requires = "reference")]
    pub trial: Option<PathBuf>,

    /// A file that lists several trials, each with its reference
    #[arg(long, value_name = "FILE", conflicts_with = "reference")]
    pub manifest: Option<PathBuf>,

    /// What they are compared with.
    #[command(flatten)]
    pub against: Against,

    /// Write all figures into this file
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,

    /// Draw differences and regression into this file
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,

    /// Replace these files if they exist
    #[arg(long)]
    pub force: bool,
}

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
    /// What a reader should know.
    pub warnings: Vec<String>,
    /// The values that were compared, trial by trial.
    #[serde(skip)]
    pub paired: Vec<Paired>,
}

impl Against {
    /// The first option that is given.
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
            return match self.given() {
                None => Ok(None),
                Some(option) => Err(BadInput::new(
                    &points.place,
                    option,
                    "an option of a reference, and there is none",
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
    /// Of trials that were brought together with their references.
    fn of(
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
            // Of movements that have nothing in common a slope says nothing.
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

/// Movements with a smaller r² are not the same one.
const ALIKE_MIN: f64 = 0.25;

/// How far the camera may see a movement that the reference sees as 1, and be in the same unit.
const SLOPES: std::ops::RangeInclusive<f64> = 0.2..=5.0;

/// Runs the subcommand.
///
/// # Errors
/// When a trial or a reference cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Against { reference, how, keep_origins } = &arguments.against;
    let pairs = match (&arguments.manifest, &arguments.trial, reference) {
        (Some(manifest), ..) => Pair::of_manifest(manifest, how)?,
        (None, Some(trial), Some(reference)) => {
            vec![Pair { trial: trial.clone(), reference: reference.clone(), how: how.clone() }]
        }
        _ => unreachable!("the trial requires the reference, or the manifest is given"),
    };
    let mut warnings = Vec::new();
    let mut compared = Vec::new();
    for pair in &pairs {
        let points = pair.points(&mut warnings)?;
        compared.push(pair.compare(&points, !keep_origins, &mut warnings)?);
    }
    let validation = Validation::of(compared, !keep_origins, warnings)?;
    write(arguments, &validation)?;
    for warning in &validation.warnings {
        eprintln!("warning: {warning}");
    }
    // A closed pipe must not hide the result.
    let _ = write!(std::io::stdout(), "{}", print::text(&validation));
    Ok(())
}

fn write(arguments: &Arguments, validation: &Validation) -> anyhow::Result<()> {
    let mut outputs = Vec::new();
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(validation)? + "\n";
        outputs.push((path.clone(), text.into_bytes()));
    }
    if let Some(path) = &arguments.plot {
        outputs.push((path.clone(), plot::svg(validation)?.into_bytes()));
    }
    Ok(write_all(&outputs, arguments.force)?)
}
