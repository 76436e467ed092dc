//! `plumb cohort show`: all that a cohort says of one trial, or of itself.

use std::path::PathBuf;

use clap::Args;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::row::Row;
use plumbline_files::BadInput;
use plumbline_trial::frame::Trunk;

use super::list::{table, time_of_day};
use crate::ui::stdout;

/// Show all that a cohort says of a participant's trials.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  plumb cohort show cohort/ P01\n  \
    plumb cohort show cohort/ P01 --condition control --session 2")]
pub struct Arguments {
    /// The cohort's folder
    cohort: PathBuf,

    /// The participant
    participant: String,

    /// Only the trials of this session
    #[arg(long, value_name = "LABEL")]
    session: Option<String>,

    /// Only the trials under this condition
    #[arg(long, value_name = "NAME")]
    condition: Option<String>,

    /// Only the trials of this run
    #[arg(long, value_name = "NUMBER")]
    run: Option<u32>,
}

/// Runs the subcommand.
///
/// # Errors
/// When the cohort cannot be read, or has no such trial.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { cohort, participant, session, condition, run } = arguments;
    let cohort = Cohort::open(cohort)?;
    let mut rows = cohort.rows()?;
    rows.retain(|Row { key, .. }| {
        key.participant == *participant
            && session.as_ref().is_none_or(|it| key.session == *it)
            && condition.as_ref().is_none_or(|it| key.condition == *it)
            && run.is_none_or(|it| key.run == it)
    });
    if rows.is_empty() {
        let found = format!("there is no such trial of {participant:?}");
        let remedy = "`plumb cohort list` shows the trials that there are";
        return Err(BadInput::whole(cohort.path().display(), found, remedy).into());
    }
    let texts: Vec<String> = rows.iter().map(|row| shown(&cohort, row)).collect();
    stdout::print(&texts.join("\n"))?;
    Ok(())
}

fn shown(cohort: &Cohort, row: &Row) -> String {
    let mut table = table(&[]);
    let mut line = |name: &str, text: String| {
        if !text.is_empty() {
            table.add_row([format!("  {name}"), text]);
        }
    };
    let Row { person, .. } = row;
    let unit = |value: Option<f64>, unit: &str| value.map(|it| format!("{it} {unit}"));
    let of_person = [
        unit(person.age_years, "years"),
        person.sex.clone(),
        unit(person.height_cm, "cm"),
        unit(person.mass_kg, "kg"),
    ];
    line("participant", of_person.into_iter().flatten().collect::<Vec<_>>().join(", "));
    line("started", row.started_us.map_or_else(String::new, time_of_day));
    let rate = row.rate_hz.map_or_else(String::new, |it| format!(", {it:.2} Hz"));
    let lost = row.lost.map_or_else(String::new, |it| format!(", {it} lost"));
    line("duration", format!("{:.1} s{rate}, {} frames{lost}", row.duration_s, row.frames));
    for (trunk, seen) in Trunk::ALL.into_iter().zip(&row.seen) {
        let gaps = format!("{} gaps of {:.1} s together", seen.gaps, seen.gaps_s);
        line(&format!("{} trunk", trunk.word()), format!("{} positions, {gaps}", seen.samples));
    }
    line("t = 0", row.zero.clone());
    line("verdict", row.verdict.line());
    line("warnings", row.warnings.join("\n"));
    let [device, serial, firmware, crc] = row.the_box.each_ref().map(|it| it.as_deref());
    let of_box = [
        device.map(str::to_owned),
        serial.map(|it| format!("serial number {it}")),
        firmware.map(|it| format!("firmware {it}")),
        crc.map(|it| format!("configuration {it}")),
    ];
    line("box", of_box.into_iter().flatten().collect::<Vec<_>>().join(", "));
    line("calibration", row.calibration.clone().unwrap_or_default());
    line("added", format!("{} from {}, by {}", time_of_day(row.added_us), row.folder, row.program));
    line("content", row.trial.clone());
    line("points", cohort.points_file(row).display().to_string());
    format!("{}\n{}\n", row.key, table.trim_fmt())
}
