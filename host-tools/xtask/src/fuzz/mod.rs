//! `cargo xtask fuzz`: tries the laws in `tests/fuzz` with inputs that libFuzzer makes up.
//!
//! libFuzzer changes inputs at random and keeps those that reach code that no other has reached. Its
//! programs need options of the compiler that are not stable: they are switched on by `RUSTC_BOOTSTRAP`,
//! as the compiler's own build does it, so that what is tried is compiled by the compiler that everything
//! else is. All of it is compiled with the address sanitizer: the box's program has `unsafe` code where
//! it shares memory with a driver, and many dependencies have some.
//!
//! ```text
//! target/fuzz/build        the programs
//! target/fuzz/corpus/T     what has been found to be worth trying again, from one run to the next
//! target/fuzz/finds/T      inputs for which a law did not hold, or that took too long or too much memory
//! target/fuzz/counts/T     what the latest run has counted so far
//! target/fuzz/log/T        what libFuzzer has said in it
//! target/fuzz/seeds/T      the seeds that the target has made
//! target/fuzz/merging/T    libFuzzer's account of the latest `--minimise`
//! target/fuzz/stored/T     the stored inputs, each as a file
//! tests/fuzz/corpus/T.txt  the stored inputs, which `--minimise` has chosen for the usual tests
//! ```
//!
//! The files that a target makes are kept in memory where there is room for such: what is written to be
//! kept is waited for, at each of many inputs a second, until a disk has it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser};
use plumbline_test_support::fuzz::{FuzzTarget, TARGETS, inputs_of};
use tempfile::TempDir;

use crate::command::{BadInput, Task, target_directory};
use crate::setup::{self, CargoTool};

mod minimise;
mod run;
mod tally;

use tally::Tally;

/// The package with the programs, relative to the root of the checkout.
const RUNNER: &str = "tests/fuzz/runner";

/// Compiles programs for libFuzzer.
const CARGO_FUZZ: CargoTool =
    CargoTool { name: "cargo-fuzz", version: "0.13.2", why: "compiles programs for libFuzzer" };

/// What the programs may take below the target directory: an estimate.
const DISK_MB: u64 = 6000;

/// The arguments of `cargo xtask fuzz`.
#[derive(clap::Args)]
pub struct Arguments {
    /// What is tried; every target when left out.
    #[arg(value_parser = names())]
    targets: Vec<String>,
    /// How long each target is tried.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    minutes: u32,
    /// How many targets are tried at a time; each keeps a processor core busy, and takes 2.5 GB of
    /// memory at most.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    jobs: u32,
    /// Instead of trying new inputs: bring what the runs have found worth keeping into tests/fuzz/corpus,
    /// which the usual tests replay.
    #[arg(long, conflicts_with_all = ["minutes", "jobs"])]
    minimise: bool,
    /// Instead of trying new inputs: give the target this one, such as one for which a law did not hold.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["minutes", "jobs", "minimise"])]
    input: Option<PathBuf>,
}

/// The targets, each with what it tries, for the help.
pub fn names() -> PossibleValuesParser {
    TARGETS.map(|target| PossibleValue::new(target.name).help(target.what)).into()
}

/// A target, and where its files are.
struct Place {
    target: FuzzTarget,
    program: PathBuf,
    /// Where it makes its files; removed at the end.
    temporary: TempDir,
}

impl Place {
    /// A directory or a file of this target.
    fn of(&self, kind: &str) -> PathBuf {
        home().join(kind).join(self.target.name)
    }

    /// The file with the stored inputs.
    fn stored(&self) -> PathBuf {
        let corpus = crate::command::root().join("tests/fuzz/corpus");
        corpus.join(self.target.name).with_extension("txt")
    }

    /// A directory with the stored inputs, as libFuzzer wants them.
    fn unpacked(&self) -> Result<PathBuf> {
        let (directory, file) = (self.of("stored"), self.stored());
        emptied(&directory)?;
        let said = || file.display().to_string();
        let text = match fs::read_to_string(&file) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            read => read.with_context(said)?,
        };
        let inputs =
            inputs_of(&text).context("not lines of hexadecimal digits").with_context(said)?;
        for (number, input) in inputs.iter().enumerate() {
            let path = directory.join(number.to_string());
            fs::write(&path, input).with_context(|| path.display().to_string())?;
        }
        Ok(directory)
    }

    /// Its program, with the arguments and the environment of every run; its files are made in an empty
    /// directory.
    fn task(&self) -> Result<Task> {
        let temporary = self.temporary.path().join("run");
        emptied(&temporary)?;
        let home = temporary.join("home");
        fs::create_dir_all(&home).with_context(|| home.display().to_string())?;
        let seconds = self.target.input_s_max;
        Ok(Task::new(&self.program)
            .args([
                format!("-max_len={}", self.target.input_bytes_max),
                format!("-timeout={seconds}"),
                format!("-rss_limit_mb={}", run::MEMORY_MB_MAX),
                "-detect_leaks=0".to_owned(),
                "-print_final_stats=1".to_owned(),
                // Not the names of functions that are reached for the first time: to find them takes as
                // long as thousands of inputs.
                "-print_funcs=0".to_owned(),
            ])
            .env("TMPDIR", &temporary.to_string_lossy())
            .env("XDG_DATA_HOME", &home.to_string_lossy()))
    }
}

/// Where everything is kept.
fn home() -> PathBuf {
    target_directory().join("fuzz")
}

/// Makes a directory that has nothing in it.
fn emptied(directory: &Path) -> Result<()> {
    let place = || directory.display().to_string();
    match fs::remove_dir_all(directory) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(error).with_context(place);
        }
        _ => {}
    }
    fs::create_dir_all(directory).with_context(place)
}

/// Tries the targets, and says what was found.
pub fn run(arguments: &Arguments) -> Result<()> {
    let is_chosen = |target: &FuzzTarget| {
        arguments.targets.is_empty() || arguments.targets.iter().any(|it| it == target.name)
    };
    let targets: Vec<FuzzTarget> = TARGETS.into_iter().filter(is_chosen).collect();
    // Before minutes are spent on compiling.
    let input = match &arguments.input {
        None => None,
        Some(_) if arguments.targets.len() != 1 => {
            bail!(BadInput("--input: name the one target that is to be given it".to_owned()))
        }
        Some(path) => Some(path.canonicalize().map_err(|error| {
            BadInput(format!("--input: {}: {error}; give a file", path.display()))
        })?),
    };
    let places = build(&targets)?;
    if let Some(input) = input {
        return places[0].task()?.args([input]).run();
    }
    if arguments.minimise {
        return places.iter().try_for_each(minimise::minimise);
    }
    let limit = Duration::from_secs(60 * u64::from(arguments.minutes));
    let tallies = try_all(&places, limit, arguments.jobs as usize)?;
    tally::report(&tallies);
    let finds: usize = tallies.iter().map(|tally| tally.finds.len()).sum();
    if finds > 0 {
        bail!("finds: {finds}; each is above, with the line that tries it again");
    }
    Ok(())
}

/// Installs what is missing, and builds the programs.
fn build(targets: &[FuzzTarget]) -> Result<Vec<Place>> {
    setup::ensure(&[setup::LINKER, setup::VIDEO, setup::LIBFUZZER])?;
    setup::ensure_disk(&home(), DISK_MB)?;
    CARGO_FUZZ.ensure()?;
    let manifest = format!("{RUNNER}/Cargo.toml");
    // cargo-fuzz itself cannot be told to keep to the lock.
    let kept = Task::cargo().args(["fetch", "--locked", "--quiet", "--manifest-path", &manifest]);
    kept.run().with_context(|| {
        format!(
            "where {RUNNER}/Cargo.lock is behind the manifests: cp Cargo.lock {RUNNER}/ && cargo \
             fetch --manifest-path {manifest}"
        )
    })?;
    let output = home().join("build");
    let build = || {
        Task::cargo()
            .args(["fuzz", "build", "--fuzz-dir", RUNNER, "--sanitizer", "address"])
            .args(["--strip-dead-code", "--target-dir", &output.to_string_lossy()])
            .env("RUSTC_BOOTSTRAP", "1")
            // libFuzzer itself is not checked, as where it comes from.
            .env("CXXFLAGS", "-fno-sanitize=address")
    };
    if targets.len() == TARGETS.len() {
        build().run()?;
    } else {
        targets.iter().try_for_each(|target| build().args([target.name]).run())?;
    }
    let about = Task::new("rustc").args(["-vV"]).output()?;
    let triple = about.lines().find_map(|line| line.strip_prefix("host: "));
    let programs = output.join(triple.context("rustc says its host")?).join("release");
    let place = |target: &FuzzTarget| -> Result<Place> {
        let (program, temporary) = (programs.join(target.name), temporary()?);
        Ok(Place { target: *target, program, temporary })
    };
    targets.iter().map(place).collect()
}

/// A directory in memory, or else beside everything.
fn temporary() -> Result<TempDir> {
    let make =
        |parent: &Path| tempfile::Builder::new().prefix("plumbline-fuzz-").tempdir_in(parent);
    let home = home();
    let made = make(Path::new("/dev/shm")).or_else(|_| make(&home));
    made.with_context(|| home.display().to_string())
}

/// Tries each target for this time, so many at once. Ctrl-C ends all of them; what was counted until
/// then counts.
fn try_all(places: &[Place], limit: Duration, jobs: usize) -> Result<Vec<Tally>> {
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    let queue = Mutex::new(places.iter());
    let next = || queue.lock().expect("nobody panics with it").next();
    let tallies = Mutex::new(Vec::new());
    let failures = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed)
                    && let Some(place) = next()
                {
                    match run::run(place, limit, &is_over) {
                        Ok(tally) => {
                            println!("{}", tally.evidence());
                            tallies.lock().expect("nobody panics with it").push(tally);
                        }
                        Err(error) => {
                            let mut failures = failures.lock().expect("nobody panics with it");
                            failures.push(format!("{}: {error:#}", place.target.name));
                        }
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().expect("nobody panicked with it");
    let tallies = tallies.into_inner().expect("nobody panicked with it");
    if !failures.is_empty() {
        // What the others have found is not lost.
        tally::report(&tallies);
        bail!("{}", failures.join("\n"));
    }
    Ok(tallies)
}
