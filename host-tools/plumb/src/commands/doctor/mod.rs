//! `plumb doctor`: is everything as it should be, and if not, what is to be done?

mod check;
mod findings;
#[cfg(test)]
pub(crate) mod fixture;
mod judge;
mod report;
mod watch;

use std::path::{Path, PathBuf};
use std::time::Duration;

use findings::Expected;
use judge::{Comparison, TAPE_MM_MAX, TAPE_MM_MIN, Tape};
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;

pub(super) use check::{Check, Verdict};
pub(super) use findings::{Background, Findings};
pub(super) use judge::all as judged;
pub(super) use report::{amiss_in_words, print_amiss};
pub(super) use watch::{LAST_ANSWERS, VIEW_EVERY};

use crate::arguments::{LinkArguments, seconds};
use crate::scale::{self, Compared};
use crate::setup;

/// Check a running box: its link, its program, clock, camera, configuration, targets and light.
///
/// The box that this computer hears is watched for a few seconds while the targets are in
/// sight. Each check is a line: `ok`, `warn` (it measures, but could do better), `FAIL` (what it
/// measures is not to be used), or `skip` (nothing to look at); what was seen, with the bound in
/// brackets; and what to do.
///
/// What is checked:
///   link           heard, losses, damaged packets, answers
///   box            its program, start, temperature, power, memory, set-up mode, log
///   clock          its time, and the times of the frames
///   camera         running, frames of the calibrated size, rate (as configured, and at least
///                  50 Hz), missing frames, latency
///   configuration  the intended one, calibration, exposure, watchdog, both targets
///   scene          measured; a scene board in sight is where it was; the background does not show
///                  that the camera was turned
///   targets        how often and how well each is found, its depth, fit, size, light, white and
///                  focus; the upper one is above the lower
///   scale          somebody has compared the distance to a target with a tape
///
/// For the background the box is in set-up mode for a moment at the end: one small picture leaves
/// it, is compared with the one that `plumb scene` has kept on this computer, and is discarded.
///
/// One camera cannot see how large a print is: where pitch_mm is wrong, every length is wrong by as
/// much. So measure once, for each lens and print, from the front of the lens to the middle of a
/// target, and give that as --distance-mm: 13 mm described as 12 fails. (The 3 % of a print that was
/// scaled to the page only the ruler on the sheet shows.) It is remembered on this computer, also for
/// the other target if its pitch is the same, since both are then on one sheet.
///
/// Exit code 0: nothing failed; 1: something did; 2: a wrong command line, or this computer
/// cannot listen there.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  plumb doctor                           # the box that sends to this computer
  plumb doctor --config config.plb       # and it runs with this configuration
  plumb doctor --distance-mm 1030        # by a tape, from the lens to the lower target
  plumb doctor --serial /dev/ttyUSB0 --seconds 20"
)]
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
    /// Compare this distance, by a tape from the front of the lens to the middle of a target, with
    /// what the box measures.
    #[arg(long, value_name = "MM", value_parser = tape_mm)]
    distance_mm: Option<f64>,
    /// The target to which the tape was held, by its name [default: the lower one]
    #[arg(long, value_name = "NAME", requires = "distance_mm")]
    distance_to: Option<String>,
}

/// Parses a distance by a tape.
fn tape_mm(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|it| (TAPE_MM_MIN..=TAPE_MM_MAX).contains(it)).ok_or_else(|| {
        format!(
            "give millimetres, {TAPE_MM_MIN} to {TAPE_MM_MAX}: of a shorter distance a tape cannot tell \
             a wrong print, so hold the target farther away"
        )
    })
}

/// The configuration of a file, as it is now.
fn expected(path: &Path) -> Result<Expected, BadInput> {
    Ok(Expected { name: path.display().to_string(), crc: setup::read_blob(path)?.crc() })
}

/// Watches a box for this time, and judges what was seen.
///
/// # Errors
/// When the link cannot be used any more.
pub(super) fn examine(link: &mut BoxLink, duration: Duration) -> Result<Vec<Check>, BadInput> {
    Ok(judged(&watch::watch(link, duration, None)?))
}

/// Runs the subcommand; whether nothing failed.
///
/// # Errors
/// When the link cannot be opened, or the file of --config is no configuration.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let expected = arguments.config.as_deref().map(expected).transpose()?;
    let mut link = arguments.link.open()?;
    let mut findings = watch::watch(&mut link, arguments.seconds, expected)?;
    let target = arguments.distance_to.clone();
    findings.tape = arguments.distance_mm.map(|distance_mm| Tape { target, distance_mm });
    let checks = judged(&findings);
    report::print(&checks);
    if let Err(error) = remember(&findings) {
        eprintln!("warning: what the tape has shown is not kept: {error}");
    }
    Ok(checks.iter().all(|check| check.verdict != Verdict::Fail))
}

/// Keeps a comparison with a tape on this computer if both agreed, and forgets those of
/// its sheet if not.
fn remember(findings: &Findings) -> Result<(), BadInput> {
    let Some((config, comparison)) = findings.config().zip(judge::comparison(findings)) else {
        return Ok(());
    };
    let (lens, target) = (&config.lens, &comparison.target.geometry);
    if !comparison.agrees() {
        let mut sheet = comparison.sheet(config);
        return sheet.try_for_each(|target| scale::forget(lens, &target.geometry));
    }
    let date = jiff::Zoned::now().date().to_string();
    let Comparison { tape_mm, measured_mm, .. } = comparison;
    let path = scale::keep(lens, target, &Compared { date, tape_mm, measured_mm })?;
    eprintln!("that the tape agrees is kept in {}", path.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use plumbline::config::BLOB_BYTES_MAX;

    use super::*;

    /// The checksum that `plumb provision` prints and the box tells is that of the file's content,
    /// at the time when it is read.
    #[test]
    fn a_file_is_named_with_the_checksum_of_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.plb");
        let mut config = fixture::config();
        for exposure_us in [4000, 5000] {
            config.capture.as_mut().unwrap().exposure_us = Some(exposure_us);
            let mut blob = [0; BLOB_BYTES_MAX];
            std::fs::write(&path, config.encode(&mut blob).unwrap()).unwrap();
            let found = expected(&path).unwrap();
            assert_eq!((found.crc, found.crc), (config.crc(), fixture::hello(&config).config_crc));
        }
    }
}
