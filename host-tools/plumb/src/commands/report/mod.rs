//! `plumb report`: a trial, or a study, on one page.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_files::BadInput;
use plumbline_files::{directory_of, write_all};
use plumbline_study::manifest;
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;

use crate::agreement::Against;
use crate::arguments::method::Method;
use crate::budget::Conditions;

mod agreement;
mod budget;
mod labels;
mod plots;
mod study;
mod trial;
mod verdict;

/// A trial or a study on one page, to be read in any browser, offline or on paper.
///
/// Of a trial: sway paths in the three planes, positions over time with events and gaps, spectra,
/// all figures, how good the data are and, with --camera, how well the figures are known (see `plumb
/// budget`) and, with --reference, how well the trial agrees with motion capture (see `plumb
/// validate`). Of a study: path lengths by direction, condition and
/// time, and their statistics. The page is one file that needs nothing else.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "Examples:\n  plumb report trials/p01-control --out p01.html\n  \
    plumb report trials/p01-control --bins 0-30,30-60 --out p01.html\n  \
    plumb report trials/p01-control --camera camera.toml --budget budget.toml\n  \
    plumb report trials/p01-control --reference p01.trc --marker LPSI --marker RPSI\n  \
    plumb report study.toml --out study.html")]
pub struct Arguments {
    /// The trial's folder, or a study.toml
    source: PathBuf,

    /// How figures are made.
    #[command(flatten)]
    method: Method,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long)]
    zero: Option<Zero>,

    /// What the trial is compared with.
    #[command(flatten)]
    against: Against,

    /// How well its conditions are known.
    #[command(flatten)]
    conditions: Conditions,

    /// The page [default: report.html in the trial's folder, or beside study.toml]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Replace the page if it exists
    #[arg(long)]
    force: bool,
}

/// A study would not hear of them.
fn refuse_options_of_a_trial(arguments: &Arguments) -> Result<(), BadInput> {
    let Arguments { source, method, zero, against, conditions, out: _, force: _ } = arguments;
    let zero = zero.map(|_| "--zero");
    match method.given().or(zero).or(against.given()).or(conditions.given()) {
        None => Ok(()),
        Some(option) => Err(BadInput::new(
            source.display(),
            option,
            "an option of a trial; a study has its settings in study.toml",
            "leave it out; `plumb study --new FILE` explains what a study.toml can say",
        )),
    }
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial cannot be read, or the page cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let source = &arguments.source;
    let (html, warnings, folder) = if source.is_file() {
        if source.extension().is_none_or(|it| it != "toml") {
            let remedy = "give the folder that `plumb receive --out` has made, or a study.toml";
            let found = "neither a trial's folder nor a study";
            return Err(BadInput::whole(source.display(), found, remedy).into());
        }
        refuse_options_of_a_trial(arguments)?;
        let figures = plumbline_study::figures::analyze(&manifest::read(source)?)?;
        (study::report(&figures)?, figures.warnings, directory_of(source))
    } else {
        let trial = Trial::open(source)?;
        let zero = arguments.zero.unwrap_or(trial.manifest.zero);
        let mut points = Points::of(&trial, zero)?;
        let validation = arguments.against.validate(&points)?;
        points.warnings.extend(validation.iter().flat_map(|it| it.warnings.clone()));
        let settings = arguments.method.settings();
        let conditioned = arguments.conditions.of(&trial, &points, zero)?;
        let budget = conditioned.map(|it| it.budget(&settings)).transpose()?;
        points.warnings.extend(budget.iter().flat_map(|it| it.budget.warnings.clone()));
        let beside = [
            budget.as_ref().map(budget::section),
            validation.as_ref().map(agreement::section).transpose()?,
        ];
        let html = trial::report(&trial, &points, &arguments.method, &beside)?;
        (html, points.warnings, &**source)
    };
    let out = arguments.out.clone().unwrap_or_else(|| folder.join("report.html"));
    write_all(&[(out.clone(), html.into_bytes())], arguments.force)?;
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{}: open it in a browser", out.display());
    Ok(())
}
