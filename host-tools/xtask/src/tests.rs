//! `cargo xtask test`: every check of the project, in one run.
//!
//! A part is one way to run the checks (on this machine, or for another processor). It consists of
//! steps. A step that fails does not stop later steps that can still give information; the run as a
//! whole fails at the end.

use std::path::PathBuf;
use std::sync::mpsc::{self, Sender};
use std::thread::{self, JoinHandle};

use anyhow::{Result, anyhow, bail};
use clap::ValueEnum;
use plumbline_test_support::{
    DATA, PROGRAMS, RECORDINGS, SKIPS, data_directory, make_recordings, program,
};

use crate::bare_metal::Document;
use crate::command::{BadInput, LOCKED, Task, run_beside_each_other, target_directory, word};
use crate::cross::{Linking, Target};
use crate::image::DebianRoot;
use crate::python::{READERS, SPARK};
use crate::suite::Suite;
use crate::{agreement, bare_metal, deny, dist, image, setup, toolchain};

mod ahead;
mod endurance;
mod journal;
mod named;
mod processors;

pub use endurance::Ordeal;
use journal::Journal;
pub use journal::Told;

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
    /// In `endurance`: only these things, separated by commas.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    only: Vec<Ordeal>,
}

/// The variable that tells the tests in `tests/boot` where the images are.
const IMAGES: &str = "PLUMBLINE_IMAGES";

/// One way to run the checks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// For daily work: rustfmt, clippy, the dependencies, and the tests on this machine, without those that render
    /// or photograph many pictures, start the box's program, or open a browser; without the tests
    /// in the documentation, other processors and images.
    Quick,
    /// On this machine: rustfmt, clippy, the dependencies, build, all tests, and the core's own with the
    /// smaller limits.
    Native,
    /// The tests of what ships on 64-bit ARM, the core and the box's program, built for it and run
    /// under QEMU; and one recording whose poses agree with this machine's.
    Arm,
    /// The core's own tests, built for 32-bit ARM with hard float and run under QEMU.
    Armhf,
    /// The core as firmware without an allocator, on an emulated 64-bit ARM board and on one with a
    /// Cortex-M7; and how much of the stack it takes there and here, against memory.md.
    BareMetal,
    /// The box's image, booted under QEMU: it tracks a camera, and survives what
    /// happens to a box.
    Boot,
    /// With the box's image under QEMU: the whole way from the printed sheet to the sway of a person. Five
    /// minutes, alone on a quiet computer: the programs at the bedside tell how well the box keeps its
    /// camera's pace; only when it is named.
    FirstTrial,
    /// Up to ten thousand simulated trials of a minute in a cohort: seconds, memory and bytes for each,
    /// and what a million would cost. A quarter of an hour with what is built, alone on a quiet
    /// computer, and 3 GB of disk; only when it is named.
    Cohort,
    /// What others watch for seconds, watched for ten minutes each, with the programs as users have
    /// them: the desk at 200 Hz, and the streams for other programs. Half an hour, alone on a quiet
    /// computer; only when it is named.
    Long,
    /// What people download: the Debian package and the wheel in a fresh Debian without Rust, and the
    /// Windows program under Wine beside a box. Half an hour; only when it is named.
    Dist,
    /// A ward: 10, 30 and 100 boxes at 60 Hz, recorded by the gateway as users have it, beside a real
    /// broker. No pose may be missing, and each box must cost what it costs among few; prints the
    /// costs, and those of a thousand boxes. Five minutes, alone on a quiet computer; only when it is
    /// named.
    Ward,
    /// Laws and state machines with millions of inputs; then what a box meets in years, in hours, with the
    /// programs as users have them: a million frames,
    /// a thousand losses of the camera; a hundred power cuts, pulled plugs, killed recordings and dead
    /// links; full disks, slow cards, clocks that jump; and its latency beside programs that never
    /// rest. Four hours on a quiet computer, 10 GB of disk, and root for the full disks;
    /// `PLUMBLINE_SHARE=0.05` does a twentieth of all, `PLUMBLINE_SEED` repeats what was random. Only
    /// when it is named.
    Endurance,
    /// The pages for other languages: their examples in R and Octave, whose packages are large; only
    /// when it is named.
    Languages,
    /// A cohort on a cluster of Apache Spark, whose processes run on this computer. The download is 400
    /// MB; only when it is named.
    Cluster,
}

impl Part {
    /// The parts that are checked if none is named.
    const EVERYTHING: [Self; 5] =
        [Self::Native, Self::Arm, Self::Armhf, Self::BareMetal, Self::Boot];

    /// Those that compile for other processors.
    const FOR_OTHERS: [Self; 4] = [Self::Arm, Self::Armhf, Self::BareMetal, Self::Boot];

    /// Installs what the part needs; of [`Native`](Self::Native), what it is compiled with, and the rest
    /// meanwhile: see [`Installing`].
    fn prepare(self) -> Result<()> {
        match self {
            Self::Quick => {
                setup::ensure(&[setup::LINKER, setup::VIDEO])?;
                setup::ensure_components()
            }
            Self::Native => {
                setup::ensure(&[setup::LINKER, setup::VIDEO, setup::BINUTILS])?;
                setup::ensure_components()
            }
            Self::Arm => {
                setup::ensure(&[setup::RENDERERS])?;
                DebianRoot::prepare()?;
                Target::Aarch64.prepare()
            }
            Self::Armhf => Target::Armv7.prepare(),
            Self::BareMetal => bare_metal::prepare(),
            Self::Boot | Self::FirstTrial => image::prepare_for_tests(),
            Self::Dist => dist::prepare_for_tests(),
            Self::Cohort => {
                setup::ensure(&[setup::LINKER, setup::VIDEO, setup::PYTHON])?;
                READERS.prepare()
            }
            Self::Long => {
                setup::ensure(&[setup::LINKER, setup::VIDEO, setup::PYTHON, setup::BROWSER])?;
                READERS.prepare()
            }
            Self::Languages => {
                let build = [setup::LINKER, setup::VIDEO, setup::PYTHON];
                setup::ensure(&[&build[..], &[setup::LANGUAGES]].concat())?;
                READERS.prepare()
            }
            Self::Cluster => {
                setup::ensure(&[setup::LINKER, setup::VIDEO, setup::PYTHON, setup::JAVA])?;
                SPARK.prepare()
            }
            Self::Ward => setup::ensure(&[setup::LINKER, setup::VIDEO, setup::BROKER]),
            Self::Endurance => {
                setup::ensure(&[setup::LINKER, setup::VIDEO, setup::FALSE_TIME])?;
                image::prepare_for_tests()
            }
        }
    }

    /// The number of megabytes that the part writes below the target directory: as measured, plus
    /// a fifth at least.
    fn disk_mb(self) -> u64 {
        match self {
            Self::Quick | Self::Native => 3900,
            Self::Arm => 1200,
            Self::Armhf => 400,
            Self::BareMetal => 1200,
            Self::Boot | Self::FirstTrial => 1600,
            Self::Cohort => 8200,
            Self::Long | Self::Ward => 4900,
            Self::Dist => 9000,
            Self::Endurance => 10_000,
            Self::Languages => 4900,
            Self::Cluster => 5100,
        }
    }

    /// Runs the part. While this machine's programs are compiled, `later` is prepared, and beside their
    /// tests `ahead` is built.
    fn run(
        self,
        journal: &mut Journal,
        arguments: &Arguments,
        later: &[Self],
        ahead: &[Self],
    ) -> Result<()> {
        match self {
            Self::Quick => quick(journal),
            Self::Native => native(journal, later, ahead)?,
            Self::Arm => arm(journal, arguments.all)?,
            Self::Armhf => armhf(journal)?,
            Self::BareMetal => bare_metal(journal, arguments.document()),
            // Three machines at a time: each keeps some two thirds of a processor core busy.
            Self::Boot => boot(journal, &["--test-threads=3", "--skip", FIRST_TRIAL]),
            Self::FirstTrial => boot(journal, &["--exact", FIRST_TRIAL]),
            Self::Cohort => named::cohort(journal),
            Self::Long => named::long(journal),
            Self::Dist => named::dist(journal),
            Self::Ward => named::ward(journal),
            Self::Endurance => endurance::endurance(journal, &arguments.only),
            Self::Languages => named::of_python(journal, "languages::", &READERS),
            Self::Cluster => named::of_python(journal, "cluster::", &SPARK),
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
    toolchain::settle()?;
    let parts =
        if arguments.parts.is_empty() { &Part::EVERYTHING[..] } else { &arguments.parts[..] };
    for (is_given, option, part, why) in [
        (arguments.write_memory, "--write-memory", Part::BareMetal, "measures the stack"),
        (arguments.all, "--all", Part::Arm, "leaves tests out"),
        (!arguments.only.is_empty(), "--only", Part::Endurance, "consists of such things"),
    ] {
        if is_given && !parts.contains(&part) {
            let part = word(&part);
            bail!(BadInput(format!("{option}: only the part `{part}` {why}")));
        }
    }
    // What a later part lacks should be known before an earlier one takes its minutes.
    setup::ensure_disk(&target_directory(), parts.iter().map(|part| part.disk_mb()).sum())?;
    let native = parts.iter().position(|part| *part == Part::Native);
    let (at_once, later) = parts.split_at(native.map_or(parts.len(), |at| at + 1));
    for part in at_once {
        part.prepare()?;
    }
    let mut journal = Journal::begin()?;
    let mut is_ahead = false;
    for (index, part) in parts.iter().enumerate() {
        let left = &parts[index..];
        let has_several = left.len() > 1 || *part == Part::BareMetal;
        let is_due = has_several && !is_ahead && !arguments.all;
        // What runs on this machine renders the recordings, and builds ahead beside its tests.
        if Part::FOR_OTHERS.contains(part) && is_due {
            ahead::build(&mut journal, left);
        }
        is_ahead |= is_due && (*part == Part::Native || Part::FOR_OTHERS.contains(part));
        let beside = if is_due { left } else { &[] };
        journal.part = word(part);
        part.run(&mut journal, arguments, later, beside)?;
    }
    journal.notices.extend(toolchain::notice());
    if [Part::Arm, Part::Boot].iter().any(|part| parts.contains(part)) {
        journal.notices.extend(DebianRoot::notice()?);
    }
    journal.close()
}

/// The tests that `quick` runs: some of those that start programs, and every crate's own.
const QUICK: &[&str] = &["--workspace", "--lib", "--bins", "--test", "published", "--test", "core"];

fn quick(journal: &mut Journal) {
    format(journal);
    journal.check("lint", lint);
    dependencies(journal);
    let Some(recordings) = recordings(journal) else { return };
    let cargo = || Task::cargo().env(RECORDINGS, &recordings.to_string_lossy());
    let suite =
        Suite { cargo: &cargo, selection: QUICK, emulator: None, with_documentation: false };
    if let Some(programs) = journal.built("build", &suite) {
        journal.suite("tests", &suite, programs);
    }
}

fn format(journal: &mut Journal) {
    journal.check("format", || Task::cargo().args(["fmt", "--all", "--check"]).run());
}

fn lint() -> Result<()> {
    let lint = ["clippy", LOCKED, "--workspace", "--all-targets", "--", "--deny", "warnings"];
    Task::cargo().args(lint).run()?;
    // "All targets" are those that `cargo test` runs; these are separate.
    let lint = ["clippy", LOCKED, "--workspace", "--test", "boot", "--test", "dist", "--"];
    Task::cargo().args(lint).args(["--deny", "warnings"]).run()
}

/// Checks the crates that are used.
fn dependencies(journal: &mut Journal) {
    let mut notices = Vec::new();
    journal.check("dependencies", || {
        notices = deny::check()?;
        Ok(())
    });
    journal.notices.append(&mut notices);
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

/// What is downloaded and unpacked while this machine's programs are compiled.
struct Installing(JoinHandle<Result<ThirdParty>>);

/// Third-party software that the tests try the project's files and messages with. What of it cannot be
/// installed is told in the end, and everything else still counts.
struct ThirdParty {
    readers: Result<()>,
    browser: Result<()>,
    broker: Result<()>,
}

impl Installing {
    /// What the tests on this machine need, and these parts, of which `prepared` is told.
    fn begin(parts: &[Part], prepared: Sender<()>) -> Self {
        let parts = parts.to_vec();
        Self(thread::spawn(move || {
            setup::ensure(&[setup::RENDERERS, setup::PYTHON, setup::NETWORKS])?;
            for part in parts {
                part.prepare()?;
            }
            // Where nothing is built ahead, nobody waits for it.
            let _ = prepared.send(());
            Ok(ThirdParty {
                readers: READERS.prepare(),
                // Ubuntu has it only as a snap, which apt does not install.
                browser: setup::ensure(&[setup::BROWSER]),
                broker: setup::ensure(&[setup::BROKER]),
            })
        }))
    }

    /// Waits until it is there.
    fn end(self) -> Result<ThirdParty> {
        self.0.join().expect("it does not panic")
    }
}

/// Builds and tests on this machine. At the end of the build one crate is compiled alone, and many tests wait
/// for sockets and for clocks: meanwhile the processor has time for what `ahead` needs.
fn native(journal: &mut Journal, later: &[Part], ahead: &[Part]) -> Result<()> {
    let (prepared, is_prepared) = mpsc::channel();
    let (rendered, recordings) = mpsc::channel();
    let installing = Installing::begin(later, prepared);
    format(journal);
    let mut notices = Vec::new();
    let mut beside = vec![journal.later("dependencies", || {
        notices = deny::check()?;
        Ok(())
    })];
    let jobs = ahead::jobs(ahead, recordings);
    if !jobs.is_empty() {
        beside.push(journal.later("build ahead", move || match is_prepared.recv() {
            Ok(()) => run_beside_each_other(jobs),
            // Why nothing could be installed is told by whoever waits for it.
            Err(mpsc::RecvError) => Ok(()),
        }));
    }
    let mut done = Ok(());
    journal.beside(beside, |journal| done = on_this_machine(journal, later, installing, rendered));
    journal.notices.append(&mut notices);
    done
}

/// Builds and tests; `rendered` is told where the recordings are, once they are there.
fn on_this_machine(
    journal: &mut Journal,
    later: &[Part],
    installing: Installing,
    rendered: Sender<PathBuf>,
) -> Result<()> {
    // With all targets, although the tests come later: otherwise dependencies would be rebuilt for
    // the tests, with the features that these request.
    let build = ["build", "--workspace", "--all-targets"];
    let built = journal.check("build", || Task::cargo().args(build).run());
    if built && later.contains(&Part::Boot) {
        // Of one crate, while the other processor cores build ahead; and cargo, which does one thing at a
        // time in a directory, is then free for what runs beside the booted boxes.
        journal.check("build for boot", || Task::cargo().args(["build"]).args(BOOT_TESTS).run());
    }
    let programs = target_directory().join("debug");
    journal.programs = built.then(|| programs.clone());
    let recordings = if built { recordings(journal) } else { None };
    let ThirdParty { readers, browser, broker } = installing.end()?;
    let has_readers = is_there(journal, "other people's readers", readers);
    is_there(journal, "a browser", browser);
    is_there(journal, "a broker", broker);
    let Some(recordings) = recordings else { return Ok(()) };
    // Where nothing is built ahead, nobody waits for them.
    let _ = rendered.send(recordings.clone());
    say_where_the_data_are();
    let cargo = || {
        let task = Task::cargo()
            .env(PROGRAMS, &programs.to_string_lossy())
            .env(RECORDINGS, &recordings.to_string_lossy());
        with_readers(task, has_readers)
    };
    let suite = Suite {
        cargo: &cargo,
        selection: &["--workspace"],
        emulator: None,
        with_documentation: true,
    };
    let Some(programs) = journal.built("build tests", &suite) else { return Ok(()) };
    // An emulated box waits for its camera, but tests here want all of the processor.
    let (lint, mut beside) = (journal.later("lint", lint), Vec::new());
    let place = if later.contains(&Part::Boot) { &mut journal.left } else { &mut beside };
    place.push(lint);
    journal.beside(beside, |journal| journal.suite("tests", &suite, programs));
    let smaller = Suite { selection: SMALLER_LIMITS, with_documentation: false, ..suite };
    if let Some(programs) = journal.built("build tests with the smaller limits", &smaller) {
        journal.suite("tests with the smaller limits", &smaller, programs);
    }
    Ok(())
}

/// The core's own tests with the capacities that it has on a microcontroller.
const SMALLER_LIMITS: &[&str] = &["--package", "plumbline", "--lib", "--features", "small-limits"];

/// The packages that ship on ARM; the tests in `tests/core` read rendered frames.
const SHIPPED: [&str; 3] = ["plumbline", "plumbline-board", "plumbline-core-tests"];

/// The selection of their tests, and how they are compiled.
fn shipped() -> Vec<String> {
    let packages = SHIPPED.map(|package| format!("--package={package}"));
    let targets = ["--lib", "--bins", "--tests"].map(str::to_owned);
    packages.into_iter().chain(targets).chain(image::Profile::Dev.arguments()).collect()
}

/// The tests of what ships on the box's processor, or all tests. Programs that they start also run
/// through QEMU. They are built as what the boot tests put into the images is, so that the two
/// share what they compile; all tests as on this machine, on which arithmetic is checked.
fn arm(journal: &mut Journal, all: bool) -> Result<()> {
    let toolchain = Target::Aarch64.toolchain()?;
    let Some(recordings) = recordings(journal) else { return Ok(()) };
    let debian = DebianRoot::for_checks()?;
    let linking = Linking::Root(debian.path());
    let programs = toolchain.programs(linking, "debug");
    let readers = || setup::ensure(&[setup::PYTHON]).and_then(|()| READERS.prepare());
    let has_readers = all && is_there(journal, "other people's readers", readers());
    let cargo = || {
        let task = toolchain
            .cargo(linking)
            .env(PROGRAMS, &programs.to_string_lossy())
            .env(RECORDINGS, &recordings.to_string_lossy());
        with_readers(task, has_readers)
    };
    let shipped = shipped();
    let shipped: Vec<&str> = shipped.iter().map(String::as_str).collect();
    let selection = if all { &["--workspace"] } else { &shipped[..] };
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
    if let Some(programs) = journal.built("build tests", &suite) {
        journal.suite("tests", &suite, programs);
    }
    let native = journal.programs.clone();
    journal.check("agreement", || {
        agreement::check(native.as_deref(), &toolchain, linking, &recordings)
    });
    Ok(())
}

/// Whether third-party software could be installed. It is a second opinion: if an index of packages cannot
/// be reached, everything else still counts.
fn is_there(journal: &mut Journal, what: &str, installed: Result<()>) -> bool {
    if let Err(error) = &installed {
        journal.cannot_be_had(what, error);
    }
    installed.is_ok()
}

/// Tells the tests which Python has the readers.
fn with_readers(task: Task, has_readers: bool) -> Task {
    if has_readers { READERS.tells(task) } else { task }
}

/// What ships on 32-bit ARM.
const ARMHF: &[&str] = &["--package", "plumbline", "--lib"];

/// The core on a smaller processor: its own tests.
fn armhf(journal: &mut Journal) -> Result<()> {
    let toolchain = Target::Armv7.toolchain()?;
    let suite = Suite {
        cargo: &|| toolchain.cargo(Linking::Static),
        selection: ARMHF,
        emulator: Some(toolchain.emulator()),
        with_documentation: false,
    };
    if let Some(programs) = journal.built("build", &suite) {
        journal.suite("tests", &suite, programs);
    }
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
const BOOT_TESTS: [&str; 3] = ["--workspace", "--test", "boot"];

/// The test of [`Part::FirstTrial`].
const FIRST_TRIAL: &str = "first_trial::from_a_printed_sheet_to_the_sway_of_a_person";

/// The test that boots a box with a camera; it prints its figures in the same format as the bench.
pub fn boot_with_camera() -> Result<Task> {
    let images = image::make_for_tests(image::Profile::Release)?;
    let name = "poses::a_camera_is_tracked_over_both_links_as_well_as_here";
    let how = ["--", "--nocapture", "--exact", name];
    let task = Task::cargo().args(["test"]).args(BOOT_TESTS).args(how);
    Ok(task.env(IMAGES, &images.to_string_lossy()))
}

/// Boots the box and observes it from outside in the tests that `which` chooses. Beside them runs
/// what was left for that.
fn boot(journal: &mut Journal, which: &[&str]) {
    let mut environment = vec![(SKIPS, journal.skips.clone())];
    environment.extend(journal.programs.clone().map(|programs| (PROGRAMS, programs)));
    let cargo = || {
        environment
            .iter()
            .fold(Task::cargo(), |task, (name, path)| task.env(name, &path.to_string_lossy()))
    };
    let suite =
        Suite { cargo: &cargo, selection: &BOOT_TESTS, emulator: None, with_documentation: false };
    // What is left uses cargo in the same directory: it begins when this does not need it any more.
    let programs = journal.built("build tests", &suite);
    let left = std::mem::take(&mut journal.left);
    journal.beside(left, |journal| {
        let Some(program) = programs.iter().flatten().next() else { return };
        let mut images = PathBuf::new();
        let made = journal.check("images", || {
            images = image::make_for_tests(image::Profile::Dev)?;
            Ok(())
        });
        if !made {
            return;
        }
        let task = suite.task(program).env(IMAGES, &images.to_string_lossy());
        let task = task.args(["--nocapture"]).args(which);
        journal.tests("tests", |each_line| {
            each_line(&program.heading());
            task.run_and_read(each_line)
        });
    });
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
