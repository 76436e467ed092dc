//! Runs tests with one mutant, until one fails.

use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

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

/// Tests, and how long they take.
#[derive(Debug, Clone)]
pub struct Tests {
    program: PathBuf,
    /// The directory of their package.
    directory: PathBuf,
    /// Those with this in their name.
    filter: String,
    /// The processor time that they have.
    limit_s: u64,
    /// The time that they have.
    wait_s: u64,
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
    pub fn new(program: &Path, directory: &Path, filter: &str) -> Self {
        let (program, directory) = (program.to_owned(), directory.to_owned());
        Self {
            program,
            directory,
            filter: filter.to_owned(),
            limit_s: LIMIT_S,
            wait_s: 4 * LIMIT_S,
        }
    }

    /// Runs them without a mutant: they must pass, and a mutant has several times the processor time, which
    /// does not depend on what else runs on the computer.
    pub fn measured(mut self, is_over: &AtomicBool) -> Result<Self> {
        let (began, mut took_s) = (Instant::now(), 0.0);
        let timed = format!("TIMEFORMAT='{TOOK}%U %S'; time \"$0\" \"$@\"");
        let verdict = self.run_by(&timed, 0, is_over, |line| {
            if let Some(seconds) = line.strip_prefix(TOOK) {
                took_s = seconds.split(' ').filter_map(|it| it.parse::<f64>().ok()).sum();
            }
        })?;
        ensure!(
            matches!(verdict, Verdict::Passed | Verdict::Interrupted),
            "without a mutant, tests of {} with \"{}\" in their name do not pass",
            self.program.display(),
            self.filter
        );
        self.limit_s = 5 + (5.0 * took_s) as u64;
        // Who only waits takes no processor time.
        self.wait_s = 60 + 5 * began.elapsed().as_secs();
        Ok(self)
    }

    /// Runs them with this mutant.
    pub fn run(&self, number: u32, is_over: &AtomicBool) -> Result<Verdict> {
        let limits = format!("ulimit -t {} -v {MEMORY_KB_MAX} && exec \"$0\" \"$@\"", self.limit_s);
        self.run_by(&limits, number, is_over, |_| {})
    }

    /// Runs them by a line for a shell, and passes on what they say.
    fn run_by(
        &self,
        shell: &str,
        number: u32,
        is_over: &AtomicBool,
        mut read: impl FnMut(&str),
    ) -> Result<Verdict> {
        let temporary = super::home().join("tmp").join(number.to_string());
        fs::create_dir_all(&temporary).with_context(|| temporary.display().to_string())?;
        let task = Task::new("bash")
            .args(["-c", shell])
            .args([&self.program])
            .args(["--test-threads=1", &self.filter])
            .env(arms::VARIABLE, &number.to_string())
            .env("RUST_MIN_STACK", STACK_BYTES)
            .env("RUST_BACKTRACE", "0")
            .env("TMPDIR", &temporary.to_string_lossy())
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
        // A test that was ended leaves its files.
        let _ = fs::remove_dir_all(&temporary);
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
    fn a_mutant_has_several_times_the_processor_time_of_the_tests() {
        let folder = tempfile::tempdir().unwrap();
        let is_over = AtomicBool::new(false);
        let spin = "n=0; while [ $n -lt 300000 ]; do n=$((n+1)); done";
        for (script, is_long) in [("sleep 1.5", false), (spin, true)] {
            let tests = Tests::new(&program(folder.path(), script), folder.path(), "a::");
            let tests = tests.measured(&is_over).unwrap();
            assert!(if is_long { tests.limit_s > 5 } else { tests.limit_s == 5 }, "{tests:?}");
            assert!(is_long || tests.wait_s >= 65, "{tests:?}");
        }
    }

    fn run(script: &str, limit_s: u64, is_over: bool) -> Verdict {
        let folder = tempfile::tempdir().unwrap();
        let program = program(folder.path(), script);
        let tests = Tests { limit_s, ..Tests::new(&program, folder.path(), "a::") };
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
    fn tests_that_fail_without_a_mutant_tell_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (program, is_over) = (program(folder.path(), "exit 1"), AtomicBool::new(false));
        let tests = Tests::new(&program, folder.path(), "a::");
        let error = tests.measured(&is_over).unwrap_err();
        assert!(error.to_string().contains("\"a::\" in their name do not pass"), "{error}");
    }
}
