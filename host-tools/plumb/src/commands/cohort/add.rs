//! `plumb cohort add`: trials into a cohort.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_cohort::add::{Added, Step, add};
use plumbline_cohort::given::Said;
use plumbline_files::counting::counted;

use crate::ui::progress::Progress;

/// So many notes of one kind are shown; of more, only the number.
const NOTES_MAX: usize = 20;

/// Add trials to a cohort; without one, make it.
///
/// All trials are added or none: if one cannot be read or lacks a part of its key, each such trial is
/// named and the cohort stays as it was. So it does if the program is killed or the disk is full.
/// Trials that are in the cohort already are passed over, so that the same command can be given again
/// when there are more.
///
/// Participant and condition are in a trial's trial.toml. Session and run are known of trials that the
/// desk has recorded in a session (sessions/P01-1/03-control is session 1 of P01), of which only the
/// accepted recordings are added; and where the folder's name has them as in
/// sub-P01_ses-2_task-stand_run-1. Otherwise both are 1, or what --session and --run say.
///
/// Age, sex, height and mass are those of participants.tsv, if there is one in a folder above the
/// trial, as in the desk's studies.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  plumb cohort add trials/* --to cohort/\n  \
    plumb cohort add studies/balance/sessions/*/* --to cohort/\n  \
    plumb cohort add followup/* --to cohort/ --session 2 --participants balance/participants.tsv\n  \
    plumb cohort add repeated/* --to cohort/ --number-runs")]
pub struct Arguments {
    /// The trials' folders
    #[arg(required = true, value_name = "TRIAL")]
    trials: Vec<PathBuf>,

    /// The cohort's folder
    #[arg(long, value_name = "FOLDER")]
    to: PathBuf,

    /// The participant of these trials, where trial.toml does not say it
    #[arg(long, value_name = "CODE")]
    participant: Option<String>,

    /// The session of these trials, where nothing says it [default: 1]
    #[arg(long, value_name = "LABEL")]
    session: Option<String>,

    /// The condition of these trials, where trial.toml does not say it
    #[arg(long, value_name = "NAME")]
    condition: Option<String>,

    /// The run of these trials, where nothing says it [default: 1]
    #[arg(long, value_name = "NUMBER", conflicts_with = "number_runs")]
    run: Option<u32>,

    /// Number trials of one participant, session and condition in the order in which they began,
    /// where nothing says their run
    #[arg(long)]
    number_runs: bool,

    /// The participants' ages, sexes, heights and masses [default: participants.tsv in a folder above
    /// each trial]
    #[arg(long, value_name = "FILE")]
    participants: Option<PathBuf>,
}

/// Runs the subcommand.
///
/// # Errors
/// When a trial cannot be added.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { trials, to, participant, session, condition, run, number_runs, participants } =
        arguments;
    let said = Said {
        participant: participant.clone(),
        session: session.clone(),
        condition: condition.clone(),
        run: *run,
        numbers_runs: *number_runs,
        participants: participants.clone(),
    };
    let looked_at = Progress::of_trials("looking at", trials.len());
    let written = Progress::of_trials("adding", trials.len());
    let program = concat!("plumb ", env!("CARGO_PKG_VERSION"));
    let added = add(to, trials, &said, program, &|step| match step {
        Step::LookedAt => {
            looked_at.advance();
            if looked_at.is_full() {
                looked_at.finish();
            }
        }
        Step::Written => written.advance(),
    });
    looked_at.finish();
    written.finish();
    let Added { added, already, left_out, notes } = added?;
    for (folder, why) in left_out.iter().take(NOTES_MAX) {
        eprintln!("left out: {}: {why}", folder.display());
    }
    for note in notes.iter().take(NOTES_MAX) {
        eprintln!("note: {note}");
    }
    for (what, all) in [("left out", left_out.len()), ("notes", notes.len())] {
        if all > NOTES_MAX {
            eprintln!("{what}: and {} more", all - NOTES_MAX);
        }
    }
    let mut line = format!("{}: {} added", to.display(), counted(added.len(), "trial"));
    if !already.is_empty() {
        line += &format!(", {} already there", already.len());
    }
    if !left_out.is_empty() {
        line += &format!(", {} left out", left_out.len());
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{line}");
    Ok(())
}
