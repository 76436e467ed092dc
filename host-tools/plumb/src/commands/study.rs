//! `plumb study`: the statistics of many trials, or of any long table.

use std::path::{Path, PathBuf};

use clap::Args;
use plumbline_files::BadInput;
use plumbline_files::columns::Delimiter;
use plumbline_files::counting::counted;
use plumbline_files::write_all;
use plumbline_study::{inference, long, manifest};

use crate::ui::stdout;

/// The statistics of a study: many trials, or any table of measurements within subjects.
///
/// A study.toml names the trials (trials = ["trials/*"]), which say themselves who was measured
/// under which condition, and the figures to compare (figures = "all", or some; without it, path
/// length). Path length and mean velocity are compared by condition and time, all other figures
/// by condition, for each trunk and direction: means and SEM without the differences between
/// participants (Cousineau-Morey), Cohen's d, paired t tests with Bonferroni, repeated-measures
/// ANOVA with Mauchly's test and Greenhouse-Geisser, and the non-parametric ANOVA of Brunner,
/// Domhof and Langer, whose p is also given adjusted for the number of figures (Holm;
/// Benjamini-Hochberg).
///
/// A value needs 90 % of its time measured. If a participant lacks one, the study says which, why
/// and where; with drop_incomplete = true it goes on without them in that figure, and each table
/// says how many participants are in it.
///
/// With a [physiology] section the same is done for what was recorded with the sway: heart rate,
/// arterial pressure, stroke volume, cardiac output, cerebral blood flow velocity, oxygenation
/// and end-tidal CO2, from ECG, pressure and other signals in CSV files.
///
/// With --cohort, or with cohort = "..." in study.toml instead of trials, it compares the trials of a
/// cohort (see `plumb cohort`) that have the study's conditions and what [choose] asks for.
///
/// With --long the same is done for a table with one measurement per line.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["study", "long", "new"])))]
#[command(after_help = "Examples:\n  plumb study --new study.toml\n  \
    plumb study study.toml --json study.json\n  \
    plumb study --cohort cohort/ study.toml\n  \
    plumb study --long sway.csv --response path --within condition,time --subject id --json out.json")]
pub struct Arguments {
    /// The study
    study: Option<PathBuf>,

    /// Compare this cohort's trials, instead of those that the study names
    #[arg(long, value_name = "FOLDER", requires = "study")]
    cohort: Option<PathBuf>,

    /// Write an example study.toml with comments
    #[arg(long, value_name = "FILE")]
    new: Option<PathBuf>,

    /// A long table instead: one measurement per line, with its subject and its levels
    #[arg(long, value_name = "FILE", requires_all = ["response", "within", "subject"])]
    long: Option<PathBuf>,

    /// The table's column with what was measured
    #[arg(long, value_name = "COLUMN", requires = "long")]
    response: Option<String>,

    /// The table's columns with the within-subject factors, one or two.
    ///
    /// p of the paired comparisons is corrected after Bonferroni for a family of them. With one
    /// factor that is all its pairs of levels. With two: of the first, the comparisons of the same
    /// two levels at all levels of the second; of the second, all its pairs of levels within one
    /// level of the first.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', requires = "long")]
    within: Vec<String>,

    /// The table's column that identifies the subject
    #[arg(long, value_name = "COLUMN", requires = "long")]
    subject: Option<String>,

    /// What separates the table's columns
    #[arg(long, default_value = "comma", requires = "long")]
    delimiter: Delimiter,

    /// Leave out subjects that lack a measurement
    #[arg(long, requires = "long")]
    drop_incomplete: bool,

    /// Write all statistics into this file
    #[arg(long, value_name = "FILE", conflicts_with = "new")]
    json: Option<PathBuf>,

    /// Replace the file that is written if it exists
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the study or the table cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(path) = &arguments.new {
        write_all(&[(path.clone(), manifest::EXAMPLE.into())], arguments.force)?;
        eprintln!("written to {}; name your trials and conditions in it", path.display());
        return Ok(());
    }
    let (json, text) = match (&arguments.study, &arguments.long) {
        (Some(path), _) => of_study(path, arguments.cohort.as_deref())?,
        (None, Some(path)) => of_long(arguments, path)?,
        (None, None) => unreachable!("one of them is required"),
    };
    if let Some(path) = &arguments.json {
        write_all(&[(path.clone(), (json + "\n").into_bytes())], arguments.force)?;
    }
    stdout::print(&text)?;
    Ok(())
}

fn of_study(path: &Path, cohort: Option<&Path>) -> anyhow::Result<(String, String)> {
    let figures = crate::study::analyze(&crate::study::read(path, cohort)?)?;
    for warning in &figures.warnings {
        eprintln!("warning: {warning}");
    }
    let mut text = format!(
        "{}: {}; means and SEM without the differences between participants\n",
        figures.title,
        figures.participants_text(),
    );
    for part in figures.parts() {
        text += &format!("\n{}\n\n", part.title.to_uppercase());
        for table in &part.tables {
            text += &format!("{}\n", table.text());
        }
        text += &part.effects.text();
        text.extend(part.adjusted.map(|adjusted| adjusted + "\n"));
        text += &format!("\n{}", part.comparisons.text());
    }
    text += &format!("\n{}\n", inference::COMPARED);
    text.extend(figures.not_compared_lines().into_iter().map(|line| line + "\n"));
    Ok((serde_json::to_string_pretty(&figures)?, text))
}

fn of_long(arguments: &Arguments, path: &Path) -> anyhow::Result<(String, String)> {
    let (Some(response), Some(subject)) = (&arguments.response, &arguments.subject) else {
        unreachable!("--long requires both");
    };
    if !(1..=2).contains(&arguments.within.len()) {
        return Err(BadInput::whole(
            "--within",
            counted(arguments.within.len(), "factor"),
            "name one or two columns: --within condition,time",
        )
        .into());
    }
    let columns = long::Columns {
        response: response.clone(),
        within: arguments.within.clone(),
        subject: subject.clone(),
    };
    let figures = long::analyze(path, &columns, arguments.delimiter, arguments.drop_incomplete)?;
    for it in &figures.left_out {
        let cell = it.cell.join(", ");
        eprintln!("warning: subject {} is left out: no value in {cell}", it.subject);
    }
    Ok((serde_json::to_string_pretty(&figures)?, figures.text()))
}
