//! `plumb cohort`: a data set of many trials.

mod add;
mod check;
mod list;
mod reference;
mod remove;
mod show;

use clap::{Args, Subcommand};

/// Keep a data set of many trials, in Parquet files that every data program reads.
///
/// A cohort is a folder with three tables: the trials, their figures, and their points over time.
/// `plumb cohort add` puts trials into it; `plumb study --cohort` compares them; DuckDB, Polars,
/// pandas, R and Spark read it as it is.
///
/// A trial's key is participant, session, condition and run. The column `trial`, which all three
/// tables have, is the SHA-256 of the trial's content.
#[derive(Debug, Args)]
#[command(after_help = "Tables:\n  \
    trials/*.parquet    one row for each trial: key, start, duration, rate, frames, gaps, verdict,\n                      \
    box, calibration, age, sex, height, mass\n  \
    figures/*.parquet   the table of `plumb figures`: one row for each figure\n  \
    points/participant=P/session=S/condition=C/run=R/points.parquet\n                      \
    both trunk points over time: one row for each frame\n\n\
Examples:\n  plumb cohort add trials/* --to cohort/\n  \
    plumb cohort list cohort/\n  \
    plumb cohort remove cohort/ --participant P07\n  \
    plumb study --cohort cohort/ study.toml\n  \
    duckdb -c \"select condition, avg(value) from 'cohort/figures/*.parquet' \\\n      \
    where figure = 'path length' and direction = 'APML' and segment = 'whole' group by all\"")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Add(add::Arguments),
    Remove(remove::Arguments),
    List(list::Arguments),
    Show(show::Arguments),
    Check(check::Arguments),
    Reference(reference::Arguments),
}

/// Runs the subcommand. Gives whether what it checks is as it should be.
///
/// # Errors
/// When the cohort or the trials cannot be used.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    match &arguments.command {
        Command::Add(arguments) => add::run(arguments),
        Command::Remove(arguments) => remove::run(arguments),
        Command::List(arguments) => list::run(arguments),
        Command::Show(arguments) => show::run(arguments),
        Command::Reference(arguments) => reference::run(arguments),
        Command::Check(arguments) => return check::run(arguments),
    }?;
    Ok(true)
}
