//! Running other programs: each command line is printed before it starts, and a
//! failure is reported with that line.
//!
//! Children stay in the terminal's foreground group, so Ctrl-C reaches them and
//! this program alike.

use std::env;
use std::ffi::{OsStr, OsString};
use std::fmt::{self, Write as _};
use std::io::{self, BufRead, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::ValueEnum;

/// The user's input cannot be used; the text says what is wrong, why, and what to do. Exit code 2.
#[derive(Debug)]
pub struct BadInput(pub String);

impl fmt::Display for BadInput {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

/// The root of the checkout.
pub fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).expect("the package lies two directories deep")
}

/// The directory into which cargo builds.
pub fn target_directory() -> PathBuf {
    // An absolute CARGO_TARGET_DIR replaces the root, a relative one is below it.
    root().join(env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// The directory into which [`beside`](crate::beside) unpacks packages.
pub fn unpacked() -> PathBuf {
    target_directory().join("beside")
}

/// The directory of the programs of unpacked packages.
pub fn unpacked_programs() -> PathBuf {
    unpacked().join("bin")
}

/// Has cargo take the versions in Cargo.lock, or fail. A subcommand that is a program of its own, such as
/// clippy, is not told of it, and needs it among its own arguments.
pub const LOCKED: &str = "--locked";

/// A program with its arguments, run in the root of the checkout.
pub struct Task {
    command: Command,
    line: String,
    is_quiet: bool,
}

impl Task {
    /// `program` without arguments. The program and its children also find what was unpacked beside
    /// the system.
    pub fn new(program: impl AsRef<OsStr>) -> Self {
        let mut command = Command::new(program.as_ref());
        command.current_dir(root());
        let path = env::var_os("PATH").unwrap_or_default();
        let places = env::split_paths(&path).chain([unpacked_programs()]);
        // If the extended PATH cannot be represented, PATH stays as it is.
        if let Ok(path) = env::join_paths(places) {
            command.env("PATH", path);
        }
        Self { command, line: quoted(program.as_ref()), is_quiet: false }
    }

    /// The cargo that runs this program, as if it were started by hand: without what it has said of this
    /// package, since some build scripts look at such variables, and all that uses what they build would be
    /// compiled again. It takes the versions in Cargo.lock, or fails.
    pub fn cargo() -> Self {
        let mut task = Self::new(env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")));
        task.line = "cargo".into();
        for (name, _) in env::vars_os().filter(|(name, _)| is_of_this_package(name)) {
            task.command.env_remove(name);
        }
        task.args([LOCKED])
    }

    /// Adds arguments.
    pub fn args<A: AsRef<OsStr>>(mut self, arguments: impl IntoIterator<Item = A>) -> Self {
        for argument in arguments {
            self.command.arg(argument.as_ref());
            let _ = write!(self.line, " {}", quoted(argument.as_ref()));
        }
        self
    }

    /// Sets an environment variable, which is shown in the printed line.
    pub fn env(mut self, name: &str, value: &str) -> Self {
        self.command.env(name, value);
        self.line = format!("{name}={} {}", quoted(value.as_ref()), self.line);
        self
    }

    /// Adds the environment variables of another task, except those that this task sets itself, and
    /// sets that task's program as cargo. They are not shown.
    pub fn with_environment_of(mut self, cargo: &Self) -> Self {
        let own: Vec<OsString> = self.command.get_envs().map(|(name, _)| name.to_owned()).collect();
        for (name, value) in cargo.command.get_envs() {
            if let Some(value) = value.filter(|_| !own.iter().any(|own| own == name)) {
                self.command.env(name, value);
            }
        }
        self.command.env("CARGO", cargo.command.get_program());
        self
    }

    /// Runs in this directory instead of the root of the checkout.
    pub fn current_dir(mut self, directory: &Path) -> Self {
        self.command.current_dir(directory);
        self.line = format!("cd {} && {}", quoted(directory.as_os_str()), self.line);
        self
    }

    /// Does not print the line: one of thousands.
    pub fn quiet(mut self) -> Self {
        self.is_quiet = true;
        self
    }

    /// The command line as one would type it.
    #[cfg(test)]
    pub fn line(&self) -> &str {
        &self.line
    }

    /// Prints the line and runs it with this program's input and output.
    pub fn run(mut self) -> Result<()> {
        self.announce();
        let status = self.command.status();
        self.judge(status)
    }

    /// As [`Self::run`], but kills the program if it takes longer than `limit`.
    pub fn run_within(mut self, limit: Duration) -> Result<()> {
        self.announce();
        let deadline = Instant::now() + limit;
        let mut child =
            self.command.spawn().with_context(|| format!("cannot start `{}`", self.line))?;
        loop {
            if let Some(status) = child.try_wait()? {
                return self.judge(Ok(status));
            }
            if Instant::now() > deadline {
                child.kill()?;
                child.wait()?;
                bail!("`{}` was ended after {} s without a result", self.line, limit.as_secs());
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// As [`Self::run`], but passes each line of output and error output, in the order of writing,
    /// to `each_line` as well as to the terminal.
    pub fn run_and_read(mut self, mut each_line: impl FnMut(&str)) -> Result<()> {
        self.announce();
        let (reader, writer) = io::pipe()?;
        self.command.stdout(writer.try_clone()?).stderr(writer);
        let child = self.command.spawn();
        // The command still holds the write ends of the pipe; otherwise reading would never end.
        self.command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = child.with_context(|| format!("cannot start `{}`", self.line))?;
        for line in BufReader::new(reader).split(b'\n') {
            let line = line?;
            let line = String::from_utf8_lossy(&line);
            println!("{line}");
            each_line(&line);
        }
        self.judge(child.wait())
    }

    /// Prints the line, runs it, and passes each line of output and error output to `each`, printing
    /// none; or `None` when `pause` has passed without one. The program is ended where `each` returns
    /// false. Returns its exit status.
    pub fn watch(
        mut self,
        pause: Duration,
        mut each: impl FnMut(Option<&str>) -> bool,
    ) -> Result<ExitStatus> {
        self.announce();
        let (reader, writer) = io::pipe()?;
        self.command.stdin(Stdio::null()).stdout(writer.try_clone()?).stderr(writer);
        let child = self.command.spawn();
        // As in `run_and_read`.
        self.command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = child.with_context(|| format!("cannot start `{}`", self.line))?;
        let (sender, lines) = mpsc::sync_channel(1000);
        let read = thread::spawn(move || {
            for line in BufReader::new(reader).split(b'\n') {
                // Without a reader, or one who waits, there is nothing left to do.
                let Ok(line) = line else { break };
                if sender.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                    break;
                }
            }
        });
        loop {
            let goes_on = match lines.recv_timeout(pause) {
                Ok(line) => each(Some(&line)),
                Err(mpsc::RecvTimeoutError::Timeout) => each(None),
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            };
            if !goes_on {
                child.kill()?;
                break;
            }
        }
        drop(lines);
        let status = child.wait()?;
        read.join().expect("reading does not panic");
        Ok(status)
    }

    /// Prints the line and returns the standard output; error output goes to this program's own.
    pub fn run_and_take(mut self) -> Result<String> {
        self.announce();
        let output = self.command.stderr(Stdio::inherit()).output();
        let output = output.with_context(|| format!("cannot start `{}`", self.line))?;
        self.judge(Ok(output.status))?;
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// Returns output and error output in the order of writing, printing nothing, and the exit
    /// status.
    pub fn capture(mut self) -> io::Result<(String, ExitStatus)> {
        let (mut reader, writer) = io::pipe()?;
        self.command.stdin(Stdio::null()).stdout(writer.try_clone()?).stderr(writer);
        let child = self.command.spawn();
        // As in `run_and_read`.
        self.command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = child?;
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes)?;
        Ok((String::from_utf8_lossy(&bytes).into_owned(), child.wait()?))
    }

    /// Returns the standard output, printing nothing.
    pub fn output(self) -> Result<String> {
        Ok(String::from_utf8_lossy(&self.output_bytes()?).into_owned())
    }

    /// As [`Self::output`], for output that is not text.
    pub fn output_bytes(mut self) -> Result<Vec<u8>> {
        let output = self
            .command
            .stdin(Stdio::null())
            .output()
            .with_context(|| format!("cannot start `{}`", self.line))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            bail!("`{}` failed ({}): {}", self.line, output.status, said.trim());
        }
        Ok(output.stdout)
    }

    fn announce(&self) {
        if !self.is_quiet {
            println!("$ {}", self.line);
            let _ = io::stdout().flush();
        }
    }

    fn judge(&self, status: io::Result<ExitStatus>) -> Result<()> {
        let status = status.with_context(|| format!("cannot start `{}`", self.line))?;
        if !status.success() {
            bail!("`{}` failed ({status})", self.line);
        }
        Ok(())
    }
}

/// Whether cargo tells a program with this variable about the program's package.
fn is_of_this_package(variable: &OsStr) -> bool {
    let variable = variable.to_string_lossy();
    ["CARGO_PKG_", "CARGO_MANIFEST_"].iter().any(|begin| variable.starts_with(begin))
}

/// Something to run, which may fail.
pub type Job<'a> = Box<dyn FnOnce() -> Result<()> + Send + 'a>;

/// Runs all of them, as many at a time as there are processor cores, the first ones first; the error
/// tells every failure.
pub fn run_beside_each_other(jobs: Vec<Job<'_>>) -> Result<()> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let queue = Mutex::new(jobs.into_iter());
    let next = || queue.lock().expect("nobody panics with it").next();
    let failures = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                while let Some(job) = next() {
                    if let Err(error) = job() {
                        let mut failures = failures.lock().expect("nobody panics with it");
                        failures.push(format!("{error:#}"));
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().expect("nobody panicked with it");
    if !failures.is_empty() {
        bail!("{}", failures.join("\n"));
    }
    Ok(())
}

/// Leaves the processor to whoever wants it: this thread from now on, and the programs that it starts.
pub fn give_way() {
    // It ends in the thread's number. Where there is none, or no program that does it, everything only
    // takes longer.
    let Ok(place) = std::fs::read_link("/proc/thread-self") else { return };
    let Some(thread) = place.file_name() else { return };
    let _ = Task::new("renice").args(["-n", "19", "-p"]).args([thread]).output();
}

/// The word that stands for a value on the command line.
pub fn word(value: &impl ValueEnum) -> String {
    value.to_possible_value().expect("none is hidden").get_name().to_owned()
}

/// A word as one would type it in a shell.
pub fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=./:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_names_the_whole_command_line() {
        let error = Task::new("sh").args(["-c", "exit 3"]).run().unwrap_err().to_string();
        assert!(error.contains("`sh -c 'exit 3'`") && error.contains('3'), "{error}");
        let error = Task::new("no-such-program").run().unwrap_err().to_string();
        assert!(error.contains("`no-such-program`"), "{error}");
    }

    #[test]
    fn output_and_error_output_are_read_in_the_order_of_writing() {
        let mut lines = Vec::new();
        let script = "echo one; echo two >&2; echo three; exit 1";
        let done =
            Task::new("sh").args(["-c", script]).run_and_read(|line| lines.push(line.to_owned()));
        assert!(done.is_err());
        assert_eq!(lines, ["one", "two", "three"]);
    }

    #[test]
    fn a_program_is_watched_and_ended_when_it_is_no_longer_wanted() {
        let (mut lines, mut pauses) = (Vec::new(), 0);
        let status = Task::new("sh").args(["-c", "echo one; echo two >&2; exit 3"]);
        let status = status.watch(Duration::from_secs(60), |line| {
            lines.extend(line.map(str::to_owned));
            true
        });
        assert_eq!((lines, status.unwrap().code()), (vec!["one".into(), "two".into()], Some(3)));
        let start = Instant::now();
        let status = Task::new("sleep").args(["60"]).watch(Duration::from_millis(10), |line| {
            pauses += usize::from(line.is_none());
            pauses < 3
        });
        assert_eq!((pauses, status.unwrap().success()), (3, false));
        assert!(start.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn a_program_that_hangs_is_ended() {
        let start = Instant::now();
        let error = Task::new("sleep").args(["60"]).run_within(Duration::from_millis(200));
        assert!(error.unwrap_err().to_string().contains("`sleep 60`"));
        assert!(start.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn jobs_are_all_run_and_every_failure_is_told() {
        let (folder, jobs) = (tempfile::tempdir().unwrap(), 5);
        let job = |number: usize| -> Job<'_> {
            let place = folder.path().join(number.to_string());
            Box::new(move || {
                std::fs::write(place, "")?;
                if number % 2 == 1 { bail!("number {number}") } else { Ok(()) }
            })
        };
        let error = run_beside_each_other((0..jobs).map(job).collect()).unwrap_err().to_string();
        let mut told: Vec<&str> = error.lines().collect();
        told.sort_unstable();
        assert_eq!(told, ["number 1", "number 3"]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), jobs);
        assert!(run_beside_each_other(Vec::new()).is_ok());
    }

    #[test]
    fn a_thread_that_gives_way_starts_programs_that_do() {
        let nice = || Task::new("nice").output().unwrap().trim().parse::<i32>().unwrap();
        let (before, here) = (nice(), thread::spawn(give_way));
        here.join().unwrap();
        assert_eq!(nice(), before, "another thread has given way");
        let beside = thread::spawn(move || {
            give_way();
            nice()
        });
        assert_eq!(beside.join().unwrap(), before.max(19));
    }

    #[test]
    fn cargo_is_not_told_of_this_package() {
        assert!(env::vars_os().any(|(name, _)| is_of_this_package(&name)), "cargo runs this test");
        let cargo = Task::cargo();
        let removed = cargo.command.get_envs().filter(|(_, value)| value.is_none());
        let removed: Vec<&OsStr> = removed.map(|(name, _)| name).collect();
        for name in ["CARGO_PKG_NAME", "CARGO_PKG_VERSION", "CARGO_MANIFEST_DIR"] {
            assert!(env::var_os(name).is_none() || removed.contains(&OsStr::new(name)), "{name}");
        }
        assert!(!removed.contains(&OsStr::new("CARGO_HOME")));
    }

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(quoted("--flag=1".as_ref()), "--flag=1");
        assert_eq!(quoted("two words".as_ref()), "'two words'");
        assert_eq!(quoted("it's".as_ref()), r"'it'\''s'");
        assert_eq!(quoted("".as_ref()), "''");
    }
}
