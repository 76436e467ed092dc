//! `plumb cohort list`: the trials of a cohort.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use comfy_table::{CellAlignment, Table, presets};
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::row::Row;

use crate::ui::stdout;

/// List the trials of a cohort: key, start, duration, rate, verdict.
///
/// With --counts only how many there are of each condition.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  plumb cohort list cohort/\n  \
    plumb cohort list cohort/ --participant P01\n  \
    plumb cohort list cohort/ --counts")]
pub struct Arguments {
    /// The cohort's folder
    cohort: PathBuf,

    /// Only the trials of this participant
    #[arg(long, value_name = "CODE")]
    participant: Option<String>,

    /// Only the trials under this condition
    #[arg(long, value_name = "NAME")]
    condition: Option<String>,

    /// Count the trials and participants of each condition instead
    #[arg(long)]
    counts: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the cohort cannot be read.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { cohort, participant, condition, counts } = arguments;
    let mut rows = Cohort::open(cohort)?.rows()?;
    rows.retain(|row| {
        participant.as_ref().is_none_or(|it| row.key.participant == *it)
            && condition.as_ref().is_none_or(|it| row.key.condition == *it)
    });
    let text = if *counts { counted(&rows) } else { listed(&rows) };
    stdout::print(&text)?;
    Ok(())
}

/// A table without borders, its numbers from this column on to the right.
pub fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(header);
    table
}

/// A line for each trial, and how many there are.
pub fn listed(rows: &[Row]) -> String {
    let header = ["participant", "session", "condition", "run", "started", "s", "Hz", "verdict"];
    let mut table = table(&header);
    for row in rows {
        let number = |value: Option<f64>| value.map_or(String::new(), |it| format!("{it:.1}"));
        table.add_row([
            row.key.participant.clone(),
            row.key.session.clone(),
            row.key.condition.clone(),
            row.key.run.to_string(),
            row.started_us.map_or_else(String::new, time_of_day),
            number(Some(row.duration_s)),
            number(row.rate_hz),
            row.verdict.grade().word().to_owned(),
        ]);
    }
    for column in [3, 5, 6] {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    let mut text = format!("{}\n", table.trim_fmt());
    let _ = writeln!(text, "{}", summary(rows));
    text
}

fn summary(rows: &[Row]) -> String {
    use plumbline_files::counting::counted;
    let mut participants: Vec<&str> = rows.iter().map(|it| &*it.key.participant).collect();
    participants.sort_unstable();
    participants.dedup();
    format!("{} of {}", counted(rows.len(), "trial"), counted(participants.len(), "participant"))
}

fn counted(rows: &[Row]) -> String {
    let mut conditions: Vec<&str> = rows.iter().map(|it| &*it.key.condition).collect();
    conditions.sort_unstable();
    conditions.dedup();
    let mut table = table(&["condition", "trials", "participants", "good", "doubtful", "unusable"]);
    for condition in conditions {
        let own: Vec<&Row> = rows.iter().filter(|it| it.key.condition == condition).collect();
        let mut participants: Vec<&str> = own.iter().map(|it| &*it.key.participant).collect();
        participants.sort_unstable();
        participants.dedup();
        let graded = |word: &str| own.iter().filter(|it| it.verdict.grade().word() == word).count();
        table.add_row([
            condition.to_owned(),
            own.len().to_string(),
            participants.len().to_string(),
            graded("good").to_string(),
            graded("doubtful").to_string(),
            graded("unusable").to_string(),
        ]);
    }
    for column in 1..6 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    format!("{}\n{}\n", table.trim_fmt(), summary(rows))
}

/// A time of day in this computer's zone, to the minute.
pub fn time_of_day(us: i64) -> String {
    let zoned = jiff::Timestamp::from_microsecond(us)
        .map(|it| it.to_zoned(jiff::tz::TimeZone::system()).strftime("%Y-%m-%d %H:%M").to_string());
    zoned.unwrap_or_default()
}
