//! `plumb report`: a trial, or a study, on one page.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use plumbline_analysis::sway::Settings;
use plumbline_cohort::given::People;
use plumbline_files::BadInput;
use plumbline_files::{directory_of, write_all};
use plumbline_report::study;
use plumbline_report::trial::{self, Beside};
use plumbline_study::reference::{self, Comparison};
use plumbline_study::tidy::{self, About};
use plumbline_trial::Trial;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;

use crate::agreement::Against;
use crate::arguments::method::Method;
use crate::budget::Conditions;

/// A trial or a study on one page, to be read in any browser, offline or on paper.
///
/// Of a trial: sway paths in the three planes, positions over time with events and gaps, spectra,
/// all figures, how good the data are and, with --camera, how well the figures are known (see `plumb
/// budget`) and, with --reference, how well the trial agrees with motion capture (see `plumb
/// validate`) and, with --bands, where its figures lie among those of a cohort (see `plumb cohort
/// reference`). Figures, filter and span are those of `plumb analyze`; a table of another system,
/// such as a force plate, gets the same page with --table. Of a study: the figures that it compares,
/// by condition and time, and their statistics. The page is one file that needs nothing else.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["source", "table"])))]
#[command(after_help = "Examples:\n  plumb report trials/p01-control --out p01.html\n  \
    plumb report trials/p01-control --bins 0-30,30-60 --out p01.html\n  \
    plumb report trials/p01-control --camera camera.toml --budget budget.toml\n  \
    plumb report trials/p01-control --reference p01.trc --marker LPSI --marker RPSI\n  \
    plumb report trials/p01-control --bands bands.parquet --age 63\n  \
    plumb report --table plate.txt --columns 'time=Time[s],ap=COPx[cm],ml=COPy[cm]' --unit cm \\\n      \
    --out plate.html\n  \
    plumb report study.toml --out study.html")]
pub struct Arguments {
    /// The trial's folder, or a study.toml
    source: Option<PathBuf>,

    /// A table of positions instead (text; .gz is unpacked)
    #[arg(long, value_name = "FILE", requires_all = ["columns", "unit"])]
    table: Option<PathBuf>,

    /// How figures are made.
    #[command(flatten)]
    method: Method,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long, conflicts_with = "table")]
    zero: Option<Zero>,

    /// What the trial is compared with.
    #[command(flatten)]
    against: Against,

    /// How well its conditions are known.
    #[command(flatten)]
    conditions: Conditions,

    /// Show the trial's figures beside these reference bands, as `plumb cohort reference` makes them
    #[arg(long, value_name = "FILE", conflicts_with = "table")]
    bands: Option<PathBuf>,

    /// The participant's age, years [default: from participants.tsv in a folder above the trial]
    #[arg(long, value_name = "YEARS", requires = "bands")]
    age: Option<f64>,

    /// The page [default: report.html in the trial's folder, or beside study.toml or the table]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Replace the page if it exists
    #[arg(long)]
    force: bool,
}

/// A study would not hear of them.
fn refuse_options_of_a_trial(arguments: &Arguments, source: &Path) -> Result<(), BadInput> {
    let Arguments { method, zero, against, conditions, .. } = arguments;
    let zero = zero.map(|_| "--zero").or(arguments.bands.as_ref().map(|_| "--bands"));
    let beside = against.given().or(against.how.table.given()).or(conditions.given());
    match method.given().or(zero).or(beside) {
        None => Ok(()),
        Some(option) => Err(BadInput::new(
            source.display(),
            option,
            "an option of a trial; a study has its settings in study.toml",
            "leave it out; `plumb study --new FILE` explains what a study.toml can say",
        )),
    }
}

/// A page, what its reader should know, and the folder in which it usually lies.
type Page<'a> = (String, Vec<String>, &'a Path);

fn of_study<'a>(arguments: &Arguments, source: &'a Path) -> anyhow::Result<Page<'a>> {
    if source.extension().is_none_or(|it| it != "toml") {
        let remedy = "give the folder that `plumb receive --out` has made, or a study.toml; a \
                      table of positions takes --table, --columns and --unit";
        let found = "neither a trial's folder nor a study";
        return Err(BadInput::whole(source.display(), found, remedy).into());
    }
    refuse_options_of_a_trial(arguments, source)?;
    let figures = crate::study::analyze(&crate::study::read(source, None)?)?;
    Ok((study::report(&figures)?, figures.warnings, directory_of(source)))
}

fn of_table<'a>(arguments: &Arguments, path: &'a Path) -> anyhow::Result<Page<'a>> {
    let Arguments { method, against, conditions, .. } = arguments;
    if let Some(option) = against.given().or(conditions.given()) {
        let found = "an option of a trial, but a table is given";
        return Err(BadInput::new(path.display(), option, found, "leave it out").into());
    }
    let Some(table) = against.how.table.of(path)? else {
        unreachable!("--table requires both");
    };
    let points = Points::of_table(&table)?;
    let (html, warnings) =
        trial::report(None, &points, &method.settings(&points), &Beside::default())?;
    Ok((html, warnings, directory_of(path)))
}

fn of_trial<'a>(arguments: &Arguments, folder: &'a Path) -> anyhow::Result<Page<'a>> {
    let trial = Trial::open(folder)?;
    let zero = arguments.zero.unwrap_or(trial.manifest.zero);
    let mut points = Points::of(&trial, zero)?;
    let validation = arguments.against.validate(&points)?;
    points.warnings.extend(validation.iter().flat_map(|it| it.warnings.clone()));
    let settings = arguments.method.settings(&points);
    let conditioned = arguments.conditions.of(&trial, &points, zero)?;
    let budget = conditioned.map(|it| it.budget(&settings)).transpose()?;
    points.warnings.extend(budget.iter().flat_map(|it| it.budget.warnings.clone()));
    let comparison = compare(arguments, &trial, &points, &settings)?;
    let beside = Beside {
        budget: budget.as_ref(),
        validation: validation.as_ref(),
        comparison: comparison.as_ref(),
    };
    let (html, warnings) = trial::report(Some(&trial), &points, &settings, &beside)?;
    Ok((html, warnings, folder))
}

/// The trial's figures beside the bands that are given.
fn compare(
    arguments: &Arguments,
    trial: &Trial,
    points: &Points,
    settings: &Settings,
) -> Result<Option<Comparison>, BadInput> {
    let Some(path) = &arguments.bands else { return Ok(None) };
    let bands = reference::read(path)?;
    let text = |text: &Option<String>| text.as_deref().unwrap_or_default().trim().to_owned();
    let about = About {
        participant: text(&trial.manifest.participant),
        condition: text(&trial.manifest.condition),
        trial: String::new(),
        verdict: trial.manifest.verdict().grade(),
    };
    let age_years = match arguments.age {
        Some(age) => Some(age),
        None => {
            let people = People::of(std::slice::from_ref(&trial.folder), None)?;
            people.get(&trial.folder, &about.participant)?.age_years
        }
    };
    let mut points = points.clone();
    // The uncertainty of the figures is not compared, and takes long.
    points.points.iter_mut().for_each(|it| it.noise = None);
    let rows = tidy::rows(about, &points, settings);
    Ok(Some(reference::compare(&bands, &rows, age_years)))
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial cannot be read, or the page cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (html, warnings, folder) = match (&arguments.table, &arguments.source) {
        (Some(path), _) => of_table(arguments, path)?,
        (None, Some(source)) if source.is_file() => of_study(arguments, source)?,
        (None, Some(source)) => of_trial(arguments, source)?,
        (None, None) => unreachable!("one of both is required"),
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
