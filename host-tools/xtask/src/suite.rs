//! Runs the test programs of the workspace, several at a time.
//!
//! `cargo test` runs one program after the other, and many of ours wait for sockets or for frames
//! of a paced recording. Here cargo builds all of them and reports where they are; as many run at a
//! time as there are processor cores. The output of a program is shown when it ends,
//! complete and in cargo's own format. Documentation tests have no program, so cargo runs them.

use std::cmp::Reverse;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, mpsc};
use std::{fs, thread};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::command::{Task, root};

/// Which tests to build and run.
pub struct Suite<'a> {
    /// The cargo that builds them, with its environment, which the tests also get.
    pub cargo: &'a (dyn Fn() -> Task + Sync),
    /// The selection of packages, targets and features, as arguments of `cargo test`.
    pub selection: &'a [&'a str],
    /// The emulator that runs the programs, if they are for another processor.
    pub emulator: Option<&'a str>,
    /// Whether documentation tests are included.
    pub with_documentation: bool,
}

/// A test program that was built.
#[derive(Debug, PartialEq, Eq)]
pub struct Program {
    path: PathBuf,
    /// The directory of its package, in which it is run.
    package: PathBuf,
    /// Its source, relative to the root of the checkout.
    source: PathBuf,
    /// Whether it contains a crate's own tests rather than tests that start programs.
    is_unit: bool,
}

impl Suite<'_> {
    /// Builds the tests.
    pub fn build(&self) -> Result<Vec<Program>> {
        let build = ["test", "--no-run", "--message-format=json-render-diagnostics"];
        let messages = (self.cargo)().args(build).args(self.selection).run_and_take()?;
        programs(&messages)
    }

    /// Runs what was built; each line that it prints is also passed to `each_line`. An error if a program
    /// fails.
    pub fn run(&self, programs: Vec<Program>, mut each_line: impl FnMut(&str)) -> Result<()> {
        let mut failed = run_programs(
            programs,
            |program| self.task(program),
            |text| {
                for line in text.lines() {
                    println!("{line}");
                    each_line(line);
                }
            },
        )?;
        if self.with_documentation {
            let task = (self.cargo)().args(["test", "--doc", "--no-fail-fast"]);
            let done = task.args(self.selection).run_and_read(&mut each_line);
            failed.extend(done.err().map(|error| format!("{error:#}")));
        }
        if !failed.is_empty() {
            bail!("{}", failed.join("\n"));
        }
        Ok(())
    }

    /// The task that starts a program as `cargo test` does.
    pub fn task(&self, program: &Program) -> Task {
        let cargo = (self.cargo)();
        let task = match self.emulator {
            Some(emulator) => Task::new(emulator).args([&program.path]),
            None => Task::new(&program.path),
        };
        let package = program.package.display().to_string();
        let task = task.current_dir(&program.package).env("CARGO_MANIFEST_DIR", &package);
        // Some tests build programs for the same processor.
        task.with_environment_of(&cargo)
    }
}

impl Program {
    /// The line by which cargo says that it runs it.
    pub fn heading(&self) -> String {
        let kind = if self.is_unit { "unittests " } else { "" };
        let (source, path) = (self.source.display(), shortened(&self.path));
        format!("     Running {kind}{source} ({})", path.display())
    }
}

/// The test programs reported by `cargo test --message-format=json`. The largest come first: they
/// contain most of the project and take longest.
fn programs(messages: &str) -> Result<Vec<Program>> {
    let mut programs = Vec::new();
    for line in messages.lines() {
        let message: Value = serde_json::from_str(line).context("a message of cargo")?;
        let is_test = message["profile"]["test"] == true;
        let Some(path) = message["executable"].as_str().filter(|_| is_test) else { continue };
        let text = |value: &Value| value.as_str().map(PathBuf::from).context("cargo's message");
        let manifest = text(&message["manifest_path"])?;
        let source = text(&message["target"]["src_path"])?;
        programs.push(Program {
            path: path.into(),
            package: manifest.parent().context("a manifest without a directory")?.to_owned(),
            source: source.strip_prefix(root()).unwrap_or(&source).to_owned(),
            is_unit: message["target"]["kind"] != serde_json::json!(["test"]),
        });
    }
    let bytes = |program: &Program| fs::metadata(&program.path).map_or(0, |about| about.len());
    programs.sort_by_cached_key(|program| (Reverse(bytes(program)), program.source.clone()));
    Ok(programs)
}

/// Runs them and shows the output of each as soon as it has ended; returns those that failed.
fn run_programs(
    programs: Vec<Program>,
    task: impl Fn(&Program) -> Task + Sync,
    mut show: impl FnMut(&str),
) -> Result<Vec<String>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let queue = Mutex::new(programs.into_iter());
    let next = || queue.lock().expect("nobody panics with it").next();
    let (sender, ended) = mpsc::channel();
    let mut failed = Vec::new();
    thread::scope(|scope| {
        for _ in 0..cores {
            let (sender, task, next) = (sender.clone(), &task, &next);
            scope.spawn(move || {
                while let Some(program) = next() {
                    let done = task(&program).capture();
                    // After an error nobody receives.
                    let _ = sender.send((program, done));
                }
            });
        }
        drop(sender);
        for (program, done) in ended {
            let (text, status) = done?;
            show(&format!("{}\n{text}", program.heading()));
            if !status.success() {
                failed.push(format!("{} ended with {status}", program.source.display()));
            }
        }
        io::Result::Ok(())
    })?;
    Ok(failed)
}

/// The path relative to the root of the checkout, if it is below it.
fn shortened(path: &Path) -> &Path {
    path.strip_prefix(root()).unwrap_or(path)
}

/// Removes a file that an earlier run may have left.
pub fn remove(file: &Path) -> Result<()> {
    match fs::remove_file(file) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        done => done.with_context(|| file.display().to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program(source: &str, is_unit: bool) -> Program {
        Program { path: source.into(), package: root().into(), source: source.into(), is_unit }
    }

    #[test]
    fn only_test_programs_are_run_and_the_largest_first() {
        let folder = tempfile::tempdir().unwrap();
        let [small, large] = ["a-1", "main-2"].map(|name| folder.path().join(name));
        fs::write(&small, "1").unwrap();
        fs::write(&large, "12").unwrap();
        let message = |kind: &str, source: &str, is_test: bool, executable: &str| {
            format!(
                "{{\"reason\":\"compiler-artifact\",\"manifest_path\":\"/a/Cargo.toml\",\
                 \"target\":{{\"kind\":[\"{kind}\"],\"src_path\":\"{source}\"}},\
                 \"profile\":{{\"test\":{is_test}}},\"executable\":{executable}}}\n"
            )
        };
        let messages = message("lib", "/a/src/lib.rs", true, &format!("{small:?}"))
            + &message("lib", "/a/src/lib.rs", false, "null")
            + &message("bin", "/a/src/main.rs", false, "\"/t/a\"")
            + "{\"reason\":\"build-finished\",\"success\":true}\n"
            + &message("test", "/a/tests/main.rs", true, &format!("{large:?}"));
        let found = programs(&messages).unwrap();
        let found_at: Vec<_> = found.iter().map(|it| (&it.path, it.is_unit)).collect();
        assert_eq!(found_at, [(&large, false), (&small, true)]);
        assert!(found.iter().all(|it| it.package == Path::new("/a")));
        assert!(programs("no JSON").is_err());
    }

    #[test]
    fn output_is_shown_whole_and_failures_are_named() {
        let programs = (0..6).map(|at| program(&at.to_string(), at % 2 == 0)).collect();
        let script = |program: &Program| {
            let at = program.path.display();
            let script = format!("echo {at} begins; sleep 0.1; echo {at} ends >&2; test {at} != 3");
            Task::new("sh").args(["-c", &script])
        };
        let mut shown = Vec::new();
        let failed = run_programs(programs, script, |text| shown.push(text.to_owned())).unwrap();
        shown.sort();
        assert_eq!(shown.len(), 6);
        assert!(shown.contains(&"     Running 1 (1)\n1 begins\n1 ends\n".to_owned()), "{shown:?}");
        assert!(shown.contains(&"     Running unittests 2 (2)\n2 begins\n2 ends\n".to_owned()));
        assert_eq!(failed, ["3 ended with exit status: 1"]);
    }
}
