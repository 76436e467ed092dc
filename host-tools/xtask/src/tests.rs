//! `cargo xtask test`: every check of the project, in one run.
//!
//! A part is one way to run the checks (on this machine, or for another processor). It consists of
//! steps. A step that fails does not stop later steps that can still give information; the run as a
//! whole fails at the end.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clap::ValueEnum;
use plumbline_test_support::{
    Absent, DATA, PROGRAMS, RECORDINGS, SKIPS, Skip, data_directory, make_recordings, program,
    read_skips,
};

use crate::bare_metal::Document;
use crate::command::{BadInput, Task, target_directory};
use crate::cross::{Linking, Target};
use crate::suite::{self, Suite};
use crate::{agreement, bare, bare_metal, image, python, setup};

/// The arguments of `cargo xtask test`.
#[derive(clap::Args)]
pub struct Arguments {
    /// What to check; everything (which contains `quick`) when left out.
    #[arg(value_enum)]
    parts: Vec<Part>,
    /// In `arm`: all tests of the workspace, not only those of what ships on ARM. Takes an hour or
    /// more, most of it to render pictures in the emulator.
    #[arg(long)]
    all: bool,
    /// Put the depths of the stack that `bare-metal` measures into memory.md, instead of
    /// comparing them with what it says.
    #[arg(long)]
    write_memory: bool,
}

/// The variable that tells the tests in `tests/boot` where the images are.
const IMAGES: &str = "PLUMBLINE_IMAGES";

/// One way to run the checks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// For daily work: rustfmt, clippy, and the tests on this machine, without those that render
    /// or photograph many pictures, start the box's program, or open a browser; without the tests
    /// in the documentation, other processors and images.
    Quick,
    /// On this machine: rustfmt, clippy, build, all tests, and the core linked
    /// without an allocator.
    Native,
    /// The tests of what ships on 64-bit ARM, the core and the box's program, built for it and run
    /// under QEMU; and one recording whose poses agree with this machine's.
    Arm,
    /// The core's own tests, built for 32-bit ARM with hard float and run under QEMU.
    Armhf,
    /// The core as firmware, on an emulated 64-bit ARM board and on one with a Cortex-M7; how
    /// much of the stack it takes there and here, against memory.md.
    BareMetal,
    /// The box's image, booted under QEMU: it tracks a camera, and survives what
    /// happens to a box.
    Boot,
}

impl Part {
    /// The parts that are checked if none is named.
    const EVERYTHING: [Self; 5] =
        [Self::Native, Self::Arm, Self::Armhf, Self::BareMetal, Self::Boot];

    /// Its name on the command line.
    fn word(self) -> String {
        self.to_possible_value().expect("no part is hidden").get_name().to_owned()
    }

    /// Installs what the part needs.
    fn prepare(self) -> Result<()> {
        match self {
            Self::Quick => {
                setup::ensure(&[setup::LINKER, setup::VIDEO])?;
                setup::ensure_components()
            }
            Self::Native => {
                let build = [setup::LINKER, setup::VIDEO, setup::BINUTILS];
                setup::ensure(&[&build[..], &[setup::RENDERERS, setup::PYTHON]].concat())?;
                setup::ensure_components()
            }
            Self::Arm => {
                setup::ensure(&[setup::RENDERERS])?;
                Target::Aarch64.prepare()
            }
            Self::Armhf => Target::Armv7.prepare(),
            Self::BareMetal => bare_metal::prepare(),
            Self::Boot => image::prepare_for_tests(),
        }
    }

    /// The number of megabytes that the part writes below the target directory: as measured, plus a
    /// fifth.
    fn disk_mb(self) -> u64 {
        match self {
            Self::Quick | Self::Native => 3500,
            Self::Arm => 1200,
            Self::Armhf => 400,
            Self::BareMetal => 1200,
            Self::Boot => 1600,
        }
    }

    fn run(self, journal: &mut Journal, arguments: &Arguments) -> Result<()> {
        match self {
            Self::Quick => quick(journal),
            Self::Native => native(journal),
            Self::Arm => arm(journal, arguments.all)?,
            Self::Armhf => armhf(journal)?,
            Self::BareMetal => bare_metal(journal, arguments.document()),
            Self::Boot => boot(journal),
        }
        Ok(())
    }
}

impl Arguments {
    const fn document(&self) -> Document {
        if self.write_memory { Document::Write } else { Document::Compare }
    }
}

/// Runs the parts and prints a summary.
pub fn run(arguments: &Arguments) -> Result<()> {
    let parts =
        if arguments.parts.is_empty() { &Part::EVERYTHING[..] } else { &arguments.parts[..] };
    for (is_given, option, part, why) in [
        (arguments.write_memory, "--write-memory", Part::BareMetal, "measures the stack"),
        (arguments.all, "--all", Part::Arm, "leaves tests out"),
    ] {
        if is_given && !parts.contains(&part) {
            let part = part.word();
            bail!(BadInput(format!("{option}: only the part `{part}` {why}")));
        }
    }
    // What a later part lacks should be known before an earlier one takes its minutes.
    setup::ensure_disk(&target_directory(), parts.iter().map(|part| part.disk_mb()).sum())?;
    for part in parts {
        part.prepare()?;
    }
    let mut journal = Journal::begin()?;
    for part in parts {
        journal.part = part.word();
        part.run(&mut journal, arguments)?;
    }
    journal.close()
}

/// The tests that `quick` runs: some of those that start programs, and every crate's own.
const QUICK: &[&str] = &["--workspace", "--lib", "--bins", "--test", "published", "--test", "core"];

fn quick(journal: &mut Journal) {
    format_and_lint(journal);
    let Some(recordings) = recordings(journal) else { return };
    let cargo = || Task::cargo().env(RECORDINGS, &recordings.to_string_lossy());
    let suite =
        Suite { cargo: &cargo, selection: QUICK, emulator: None, with_documentation: false };
    journal.suite("tests", &suite);
}

fn format_and_lint(journal: &mut Journal) {
    journal.check("format", || Task::cargo().args(["fmt", "--all", "--check"]).run());
    journal.check("lint", || {
        let lint = ["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"];
        Task::cargo().args(lint).run()?;
        // "All targets" are those that `cargo test` runs; this one is separate.
        let lint = ["clippy", "--workspace", "--test", "boot", "--"];
        Task::cargo().args(lint).args(["--deny", "warnings"]).run()
    });
}

/// Renders the recordings that the tests read, on this machine; returns their directory.
fn recordings(journal: &mut Journal) -> Option<PathBuf> {
    let mut directory = None;
    let built = journal.programs.as_ref().map(|programs| programs.join("plumb"));
    journal.check("recordings", || {
        let plumb = built.map_or_else(|| program("plumb"), Ok).map_err(|error| anyhow!(error))?;
        let made = make_recordings(&target_directory(), &plumb);
        directory = Some(made.map_err(|error| anyhow!(error))?);
        Ok(())
    });
    directory
}

fn native(journal: &mut Journal) {
    // A download, in parallel with compiling.
    let python = thread::spawn(python::prepare);
    format_and_lint(journal);
    // With all targets, although the tests come later: otherwise dependencies would be rebuilt for
    // the tests, with the features that these request.
    let build = ["build", "--workspace", "--all-targets"];
    let built = journal.check("build", || Task::cargo().args(build).run());
    let programs = target_directory().join("debug");
    journal.programs = built.then(|| programs.clone());
    if built && let Some(recordings) = recordings(journal) {
        say_where_the_data_are();
        // Ubuntu has it only as a snap, which apt does not install.
        if let Err(error) = setup::ensure(&[setup::BROWSER]) {
            journal.cannot_be_had("a browser", &error);
        }
        // A second opinion: if the package index cannot be reached, everything else still counts.
        let python = python.join().expect("it does not panic");
        if let Err(error) = &python {
            journal.cannot_be_had("other people's readers", error);
        }
        let cargo = || {
            let task = Task::cargo()
                .env(PROGRAMS, &programs.to_string_lossy())
                .env(RECORDINGS, &recordings.to_string_lossy());
            match python {
                Ok(()) => task.env(python::VARIABLE, &python::program().to_string_lossy()),
                Err(_) => task,
            }
        };
        let suite = Suite {
            cargo: &cargo,
            selection: &["--workspace"],
            emulator: None,
            with_documentation: true,
        };
        journal.suite("tests", &suite);
    }
    journal.check("bare", bare::check);
}

/// The packages that ship on ARM; the tests in `tests/core` read rendered frames.
const SHIPPED: &[&str] = &[
    "--package",
    "plumbline",
    "--package",
    "plumbline-board",
    "--package",
    "plumbline-core-tests",
    "--lib",
    "--bins",
    "--tests",
];

/// The tests of what ships on the box's processor, or all tests. Programs that they start also run
/// through QEMU.
fn arm(journal: &mut Journal, all: bool) -> Result<()> {
    let toolchain = Target::Aarch64.toolchain()?;
    let Some(recordings) = recordings(journal) else { return Ok(()) };
    let programs = toolchain.programs(Linking::Static, "debug");
    let cargo = || {
        toolchain
            .cargo(Linking::Static)
            .env(PROGRAMS, &programs.to_string_lossy())
            .env(RECORDINGS, &recordings.to_string_lossy())
    };
    let selection = if all { &["--workspace"] } else { SHIPPED };
    if all {
        say_where_the_data_are();
        let build = ["build", "--workspace", "--all-targets"];
        if !journal.check("build", || cargo().args(build).run()) {
            return Ok(());
        }
    }
    let suite = Suite {
        cargo: &cargo,
        selection,
        emulator: Some(toolchain.emulator()),
        with_documentation: all,
    };
    journal.suite("tests", &suite);
    let native = journal.programs.clone();
    journal.check("agreement", || agreement::check(native.as_deref(), &toolchain, &recordings));
    Ok(())
}

/// The core on a smaller processor: its own tests.
fn armhf(journal: &mut Journal) -> Result<()> {
    let toolchain = Target::Armv7.toolchain()?;
    let suite = Suite {
        cargo: &|| toolchain.cargo(Linking::Static),
        selection: &["--package", "plumbline", "--lib"],
        emulator: Some(toolchain.emulator()),
        with_documentation: false,
    };
    journal.suite("tests", &suite);
    Ok(())
}

/// The core on computers with no other software, and as the same program on this machine.
fn bare_metal(journal: &mut Journal, document: Document) {
    let Some(recordings) = recordings(journal) else { return };
    for board in bare_metal::BOARDS {
        journal.check(board.name, || board.check(&recordings, document));
    }
}

/// Of the whole workspace, so that what it uses has the features, and so the builds, of the other
/// tests.
const BOOT_TESTS: [&str; 5] = ["test", "--workspace", "--test", "boot", "--"];

/// The test that boots a box with a camera; it prints its figures in the same format as the bench.
pub fn boot_with_camera() -> Result<Task> {
    let images = image::make_for_tests(image::Profile::Release)?;
    let name = "poses::a_camera_is_tracked_over_both_links_as_well_as_here";
    let test = [&BOOT_TESTS[..], &["--nocapture", "--exact", name]].concat();
    Ok(Task::cargo().args(test).env(IMAGES, &images.to_string_lossy()))
}

/// Boots the box and observes it from outside, on two machines at a time: each keeps one processor
/// core busy.
fn boot(journal: &mut Journal) {
    let mut images = PathBuf::new();
    let made = journal.check("images", || {
        images = image::make_for_tests(image::Profile::ImageTests)?;
        Ok(())
    });
    if made {
        let test = [&BOOT_TESTS[..], &["--test-threads=2", "--nocapture"]].concat();
        let task = Task::cargo().args(test).env(IMAGES, &images.to_string_lossy());
        let task = task.env(SKIPS, &journal.skips.to_string_lossy());
        journal.tests("tests", |each_line| task.run_and_read(each_line));
    }
}

/// Tests on photographs are skipped if there are none: says beforehand where to put them.
fn say_where_the_data_are() {
    let data = data_directory();
    let place = data.display();
    if data.is_dir() {
        println!("Photographs: {place}");
    } else {
        println!("Photographs: none at {place} ({DATA} names another place)");
    }
}

/// The run failed, and the summary has said how; its count remains the last line.
#[derive(Debug)]
pub struct Told;

impl std::fmt::Display for Told {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("see the summary")
    }
}

impl std::error::Error for Told {}

/// The steps that have been run so far.
#[derive(Default)]
struct Journal {
    /// The part that is being run.
    part: String,
    steps: Vec<Step>,
    summaries: Vec<String>,
    /// The file into which tests write when they skip.
    skips: PathBuf,
    /// The directory of this machine's programs, once they are built.
    programs: Option<PathBuf>,
    /// Third-party software that tests need and this machine cannot have, with the reason.
    lacking: Vec<String>,
}

struct Step {
    part: String,
    name: &'static str,
    took: Duration,
    failure: Option<String>,
    /// The counts, if the step is a run of tests.
    tests: Option<Tally>,
    skips: Vec<Skip>,
}

impl Journal {
    fn begin() -> Result<Self> {
        let skips = target_directory().join("skips");
        suite::remove(&skips)?;
        Ok(Self { skips, ..Self::default() })
    }

    /// Records what could not be installed: tests that skip for lack of it are excused.
    fn cannot_be_had(&mut self, what: &str, error: &anyhow::Error) {
        let lacking = format!("{what}: {error:#}");
        println!("{lacking}\nThe tests that need this skip");
        self.lacking.push(lacking);
    }

    /// Runs one check; returns whether it passed.
    fn check(&mut self, name: &'static str, run: impl FnOnce() -> Result<()>) -> bool {
        println!("\n== {}: {name}", self.part);
        let start = Instant::now();
        let failure = run().err().map(|error| format!("{error:#}"));
        if let Some(failure) = &failure {
            println!("{name}: {failure}");
        }
        let passed = failure.is_none();
        self.steps.push(Step {
            part: self.part.clone(),
            name,
            took: start.elapsed(),
            failure,
            tests: None,
            skips: Vec::new(),
        });
        passed
    }

    /// Builds and runs tests, and collects their summaries.
    fn suite(&mut self, name: &'static str, suite: &Suite) {
        let skips = self.skips.to_string_lossy().into_owned();
        let cargo = || (suite.cargo)().env(SKIPS, &skips);
        let suite = Suite { cargo: &cargo, ..*suite };
        self.tests(name, |each_line| suite.run(each_line));
    }

    /// Runs tests, whose lines `run` passes on, and collects their summaries.
    fn tests(&mut self, name: &'static str, run: impl FnOnce(&mut dyn FnMut(&str)) -> Result<()>) {
        let mut tally = Tally::default();
        let mut summaries = Vec::new();
        let mut failed = Vec::new();
        self.check(name, || {
            let mut running = String::new();
            let done = run(&mut |line| {
                let words = line.trim_start();
                if words.starts_with("Running ") || words.starts_with("Doc-tests ") {
                    running = line.to_owned();
                } else if line.starts_with("test ") && line.ends_with("... FAILED") {
                    failed.push(line.to_owned());
                } else if let Some(suite) = Tally::of_summary(line) {
                    tally.passed += suite.passed;
                    tally.failed += suite.failed;
                    // The summary of a crate without tests is meaningless.
                    if suite != Tally::default() {
                        summaries.push(format!("{running}\n{line}"));
                    }
                }
            });
            match done {
                Err(_) if tally.failed > 0 => bail!("\n{}", failed.join("\n")),
                Err(error) => Err(error).context("no test failed, yet the run did"),
                Ok(()) if tally == Tally::default() => bail!("cargo ran no test at all"),
                Ok(()) => Ok(()),
            }
        });
        let skips = read_skips(&self.skips).map_err(|error| {
            println!("{}: {error}", self.skips.display());
        });
        let _ = suite::remove(&self.skips);
        let step = self.steps.last_mut().expect("check adds a step");
        step.tests = Some(tally);
        match skips {
            Ok(skips) => step.skips = skips,
            Err(()) => step.failure = step.failure.take().or(Some("the skips are unknown".into())),
        }
        self.summaries.append(&mut summaries);
    }

    /// Prints the summaries and the verdict; an error if anything failed.
    fn close(self) -> Result<()> {
        println!("\n== summary");
        for summary in &self.summaries {
            println!("{summary}");
        }
        print!("\n{}\n{}", self.skipped(), self.table());
        for step in &self.steps {
            if let Some(failure) = &step.failure {
                println!("{} {}: {failure}", step.part, step.name);
            }
        }
        let total = self.total();
        println!("{} passed, {} failed", total.passed, total.failed);
        if total.failed > 0 {
            bail!(Told);
        }
        Ok(())
    }

    /// Whether a test may skip for lack of this. What the run builds itself is never excused, and
    /// what it installs only if it could not be installed.
    fn is_excused(&self, absent: Absent) -> bool {
        match absent {
            Absent::Data | Absent::Machine | Absent::Emulator => true,
            Absent::Tool => !self.lacking.is_empty(),
            Absent::Build => false,
        }
    }

    /// The tests that were skipped, each with its reason.
    fn skipped(&self) -> String {
        let mut text = String::new();
        for step in &self.steps {
            for Skip { absent, test, reason } in &step.skips {
                let verdict = if self.is_excused(*absent) { "skipped" } else { "FAILED by a skip" };
                let _ = writeln!(text, "{verdict}: {} {test}: {reason}", step.part);
            }
        }
        text
    }

    /// The duration of each step.
    fn table(&self) -> String {
        let mut text = String::from("part        step             seconds\n");
        let mut row = |part: &str, step: &str, took: Duration, verdict| {
            let seconds = took.as_secs_f64();
            let _ = writeln!(text, "{part:<11} {step:<16} {seconds:>7.0}{verdict}");
        };
        for step in &self.steps {
            let verdict = if step.failure.is_some() { " FAILED" } else { "" };
            row(&step.part, step.name, step.took, verdict);
        }
        row("all", "", self.steps.iter().map(|step| step.took).sum(), "");
        text
    }

    /// The tests, plus one for each step that is not a run of tests; a run that ended early without
    /// a failed test counts as one failure. A test that was skipped has not passed, and has failed
    /// if it is not excused.
    fn total(&self) -> Tally {
        let mut total = Tally::default();
        for step in &self.steps {
            let failed = usize::from(step.failure.is_some());
            let own = match step.tests {
                Some(tests) => Tally { failed: tests.failed.max(failed), ..tests },
                None => Tally { passed: 1 - failed, failed },
            };
            let mut skipped: Vec<_> = step.skips.iter().collect();
            skipped.dedup_by_key(|skip| &skip.test);
            let unexcused = skipped.iter().filter(|skip| !self.is_excused(skip.absent)).count();
            total.passed += own.passed.saturating_sub(skipped.len());
            total.failed += own.failed + unexcused;
        }
        total
    }
}

/// Counts of tests.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Tally {
    passed: usize,
    failed: usize,
}

impl Tally {
    /// Parses a line such as `test result: ok. 12 passed; 0 failed; 1 ignored; ...`.
    fn of_summary(line: &str) -> Option<Self> {
        let (_, counts) = line.strip_prefix("test result: ")?.split_once(". ")?;
        let count = |kind: &str| {
            counts.split("; ").find_map(|part| part.strip_suffix(kind)?.trim().parse().ok())
        };
        Some(Self { passed: count("passed")?, failed: count("failed")? })
    }
}

#[cfg(test)]
mod checks {
    use super::*;

    #[test]
    fn a_summary_line_is_counted() {
        let line = "test result: FAILED. 12 passed; 3 failed; 1 ignored; 0 measured; \
                    0 filtered out; finished in 0.01s";
        assert_eq!(Tally::of_summary(line), Some(Tally { passed: 12, failed: 3 }));
        assert_eq!(Tally::of_summary("test corner::finds ... ok"), None);
        assert_eq!(Tally::of_summary("test result: gone"), None);
    }

    fn step(name: &'static str, failure: Option<&str>, tests: Option<Tally>) -> Step {
        Step {
            part: "native".into(),
            name,
            took: Duration::from_secs(2),
            failure: failure.map(str::to_owned),
            tests,
            skips: Vec::new(),
        }
    }

    #[test]
    fn checks_and_broken_runs_are_in_the_total() {
        let journal = |format: Option<&str>, tests: Option<&str>, passed, failed| {
            let tally = Tally { passed, failed };
            let steps = vec![step("format", format, None), step("tests", tests, Some(tally))];
            Journal { steps, ..Journal::default() }
        };
        let total = |passed, failed| Tally { passed, failed };
        let good = journal(None, None, 10, 0);
        assert_eq!(good.total(), total(11, 0));
        assert!(good.close().is_ok());
        let unformatted = journal(Some("x"), None, 10, 0);
        assert_eq!(unformatted.total(), total(10, 1));
        assert!(unformatted.close().is_err());
        assert_eq!(journal(None, Some("x"), 10, 2).total(), total(11, 2));
        let crashed = journal(None, Some("x"), 10, 0);
        assert_eq!(crashed.total(), total(11, 1));
        assert!(crashed.close().is_err());
    }

    #[test]
    fn a_skip_is_no_pass_and_without_an_excuse_a_failure() {
        let journal = |absent, lacking: &[&str]| {
            let skip = Skip { absent, test: "main: it_shows".into(), reason: "no such".into() };
            // One line for each thing that the same test lacks.
            let again = Skip { reason: "nor such".into(), ..skip.clone() };
            let mut step = step("tests", None, Some(Tally { passed: 10, failed: 0 }));
            step.skips = vec![skip, again];
            let lacking = lacking.iter().map(|&it| it.to_owned()).collect();
            Journal { steps: vec![step], lacking, ..Journal::default() }
        };
        for (absent, lacking, failed) in [
            (Absent::Data, &[][..], 0),
            (Absent::Machine, &[], 0),
            (Absent::Emulator, &[], 0),
            (Absent::Tool, &[], 1),
            (Absent::Tool, &["a browser: it cannot be installed"], 0),
            (Absent::Build, &["a browser: it cannot be installed"], 1),
        ] {
            let journal = journal(absent, lacking);
            assert_eq!(journal.total(), Tally { passed: 9, failed }, "{absent:?} {lacking:?}");
            let verdict = if failed == 0 { "skipped" } else { "FAILED by a skip" };
            let line = format!("{verdict}: native main: it_shows: no such\n");
            assert!(journal.skipped().starts_with(&line), "{}", journal.skipped());
        }
    }

    #[test]
    fn the_table_has_a_row_per_step_and_the_sum() {
        let steps = vec![step("format", None, None), step("tests", Some("x"), None)];
        let table = Journal { steps, ..Journal::default() }.table();
        assert_eq!(
            table,
            "part        step             seconds\n\
             native      format                 2\n\
             native      tests                  2 FAILED\n\
             all                                4\n"
        );
    }
}
