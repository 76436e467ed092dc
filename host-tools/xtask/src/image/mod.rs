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
mod here;
mod initramfs;
mod lock;
mod modules;
pub mod output;
mod own_module;
mod resolve;
mod rpi4;
mod slot;
mod test_debian;
mod test_overlay;
mod unpacked;
mod update;
mod virt;

use std::fs;
use std::path::{self, Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use plumbline_update::header::VerifyingKey;
use plumbline_update::sign::SigningKey;

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
  An update for boxes whose cards were made with the key of the same name (`plumb update`):
    openssl genpkey -algorithm ed25519 -out release.key
    openssl pkey -in release.key -pubout -out release.pub
    cargo xtask image rpi4 --config box.plb --update-key release.pub
    cargo xtask image update --signing-key release.key
  A package for Raspberry Pi OS or Debian, for a camera on a ribbon cable:
    cargo xtask image deb

The configuration is the file config.plb in the root of the card's partition
PLUMBLINE, and the key the file box.key beside it: any computer can replace
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
    /// A public key in PEM with whose private one updates are signed; may be repeated. A box whose
    /// image has none is updated by writing its card anew.
    #[arg(long, value_name = "FILE.pub")]
    update_key: Vec<PathBuf>,
    /// With `update`: the private key in PEM to sign it with. Its public one is in the update itself,
    /// so that the next one can follow.
    #[arg(long, value_name = "FILE.key")]
    signing_key: Option<PathBuf>,
    /// Where to [default: target/image/virt, target/image/plumbline-rpi4.img,
    /// target/image/plumbline-board_VERSION_arm64.deb, target/image/plumbline-VERSION-rpi4.plu]
    #[arg(long, value_name = "DIR|FILE")]
    out: Option<PathBuf>,
    /// Write Debian's newest packages into board/image/packages.lock, from which the images are made,
    /// and say what has changed.
    #[arg(long, conflicts_with_all = ["what", "config", "update_key", "signing_key", "out"])]
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
    /// An update of the boxes whose cards this makes, for `plumb update`.
    Update,
}

/// The configuration's name on the settings partition.
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
        What::Update => format!("plumbline-{}-rpi4.plu", debian::VERSION),
    };
    let out = arguments.out.clone().unwrap_or_else(|| directory().join(default));
    // The programs that make the image run in other directories.
    let out = path::absolute(out).context("--out")?;
    output::check(&out, what == What::Virt)?;
    let signing_key = signing_key(what, arguments.signing_key.as_deref())?;
    let mut update_keys = update::public_keys(&arguments.update_key)?;
    update_keys.extend(signing_key.as_ref().map(SigningKey::verifying_key));
    if matches!(what, What::Deb | What::Update) && arguments.config.is_some() {
        bail!(BadInput(
            "--config: a package or an update serves all boxes; leave it out, and copy the configuration to \
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
        What::Virt => virt::make(&Parts::make(&update_keys)?, &provided, &out),
        What::Rpi4 => rpi4::make(&Parts::make(&update_keys)?, &provided, &out),
        What::Deb => make_deb(&out),
        What::Update => {
            let key = signing_key.context("--signing-key")?;
            update::make(&Parts::make(&update_keys)?, &key, &out)
        }
    }
}

/// The key to sign an update with: given for one, and for nothing else.
fn signing_key(what: What, file: Option<&Path>) -> Result<Option<SigningKey>> {
    match (what, file) {
        (What::Update, Some(file)) => update::signing_key(file).map(Some),
        (What::Update, None) => bail!(BadInput(
            "--signing-key: an update must be signed: give the private key whose public one the \
             boxes' cards were made with (--update-key)"
                .into()
        )),
        (_, Some(_)) => bail!(BadInput("--signing-key: only an update is signed".into())),
        (_, None) => Ok(None),
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
    let parts = Parts::make(&[])?;
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
    setup::ensure(&[NEEDS, own_module::NEEDS, fat::NEEDS, rpi4::NEEDS, debian::NEEDS])?;
    DebianRoot::prepare()?;
    Target::Aarch64.prepare()
}

/// Installs what the tests need in addition.
pub fn prepare_for_tests() -> Result<()> {
    // Separately, because a package that cannot be installed beside others would hold up the rest.
    setup::ensure(&[emulated_pi::NEEDS, UNPACKING, LIBCAMERA_NEEDS])?;
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
    pub fn arguments(self) -> Vec<String> {
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
/// | `update.key` | the private key for its updates |
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
    let key = SigningKey::from_bytes(&TEST_SIGNING_KEY);
    let initramfs = initramfs::make(&debian, &program, &[key.verifying_key()])?;
    let parts = Parts { debian, initramfs };
    parts.write_to(&directory)?;
    fs::write(directory.join("update.key"), TEST_SIGNING_KEY)?;
    let debian = &parts.debian;
    rpi4::make(&parts, &Provided::default(), &directory.join("rpi4.img"))?;
    let tree = debian.device_trees()?.join(slot::DEVICE_TREES[0]);
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
    /// Fetches and builds them, for boxes that take updates signed with these keys.
    fn make(update_keys: &[VerifyingKey]) -> Result<Self> {
        prepare()?;
        let debian = DebianRoot::locked()?;
        let program = built(&debian, Profile::Release, Libraries::Inside, BOARD, &[])?;
        let initramfs = initramfs::make(&debian, &program, update_keys)?;
        Ok(Self { debian, initramfs })
    }

    /// Writes kernel and initramfs into a directory.
    fn write_to(&self, directory: &Path) -> Result<()> {
        fs::copy(self.debian.kernel_path()?, directory.join("vmlinuz"))?;
        fs::write(directory.join("initramfs"), &self.initramfs)?;
        Ok(())
    }
}

/// The private key for updates of the boxes in the tests: no secret, and good for nothing else.
const TEST_SIGNING_KEY: [u8; 32] = [7; 32];

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
