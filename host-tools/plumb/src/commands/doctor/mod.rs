//! `plumb doctor`: is everything as it should be, and if not, what is to be done?

mod check;
mod findings;
#[cfg(test)]
pub(crate) mod fixture;
mod judge;
mod report;
mod watch;

use std::path::PathBuf;
use std::time::Duration;

use check::Verdict;
use findings::Expected;

use crate::arguments::{LinkArguments, seconds};
use crate::setup;

/// Check a running box: its link, its program, clock, camera, configuration, targets and light.
///
/// The box that this computer hears is watched for a few seconds while the targets are in
/// sight. Each check is a line: `ok`, `warn` (it measures, but could do better), `FAIL`, or
/// `skip` (nothing to look at); what was seen, with the bound in brackets; and what to do.
///
/// Exit code 0: nothing failed; 1: something did; 2: a wrong command line, or this computer
/// cannot listen there.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  plumb doctor                           # the box that sends to this computer
  plumb doctor --config config.plb       # and it runs with this configuration
  plumb doctor --serial /dev/ttyUSB0 --seconds 20")]
pub struct Arguments {
    /// Where the box is heard.
    #[command(flatten)]
    link: LinkArguments,
    /// Compare the box's configuration with this one.
    #[arg(long, value_name = "FILE.plb")]
    config: Option<PathBuf>,
    /// How long the box is watched.
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = seconds,
        default_value = "5"
    )]
    seconds: Duration,
}

/// Runs the subcommand; whether nothing failed.
///
/// # Errors
/// When the link cannot be opened, or the file of --config is no configuration.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let expected = match &arguments.config {
        Some(path) => {
            Some(Expected { name: path.display().to_string(), crc: setup::read_blob(path)?.crc() })
        }
        None => None,
    };
    let mut link = arguments.link.open()?;
    let findings = watch::watch(&mut link, arguments.seconds, expected)?;
    let checks = judge::all(&findings);
    report::print(&checks);
    Ok(checks.iter().all(|check| check.verdict != Verdict::Fail))
}
