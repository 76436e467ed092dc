//! `cargo xtask image`: makes the images for a box.
//!
//! ```text
//! packages.lock
//!       ▼
//! Debian's packages ─▶ kernel, modules, busybox ─┐
//!                                                ├─▶ initramfs ─┬─▶ virt: for QEMU
//! plumbline-board, built static for arm64 ───────┘              └─▶ rpi4: SD card
//! plumbline-board, built with libcamera for arm64 ────────────────▶ deb: Debian package
//! ```
//!
//! `virt` and `rpi4` have one and the same initramfs, so that what the tests boot is what stands at
//! the bedside. For the same reason there is only one kernel, Debian's ordinary one: its PREEMPT_RT
//! variant would need its own modules.

mod archive;
mod archives;
mod config;
mod deb;
mod debian_root;
mod emulated_pi;
mod fat;
mod initramfs;
mod lock;
mod modules;
mod output;
mod resolve;
mod rpi4;
mod test_debian;
mod test_overlay;
mod unpacked;
mod virt;

use std::fs;
use std::path::{self, Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::ValueEnum;

use crate::command::{BadInput, target_directory};
use crate::commit::{self, Commit};
use crate::cross::{Linking, Target};
use crate::debian;
use crate::setup;
pub use archive::Archive;
use config::Provided;
pub use debian_root::DebianRoot;
pub use lock::Package;
pub use unpacked::NEEDS as UNPACKING;

/// The arguments of `cargo xtask image`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  A box in QEMU, from nothing:
    plumb provision --camera camera.toml --targets targets.toml --box box.toml \\
        --udp 10.0.2.2:4210 --new-key --out box.plb
    cargo xtask image virt --config box.plb
    target/image/virt/run
  An SD card for a Raspberry Pi 4, 400 or CM4 with a USB camera; X is the card's letter:
    cargo xtask image rpi4 --config box.plb
    sudo dd if=target/image/plumbline-rpi4.img of=/dev/sdX bs=4M conv=fsync
  A package for Raspberry Pi OS or Debian, for a camera on a ribbon cable:
    cargo xtask image deb

The configuration is the file config.plb in the root of the card's one
partition, and the key the file box.key beside it: any computer can replace
them. `plumb provision --new-key --out box.plb` writes both, and `plumb
provision --card` puts them into an image or onto a card. Whoever reads an
image with a key in it can listen to that box and command it.")]
pub struct Arguments {
    /// What to make.
    #[arg(value_enum, required_unless_present = "update_lock")]
    what: Option<What>,
    /// The configuration to put in, as `plumb provision` wrote it; refused where a box
    /// would refuse it.
    #[arg(long, value_name = "box.plb")]
    config: Option<PathBuf>,
    /// The box's key to put in [default: box.key beside the configuration, if it is there]. A box
    /// without a key only says that it is there, and takes one over its serial cable.
    #[arg(long, value_name = "box.key", requires = "config")]
    key: Option<PathBuf>,
    /// Where to [default: target/image/virt, target/image/plumbline-rpi4.img,
    /// target/image/plumbline-board_VERSION_arm64.deb]
    #[arg(long, value_name = "DIR|FILE")]
    out: Option<PathBuf>,
    /// Write Debian's newest packages into board/image/packages.lock, from which the images are made,
    /// and say what has changed.
    #[arg(long, conflicts_with_all = ["what", "config", "out"])]
    update_lock: bool,
}

/// The kinds of image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// A directory with kernel, initramfs and disk for QEMU's arm64 board.
    Virt,
    /// The image of an SD card for a Raspberry Pi 4 with a USB camera.
    Rpi4,
    /// The Debian package of the box's program with libcamera, for arm64.
    Deb,
}

/// The configuration's name on the boot partition.
const CONFIG_NAME: &str = "config.plb";

/// The name of the key beside it.
const KEY_NAME: &str = "box.key";

/// Makes the image.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Some(what) = arguments.what else { return update_lock() };
    let default = match what {
        What::Virt => "virt".into(),
        What::Rpi4 => "plumbline-rpi4.img".into(),
        What::Deb => format!("plumbline-board_{}_arm64.deb", debian::VERSION),
    };
    let out = arguments.out.clone().unwrap_or_else(|| directory().join(default));
    // The programs that make the image run in other directories.
    let out = path::absolute(out).context("--out")?;
    output::check(&out, what == What::Virt)?;
    if what == What::Deb && arguments.config.is_some() {
        bail!(BadInput(
            "--config: a package serves all boxes; leave it out, and copy the configuration to \
             /var/lib/plumbline/config.plb on the box"
                .into()
        ));
    }
    let key = arguments.key.as_deref();
    let provided = match &arguments.config {
        Some(config) => Provided::checked(config, key)?,
        None => Provided::default(),
    };
    match what {
        What::Virt => virt::make(&Parts::make()?, &provided, &out),
        What::Rpi4 => rpi4::make(&Parts::make()?, &provided, &out),
        What::Deb => make_deb(&out),
    }
}

/// Renews the lock, and says what has changed.
fn update_lock() -> Result<()> {
    DebianRoot::prepare()?;
    let lines = DebianRoot::update_lock()?;
    for line in &lines {
        println!("{line}");
    }
    if lines.is_empty() {
        println!("{}: Debian has nothing newer", lock::PLACE);
    } else {
        println!("{}: written; `cargo xtask test boot` tries the new packages", lock::PLACE);
    }
    Ok(())
}

/// Makes the image of an SD card without a configuration; returns the Debian packages of which parts are
/// in it.
pub fn make_card(out: &Path) -> Result<Vec<Package>> {
    let parts = Parts::make()?;
    rpi4::make(&parts, &Provided::default(), out)?;
    parts.debian.on_card()
}

/// Makes the Debian package of the box's program.
pub fn make_deb(out: &Path) -> Result<()> {
    prepare()?;
    let debian = DebianRoot::locked()?;
    deb::make(&built_with_libcamera(&debian, Profile::Release)?, out)
}

/// Installs what making the images needs.
pub fn prepare() -> Result<()> {
    setup::ensure(&[NEEDS, fat::NEEDS, rpi4::NEEDS, debian::NEEDS])?;
    DebianRoot::prepare()?;
    Target::Aarch64.prepare()
}

/// Installs what the tests need in addition.
pub fn prepare_for_tests() -> Result<()> {
    // Separately, because a package that cannot be installed beside others would hold up the rest.
    setup::ensure(&[emulated_pi::NEEDS, UNPACKING])?;
    setup::ensure(&[setup::QEMU_SYSTEM])?;
    prepare()
}

/// How the programs in an image are built: a profile of the root's Cargo.toml.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// As shipped.
    Release,
    /// That of the tests, with which it shares the dependencies: quicker to make. The core and the
    /// box's program do not check for overflow, which an emulated box has no time for.
    Dev,
}

impl Profile {
    const fn name(self) -> &'static str {
        match self {
            Self::Release => "release",
            Self::Dev => "dev",
        }
    }

    /// What cargo is told besides the profile's name.
    fn arguments(self) -> Vec<String> {
        let unchecked = |package| {
            ["overflow-checks", "debug-assertions"]
                .map(|check| format!("--config=profile.dev.package.{package}.{check}=false"))
        };
        match self {
            Self::Release => Vec::new(),
            Self::Dev => ["plumbline", BOARD].into_iter().flat_map(unchecked).collect(),
        }
    }

    /// Cargo's directory for what is built with it.
    const fn directory(self) -> &'static str {
        match self {
            Self::Release => "release",
            Self::Dev => "debug",
        }
    }
}

/// Builds the programs that [`make_for_tests`] needs, which then finds them built.
pub fn build_ahead(profile: Profile) -> Result<()> {
    let debian = DebianRoot::for_checks()?;
    built(&debian, profile, Libraries::Inside, GUEST, &[])?;
    built(&debian, profile, Libraries::Inside, BOARD, &["fault-injection"])?;
    built_with_libcamera(&debian, profile).map(drop)
}

/// Makes what the tests boot, and the SD card that they inspect; returns their directory.
///
/// The box's program in it can be told by the kernel's command line to hang or to panic; without
/// these words it behaves as the one that ships.
///
/// | file | is |
/// |---|---|
/// | `vmlinuz`, `initramfs` | as they ship, but for the program |
/// | `overlay.cpio` | [`test_overlay`] |
/// | `rpi4.img` | the SD card, without a configuration |
/// | `rpi4.dtb`, `qemu-raspi4b` | [`emulated_pi`] |
/// | `kernel-config` | what the kernel was built with |
/// | `plumbline-board.deb` | the Debian package |
/// | `overlay-libcamera.cpio` | its program as `/init`, and its libraries |
/// | `debian.cpio` | [`test_debian`] |
pub fn make_for_tests(profile: Profile) -> Result<PathBuf> {
    prepare()?;
    let directory = directory().join("tests");
    fs::create_dir_all(&directory).with_context(|| directory.display().to_string())?;
    let debian = DebianRoot::for_checks()?;
    let guest = built(&debian, profile, Libraries::Inside, GUEST, &[])?;
    let overlay = test_overlay::make(&debian, &guest)?;
    fs::write(directory.join("overlay.cpio"), overlay)?;
    let program = built(&debian, profile, Libraries::Inside, BOARD, &["fault-injection"])?;
    let initramfs = initramfs::make(&debian, &program)?;
    let parts = Parts { debian, initramfs };
    parts.write_to(&directory)?;
    let debian = &parts.debian;
    rpi4::make(&parts, &Provided::default(), &directory.join("rpi4.img"))?;
    let tree = debian.device_trees()?.join(rpi4::DEVICE_TREES[0]);
    emulated_pi::make_tree(&tree, &directory.join("rpi4.dtb"))?;
    emulated_pi::make_emulator(&directory.join("qemu-raspi4b"))?;
    fs::copy(debian.kernel_config_path()?, directory.join("kernel-config"))?;
    let program = built_with_libcamera(debian, profile)?;
    deb::make(&program, &directory.join("plumbline-board.deb"))?;
    let overlay = test_overlay::make_with_libcamera(debian, &program)?;
    fs::write(directory.join("overlay-libcamera.cpio"), overlay)?;
    fs::write(directory.join("debian.cpio"), test_debian::make(debian, &program)?)?;
    Ok(directory)
}

const NEEDS: &[setup::Need] = &[setup::Need {
    probe: setup::Probe::Program("xz"),
    package: "xz-utils",
    why: "unpacks Debian's kernel modules",
}];

fn directory() -> PathBuf {
    target_directory().join("image")
}

/// The components of a bootable image.
struct Parts {
    debian: DebianRoot,
    initramfs: Vec<u8>,
}

impl Parts {
    /// Fetches and builds them.
    fn make() -> Result<Self> {
        prepare()?;
        let debian = DebianRoot::locked()?;
        let program = built(&debian, Profile::Release, Libraries::Inside, BOARD, &[])?;
        let initramfs = initramfs::make(&debian, &program)?;
        Ok(Self { debian, initramfs })
    }

    /// Writes kernel and initramfs into a directory.
    fn write_to(&self, directory: &Path) -> Result<()> {
        fs::copy(self.debian.kernel_path()?, directory.join("vmlinuz"))?;
        fs::write(directory.join("initramfs"), &self.initramfs)?;
        Ok(())
    }
}

/// The package of the box's program, and the program's name.
const BOARD: &str = "plumbline-board";

/// The package and name of the program that plays the camera in the tests.
const GUEST: &str = "plumbline-test-guest";

/// Where a program has its libraries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Libraries {
    /// In itself: it runs in any root file system, even as the first process.
    Inside,
    /// In the root file system of a Debian.
    Shared,
}

/// Builds a program for the box against Debian's libraries; returns its path.
///
/// Only the program's own crate is told how to be linked, so that the crates that it uses are
/// compiled once for all programs. The next build of the same program replaces it.
fn built(
    debian: &DebianRoot,
    profile: Profile,
    libraries: Libraries,
    program: &str,
    features: &[&str],
) -> Result<PathBuf> {
    let toolchain = Target::Aarch64.toolchain()?;
    let linking = Linking::Root(debian.path());
    let cargo = toolchain.cargo(linking);
    let cargo = match (profile, Commit::read()) {
        (Profile::Release, Ok(commit)) => cargo.env(commit::VARIABLE, &commit.mark()),
        (Profile::Release, Err(error)) => {
            println!("{error:#}\nThe program will not say which commit it is of.");
            cargo
        }
        (Profile::Dev, _) => cargo,
    };
    let cargo = cargo
        .args(["rustc", "--profile", profile.name(), "--package", program, "--bin", program])
        .args(profile.arguments())
        .args(features.iter().flat_map(|feature| ["--features", feature]));
    match libraries {
        Libraries::Inside => cargo.args(["--", "-Ctarget-feature=+crt-static"]).run()?,
        Libraries::Shared => cargo.run()?,
    }
    Ok(toolchain.programs(linking, profile.directory()).join(program))
}

/// Builds the box's program with libcamera; returns its path.
fn built_with_libcamera(debian: &DebianRoot, profile: Profile) -> Result<PathBuf> {
    setup::ensure(&[LIBCAMERA_NEEDS])?;
    built(debian, profile, Libraries::Shared, BOARD, &["libcamera"])
}

const LIBCAMERA_NEEDS: &[setup::Need] = &[
    setup::Need {
        probe: setup::Probe::Program("aarch64-linux-gnu-g++"),
        package: "g++-aarch64-linux-gnu",
        why: "compiles the bridge to libcamera, which is C++",
    },
    setup::Need {
        probe: setup::Probe::Program("pkg-config"),
        package: "pkg-config",
        why: "tells where libcamera's headers are",
    },
];
