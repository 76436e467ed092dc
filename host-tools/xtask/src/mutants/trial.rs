//! Runs tests with one mutant, until one fails.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fs;
use std::ops::AddAssign;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use tempfile::TempDir;

use super::arms;
use crate::command::Task;

/// The processor time of tests that were not measured.
const LIMIT_S: u64 = 300;

/// How the line begins in which the shell says how long a program took.
const TOOK: &str = "took ";

/// A mutant may ask for memory without end; this much is left to it.
const MEMORY_KB_MAX: u32 = 4_000_000;

/// The stack of a test: a function with many arms has a large frame.
const STACK_BYTES: &str = "67108864";

/// Tests of a program, and the time that they have.
#[derive(Debug, Clone)]
pub struct Tests {
    program: PathBuf,
    /// The directory of their package.
    directory: PathBuf,
    /// What the program is told of which tests are meant.
    which: Vec<String>,
    /// The processor time that they have.
    limit_s: u64,
    /// The time that they have.
    wait_s: u64,
}

/// How long tests take.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Took {
    /// Of a processor.
    pub processor_s: f64,
    /// With what they wait for.
    pub all_s: f64,
}

impl AddAssign for Took {
    fn add_assign(&mut self, more: Self) {
        self.processor_s += more.processor_s;
        self.all_s += more.all_s;
    }
}

/// A test that passes without a mutant.
#[derive(Debug)]
pub struct Passed {
    pub took: Took,
    /// The numbers of the functions that it reaches.
    pub reached: BTreeSet<u32>,
}

/// How tests went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Passed,
    Failed,
    TimedOut,
    /// The run was ended meanwhile: it says nothing.
    Interrupted,
}

impl Tests {
    /// Those of a program with this in their name; their package has this directory. They have
    /// [`LIMIT_S`].
    pub fn with(program: &Path, directory: &Path, part: &str) -> Self {
        Self::of(program, directory, vec![part.to_owned()])
    }

    /// Those with these names, which have several times what they take without a mutant.
    pub fn named(program: &Path, directory: &Path, names: &[&str], took: Took) -> Self {
        let names = names.iter().map(|name| (*name).to_owned());
        let which = ["--exact".to_owned()].into_iter().chain(names).collect();
        Self {
            // Processor time does not depend on what else runs on the computer; but who only waits takes
            // none.
            limit_s: 5 + (5.0 * took.processor_s) as u64,
            wait_s: 60 + (5.0 * took.all_s) as u64,
            ..Self::of(program, directory, which)
        }
    }

    fn of(program: &Path, directory: &Path, which: Vec<String>) -> Self {
        let (program, directory) = (program.to_owned(), directory.to_owned());
        Self { program, directory, which, limit_s: LIMIT_S, wait_s: 4 * LIMIT_S }
    }

    /// Runs one test without a mutant: it must pass. `None` when the run was ended.
    pub fn survey(
        program: &Path,
        directory: &Path,
        name: &str,
        is_over: &AtomicBool,
    ) -> Result<Option<Passed>> {
        let tests = Self::of(program, directory, ["--exact", name].map(str::to_owned).to_vec());
        let folder = temporary()?;
        let file = folder.path().join("reached");
        let variable = (arms::REACHED, file.to_string_lossy());
        let timed = format!("TIMEFORMAT='{TOOK}%U %S'; time \"$0\" \"$@\"");
        let (began, mut processor_s) = (Instant::now(), 0.0);
        let verdict = tests.run_by(&timed, variable, is_over, |line| {
            if let Some(seconds) = line.strip_prefix(TOOK) {
                processor_s = seconds.split(' ').filter_map(|it| it.parse::<f64>().ok()).sum();
            }
        })?;
        if verdict == Verdict::Interrupted {
            return Ok(None);
        }
        let program = program.display();
        ensure!(
            verdict == Verdict::Passed,
            "without a mutant, the test {name} of {program} does not pass"
        );
        let took = Took { processor_s, all_s: began.elapsed().as_secs_f64() };
        // A test that reaches no function with a mutant makes no file.
        let bytes = if file.is_file() { fs::read(&file)? } else { Vec::new() };
        let (numbers, _) = bytes.as_chunks();
        Ok(Some(Passed {
            took,
            reached: numbers.iter().copied().map(u32::from_le_bytes).collect(),
        }))
    }

    /// Runs them with this mutant.
    pub fn run(&self, number: u32, is_over: &AtomicBool) -> Result<Verdict> {
        let limits = format!("ulimit -t {} -v {MEMORY_KB_MAX} && exec \"$0\" \"$@\"", self.limit_s);
        let number = number.to_string();
        self.run_by(&limits, (arms::MUTANT, number.into()), is_over, |_| {})
    }

    /// Runs them by a line for a shell, and passes on what they say.
    fn run_by(
        &self,
        shell: &str,
        (variable, value): (&str, Cow<'_, str>),
        is_over: &AtomicBool,
        mut read: impl FnMut(&str),
    ) -> Result<Verdict> {
        // A test that is ended leaves its files.
        let files = temporary()?;
        let task = Task::new("bash")
            .args(["-c", shell])
            .args([&self.program])
            .args(["--test-threads=1"])
            .args(&self.which)
            .env(variable, &value)
            .env("RUST_MIN_STACK", STACK_BYTES)
            .env("RUST_BACKTRACE", "0")
            .env("TMPDIR", &files.path().to_string_lossy())
            .env("CARGO_MANIFEST_DIR", &self.directory.to_string_lossy())
            .current_dir(&self.directory);
        let deadline = Instant::now() + Duration::from_secs(self.wait_s);
        let (mut has_failed, mut is_late) = (false, false);
        let status = task.quiet().watch(Duration::from_secs(1), |line| {
            if let Some(line) = line {
                read(line);
            }
            has_failed |= line.is_some_and(is_failure);
            is_late = Instant::now() > deadline;
            !has_failed && !is_late && !is_over.load(Ordering::Relaxed)
        })?;
        Ok(if has_failed {
            Verdict::Failed
        } else if is_over.load(Ordering::Relaxed) {
            Verdict::Interrupted
        } else if is_late {
            Verdict::TimedOut
        } else {
            verdict(status)
        })
    }
}

/// A directory for one run of tests.
fn temporary() -> Result<TempDir> {
    let place = super::home().join("tmp");
    fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
    tempfile::tempdir_in(&place).with_context(|| place.display().to_string())
}

/// Whether a line of a test program says that a test failed.
fn is_failure(line: &str) -> bool {
    line.starts_with("test ") && line.ends_with("FAILED")
}

fn verdict(status: ExitStatus) -> Verdict {
    use signal_hook::consts::{SIGINT, SIGKILL, SIGTERM, SIGXCPU};

    match status.signal() {
        _ if status.success() => Verdict::Passed,
        // Ctrl-C reaches the tests too, perhaps before this program.
        Some(SIGINT | SIGTERM) => Verdict::Interrupted,
        Some(SIGXCPU | SIGKILL) => Verdict::TimedOut,
        // A test failed, or the program was ended by a signal of its own making.
        _ => Verdict::Failed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program that does as if it ran tests.
    fn program(folder: &Path, script: &str) -> PathBuf {
        use std::os::unix::fs::PermissionsExt as _;

        let path = folder.join("program");
        // Not written by this process, which starts others meanwhile: they would hold it open.
        let text = format!("#!/bin/sh\n{script}\n");
        let copy = Task::new("sh").args(["-c", "printf %s \"$1\" > \"$0\""]);
        copy.args([path.as_os_str(), text.as_ref()]).output().unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    fn a_survey_tells_what_a_test_reaches_and_how_long_it_takes() {
        let folder = tempfile::tempdir().unwrap();
        let is_over = AtomicBool::new(false);
        let spin = "n=0; while [ $n -lt 300000 ]; do n=$((n+1)); done";
        let reach = "printf '\\003\\0\\0\\0\\001\\001\\0\\0' > $PLUMBLINE_REACHED";
        for (script, is_long, reached) in
            [("sleep 1.5", false, &[][..]), (&format!("{reach}; {spin}"), true, &[3, 257])]
        {
            let program = program(folder.path(), script);
            let passed = Tests::survey(&program, folder.path(), "a::b", &is_over).unwrap().unwrap();
            assert!(passed.reached.iter().eq(reached), "{passed:?}");
            let tests = Tests::named(&program, folder.path(), &["a::b"], passed.took);
            assert!(if is_long { tests.limit_s > 5 } else { tests.limit_s == 5 }, "{tests:?}");
            assert!(is_long || tests.wait_s >= 65, "{tests:?}");
        }
    }

    fn run(script: &str, limit_s: u64, is_over: bool) -> Verdict {
        let folder = tempfile::tempdir().unwrap();
        let program = program(folder.path(), script);
        let tests = Tests { limit_s, ..Tests::with(&program, folder.path(), "a::") };
        tests.run(u32::MAX, &AtomicBool::new(is_over)).unwrap()
    }

    #[test]
    fn a_failure_ends_the_tests_and_what_does_not_end_is_ended() {
        assert_eq!(run("[ \"$*\" = '--test-threads=1 a::' ]", 600, false), Verdict::Passed);
        assert_eq!(run("echo 'test a::b ... FAILED'; exec sleep 600", 600, false), Verdict::Failed);
        assert_eq!(run("echo 'test a::b ... ok'; exit 101", 600, false), Verdict::Failed);
        assert_eq!(run("kill -SEGV $$", 600, false), Verdict::Failed);
        assert_eq!(run("while :; do :; done", 1, false), Verdict::TimedOut);
        // Where Ctrl-C is ignored, as behind nohup, programs ignore it too.
        assert_eq!(run("kill -TERM $$", 600, false), Verdict::Interrupted);
        assert_eq!(run("exec sleep 600", 600, true), Verdict::Interrupted);
    }

    #[test]
    fn a_test_that_fails_without_a_mutant_tells_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (program, is_over) = (program(folder.path(), "exit 1"), AtomicBool::new(false));
        let error = Tests::survey(&program, folder.path(), "a::b", &is_over).unwrap_err();
        assert!(error.to_string().contains("the test a::b"), "{error}");
        is_over.store(true, Ordering::Relaxed);
        assert!(Tests::survey(&program, folder.path(), "a::b", &is_over).unwrap().is_none());
    }
}
