//! Debian's arm64 files: kernel, modules, boot firmware, busybox, libcamera.
//!
//! `mmdebstrap` fetches the packages, checks their signatures and unpacks them; nothing in them is
//! run, so any computer can do it. The result is kept below `target/image`; if it is removed, the
//! newest packages are fetched again.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use flate2::read::GzDecoder;

use crate::command::{Task, target_directory};
use crate::setup::{self, Need, Probe};

/// The release from which the packages come: it has libcamera 0.4, which the Debian package needs,
/// and a kernel with drivers for everything that the images run on.
pub const RELEASE: &str = "trixie";

/// The packages to fetch; their dependencies come with them.
const PACKAGES: &[&str] = &[
    "linux-image-arm64",
    "busybox-static",
    "raspi-firmware",
    "libcamera-dev",
    "libcamera-ipa",
    "libc6-dev",
    "libstdc++-14-dev",
];

/// The release from which the Raspberry Pi's boot firmware comes: [`RELEASE`] has one of April 2024,
/// which cannot start the watchdog before the kernel (`kernel_watchdog_timeout`, of July 2025).
const FIRMWARE_RELEASE: &str = "forky";

/// The Raspberry Pi's boot firmware is not free software and is in a section of its own.
const COMPONENTS: &str = "main,non-free-firmware";

/// The tools needed to fetch the packages.
const NEEDS: &[Need] = &[
    Need {
        probe: Probe::Program("mmdebstrap"),
        package: "mmdebstrap",
        why: "fetches and unpacks Debian's ARM packages",
    },
    Need {
        probe: Probe::File("/usr/share/keyrings/debian-archive-keyring.gpg"),
        package: "debian-archive-keyring",
        why: "the keys that those packages are signed with",
    },
    Need {
        probe: Probe::Program("newuidmap"),
        package: "uidmap",
        why: "lets mmdebstrap work for somebody who is not root",
    },
    Need {
        probe: Probe::File("/usr/sbin/depmod"),
        package: "kmod",
        why: "finds out which kernel module needs which",
    },
];

/// The unpacked packages.
#[derive(Debug)]
pub struct DebianRoot {
    path: PathBuf,
}

impl DebianRoot {
    /// Installs what fetching needs.
    pub fn prepare() -> Result<()> {
        setup::ensure(&[NEEDS])
    }

    /// Fetches the packages, unless they are already there.
    pub fn fetch() -> Result<Self> {
        let path = path();
        let packages = format!("{},{FIRMWARE_RELEASE}", PACKAGES.join(","));
        if fs::read_to_string(stamp(&path)).is_ok_and(|found| found == packages) {
            println!("Debian's packages are those in {}", path.display());
            return Ok(Self { path });
        }
        if path.exists() {
            fs::remove_dir_all(&path).with_context(|| path.display().to_string())?;
        }
        let unfinished = path.with_extension("unfinished");
        // From the same place, and of that release nothing but what is not free. Its list of packages
        // is signed like the others, but has a date after which it is to be replaced, by which a
        // mirror may be late.
        let firmware = format!(
            "--setup-hook=sed --quiet \
             's/^deb \\(\\[\\(.*\\)\\] \\)\\?\\(.*\\) {RELEASE} .*/\
             deb [\\2 check-valid-until=no] \\3 {FIRMWARE_RELEASE} non-free-firmware/p' \
             \"$1/etc/apt/sources.list\" > \"$1/etc/apt/sources.list.d/firmware.list\""
        );
        let include = format!("--include={}", PACKAGES.join(","));
        bootstrap(&["--architectures=arm64", &include, &firmware], &unfinished)?;
        // Debian has moved /lib to /usr; the link is normally made by a script, which is not run
        // here.
        if !unfinished.join("lib").exists() {
            symlink("usr/lib", unfinished.join("lib"))?;
        }
        let root = Self { path: unfinished };
        let dependencies = Task::new("/usr/sbin/depmod")
            .args(["--show", "--basedir"])
            .args([&root.path])
            .args([root.kernel_version()?])
            .output()?;
        fs::write(root.path.join(DEPENDENCIES), dependencies)?;
        fs::write(stamp(&root.path), packages)?;
        fs::rename(&root.path, &path)?;
        Ok(Self { path })
    }

    /// The path of the root.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads a file below it.
    pub fn read(&self, name: &str) -> Result<Vec<u8>> {
        let path = self.path.join(name);
        fs::read(&path).with_context(|| path.display().to_string())
    }

    /// The version of its one kernel.
    pub fn kernel_version(&self) -> Result<String> {
        let modules = self.path.join("usr/lib/modules");
        let mut versions = Vec::new();
        for entry in fs::read_dir(&modules).with_context(|| modules.display().to_string())? {
            versions.push(entry?.file_name().to_string_lossy().into_owned());
        }
        ensure!(
            versions.len() == 1,
            "{}: expected one kernel, found {versions:?}",
            modules.display()
        );
        Ok(versions.remove(0))
    }

    /// The configuration with which the kernel was built: a line `CONFIG_NAME=y` or `=m` for each
    /// part.
    pub fn kernel_config_path(&self) -> Result<PathBuf> {
        Ok(self.path.join(format!("boot/config-{}", self.kernel_version()?)))
    }

    /// The directory of the kernel's device trees for the Raspberry Pi.
    pub fn device_trees(&self) -> Result<PathBuf> {
        Ok(self.path.join(format!("usr/lib/linux-image-{}/broadcom", self.kernel_version()?)))
    }

    /// The path of the kernel itself.
    pub fn kernel_path(&self) -> Result<PathBuf> {
        Ok(self.path.join(format!("boot/vmlinuz-{}", self.kernel_version()?)))
    }

    /// The packages of which parts get onto a card, with their versions.
    pub fn versions(&self) -> Result<Vec<(String, String)>> {
        let kernel = format!("linux-image-{}", self.kernel_version()?);
        let names = [kernel, "raspi-firmware".into(), "busybox-static".into(), "libc6".into()];
        names.into_iter().map(|name| Ok((name.clone(), self.version(&name)?))).collect()
    }

    /// The version of a package, by the first line of its changes: `name (version) ...`.
    fn version(&self, name: &str) -> Result<String> {
        let directory = self.path.join("usr/share/doc").join(name);
        let changes = ["changelog.Debian.gz", "changelog.gz"].map(|it| directory.join(it));
        let path = changes.iter().find(|it| it.is_file());
        let path = path.with_context(|| format!("{}: no list of changes", directory.display()))?;
        let failed = || path.display().to_string();
        let file = fs::File::open(path).with_context(failed)?;
        let mut line = String::new();
        BufReader::new(GzDecoder::new(file)).read_line(&mut line).with_context(failed)?;
        let version = line.split(['(', ')']).nth(1).with_context(failed)?;
        Ok(version.to_owned())
    }

    /// Which module needs which, as computed by depmod.
    pub fn module_dependencies(&self) -> Result<String> {
        Ok(String::from_utf8(self.read(DEPENDENCIES)?)?)
    }
}

const DEPENDENCIES: &str = "modules.dep";

/// Where the unpacked packages are.
pub fn path() -> PathBuf {
    target_directory().join("image").join(format!("{RELEASE}-arm64"))
}

/// Unpacks packages of the release and their dependencies into a new directory; nothing in them is
/// run.
pub fn unpack(architecture: &str, packages: &[&str], directory: &Path) -> Result<()> {
    let include = format!("--include={}", packages.join(","));
    bootstrap(&[&format!("--architectures={architecture}"), &include], directory)
}

/// Unpacks packages of the release into a new directory, each named as `name:architecture` and
/// without those that it depends on; the first of the architectures is this machine's.
pub fn unpack_alone(architectures: &[&str], packages: &[String], directory: &Path) -> Result<()> {
    // Where a hook runs, the lists of packages are there, with their signatures checked; `$1` is
    // the new root.
    let hook = format!(
        "--extract-hook=cd \"$1\" && \
         APT_CONFIG=\"$MMDEBSTRAP_APT_CONFIG\" apt-get --quiet download {} && \
         for it in *.deb; do dpkg-deb --extract \"$it\" . && rm \"$it\" || exit 1; done",
        packages.join(" ")
    );
    bootstrap(&[&format!("--architectures={}", architectures.join(",")), &hook], directory)
}

fn bootstrap(options: &[&str], directory: &Path) -> Result<()> {
    if directory.exists() {
        fs::remove_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    let archive = directory.with_extension("tar");
    Task::new("mmdebstrap")
        .args(["--variant=extract", &format!("--components={COMPONENTS}")])
        .args(options)
        .args([RELEASE.as_ref(), archive.as_os_str()])
        .run()?;
    // Device files belong to a running system, and only root may create them.
    Task::new("tar")
        .args(["--extract", "--no-same-owner", "--exclude=./dev/*", "--file"])
        .args([&archive])
        .args(["--directory".as_ref(), directory.as_os_str()])
        .run()?;
    Ok(fs::remove_file(&archive)?)
}

/// The last file to be made: its content shows that everything is there.
fn stamp(root: &Path) -> PathBuf {
    root.join("packages")
}
