//! `plumb cohort remove`: trials out of a cohort.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::remove::{Chosen, remove};
use plumbline_files::counting::counted;

use super::list::listed;
use crate::ui::stdout;

/// Remove trials from a cohort: ones that were added by mistake, or all of a participant who withdraws
/// consent.
///
/// Without --yes it only lists what it would remove. With --yes the trials' rows, figures and points
/// are deleted, and so are the folders with the participant's code: all of them or, when a key is wrong
/// or the program is killed before everything is prepared, none. A removal that is interrupted later is
/// completed by the next program that opens the cohort.
///
/// It does not reach what is outside the cohort: the trials' own folders, from which `plumb cohort add`
/// would add them again; participants.tsv; reference bands, studies and exports that were made before
/// (make them again); copies and backups. A participant who withdraws consent may have a right to the
/// deletion of these too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  plumb cohort remove cohort/ --participant P07            what would go\n  \
    plumb cohort remove cohort/ --participant P07 --yes\n  \
    plumb cohort remove cohort/ P01/1/control/2 'P02/1/eyes closed/1' --yes\n  \
    plumb cohort remove cohort/ 3fa94c01 --yes               by the content of the trial"
)]
pub struct Arguments {
    /// The cohort's folder
    cohort: PathBuf,

    /// A trial: PARTICIPANT/SESSION/CONDITION/RUN as `plumb cohort list` shows them; or the first digits,
    /// at least 8, of its content as `plumb cohort show` does
    #[arg(value_name = "KEY", required_unless_present = "participant")]
    keys: Vec<String>,

    /// All trials of this participant; can be given several times
    #[arg(long, value_name = "CODE")]
    participant: Vec<String>,

    /// Remove them, instead of only listing them
    #[arg(long)]
    yes: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the cohort cannot be read or changed, or has no such trial.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { cohort, keys, participant, yes } = arguments;
    let chosen = Chosen { keys: keys.clone(), participants: participant.clone() };
    if !yes {
        let rows = Cohort::open(cohort)?.rows()?;
        let found: Vec<_> = chosen.of(&rows, cohort)?.into_iter().cloned().collect();
        stdout::print(&listed(&found))?;
        let these = if found.len() == 1 { "it" } else { "them" };
        eprintln!("nothing was removed: add --yes to remove {these} from {}", cohort.display());
        return Ok(());
    }
    let (gone, stay) = remove(cohort, &chosen)?;
    let (gone, stay) = (counted(gone.len(), "trial"), counted(stay, "trial"));
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{}: {gone} removed, {stay} left", cohort.display());
    eprintln!(
        "note: the folders they were added from, copies, and what was made of this cohort before \
         still have them"
    );
    Ok(())
}
