//! `cargo xtask dist`: makes what people download, each with its list of components, and the sums.
//!
//! ```text
//! plumb, for each platform ─┬─▶ archive: pages for man, completions, licences
//! plumbline-board, Linux ───┴─▶ Debian package
//! the Python package, for each platform ─▶ wheel
//! cargo xtask image ─▶ the box's SD card, the box's Debian package
//! all of these ─▶ NAME.cdx.json, SHA256SUMS
//! ```
//!
//! The same commit gives the same bytes, wherever it is built, by the same compilers: Debian's packages
//! are those of a lock file, every date is the commit's, and no path, name or time of this computer is
//! in them.
//! `--check` proves it.

mod check;
mod deb;
mod host;
mod linked;
mod macos;
mod platform;
mod sbom;
mod tree;
mod used;

use std::collections::BTreeMap;
use std::fs;
use std::path::{self, Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;

use crate::command::{BadInput, Task, root, target_directory, word};
use crate::commit::Commit;
use crate::cross::{self, Target};
use crate::{debian, image, setup, sums, toolchain};
use host::Programs;
use image::Profile;
use platform::{Builder, Platform};
use sbom::Contents;
pub use used::{
    VARIABLE, WINE_VARIABLE, make_for_tests, make_wine, prepare_for_tests, use_in_debian,
};

/// The arguments of `cargo xtask dist`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask dist                                  # everything
  cargo xtask dist linux-x86-64 wheel               # an archive, and every wheel
  cargo xtask dist --leave-out macos-aarch64        # everything else
  cargo xtask dist deb-amd64 --check                # twice, in two directories, compared")]
pub struct Arguments {
    /// What to make; everything when left out.
    #[arg(value_enum)]
    what: Vec<What>,
    /// Where to [default: target/dist]. Other files there stay, and are in SHA256SUMS too.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do without this; may be repeated. What cannot be made is an error otherwise.
    #[arg(long, value_enum, value_name = "WHAT")]
    leave_out: Vec<What>,
    /// Pack the programs of the tests, for this computer alone: to try the packing, not to be given
    /// away.
    #[arg(long, conflicts_with = "check")]
    tried: bool,
    /// Build with a version of Rust that is not the pinned one: what is made has other bytes.
    #[arg(long)]
    other_rust: bool,
    /// Make it a second time, from a clone of the commit in another directory, and compare.
    #[arg(long)]
    check: bool,
}

/// What can be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum What {
    /// The host's programs for Linux on x86-64, an archive.
    #[value(name = "linux-x86-64")]
    LinuxX86_64,
    /// The same on 64-bit ARM.
    LinuxAarch64,
    /// `plumb` for Windows on x86-64, an archive.
    #[value(name = "windows-x86-64")]
    WindowsX86_64,
    /// `plumb` for macOS on Apple's processors, an archive; nobody has run it.
    MacosAarch64,
    /// The same on Intel's.
    #[value(name = "macos-x86-64")]
    MacosX86_64,
    /// Both Debian packages of the host.
    Deb,
    /// The one for x86-64.
    DebAmd64,
    /// The one for 64-bit ARM.
    DebArm64,
    /// Every wheel of the Python package.
    Wheel,
    /// The one for Linux on x86-64.
    #[value(name = "wheel-linux-x86-64")]
    WheelLinuxX86_64,
    /// The one for Linux on 64-bit ARM.
    WheelLinuxAarch64,
    /// The one for Windows on x86-64.
    #[value(name = "wheel-windows-x86-64")]
    WheelWindowsX86_64,
    /// What is for the box: its SD card and its package.
    Box,
    /// The image of the box's SD card, for a Raspberry Pi 4.
    BoxCard,
    /// The Debian package of the box's program with libcamera, for arm64.
    BoxDeb,
}

impl What {
    /// All that is made, in this order.
    const EVERYTHING: [Self; 12] = [
        Self::LinuxX86_64,
        Self::DebAmd64,
        Self::WheelLinuxX86_64,
        Self::WindowsX86_64,
        Self::WheelWindowsX86_64,
        Self::LinuxAarch64,
        Self::DebArm64,
        Self::WheelLinuxAarch64,
        Self::BoxCard,
        Self::BoxDeb,
        Self::MacosAarch64,
        Self::MacosX86_64,
    ];

    /// What a name for several stands for.
    const fn parts(&self) -> &[Self] {
        match self {
            Self::Deb => &[Self::DebAmd64, Self::DebArm64],
            Self::Wheel => {
                &[Self::WheelLinuxX86_64, Self::WheelWindowsX86_64, Self::WheelLinuxAarch64]
            }
            Self::Box => &[Self::BoxCard, Self::BoxDeb],
            one => std::slice::from_ref(one),
        }
    }

    /// What it is made for; the box has its own way.
    const fn platform(self) -> Option<Platform> {
        Some(match self {
            Self::LinuxX86_64 | Self::DebAmd64 | Self::WheelLinuxX86_64 => Platform::LinuxX86_64,
            Self::LinuxAarch64 | Self::DebArm64 | Self::WheelLinuxAarch64 => Platform::LinuxAarch64,
            Self::WindowsX86_64 | Self::WheelWindowsX86_64 => Platform::WindowsX86_64,
            Self::MacosAarch64 => Platform::MacosAarch64,
            Self::MacosX86_64 => Platform::MacosX86_64,
            Self::Deb | Self::Wheel | Self::Box | Self::BoxCard | Self::BoxDeb => return None,
        })
    }

    /// Whether it has the host's programs in it.
    const fn has_programs(self) -> bool {
        !matches!(self, Self::WheelLinuxX86_64 | Self::WheelLinuxAarch64 | Self::WheelWindowsX86_64)
            && self.platform().is_some()
    }
}

/// The wanted things, each once, in the order in which they are made.
fn chosen(what: &[What], left_out: &[What]) -> Vec<What> {
    let is_in = |list: &[What], it: &What| list.iter().any(|one| one.parts().contains(it));
    let is_wanted = |it: &What| (what.is_empty() || is_in(what, it)) && !is_in(left_out, it);
    What::EVERYTHING.into_iter().filter(is_wanted).collect()
}

/// What they cost the first time, in minutes of two cores and megabytes below the target directory,
/// rounded from what was measured.
fn cost(wanted: &[What]) -> (u64, u64) {
    let platforms = |has: &dyn Fn(What) -> bool| -> u64 {
        let mut all: Vec<_> =
            wanted.iter().filter(|it| has(**it)).map(|it| it.platform()).collect();
        all.sort_unstable();
        all.dedup();
        all.len() as u64
    };
    let programs = platforms(&What::has_programs);
    let wheels = platforms(&|it| it.platform().is_some() && !it.has_programs());
    let images = wanted.iter().filter(|it| it.platform().is_none()).count() as u64;
    (
        2 + 9 * programs + 4 * wheels + 3 * images,
        600 + 1300 * programs + 700 * wheels + 900 * images,
    )
}

/// Makes what is wanted.
pub fn run(arguments: &Arguments) -> Result<()> {
    let out = arguments.out.clone().unwrap_or_else(|| target_directory().join("dist"));
    let out = path::absolute(out).context("--out")?;
    if out.exists() && !out.is_dir() {
        let out = out.display();
        bail!(BadInput(format!("--out: {out} is a file; give another name for a directory")));
    }
    for place in [root(), &target_directory()] {
        if place.to_string_lossy().contains(char::is_whitespace) {
            let place = place.display();
            bail!(BadInput(format!(
                "{place}: the compilers cannot be told of paths with spaces; move the checkout, or \
                 name another directory with CARGO_TARGET_DIR"
            )));
        }
    }
    let wanted = chosen(&arguments.what, &arguments.leave_out);
    if wanted.is_empty() {
        bail!(BadInput("--leave-out: nothing is left to be made".into()));
    }
    toolchain::settle()?;
    if let Some(notice) = toolchain::notice() {
        if !arguments.tried && !arguments.other_rust {
            bail!(BadInput(format!("{notice} --other-rust does with the one that is here.")));
        }
        println!("{notice}");
    }
    let commit = Commit::read()?;
    if commit.is_changed {
        if arguments.check {
            bail!(BadInput("--check: files differ from the commit; commit them first".into()));
        }
        println!("Files differ from the commit: what is made is not what the commit would give.");
    }
    say_beforehand(&wanted, &arguments.leave_out, arguments.check)?;
    let programs = if arguments.tried { Profile::Dev } else { Profile::Release };
    make_from(&commit, &wanted, &out, programs)?;
    if arguments.check {
        let words: Vec<String> = wanted.iter().map(word).collect();
        check::again(&words, &out, &commit)?;
    }
    Ok(())
}

/// Makes these things of the commit that is checked out, as [`run`] does.
fn make(wanted: &[What], out: &Path) -> Result<()> {
    make_from(&Commit::read()?, wanted, out, Profile::Release)
}

fn make_from(commit: &Commit, wanted: &[What], out: &Path, profile: Profile) -> Result<()> {
    fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let mut making = Making { out, commit, profile, built: BTreeMap::new() };
    let mut failures = Vec::new();
    for &what in wanted {
        let begun = Instant::now();
        println!("\n== {}", word(&what));
        match making.make(what) {
            Ok(file) => println!("{file}: made in {} s", begun.elapsed().as_secs()),
            Err(error) => {
                println!("{}: {error:#}", word(&what));
                failures.push((what, error));
            }
        }
    }
    sums::write(out)?;
    println!("\n{}:", out.display());
    print!("{}", fs::read_to_string(out.join(sums::NAME))?);
    let Some((first, error)) = failures.into_iter().next() else { return Ok(()) };
    // The kind of the error decides the exit code.
    let word = word(&first);
    Err(error.context(format!("{word} cannot be made here; --leave-out {word} does without")))
}

fn say_beforehand(wanted: &[What], left_out: &[What], twice: bool) -> Result<()> {
    let words = |list: &[What]| list.iter().map(word).collect::<Vec<_>>().join(", ");
    println!("To be made: {}", words(wanted));
    if !left_out.is_empty() {
        println!("Left out: {}", words(left_out));
    }
    let times = if twice { 2 } else { 1 };
    let (minutes, megabytes) = cost(wanted);
    let (minutes, megabytes) = (minutes * times, megabytes * times);
    println!(
        "The first time this takes about {minutes} minutes on two quiet cores, {megabytes} MB of disk \
         below {}, and a download of some 150 MB (the box's things: 400 MB more).",
        target_directory().display()
    );
    setup::ensure_disk(&target_directory(), megabytes)
}

/// What has been built so far, and where it goes.
struct Making<'a> {
    out: &'a Path,
    commit: &'a Commit,
    profile: Profile,
    built: BTreeMap<Platform, Programs>,
}

impl Making<'_> {
    /// Makes one thing and its list of components; returns its file's name.
    fn make(&mut self, what: What) -> Result<String> {
        match what.platform() {
            None => self.make_for_box(what),
            Some(platform) => {
                let builder = platform.builder(self.commit, self.profile)?;
                if what.has_programs() {
                    self.make_host(what, &builder)
                } else {
                    self.make_wheel(&builder)
                }
            }
        }
    }

    fn make_host(&mut self, what: What, builder: &Builder) -> Result<String> {
        let platform = builder.platform;
        if !self.built.contains_key(&platform) {
            let manual = self.manual(builder)?;
            self.built.insert(platform, Programs::build(builder, &manual)?);
        }
        let programs = &self.built[&platform];
        let name = if matches!(what, What::DebAmd64 | What::DebArm64) {
            let name = deb::name(platform.debian());
            setup::ensure(&[debian::NEEDS])?;
            deb::make(builder, programs, self.commit, &self.out.join(&name))?;
            name
        } else {
            let top = format!("plumb-{}-{}", debian::VERSION, platform.name());
            let bytes = programs.to_archive(platform, &top, self.commit.seconds)?;
            let ending = if platform.is_windows() { "zip" } else { "tar.gz" };
            let name = format!("{top}.{ending}");
            fs::write(self.out.join(&name), bytes)?;
            name
        };
        self.list(&name, &programs.contents)?;
        Ok(name)
    }

    fn make_wheel(&self, builder: &Builder) -> Result<String> {
        let folder = platform::work().join("wheels").join(builder.platform.name());
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        builder.wheel(&folder)?;
        let made = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
        let made = made.collect::<Result<Vec<_>, _>>()?;
        let [wheel] = &made[..] else { bail!("maturin made {} wheels instead of one", made.len()) };
        let name = wheel.file_name().to_string_lossy().into_owned();
        fs::copy(wheel.path(), self.out.join(&name))?;
        let triple = builder.platform.triple();
        let contents = Contents::of_crates("plumbline-python", triple, &[])?
            .with_standard_library(&builder.compiler_version()?);
        self.list(&name, &contents)?;
        Ok(name)
    }

    fn make_for_box(&self, what: What) -> Result<String> {
        if what == What::BoxDeb {
            let name = format!("plumbline-board_{}_arm64.deb", debian::VERSION);
            image::make_deb(&self.out.join(&name))?;
            self.list(&name, &Self::contents_for_box(&["libcamera"])?)?;
            return Ok(name);
        }
        let name = format!("plumbline-box-{}-rpi4.img.xz", debian::VERSION);
        let card = platform::work().join("plumbline-rpi4.img");
        fs::create_dir_all(platform::work())?;
        let packages = image::make_card(&card)?;
        // One thread: the output depends on whether there are more.
        let packed = Task::new("xz").args(["--threads=1", "--stdout", "-6"]).args([&card]);
        fs::write(self.out.join(&name), packed.output_bytes()?)?;
        fs::remove_file(&card)?;
        self.list(&name, &Self::contents_for_box(&[])?.with_debian_packages(&packages))?;
        Ok(name)
    }

    /// What is in the box's program.
    fn contents_for_box(features: &[&str]) -> Result<Contents> {
        let triple = Platform::LinuxAarch64.triple();
        let library = linked::packages(cross::AARCH64_GCC, &["libgcc.a"])?;
        let contents = Contents::of_crates("plumbline-board", triple, features)?;
        let version = Target::Aarch64.toolchain()?.compiler_version()?;
        Ok(contents.with_standard_library(&version).with_linked(&library))
    }

    /// The directory with the pages and completions, written by the program of this computer.
    fn manual(&self, builder: &Builder) -> Result<PathBuf> {
        let manual = platform::work().join("manual");
        if self.built.is_empty() {
            let plumb = if builder.platform.is_here() {
                builder.plumb()?
            } else {
                // With the profile of the checks, whose dependencies may be there.
                plumbline_test_support::program("plumb").map_err(|error| anyhow::anyhow!(error))?
            };
            host::write_manual(&plumb, &manual)?;
        }
        Ok(manual)
    }

    /// Writes the list of components of a file that was made.
    fn list(&self, name: &str, contents: &Contents) -> Result<()> {
        let path = self.out.join(name);
        let bytes = fs::read(&path).with_context(|| path.display().to_string())?;
        let list = contents.to_json(name, debian::VERSION, &bytes, self.commit)?;
        fs::write(self.out.join(format!("{name}.cdx.json")), list)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_for_several_things_stand_for_each_of_them() {
        assert_eq!(chosen(&[], &[]), What::EVERYTHING);
        let wheels = [What::WheelLinuxX86_64, What::WheelWindowsX86_64, What::WheelLinuxAarch64];
        assert_eq!(chosen(&[What::Wheel, What::WheelLinuxX86_64], &[]), wheels);
        assert_eq!(chosen(&[What::Deb], &[What::DebArm64]), [What::DebAmd64]);
        assert!(chosen(&[What::Box], &[What::Box]).is_empty());
    }

    #[test]
    fn the_cost_counts_what_is_built_once() {
        let (one, _) = cost(&[What::LinuxX86_64]);
        assert_eq!(cost(&[What::LinuxX86_64, What::DebAmd64]).0, one);
        assert!(cost(&What::EVERYTHING).0 > 3 * one);
    }
}
