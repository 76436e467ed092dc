//! The platforms that programs are made for, and how: rustup's compiler where it has the standard
//! library, otherwise Debian's, which builds it if it must. Programs for Linux and macOS are linked by
//! zig, which knows the C libraries of old systems; those for Windows by MinGW's gcc.
//!
//! Each platform has a directory of its own below `target/dist-work`, and nothing of it shows in the
//! programs: paths are replaced by names that are the same everywhere.

use std::env;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::macos;
use crate::command::{BadInput, LOCKED, Task, target_directory};
use crate::commit::{self, Commit};
use crate::cross::{self, Compiler};
use crate::debian;
use crate::image::Profile;
use crate::python::Packages;
use crate::setup::{self, Need, Probe};

/// The tools from Python's package index.
pub const TOOLS: Packages = Packages {
    requirements: "host-tools/xtask/src/dist/requirements.txt",
    variable: None,
    place: "dist-work/python",
};

/// The oldest C library that programs for Linux start with, 2.28: that of Debian 10, RHEL 8 and
/// Ubuntu 20.04.
const GLIBC_MINOR: u32 = 28;

/// What a program runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Platform {
    LinuxX86_64,
    LinuxAarch64,
    WindowsX86_64,
    MacosAarch64,
    MacosX86_64,
}

impl Platform {
    /// Its name in the names of files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LinuxX86_64 => "linux-x86-64",
            Self::LinuxAarch64 => "linux-aarch64",
            Self::WindowsX86_64 => "windows-x86-64",
            Self::MacosAarch64 => "macos-aarch64",
            Self::MacosX86_64 => "macos-x86-64",
        }
    }

    /// Rust's name for it.
    pub const fn triple(self) -> &'static str {
        match self {
            Self::LinuxX86_64 => "x86_64-unknown-linux-gnu",
            Self::LinuxAarch64 => "aarch64-unknown-linux-gnu",
            Self::WindowsX86_64 => "x86_64-pc-windows-gnu",
            Self::MacosAarch64 => "aarch64-apple-darwin",
            Self::MacosX86_64 => "x86_64-apple-darwin",
        }
    }

    /// Debian's name for its processor.
    pub const fn debian(self) -> &'static str {
        match self {
            Self::LinuxAarch64 | Self::MacosAarch64 => "arm64",
            _ => "amd64",
        }
    }

    pub const fn is_linux(self) -> bool {
        matches!(self, Self::LinuxX86_64 | Self::LinuxAarch64)
    }

    const fn is_macos(self) -> bool {
        matches!(self, Self::MacosAarch64 | Self::MacosX86_64)
    }

    pub const fn is_windows(self) -> bool {
        matches!(self, Self::WindowsX86_64)
    }

    /// What links the box's program, which has its C library in itself.
    pub const fn gcc(self) -> &'static str {
        match self {
            Self::LinuxAarch64 => cross::AARCH64_GCC,
            _ => "cc",
        }
    }

    /// Whether its programs run on this computer.
    pub fn is_here(self) -> bool {
        self.is_linux() && self.triple().starts_with(env::consts::ARCH)
    }

    /// The name of a program's file.
    pub fn program(self, name: &str) -> String {
        if self.is_windows() { format!("{name}.exe") } else { name.to_owned() }
    }

    /// What the compiler needs where rustup's has no standard library for the platform, and the parts
    /// of that library that are built.
    const fn fallback(self) -> (&'static [Need], Option<&'static str>) {
        match self {
            Self::LinuxX86_64 => (cross::X86_64_COMPILER, None),
            Self::LinuxAarch64 => (cross::AARCH64_COMPILER, None),
            _ => (cross::BUILT_LIBRARY, Some("std,panic_unwind")),
        }
    }

    /// What links for it.
    const fn linking_needs(self) -> &'static [Need] {
        match self {
            Self::WindowsX86_64 => MINGW,
            Self::LinuxAarch64 => cross::AARCH64_LINKING,
            _ => &[],
        }
    }

    /// Installs what is missing, and returns what builds for it.
    pub fn builder(self, commit: &Commit, profile: Profile) -> Result<Builder> {
        if profile == Profile::Dev && !self.is_here() {
            let name = self.name();
            bail!(BadInput(format!("--tried: {name} is not this computer; name what is for it")));
        }
        setup::ensure(&[setup::LINKER, setup::PYTHON, setup::BINUTILS, self.linking_needs()])?;
        TOOLS.prepare()?;
        let (needs, built) = self.fallback();
        if !setup::are_there(needs) {
            cross::add_target(self.triple());
        }
        let compiler = Compiler::of(self.triple(), needs)?;
        let built = if compiler == Compiler::Debian { built } else { None };
        Ok(Builder { platform: self, profile, compiler, built, commit: commit.clone() })
    }
}

/// What links programs for Windows.
pub const MINGW_GCC: &str = "x86_64-w64-mingw32-gcc";

const MINGW: &[Need] = &[Need {
    probe: Probe::Program(MINGW_GCC),
    package: "gcc-mingw-w64-x86-64",
    why: "links programs for Windows",
}];

/// What is compiled in a directory of its own: with one for all, each tool would compile anew what
/// another has compiled with its own linker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Compiled {
    /// The host's program.
    Plumb,
    /// The box's program.
    Board,
    /// The Python package.
    Wheel,
}

/// Builds for one platform.
#[derive(Debug)]
pub struct Builder {
    pub platform: Platform,
    profile: Profile,
    compiler: Compiler,
    /// The parts of the standard library that are built.
    built: Option<&'static str>,
    commit: Commit,
}

impl Builder {
    /// Builds the host's program; returns its path.
    pub fn plumb(&self) -> Result<PathBuf> {
        if self.profile == Profile::Dev {
            return tried("plumb");
        }
        let build = ["--release", "--package", "plumb"];
        if self.platform.is_windows() {
            self.cargo(Compiled::Plumb)?.args(["build"]).args(build).run()?;
        } else {
            let zigbuild = Task::new(TOOLS.programs().join("cargo-zigbuild"));
            self.zig(self.with_environment(zigbuild, Compiled::Plumb)?)
                .args(["zigbuild", LOCKED])
                .args(build)
                .args(["--target".to_owned(), self.linking_target()])
                .run()?;
        }
        let plumb = self.programs(Compiled::Plumb).join(self.platform.program("plumb"));
        self.commit.ensure_said_by(&plumb)?;
        if self.platform.is_linux() {
            let newest = debian::newest_c_library(&plumb)?;
            let plumb = plumb.display();
            ensure!(newest <= GLIBC_MINOR, "{plumb} needs version 2.{newest} of the C library");
        }
        Ok(plumb)
    }

    /// Builds the box's program for Linux; returns its path. It has its C library in itself.
    pub fn board(&self) -> Result<PathBuf> {
        const BOARD: &str = "plumbline-board";
        setup::ensure(&[setup::VIDEO])?;
        if self.profile == Profile::Dev {
            return tried(BOARD);
        }
        self.cargo(Compiled::Board)?
            .args(["rustc", "--release", "--package", BOARD, "--bin", BOARD])
            .args(["--", "-Ctarget-feature=+crt-static"])
            .run()?;
        let board = self.programs(Compiled::Board).join(BOARD);
        self.commit.ensure_said_by(&board)?;
        Ok(board)
    }

    /// Builds the Python package into a directory.
    pub fn wheel(&self, out: &Path) -> Result<()> {
        let maturin = Task::new(TOOLS.programs().join("maturin"));
        let maturin = self.with_environment(maturin, Compiled::Wheel)?;
        let maturin = if self.platform.is_windows() { maturin } else { self.zig(maturin) };
        let maturin = maturin
            .args(["build", "--release", LOCKED, "--manifest-path"])
            .args(["host-tools/python/Cargo.toml", "--target", self.platform.triple(), "--out"])
            .args([out]);
        if self.platform.is_linux() {
            let tag = format!("manylinux_2_{GLIBC_MINOR}");
            maturin.args(["--zig", "--compatibility", &tag]).run()
        } else {
            maturin.run()
        }
    }

    /// The version of the compiler and of its standard library.
    pub fn compiler_version(&self) -> Result<String> {
        self.compiler.version()
    }

    /// The directory of a program.
    fn programs(&self, compiled: Compiled) -> PathBuf {
        self.directory(compiled).join(self.platform.triple()).join("release")
    }

    fn directory(&self, compiled: Compiled) -> PathBuf {
        let name = self.platform.name();
        let name = match compiled {
            Compiled::Plumb => name.to_owned(),
            Compiled::Board => format!("{name}-board"),
            Compiled::Wheel => format!("{name}-wheel"),
        };
        work().join("build").join(name)
    }

    /// A cargo that builds for the platform.
    fn cargo(&self, compiled: Compiled) -> Result<Task> {
        let task = match self.compiler {
            Compiler::Rustup => Task::cargo(),
            Compiler::Debian => Task::new("/usr/bin/cargo").args([LOCKED]),
        };
        self.with_environment(task, compiled)
    }

    fn with_environment(&self, task: Task, compiled: Compiled) -> Result<Task> {
        let environment = self.environment(compiled)?;
        Ok(environment.into_iter().fold(task, |task, (name, value)| task.env(&name, &value)))
    }

    /// With zig where the tools look for it, and its files below the target directory.
    fn zig(&self, task: Task) -> Task {
        let path = env::var_os("PATH").unwrap_or_default();
        let places = [TOOLS.programs()].into_iter().chain(env::split_paths(&path));
        let path = env::join_paths(places).unwrap_or(path);
        task.env("PATH", &path.to_string_lossy())
            .env("CARGO_ZIGBUILD_CACHE_DIR", &work().join("zigbuild").to_string_lossy())
            .env("ZIG_GLOBAL_CACHE_DIR", &work().join("zig").to_string_lossy())
    }

    /// zig's name for the platform, with the C library's version.
    fn linking_target(&self) -> String {
        let version =
            if self.platform.is_linux() { format!(".2.{GLIBC_MINOR}") } else { String::new() };
        self.platform.triple().to_owned() + &version
    }

    fn environment(&self, compiled: Compiled) -> Result<Vec<(String, String)>> {
        let triple = self.platform.triple();
        let directory = self.directory(compiled);
        let own = format!("CARGO_TARGET_{}", triple.replace('-', "_").to_uppercase());
        let mut flags = cross::without_paths(&directory)?;
        let stripped = if self.platform.is_macos() { "none" } else { "symbols" };
        let mut environment: Vec<(String, String)> = vec![
            ("CARGO_BUILD_TARGET".into(), triple.into()),
            ("CARGO_TARGET_DIR".into(), directory.display().to_string()),
            ("SOURCE_DATE_EPOCH".into(), self.commit.epoch()),
            (commit::VARIABLE.into(), self.commit.mark()),
            // What a debugger wants is not shipped.
            ("CARGO_PROFILE_RELEASE_DEBUG".into(), "0".into()),
            ("CARGO_PROFILE_RELEASE_STRIP".into(), stripped.into()),
        ];
        match self.platform {
            Platform::WindowsX86_64 => {
                let linker = mingw_linker()?.display().to_string();
                environment.push((format!("{own}_LINKER"), linker));
                flags += " -Clink-arg=-Wl,--no-insert-timestamp";
            }
            // What links with zig would take a linker that is named here instead.
            Platform::LinuxAarch64 if compiled == Compiled::Board => {
                environment.push((format!("{own}_LINKER"), cross::AARCH64_GCC.into()));
            }
            Platform::MacosAarch64 | Platform::MacosX86_64 => {
                flags += &macos::flags(&work().join("frameworks"))?;
            }
            Platform::LinuxX86_64 | Platform::LinuxAarch64 => {}
        }
        environment.push((format!("{own}_RUSTFLAGS"), flags));
        if self.compiler == Compiler::Debian {
            environment.push(("CARGO".into(), "/usr/bin/cargo".into()));
            let compiler = Compiler::environment(self.built);
            environment.extend(compiler.into_iter().map(|(name, it)| (name.into(), it.into())));
        }
        Ok(environment)
    }
}

/// A program as the tests have it, without what a debugger wants.
fn tried(name: &str) -> Result<PathBuf> {
    let program = plumbline_test_support::program(name).map_err(|error| anyhow!(error))?;
    let stripped = work().join("tried").join(name);
    fs::create_dir_all(work().join("tried")).context("the programs of the tests")?;
    Task::new("strip").args(["-o".as_ref(), stripped.as_os_str()]).args([&program]).output()?;
    Ok(stripped)
}

/// The directory for everything that is built on the way.
pub fn work() -> PathBuf {
    target_directory().join("dist-work")
}

/// MinGW's linker without Rust's own start-up objects. They are empty on 64-bit Windows, and a standard
/// library that is built here has none.
fn mingw_linker() -> Result<PathBuf> {
    const SCRIPT: &str = "\
#!/bin/sh
for argument do
    shift
    case \"$argument\" in
        rsbegin.o | rsend.o) ;;
        *) set -- \"$@\" \"$argument\" ;;
    esac
done
exec x86_64-w64-mingw32-gcc \"$@\"
";
    let path = work().join("mingw-linker");
    let failed = || path.display().to_string();
    fs::create_dir_all(work()).with_context(failed)?;
    if fs::read(&path).is_ok_and(|there| there == SCRIPT.as_bytes()) {
        return Ok(path);
    }
    fs::write(&path, SCRIPT).with_context(failed)?;
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).with_context(failed)?;
    Ok(path)
}
