//! `cargo xtask test`: every check of the project, in one run.
//!
//! A part is one way to run the checks (on this machine; on another processor).
//! A part consists of steps. A step that fails does not stop those that can
//! still tell something; the run as a whole fails at the end.

use std::env;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::ValueEnum;

use crate::bare_metal::Document;
use crate::command::{BadInput, Task, root, target_directory};
use crate::cross::{Linking, Target};
use crate::{agreement, bare, bare_metal, image, python, setup};

/// What `cargo xtask test` takes.
#[derive(clap::Args)]
pub struct Arguments {
    /// What to check; everything when left out.
    #[arg(value_enum)]
    parts: Vec<Part>,
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
    /// On this machine: rustfmt, clippy, build, all tests, and the core linked
    /// without an allocator.
    Native,
    /// All tests, built for 64-bit ARM and run under QEMU, and one recording
    /// whose poses agree with this machine's.
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
    /// Installs what the part needs.
    fn prepare(self) -> Result<()> {
        match self {
            Self::Native => {
                let build = [setup::LINKER, setup::VIDEO, setup::BINUTILS];
                setup::ensure(&[&build[..], &[setup::RENDERERS, setup::PYTHON]].concat())?;
                // Ubuntu has it as a snap alone, which apt does not install.
                if let Err(error) = setup::ensure(&[setup::BROWSER]) {
                    println!("{error:#}\nThe tests that show pages in a browser skip");
                }
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

    /// What the part writes below the target directory, megabytes: as seen, and a fifth more.
    fn disk_mb(self) -> u64 {
        match self {
            Self::Native => 3500,
            Self::Arm => 3000,
            Self::Armhf => 1000,
            Self::BareMetal => 1500,
            Self::Boot => 3900,
        }
    }

    fn run(self, journal: &mut Journal, document: Document) -> Result<()> {
        match self {
            Self::Native => native(journal),
            Self::Arm => arm(journal)?,
            Self::Armhf => armhf(journal)?,
            Self::BareMetal => bare_metal(journal, document),
            Self::Boot => boot(journal),
        }
        Ok(())
    }
}

/// Runs the parts and sums up.
pub fn run(arguments: &Arguments) -> Result<()> {
    let parts =
        if arguments.parts.is_empty() { Part::value_variants() } else { &arguments.parts[..] };
    // What a later part lacks is known before an earlier one takes its minutes.
    setup::ensure_disk(&target_directory(), parts.iter().map(|part| part.disk_mb()).sum())?;
    for part in parts {
        part.prepare()?;
    }
    let document = if arguments.write_memory { Document::Write } else { Document::Compare };
    if document == Document::Write && !parts.contains(&Part::BareMetal) {
        bail!(BadInput("--write-memory: only the part `bare-metal` measures the stack".into()));
    }
    let mut journal = Journal::default();
    for part in parts {
        part.run(&mut journal, document)?;
    }
    journal.close()
}

fn native(journal: &mut Journal) {
    journal.check("format", || Task::cargo().args(["fmt", "--all", "--check"]).run());
    journal.check("lint", || {
        let lint = ["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"];
        Task::cargo().args(lint).run()?;
        // "All targets" are those that `cargo test` runs, and this one runs by itself.
        let lint = ["clippy", "--package", "plumbline-tests", "--test", "boot", "--"];
        Task::cargo().args(lint).args(["--deny", "warnings"]).run()
    });
    // The tests start the programs, which `cargo test` alone builds only for their own packages.
    let built = journal.check("build", || Task::cargo().args(["build", "--workspace"]).run());
    if built {
        say_where_the_data_are();
        let test = Task::cargo().args(["test", "--workspace", "--no-fail-fast"]);
        // A second opinion: where its index of packages cannot be reached, all else still counts.
        let test = match python::prepare() {
            Ok(()) => test.env(python::VARIABLE, &python::program().to_string_lossy()),
            Err(error) => {
                println!("Other people's readers: {error:#}; the tests that ask them skip");
                test
            }
        };
        journal.tests("tests", test);
    }
    journal.check("bare", bare::check);
}

/// The same tests on the box's processor. They start the programs through QEMU as well,
/// and those that would take too long there do less of the same, and say so.
fn arm(journal: &mut Journal) -> Result<()> {
    let toolchain = Target::Aarch64.toolchain()?;
    let cargo = || toolchain.cargo(Linking::Static);
    let built = journal.check("arm build", || cargo().args(["build", "--workspace"]).run());
    if built {
        say_where_the_data_are();
        journal.tests("arm tests", cargo().args(["test", "--workspace", "--no-fail-fast"]));
        journal.check("agreement", || agreement::check(&toolchain));
    }
    Ok(())
}

/// The core on a smaller processor: its own tests.
fn armhf(journal: &mut Journal) -> Result<()> {
    let cargo = Target::Armv7.toolchain()?.cargo(Linking::Static);
    let core = ["test", "--package", "plumbline", "--lib", "--no-fail-fast"];
    journal.tests("armhf tests", cargo.args(core));
    Ok(())
}

/// The core on computers with nothing else on them, and as the same program here.
fn bare_metal(journal: &mut Journal, document: Document) {
    for board in bare_metal::BOARDS {
        journal.check(board.name, || board.check(document));
    }
}

/// The boot of a box with a camera, which prints its figures as the bench's programs do.
pub fn boot_with_camera() -> Result<Task> {
    let images = image::make_for_tests()?;
    let name = "poses::a_camera_is_tracked_over_both_links_as_well_as_here";
    let test = [
        "test",
        "--package",
        "plumbline-tests",
        "--test",
        "boot",
        "--",
        "--nocapture",
        "--exact",
        name,
    ];
    Ok(Task::cargo().args(test).env(IMAGES, &images.to_string_lossy()))
}

/// Boots the box and looks at it from outside. Two machines at a time: each keeps one
/// processor core busy.
fn boot(journal: &mut Journal) {
    let mut images = PathBuf::new();
    let made = journal.check("images", || {
        images = image::make_for_tests()?;
        Ok(())
    });
    if made {
        let boot = ["test", "--package", "plumbline-tests", "--test", "boot", "--"];
        let test = [&boot[..], &["--test-threads=2", "--nocapture"]].concat();
        let task = Task::cargo().args(test).env(IMAGES, &images.to_string_lossy());
        journal.tests("boot tests", task);
    }
}

/// Tests on photographs pass where there are none, so the log has to tell.
fn say_where_the_data_are() {
    let data = env::var_os("PLUMBLINE_DATA")
        .map_or_else(|| root().join("../shared/data"), |path| root().join(PathBuf::from(path)));
    if data.is_dir() {
        println!("Photographs: {}", data.display());
    } else {
        println!(
            "Photographs: none at {} (PLUMBLINE_DATA names another place); the tests on them skip",
            data.display()
        );
    }
}

/// The run failed, and the summary has said how: its count stays the last line.
#[derive(Debug)]
pub struct Told;

impl std::fmt::Display for Told {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("see the summary")
    }
}

impl std::error::Error for Told {}

/// What has been run so far.
#[derive(Default)]
struct Journal {
    steps: Vec<Step>,
    summaries: Vec<String>,
}

struct Step {
    name: &'static str,
    took: Duration,
    failure: Option<String>,
    /// Where the step is a run of tests: their counts.
    tests: Option<Tally>,
}

impl Journal {
    /// Runs one check; true when it passed.
    fn check(&mut self, name: &'static str, run: impl FnOnce() -> Result<()>) -> bool {
        println!("\n== {name}");
        let start = Instant::now();
        let failure = run().err().map(|error| format!("{error:#}"));
        if let Some(failure) = &failure {
            println!("{name}: {failure}");
        }
        let passed = failure.is_none();
        self.steps.push(Step { name, took: start.elapsed(), failure, tests: None });
        passed
    }

    /// Runs cargo's tests and collects their summaries.
    fn tests(&mut self, name: &'static str, cargo_test: Task) {
        let mut tally = Tally::default();
        let mut summaries = Vec::new();
        let mut failed = Vec::new();
        self.check(name, || {
            let mut running = String::new();
            let done = cargo_test.run_and_read(|line| {
                let words = line.trim_start();
                if words.starts_with("Running ") || words.starts_with("Doc-tests ") {
                    running = line.to_owned();
                } else if line.starts_with("test ") && line.ends_with("... FAILED") {
                    failed.push(line.to_owned());
                } else if let Some(suite) = Tally::of_summary(line) {
                    tally.passed += suite.passed;
                    tally.failed += suite.failed;
                    // Where a crate has no tests, its summary says nothing.
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
        self.steps.last_mut().expect("check adds a step").tests = Some(tally);
        self.summaries.append(&mut summaries);
    }

    /// Prints the summaries and the verdict; an error when anything failed.
    fn close(self) -> Result<()> {
        println!("\n== summary");
        for summary in &self.summaries {
            println!("{summary}");
        }
        let overview: Vec<String> = self
            .steps
            .iter()
            .map(|step| {
                let verdict = if step.failure.is_some() { " FAILED" } else { "" };
                format!("{} {:.0} s{verdict}", step.name, step.took.as_secs_f64())
            })
            .collect();
        println!("\n{}", overview.join(", "));
        for step in &self.steps {
            if let Some(failure) = &step.failure {
                println!("{}: {failure}", step.name);
            }
        }
        let total = self.total();
        println!("{} passed, {} failed", total.passed, total.failed);
        if total.failed > 0 {
            bail!(Told);
        }
        Ok(())
    }

    /// The tests, and each step that is not a run of tests as one more; a run
    /// that broke off without a failed test counts as one failure.
    fn total(&self) -> Tally {
        let mut total = Tally::default();
        for step in &self.steps {
            let failed = usize::from(step.failure.is_some());
            let own = match step.tests {
                Some(tests) => Tally { failed: tests.failed.max(failed), ..tests },
                None => Tally { passed: 1 - failed, failed },
            };
            total.passed += own.passed;
            total.failed += own.failed;
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
    /// From a line such as `test result: ok. 12 passed; 0 failed; 1 ignored; ...`.
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

    #[test]
    fn checks_and_broken_runs_are_in_the_total() {
        let journal = |format: Option<&str>, tests: Option<&str>, passed, failed| {
            let step = |name, failure: Option<&str>, tests| Step {
                name,
                took: Duration::ZERO,
                failure: failure.map(str::to_owned),
                tests,
            };
            let tally = Tally { passed, failed };
            let steps = vec![step("format", format, None), step("tests", tests, Some(tally))];
            Journal { steps, summaries: Vec::new() }
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
}
