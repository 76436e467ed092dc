//! Builds for ARM on this machine and runs the result under QEMU.
//!
//! rustup adds its standard library for the target. Where there is no rustup or its download does
//! not work, Debian's compiler is used instead, which takes longer: it has a standard library for
//! 64-bit ARM, and the sources of one for the other processors. Both link with Debian's cross gcc.
//!
//! A [`Toolchain`] is a set of environment variables for cargo, so every printed line can be typed
//! again as it is. Its output lies below `target/`, separate from the native build: artefacts of
//! two compilers must not be mixed.

use std::env;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};
use plumbline_test_support::RUNNER;

use crate::command::{LOCKED, Task, root, target_directory};
use crate::setup::{self, Need, Probe};

/// A kind of ARM processor that runs Linux programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// 64-bit: the box.
    Aarch64,
    /// 32-bit, hard float: a smaller board.
    Armv7,
}

impl Target {
    /// Rust's name for it.
    pub const fn triple(self) -> &'static str {
        match self {
            Self::Aarch64 => "aarch64-unknown-linux-gnu",
            Self::Armv7 => "armv7-unknown-linux-gnueabihf",
        }
    }

    /// The program that runs programs for it on this machine.
    const fn emulator(self) -> &'static str {
        match self {
            Self::Aarch64 => "qemu-aarch64-static",
            Self::Armv7 => "qemu-arm-static",
        }
    }

    const fn linker(self) -> &'static str {
        match self {
            Self::Aarch64 => AARCH64_GCC,
            Self::Armv7 => "arm-linux-gnueabihf-gcc",
        }
    }

    /// The packages that every build for it needs.
    const fn linking_needs(self) -> &'static [Need] {
        match self {
            Self::Aarch64 => AARCH64_LINKING,
            Self::Armv7 => ARMV7_LINKING,
        }
    }

    /// The packages that replace rustup's standard library.
    const fn compiler_needs(self) -> &'static [Need] {
        match self {
            Self::Aarch64 => AARCH64_COMPILER,
            Self::Armv7 => BUILT_LIBRARY,
        }
    }

    /// The parts of the standard library that must be built with Debian's compiler.
    const fn built_library(self) -> Option<&'static str> {
        match self {
            Self::Aarch64 => None,
            Self::Armv7 => Some("std,panic_abort"),
        }
    }

    /// Installs what is missing.
    pub fn prepare(self) -> Result<()> {
        add_target(self.triple());
        self.toolchain().map(drop)
    }

    /// Installs what is missing and returns the toolchain.
    pub fn toolchain(self) -> Result<Toolchain> {
        setup::ensure(&[setup::LINKER, setup::VIDEO, self.linking_needs()])?;
        let compiler = Compiler::of(self.triple(), self.compiler_needs())?;
        Ok(Toolchain { target: self, compiler })
    }
}

/// Rust's standard library for processors for which Debian has none.
pub const BUILT_LIBRARY: &[Need] = &[
    RUSTC,
    CARGO,
    Need {
        probe: Probe::Package("rust-web-src"),
        package: "rust-web-src",
        why: "Rust's standard library, to be built for another processor",
    },
];

/// What links programs for 64-bit ARM.
pub const AARCH64_GCC: &str = "aarch64-linux-gnu-gcc";

/// What linking for 64-bit ARM needs.
pub const AARCH64_LINKING: &[Need] = &[
    Need {
        probe: Probe::Program(AARCH64_GCC),
        package: "gcc-aarch64-linux-gnu",
        why: "links programs for 64-bit ARM",
    },
    Need {
        probe: Probe::File("/usr/aarch64-linux-gnu/lib/libc.a"),
        package: "libc6-dev-arm64-cross",
        why: "the C library of 64-bit ARM, part of its programs",
    },
    Need {
        probe: Probe::Program("qemu-aarch64-static"),
        package: "qemu-user-static",
        why: "runs ARM programs on this machine",
    },
];

/// Debian's standard library for the processor of most computers.
pub const X86_64_COMPILER: &[Need] = &[
    RUSTC,
    CARGO,
    Need {
        probe: Probe::Package("libstd-rust-web-dev:amd64"),
        package: "libstd-rust-web-dev:amd64",
        why: "Rust's standard library for x86-64",
    },
];

/// Debian's standard library for 64-bit ARM.
pub const AARCH64_COMPILER: &[Need] = &[
    RUSTC,
    CARGO,
    Need {
        probe: Probe::Package("libstd-rust-web-dev:arm64"),
        package: "libstd-rust-web-dev:arm64",
        why: "Rust's standard library for 64-bit ARM",
    },
];

const ARMV7_LINKING: &[Need] = &[
    Need {
        probe: Probe::Program("arm-linux-gnueabihf-gcc"),
        package: "gcc-arm-linux-gnueabihf",
        why: "links programs for 32-bit ARM",
    },
    Need {
        probe: Probe::File("/usr/arm-linux-gnueabihf/lib/libc.a"),
        package: "libc6-dev-armhf-cross",
        why: "the C library of 32-bit ARM, part of its programs",
    },
    Need {
        probe: Probe::Program("qemu-arm-static"),
        package: "qemu-user-static",
        why: "runs ARM programs on this machine",
    },
];

const RUSTC: Need = Need {
    probe: Probe::Package("rustc-web"),
    package: "rustc-web",
    why: "a Rust compiler that Debian has standard libraries of other processors for",
};

const CARGO: Need = Need {
    probe: Probe::Package("cargo-web"),
    package: "cargo-web",
    why: "the cargo that belongs to this compiler",
};

/// The source of the compiler and standard library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compiler {
    /// The compiler that builds this program.
    Rustup,
    /// Debian's, with its own standard library or one that is built here.
    Debian,
}

impl Compiler {
    /// rustup's if it has a standard library for `triple`, otherwise Debian's, for which `needs`
    /// are installed.
    pub fn of(triple: &str, needs: &[Need]) -> Result<Self> {
        let compiler = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
        let sysroot = Task::new(compiler).args(["--print", "sysroot"]).output();
        let is_installed = sysroot.is_ok_and(|path| {
            Path::new(path.trim()).join("lib/rustlib").join(triple).join("lib").is_dir()
        });
        if is_installed {
            return Ok(Self::Rustup);
        }
        if !setup::are_there(needs) {
            println!(
                "This Rust cannot build for {triple}: Debian's is used. \
                 Where its download works, `rustup target add {triple}` does instead."
            );
        }
        setup::ensure(&[needs])?;
        Ok(Self::Debian)
    }

    /// Its version, such as `1.96.0`.
    pub fn version(self) -> Result<String> {
        let compiler = match self {
            Self::Rustup => env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()),
            Self::Debian => "/usr/bin/rustc".into(),
        };
        let line = Task::new(compiler).args(["--version"]).output()?;
        line.split(' ').nth(1).map(str::to_owned).context("rustc did not print its version")
    }

    /// Its cargo; `built` names the parts of the standard library to be built, if they are not
    /// supplied.
    pub fn cargo(self, built: Option<&str>) -> Task {
        match self {
            Self::Rustup => Task::cargo(),
            Self::Debian => Self::environment(built)
                .into_iter()
                .fold(Task::new("/usr/bin/cargo"), |task, (name, value)| task.env(name, value))
                .args([LOCKED]),
        }
    }

    /// The environment variables that make cargo use Debian's compiler.
    pub fn environment(built: Option<&str>) -> Vec<(&'static str, &str)> {
        let mut environment = vec![("RUSTC", "/usr/bin/rustc"), ("RUSTDOC", "/usr/bin/rustdoc")];
        if let Some(built) = built {
            // Building the standard library is unstable but needs only this: the sources are those
            // of this very compiler.
            environment.push(("RUSTC_BOOTSTRAP", "1"));
            environment.push(("CARGO_UNSTABLE_BUILD_STD", built));
        }
        environment
    }
}

/// Lets rustup add its standard library for a target. Where there is no rustup or no network,
/// nothing changes, and Debian's compiler is used.
pub fn add_target(triple: &str) {
    /// Whether a download has failed: the next one would too, or would hang for as long again.
    static HAS_FAILED: AtomicBool = AtomicBool::new(false);
    let list = Task::new("rustup").args(["target", "list", "--installed"]).output();
    if list.is_ok_and(|list| !list.lines().any(|line| line == triple))
        && !HAS_FAILED.load(Ordering::Relaxed)
        && let Err(error) =
            Task::new("rustup").args(["target", "add", triple]).run_within(TARGET_WITHIN)
    {
        HAS_FAILED.store(true, Ordering::Relaxed);
        println!("{error:#}");
    }
}

/// The time limit for a target's standard library: on some networks the download hangs.
const TARGET_WITHIN: Duration = Duration::from_secs(90);

/// Flags for rustc that replace the paths of this computer by names that are the same everywhere, so
/// that a program does not tell where it was built; `directory` is what cargo builds in. Of two that
/// fit, the later one counts.
pub fn without_paths(directory: &Path) -> Result<String> {
    let cargo = match env::var_os("CARGO_HOME") {
        Some(home) => PathBuf::from(home),
        None => env::home_dir().context("this user has no home directory")?.join(".cargo"),
    };
    let names = [
        (root().to_owned(), "/plumbline"),
        (directory.to_owned(), "/target"),
        (cargo.join("registry/src"), "/registry"),
    ];
    let flags = names.map(|(path, name)| format!("--remap-path-prefix={}={name}", path.display()));
    Ok(flags.join(" "))
}

/// Where a program finds its C library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Linking<'a> {
    /// Linked into the program: it runs in any root file system, even as the first process.
    Static,
    /// As shared libraries in a root file system of the target, which is at this path.
    Root(&'a Path),
}

impl Linking<'_> {
    const fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Root(_) => "root",
        }
    }

    /// What the emulator needs to know to run a program.
    fn environment(self) -> Option<(String, String)> {
        match self {
            Self::Static => None,
            Self::Root(root) => Some(("QEMU_LD_PREFIX".into(), root.display().to_string())),
        }
    }

    /// No build id: it would be a hash of what is stripped afterwards as well, with the paths of
    /// this computer, and the package is to be the same bytes wherever it is made.
    fn rustflags(self, target: Target) -> String {
        match self {
            Self::Static => "-Ctarget-feature=+crt-static".into(),
            Self::Root(root) => {
                let libraries = match target {
                    Target::Aarch64 => "usr/lib/aarch64-linux-gnu",
                    Target::Armv7 => "usr/lib/arm-linux-gnueabihf",
                };
                format!(
                    "-Clink-arg=--sysroot={root} \
                     -Clink-arg=-Wl,-rpath-link,{root}/{libraries} \
                     -Clink-arg=-Wl,--allow-shlib-undefined \
                     -Clink-arg=-Wl,--build-id=none",
                    root = root.display()
                )
            }
        }
    }
}

/// A compiler and settings for building programs for one target.
#[derive(Debug, Clone, Copy)]
pub struct Toolchain {
    target: Target,
    compiler: Compiler,
}

impl Toolchain {
    /// The program that runs programs of the target on this machine.
    pub const fn emulator(&self) -> &'static str {
        self.target.emulator()
    }

    /// The version of the compiler and of its standard library.
    pub fn compiler_version(&self) -> Result<String> {
        self.compiler.version()
    }

    /// A run of a program under QEMU.
    pub fn emulated(&self, linking: Linking, program: &Path) -> Task {
        let task = Task::new(self.emulator()).args([program]);
        linking.environment().iter().fold(task, |task, (name, value)| task.env(name, value))
    }

    /// A cargo whose `build`, `test` and `run` are for the target. Tests and runs use QEMU.
    pub fn cargo(&self, linking: Linking) -> Task {
        let task = self.compiler.cargo(self.target.built_library());
        self.environment(linking).iter().fold(task, |task, (name, value)| task.env(name, value))
    }

    /// The directory into which cargo with the same linking puts programs; `profile` is `debug` or
    /// `release`.
    pub fn programs(&self, linking: Linking, profile: &str) -> PathBuf {
        self.target_directory(linking).join(self.target.triple()).join(profile)
    }

    fn target_directory(&self, linking: Linking) -> PathBuf {
        let processor = self.target.triple().split('-').next().expect("it has a first word");
        target_directory().join(format!("{processor}-{}", linking.name()))
    }

    fn environment(&self, linking: Linking) -> Vec<(String, String)> {
        let triple = self.target.triple();
        let own = format!("CARGO_TARGET_{}", triple.replace('-', "_").to_uppercase());
        let mut environment = vec![
            ("CARGO_BUILD_TARGET".into(), triple.into()),
            ("CARGO_TARGET_DIR".into(), self.target_directory(linking).display().to_string()),
            (format!("{own}_LINKER"), self.target.linker().into()),
            (format!("{own}_RUNNER"), self.target.emulator().into()),
            (format!("{own}_RUSTFLAGS"), self.rustflags(linking)),
            (RUNNER.into(), self.target.emulator().into()),
        ];
        environment.extend(linking.environment());
        if let Linking::Root(root) = linking {
            environment.extend(self.headers_and_libraries(root));
        }
        environment
    }

    /// The flags of the linking, and those that keep this computer's paths out of the programs.
    fn rustflags(&self, linking: Linking) -> String {
        let flags = linking.rustflags(self.target);
        match without_paths(&self.target_directory(linking)) {
            Ok(without) => format!("{flags} {without}"),
            // Without a home directory there is no registry there either.
            Err(_) => flags,
        }
    }

    /// The environment with which build scripts find the headers and libraries of the root: for
    /// pkg-config by its own files, for bindgen and the C++ compiler by arguments.
    fn headers_and_libraries(&self, root: &Path) -> Vec<(String, String)> {
        let root = root.display();
        let triple = self.target.triple().replace('-', "_");
        let multiarch = match self.target {
            Target::Aarch64 => "aarch64-linux-gnu",
            Target::Armv7 => "arm-linux-gnueabihf",
        };
        let own = format!("-I{root}/usr/include/{multiarch}");
        let cpp = format!("-I{root}/usr/include/c++/14 -I{root}/usr/include/{multiarch}/c++/14");
        let packages = format!("{root}/usr/lib/{multiarch}/pkgconfig:{root}/usr/share/pkgconfig");
        vec![
            ("PKG_CONFIG_ALLOW_CROSS".into(), "1".into()),
            ("PKG_CONFIG_SYSROOT_DIR".into(), root.to_string()),
            ("PKG_CONFIG_LIBDIR".into(), packages),
            (
                format!("BINDGEN_EXTRA_CLANG_ARGS_{triple}"),
                format!("--sysroot={root} {own} -I{root}/usr/include {cpp}"),
            ),
            (format!("CXX_{triple}"), format!("{multiarch}-g++")),
            (format!("CXXFLAGS_{triple}"), format!("--sysroot={root} {own}")),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value<'a>(environment: &'a [(String, String)], name: &str) -> Option<&'a str> {
        environment.iter().find(|(one, _)| one == name).map(|(_, value)| value.as_str())
    }

    #[test]
    fn the_variables_are_those_of_the_target() {
        let toolchain = Toolchain { target: Target::Aarch64, compiler: Compiler::Rustup };
        let environment = toolchain.environment(Linking::Static);
        let value = |name| value(&environment, name);
        assert_eq!(value("CARGO_BUILD_TARGET"), Some("aarch64-unknown-linux-gnu"));
        assert_eq!(
            value("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER"),
            Some("aarch64-linux-gnu-gcc")
        );
        assert_eq!(
            value("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER"),
            Some("qemu-aarch64-static")
        );
        assert!(value("CARGO_TARGET_DIR").unwrap().ends_with("/aarch64-static"));
        assert_eq!(value("RUSTC"), None);
    }

    #[test]
    fn only_debians_compiler_for_armv7_builds_the_standard_library() {
        for (target, compiler, starts) in [
            (Target::Armv7, Compiler::Debian, "CARGO_UNSTABLE_BUILD_STD=std,panic_abort "),
            (Target::Armv7, Compiler::Rustup, "cargo"),
            (Target::Aarch64, Compiler::Debian, "RUSTDOC=/usr/bin/rustdoc RUSTC=/usr/bin/rustc "),
        ] {
            let cargo = compiler.cargo(target.built_library());
            let line = cargo.line();
            assert!(line.starts_with(starts), "{line}");
        }
    }

    #[test]
    fn static_and_shared_builds_lie_apart() {
        let toolchain = Toolchain { target: Target::Aarch64, compiler: Compiler::Debian };
        let root = Linking::Root(Path::new("/roots/trixie"));
        assert_ne!(toolchain.programs(Linking::Static, "debug"), toolchain.programs(root, "debug"));
        let environment = toolchain.environment(root);
        let flags = value(&environment, "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUSTFLAGS");
        assert!(flags.unwrap().contains("--sysroot=/roots/trixie"));
        assert_eq!(value(&environment, "QEMU_LD_PREFIX"), Some("/roots/trixie"));
    }
}
