//! `plumb validate`: how well trials agree with motion capture.

use std::path::PathBuf;

use clap::Args;
use plumbline_files::write_all;
use plumbline_report::agreement::{self, Validation};

use crate::agreement::Against;
use crate::agreement::pair::Pair;
use crate::ui::stdout;

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
    trial: Option<PathBuf>,

    /// A file that lists several trials, each with its reference
    #[arg(long, value_name = "FILE", conflicts_with = "reference")]
    manifest: Option<PathBuf>,

    /// What they are compared with.
    #[command(flatten)]
    against: Against,

    /// Write all figures into this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Draw differences and regression into this file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,

    /// Replace these files if they exist
    #[arg(long)]
    force: bool,
}

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
    stdout::print(&agreement::text(&validation))?;
    Ok(())
}

fn write(arguments: &Arguments, validation: &Validation) -> anyhow::Result<()> {
    let mut outputs = Vec::new();
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(validation)? + "\n";
        outputs.push((path.clone(), text.into_bytes()));
    }
    if let Some(path) = &arguments.plot {
        outputs.push((path.clone(), agreement::svg(validation)?.into_bytes()));
    }
    Ok(write_all(&outputs, arguments.force)?)
}
