//! Debian's arm64 files: kernel, modules, boot firmware, busybox, libcamera; and what
//! [`own_module`](super::own_module) compiles with.
//!
//! The packages are those of the lock file, compared with its checksums and unpacked; nothing is
//! installed, so any computer can do it. The result is kept below `target/image`.
//!
//! Debian replaces packages several times a year, and then no longer has the older ones. What is given to
//! people is made of the lock's packages or not at all ([`DebianRoot::locked`]); the checks go on with
//! Debian's newest ones and say so ([`DebianRoot::for_checks`]).

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::archives::{self, FETCHER, Sources};
use super::here::Here;
use super::lock::{Lock, PLACE, Package, UPDATE};
use super::{own_module, resolve};
use crate::command::{Task, target_directory};
use crate::debian;
use crate::setup::{self, Need, Probe};

/// The release from which the packages come: it has libcamera 0.4, which the Debian package needs,
/// and a kernel with drivers for everything that the images run on.
pub const RELEASE: &str = "trixie";

/// The packages to fetch; their dependencies come with them.
pub const PACKAGES: &[&str] = &[
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
pub const FIRMWARE_RELEASE: &str = "forky";

/// The Raspberry Pi's boot firmware is not free software and is in a section of its own.
pub const COMPONENTS: &str = "main,non-free-firmware";

/// The tools needed to fetch the packages.
const NEEDS: &[Need] = &[
    Need {
        probe: Probe::File(FETCHER),
        package: "apt",
        why: "fetches Debian's ARM packages, and finds out which are the newest",
    },
    Need {
        probe: Probe::File(resolve::KEYS),
        package: "debian-archive-keyring",
        why: "the keys that the lists of those packages are signed with",
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
        setup::ensure(&[NEEDS, debian::NEEDS])
    }

    /// The packages of the lock, fetched unless they are already there. An error, with the remedy, if
    /// Debian no longer has one of them.
    pub fn locked() -> Result<Self> {
        let lock = Lock::read(PACKAGES)?;
        if let Some(there) = Self::there(&lock.to_text(), STAMP) {
            println!("Debian's packages are those in {}", there.path.display());
            return Ok(there);
        }
        let files = fetch(&lock)?;
        Self::make(&lock, &files.map_err(archives::Gone::into_error)?)
    }

    /// The same or, if Debian no longer has one of the packages, its newest ones: the checks must not
    /// fail because Debian has replaced a package. [`Self::notice`] then says so.
    pub fn for_checks() -> Result<Self> {
        let lock = Lock::read(PACKAGES)?;
        let text = lock.to_text();
        let there = [STAMP, INSTEAD_OF].into_iter().find_map(|stamp| Self::there(&text, stamp));
        if let Some(there) = there {
            println!("Debian's packages are those in {}", there.path.display());
            return Ok(there);
        }
        let gone = match fetch(&lock)? {
            Ok(files) => return Self::make(&lock, &files),
            Err(gone) => gone.into_error(),
        };
        println!("{gone}.\nThe checks go on with what Debian has now.");
        let newest = resolve::newest(PACKAGES)?;
        let files = fetch(&newest)?;
        let root = Self::make(&newest, &files.map_err(archives::Gone::into_error)?)?;
        fs::write(root.path.join(INSTEAD_OF), text)?;
        Ok(root)
    }

    /// What to tell the user if the packages that are there are not those of the lock.
    pub fn notice() -> Result<Option<String>> {
        let lock = Lock::read(PACKAGES)?;
        let Some(there) = Self::there(&lock.to_text(), INSTEAD_OF) else { return Ok(None) };
        let differences = lock.differences(&there.lock()?).join("\n  ");
        Ok(Some(format!(
            "NOT the packages of {PLACE}, which Debian no longer has: these checks are of its newest \
             ones, and `cargo xtask dist` makes no image. Run `{UPDATE}`, and commit the file.\n  \
             {differences}"
        )))
    }

    /// Writes a lock of Debian's newest packages, if it differs from that of the checkout; returns what
    /// is different.
    pub fn update_lock() -> Result<Vec<String>> {
        let newest = resolve::newest(PACKAGES)?;
        let path = Lock::path();
        let text = fs::read_to_string(&path).unwrap_or_default();
        let lines = match Lock::parse(&text) {
            Ok(lock) if lock.wanted == newest.wanted => {
                let lines = lock.differences(&newest);
                if lines.is_empty() {
                    return Ok(lines);
                }
                lines
            }
            // Without a lock, with a damaged one or with one of other packages, all is new.
            _ => newest
                .packages
                .iter()
                .map(|(name, it)| format!("{name} {}: new", it.version))
                .collect(),
        };
        fs::write(&path, newest.to_text()).with_context(|| path.display().to_string())?;
        Ok(lines)
    }

    /// What is already there, if this stamp of it has this text.
    fn there(text: &str, stamp: &str) -> Option<Self> {
        let path = place();
        let is_it = fs::read_to_string(path.join(stamp)).is_ok_and(|found| found == text);
        is_it.then_some(Self { path })
    }

    /// Unpacks the files of a lock's packages.
    fn make(lock: &Lock, files: &[PathBuf]) -> Result<Self> {
        let path = place();
        let unfinished = path.with_extension("unfinished");
        for old in [&path, &unfinished] {
            if old.exists() {
                fs::remove_dir_all(old).with_context(|| old.display().to_string())?;
            }
        }
        fs::create_dir_all(&unfinished).with_context(|| unfinished.display().to_string())?;
        for file in files {
            unpack(file, &unfinished)?;
        }
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
        own_module::prepare_tools(&root.path, &root.kernel_version()?)?;
        fs::write(root.path.join(STAMP), lock.to_text())?;
        fs::rename(&root.path, &path)?;
        fs::remove_dir_all(fetched()).context("the fetched packages")?;
        Ok(Self { path })
    }

    /// The packages that it was made of.
    pub fn lock(&self) -> Result<Lock> {
        Lock::parse(&String::from_utf8(self.read(STAMP)?)?)
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

    /// The packages of which parts get onto a card: the kernel with its modules and device trees, the
    /// boot firmware, the DHCP client, and the C library that is linked into the box's program.
    pub fn on_card(&self) -> Result<Vec<Package>> {
        let lock = self.lock()?;
        let kernel = format!("linux-image-{}", self.kernel_version()?);
        let names = [&kernel, "raspi-firmware", "busybox-static", "libc6-dev"];
        names.into_iter().map(|name| lock.package(name).cloned()).collect()
    }

    /// Which module needs which, as computed by depmod.
    pub fn module_dependencies(&self) -> Result<String> {
        Ok(String::from_utf8(self.read(DEPENDENCIES)?)?)
    }
}

const DEPENDENCIES: &str = "modules.dep";

/// The last file to be made: the lock of the packages that are there.
const STAMP: &str = "packages.lock";

/// The lock of those that should be there instead.
const INSTEAD_OF: &str = "instead-of.lock";

/// Where the root is.
fn place() -> PathBuf {
    target_directory().join("image").join(format!("{RELEASE}-arm64"))
}

/// Where packages are between being fetched and being unpacked.
fn fetched() -> PathBuf {
    target_directory().join("image").join("packages")
}

/// Fetches the packages of a lock that are of use on this computer.
fn fetch(lock: &Lock) -> Result<std::result::Result<Vec<PathBuf>, archives::Gone>> {
    let lock = lock.for_host(Here::of_this_machine()?.architecture);
    archives::fetch(&lock, &fetched(), &Sources::of_this_computer()?)
}

/// Unpacks a package's files into a directory, without those that belong to a running system, which only
/// root may create.
fn unpack(package: &Path, directory: &Path) -> Result<()> {
    let files = Task::new("dpkg-deb").args(["--fsys-tarfile"]).args([package]).output_bytes()?;
    let mut archive = tar::Archive::new(&files[..]);
    for entry in archive.entries()? {
        let mut entry = entry?;
        if !entry.path()?.strip_prefix("./").is_ok_and(|path| path.starts_with("dev/")) {
            entry.unpack_in(directory).with_context(|| package.display().to_string())?;
        }
    }
    Ok(())
}
