//! What the steps of a run of checks gave: their tests, skips and seconds, and the verdict.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use plumbline_test_support::{Absent, SKIPS, Skip, read_skips};

use crate::command::{Job, give_way, run_beside_each_other, target_directory};
use crate::suite::{self, Program, Suite};
use crate::tests::processors::Processors;

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
pub struct Journal {
    processors: Processors,
    /// The part that is being run.
    pub part: String,
    steps: Vec<Step>,
    summaries: Vec<String>,
    /// The file into which tests write when they skip.
    pub skips: PathBuf,
    /// The directory of this machine's programs, once they are built.
    pub programs: Option<PathBuf>,
    /// Third-party software that tests need and this machine cannot have, with the reason.
    lacking: Vec<String>,
    /// What else the user must know in the end; it fails nothing.
    pub notices: Vec<String>,
    /// Checks that were left to a later part, beside whose tests the processor has time for them.
    pub left: Vec<Check<'static>>,
}

/// A check of a part that is run beside tests, be they another part's.
pub struct Check<'a> {
    part: String,
    name: &'static str,
    run: Job<'a>,
}

struct Step {
    part: String,
    name: String,
    took: Duration,
    failure: Option<String>,
    /// The counts, if the step is a run of tests.
    tests: Option<Tally>,
    skips: Vec<Skip>,
}

impl Journal {
    pub fn begin() -> Result<Self> {
        let skips = target_directory().join("skips");
        suite::remove(&skips)?;
        Ok(Self::of(Vec::new(), skips))
    }

    fn of(steps: Vec<Step>, skips: PathBuf) -> Self {
        Self {
            processors: Processors::watch(),
            part: String::new(),
            steps,
            summaries: Vec::new(),
            skips,
            programs: None,
            lacking: Vec::new(),
            notices: Vec::new(),
            left: Vec::new(),
        }
    }

    /// Records what could not be installed: tests that skip for lack of it are excused.
    pub fn cannot_be_had(&mut self, what: &str, error: &anyhow::Error) {
        let lacking = format!("{what}: {error:#}");
        println!("{lacking}\nThe tests that need this skip");
        self.lacking.push(lacking);
    }

    /// Runs one check; returns whether it passed.
    pub fn check(&mut self, name: &str, run: impl FnOnce() -> Result<()>) -> bool {
        println!("\n== {}: {name}", self.part);
        let start = Instant::now();
        let done = run();
        self.record(self.part.clone(), name, start.elapsed(), done)
    }

    /// Records a check that was run; returns whether it passed.
    fn record(&mut self, part: String, name: &str, took: Duration, done: Result<()>) -> bool {
        let failure = done.err().map(|error| format!("{error:#}"));
        if let Some(failure) = &failure {
            println!("{name}: {failure}");
        }
        let passed = failure.is_none();
        let name = name.to_owned();
        self.steps.push(Step { part, name, took, failure, tests: None, skips: Vec::new() });
        passed
    }

    /// Builds tests; `None` if that fails.
    pub fn built(&mut self, name: &'static str, suite: &Suite) -> Option<Vec<Program>> {
        let mut programs = None;
        self.check(name, || {
            programs = Some(suite.build()?);
            Ok(())
        });
        programs
    }

    /// Runs tests that were built, and collects their summaries.
    pub fn suite(&mut self, name: &'static str, suite: &Suite, programs: Vec<Program>) {
        let skips = self.skips.to_string_lossy().into_owned();
        let cargo = || (suite.cargo)().env(SKIPS, &skips);
        let suite = Suite { cargo: &cargo, ..*suite };
        self.tests(name, |each_line| suite.run(programs, each_line));
    }

    /// A check of the part that is being run, for later.
    pub fn later<'a>(
        &self,
        name: &'static str,
        run: impl FnOnce() -> Result<()> + Send + 'a,
    ) -> Check<'a> {
        Check { part: self.part.clone(), name, run: Box::new(run) }
    }

    /// Runs tests, and beside them checks that leave the processor to the tests. A build waits for a check
    /// that cargo makes in the same directory: beside such a check, run tests that have been built.
    pub fn beside(&mut self, checks: Vec<Check<'_>>, run: impl FnOnce(&mut Self)) {
        let outcomes = Mutex::new(Vec::new());
        let job = |Check { part, name, run }| -> Job<'_> {
            let outcomes = &outcomes;
            Box::new(move || {
                give_way();
                let start = Instant::now();
                let outcome = (part, name, run(), start.elapsed());
                outcomes.lock().expect("nobody panics with it").push(outcome);
                Ok(())
            })
        };
        let jobs = checks.into_iter().map(job).collect();
        thread::scope(|scope| {
            scope.spawn(|| run_beside_each_other(jobs));
            run(self);
        });
        for (part, name, done, took) in outcomes.into_inner().expect("nobody panicked with it") {
            println!("\n== {part}: {name}");
            self.record(part, name, took, done);
        }
    }

    /// Runs tests, whose lines `run` passes on, and collects their summaries.
    pub fn tests(&mut self, name: &str, run: impl FnOnce(&mut dyn FnMut(&str)) -> Result<()>) {
        let mut tally = Tally::default();
        let mut summaries = Vec::new();
        let mut failures = Failures::default();
        self.check(name, || {
            let mut running = String::new();
            let done = run(&mut |line| {
                failures.take(line);
                let words = line.trim_start();
                if words.starts_with("Running ") || words.starts_with("Doc-tests ") {
                    running = line.to_owned();
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
                Err(_) if tally.failed > 0 => bail!("\n{}", failures.lines.join("\n")),
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
    pub fn close(self) -> Result<()> {
        println!("\n== summary");
        for summary in &self.summaries {
            println!("{summary}");
        }
        print!("\n{}\n{}{}\n", self.skipped(), self.table(), self.processors.spent());
        for step in &self.steps {
            if let Some(failure) = &step.failure {
                println!("{} {}: {failure}", step.part, step.name);
            }
        }
        for notice in &self.notices {
            println!("{notice}");
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
            row(&step.part, &step.name, step.took, verdict);
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

/// What the summary says of failed tests: which, and why.
#[derive(Default)]
struct Failures {
    lines: Vec<String>,
    /// The lines of a message that may follow.
    more: usize,
}

impl Failures {
    /// The lines of a failed test's message that are repeated, and how long each is.
    const MESSAGE_LINES_MAX: usize = 8;
    const LINE_LETTERS_MAX: usize = 300;

    /// Takes a line of the tests' output.
    fn take(&mut self, line: &str) {
        let is_verdict = line.starts_with("test ") && line.ends_with("... FAILED");
        if line.starts_with("thread '") && line.contains(" panicked at ") {
            self.more = Self::MESSAGE_LINES_MAX;
        } else if line.is_empty() || line.starts_with("stack backtrace:") {
            self.more = 0;
        } else if let Some(more) = self.more.checked_sub(1) {
            self.more = more;
        }
        if is_verdict || self.more > 0 {
            self.lines.push(line.chars().take(Self::LINE_LETTERS_MAX).collect());
        }
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
mod tests {
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
    fn of_a_failed_test_the_summary_says_why() {
        let output = "running 2 tests\n\
                      test one ... ok\n\
                      test two ... FAILED\n\
                      \n\
                      ---- two stdout ----\n\
                      \n\
                      thread 'two' (17) panicked at tests/two.rs:4:5:\n\
                      assertion `left == right` failed\n  left: 1\n right: 2\n\
                      stack backtrace:\n   0: begin\n\
                      \n\
                      test result: FAILED. 1 passed; 1 failed; 0 ignored; 0 measured\n";
        let mut failures = Failures::default();
        output.lines().for_each(|line| failures.take(line));
        assert_eq!(
            failures.lines,
            [
                "test two ... FAILED",
                "thread 'two' (17) panicked at tests/two.rs:4:5:",
                "assertion `left == right` failed",
                "  left: 1",
                " right: 2"
            ]
        );
        let long = format!("thread 'two' panicked at x:\n{}", "why\n".repeat(100));
        let mut failures = Failures::default();
        long.lines().for_each(|line| failures.take(line));
        assert_eq!(failures.lines.len(), Failures::MESSAGE_LINES_MAX);
    }

    fn step(name: &'static str, failure: Option<&str>, tests: Option<Tally>) -> Step {
        Step {
            part: "native".into(),
            name: name.to_owned(),
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
            Journal::of(steps, PathBuf::new())
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
            Journal { lacking, ..Journal::of(vec![step], PathBuf::new()) }
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
        let table = Journal::of(steps, PathBuf::new()).table();
        assert_eq!(
            table,
            "part        step             seconds\n\
             native      format                 2\n\
             native      tests                  2 FAILED\n\
             all                                4\n"
        );
    }
}
