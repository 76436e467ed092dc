//! `plumb budget`: how well the figures of a trial are known.

use std::path::PathBuf;

use clap::Args;
use plumbline_files::write_all;
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_uncertainty::inputs;

use crate::arguments::method::Window;
use crate::budget::Conditions;
use crate::ui::stdout;

/// How well the figures of a trial are known, cause by cause: an uncertainty budget after the GUM.
///
/// The ± of `plumb analyze` is the noise from frame to frame alone. Most of what is not known of a
/// path, an RMS, a range, an ellipse or a distance is the same in every frame: the scale of the
/// print, the calibration of the lens, targets that are not flat, axes that are not upright. Each of
/// these causes displaces the whole trial; the figures are computed again, and the change is its
/// contribution. U is twice the combined standard uncertainty (k = 2) and contains the truth in
/// about 95 of 100 trials.
///
/// The calibration's covariance is in the camera.toml of `plumb calibrate`. The noise is in the
/// poses. How well the rest is known, you say in a budget file: `plumb budget --new budget.toml`
/// writes one with the values that are taken without it, and explains each.
///
/// What is alike in all trials of a session (the same print, camera and scene) does not hide a
/// difference between two of them: for that, the last column counts.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["trial", "new"])))]
#[command(after_help = "Examples:\n  plumb budget --new budget.toml\n  \
    plumb budget trials/p01-control --camera camera.toml --budget budget.toml\n  \
    plumb budget trials/p01-control --camera camera.toml --span 0-20 --json p01-budget.json\n  \
    plumb report trials/p01-control --camera camera.toml --budget budget.toml    the same on the report")]
pub struct Arguments {
    /// The trial's folder
    #[arg(requires = "camera")]
    trial: Option<PathBuf>,

    /// Write a budget file with every setting and its meaning
    #[arg(long, value_name = "FILE", conflicts_with_all = ["camera", "budget", "json"])]
    new: Option<PathBuf>,

    /// How well the conditions are known.
    #[command(flatten)]
    conditions: Conditions,

    /// What the figures are of.
    #[command(flatten)]
    window: Window,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long)]
    zero: Option<Zero>,

    /// Write the budget with every term into this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Replace the file that is written if it exists
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial, the camera or the budget file cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(path) = &arguments.new {
        write_all(&[(path.clone(), inputs::EXAMPLE.into())], arguments.force)?;
        eprintln!("written to {}; enter what you have measured", path.display());
        return Ok(());
    }
    let Some(folder) = &arguments.trial else { unreachable!("one of both is required") };
    let trial = Trial::open(folder)?;
    let zero = arguments.zero.unwrap_or(trial.manifest.zero);
    let points = Points::of(&trial, zero)?;
    let conditioned = arguments.conditions.of(&trial, &points, zero)?;
    let Some(conditioned) = conditioned else { unreachable!("a trial requires --camera") };
    let settings = arguments.window.settings(&points);
    // A long trial is large, and all that is needed of it has been taken.
    let Points { warnings, points, .. } = points;
    drop((trial, points));
    let budget = conditioned.budget(&settings)?;
    for warning in warnings.iter().chain(&budget.budget.warnings) {
        eprintln!("warning: {warning}");
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&budget)? + "\n";
        write_all(&[(path.clone(), text.into_bytes())], arguments.force)?;
    }
    stdout::print(&plumbline_report::budget::text(&budget))?;
    Ok(())
}
