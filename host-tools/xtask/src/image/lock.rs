//! Which Debian packages the images are made of: `board/image/packages.lock`.
//!
//! Debian replaces packages several times a year. The file names each one by its version and checksum,
//! so that the same commit gives the same images, and a commit shows when one was replaced.
//!
//! ```text
//! date 20260131T120000Z
//! wanted linux-image-arm64 busybox-static ...
//! busybox-static 1:1.37.0-6+b3 arm64 944884 e3b0c4... debian/pool/main/b/busybox/busybox-static_....deb
//! ```
//!
//! A package's line has its name, version, architecture, size in bytes, SHA-256, and its place below
//! Debian's archive, as an address.
//!
//! Most are of the box's architecture or of all. Those of another are for the computer on which the
//! images are made ([`own_module`]); such a computer may have the box's architecture as well.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};

use super::own_module;
use crate::command::root;

/// The file, relative to the root of the checkout.
pub const PLACE: &str = "board/image/packages.lock";

/// What writes it.
pub const UPDATE: &str = "cargo xtask image --update-lock";

const HEADER: &str = "\
# Debian's packages of which the box's images are made: name, version, architecture, bytes, SHA-256,
# and the place below Debian's archive. Written by `cargo xtask image --update-lock`.
";

/// Debian's archives: a package's place begins with the name of one.
pub const ARCHIVES: [&str; 2] = ["debian", "debian-security"];

/// The architecture of the box.
pub const BOX: &str = "arm64";

/// The packages, by [`Package::key`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lock {
    /// When Debian had all of them, as <http://snapshot.debian.org/> writes it.
    pub date: String,
    /// The packages that were asked for; the others are those that they depend on, and those of
    /// [`own_module::packages`].
    pub wanted: Vec<String>,
    pub packages: BTreeMap<String, Package>,
}

/// A package of one version.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Package {
    pub name: String,
    pub version: String,
    pub architecture: String,
    pub bytes: u64,
    pub sha256: String,
    /// `debian/pool/...` or `debian-security/pool/...`, escaped as in an address.
    pub place: String,
}

impl Lock {
    /// Where it is.
    pub fn path() -> PathBuf {
        root().join(PLACE)
    }

    /// Reads the checkout's; an error unless it is of the `wanted` packages.
    pub fn read(wanted: &[&str]) -> Result<Self> {
        let path = Self::path();
        let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let lock = Self::parse(&text)?;
        ensure!(
            lock.wanted == wanted,
            "{PLACE} is of {:?}, and the images are made of {wanted:?}: run `{UPDATE}`",
            lock.wanted
        );
        for package in own_module::packages(lock.kernel_version()?) {
            lock.package(&package)?;
        }
        Ok(lock)
    }

    /// Reads a text that [`Self::to_text`] wrote.
    pub fn parse(text: &str) -> Result<Self> {
        let mut lock = Self { date: String::new(), wanted: Vec::new(), packages: BTreeMap::new() };
        for (number, line) in (1..).zip(text.lines()) {
            if line.starts_with('#') || line.trim().is_empty() {
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["date", date] => lock.date = date.to_owned(),
                ["wanted", ref wanted @ ..] => {
                    lock.wanted = wanted.iter().map(|&name| name.to_owned()).collect();
                }
                _ => {
                    let package = Package::parse(&words)
                        .with_context(|| format!("{PLACE}, line {number}: run `{UPDATE}`"))?;
                    lock.packages.insert(package.key(), package);
                }
            }
        }
        ensure!(
            !lock.date.is_empty() && !lock.wanted.is_empty() && !lock.packages.is_empty(),
            "{PLACE} lacks its date, what is wanted, or packages: run `{UPDATE}`"
        );
        Ok(lock)
    }

    /// The file's text.
    pub fn to_text(&self) -> String {
        let mut text = format!("{HEADER}date {}\nwanted {}\n", self.date, self.wanted.join(" "));
        for Package { name, version, architecture, bytes, sha256, place } in self.packages.values()
        {
            let _ = writeln!(text, "{name} {version} {architecture} {bytes} {sha256} {place}");
        }
        text
    }

    /// The package of this [key](Package::key).
    pub fn package(&self, key: &str) -> Result<&Package> {
        self.packages.get(key).with_context(|| format!("{key} is not in {PLACE}: run `{UPDATE}`"))
    }

    /// The version of the kernel in it: `6.12.118+deb13-arm64`.
    pub fn kernel_version(&self) -> Result<&str> {
        // The package without a version in its name depends on the newest one.
        let is_version = |name: &&str| name.starts_with(|first: char| first.is_ascii_digit());
        let names = self.packages.keys().filter_map(|key| key.strip_prefix("linux-image-"));
        let versions: Vec<&str> = names.filter(is_version).collect();
        let [version] = versions[..] else {
            bail!("{PLACE}: expected one kernel, found {versions:?}: run `{UPDATE}`");
        };
        Ok(version)
    }

    /// The part of it that is of use on a computer of this architecture.
    pub fn for_host(&self, host: &str) -> Self {
        let mut lock = self.clone();
        lock.packages.retain(|_, package| match package.architecture.as_str() {
            "all" => true,
            it if own_module::is_run_here(&package.name) => it == host,
            it => it == BOX || it == host,
        });
        lock
    }

    /// What is different in a newer one, a line for each package.
    pub fn differences(&self, newer: &Self) -> Vec<String> {
        let mut lines = Vec::new();
        for (name, package) in &self.packages {
            match newer.packages.get(name) {
                None => lines.push(format!("{name} {}: no longer needed", package.version)),
                Some(other) if other.version != package.version => {
                    lines.push(format!("{name} {}: now {}", package.version, other.version));
                }
                Some(other) if other.sha256 != package.sha256 => lines.push(format!(
                    "{name} {}: the same version with another checksum, {} and now {}",
                    package.version, package.sha256, other.sha256
                )),
                Some(_) => {}
            }
        }
        let new = newer.packages.iter().filter(|(name, _)| !self.packages.contains_key(*name));
        lines.extend(new.map(|(name, package)| format!("{name} {}: new", package.version)));
        lines
    }
}

impl Package {
    fn parse(words: &[&str]) -> Result<Self> {
        let [name, version, architecture, bytes, sha256, place] = *words else {
            bail!("six words are expected, and there are {}", words.len());
        };
        ensure!(
            sha256.len() == 64 && sha256.bytes().all(|it| it.is_ascii_hexdigit()),
            "{sha256:?} is not a SHA-256"
        );
        let is_inside = place.split_once('/').is_some_and(|(archive, place)| {
            ARCHIVES.contains(&archive) && !place.split('/').any(|it| it == "..")
        });
        ensure!(is_inside && place.ends_with(".deb"), "{place:?} is not the place of a package");
        Ok(Self {
            name: name.to_owned(),
            version: version.to_owned(),
            architecture: architecture.to_owned(),
            bytes: bytes.parse().with_context(|| format!("the size {bytes:?}"))?,
            sha256: sha256.to_owned(),
            place: place.to_owned(),
        })
    }

    /// Its name, and its architecture if the box cannot run it: `libc6`, `libc6:amd64`. dpkg names
    /// packages in this way on the box.
    pub fn key(&self) -> String {
        match self.architecture.as_str() {
            BOX | "all" => self.name.clone(),
            other => format!("{}:{other}", self.name),
        }
    }

    /// The archive that it is in, and its place there.
    pub fn archive_and_place(&self) -> (&str, &str) {
        self.place.split_once('/').unwrap_or(("", &self.place))
    }

    /// The name of its file.
    pub fn file_name(&self) -> &str {
        self.place.rsplit('/').next().unwrap_or(&self.place)
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A lock of packages: name, version, and the digit of which their checksums consist.
    pub fn lock(packages: &[(&str, &str, char)]) -> Lock {
        let package = |&(name, version, digit): &(&str, &str, char)| {
            let place = format!("debian/pool/main/x/{name}/{name}_{version}_arm64.deb");
            let sha256 = digit.to_string().repeat(64);
            let words = [name, version, "arm64", "7", &sha256, &place];
            (name.to_owned(), Package::parse(&words).unwrap())
        };
        Lock {
            date: "20260131T120000Z".into(),
            wanted: vec!["kernel".into()],
            packages: packages.iter().map(package).collect(),
        }
    }

    #[test]
    fn what_was_written_is_read() {
        let lock = lock(&[("kernel", "6.12-1", '1'), ("libc6", "1:2.41-12+deb13u5", '2')]);
        assert_eq!(Lock::parse(&lock.to_text()).unwrap(), lock);
        assert_eq!(lock.packages["libc6"].file_name(), "libc6_1:2.41-12+deb13u5_arm64.deb");
    }

    #[test]
    fn the_lock_of_this_checkout_is_of_what_the_images_are_made_of() {
        let lock = Lock::read(super::super::debian_root::PACKAGES).unwrap();
        let text = fs::read_to_string(Lock::path()).unwrap();
        assert_eq!(lock.to_text(), text, "{PLACE}: run `{UPDATE}`");
        for name in &lock.wanted {
            lock.package(name).unwrap();
        }
        assert!(Lock::read(&["busybox"]).unwrap_err().to_string().contains(UPDATE));
    }

    #[test]
    fn a_computer_gets_the_boxs_packages_and_of_programs_only_those_that_it_can_run() {
        let mut lock = lock(&[
            ("libc6", "1", '1'),
            ("linux-image-arm64", "6", '2'),
            ("linux-image-6.1+2-arm64", "6", '3'),
            ("linux-kbuild-6.1+2", "6", '4'),
        ]);
        for name in ["libc6", "linux-kbuild-6.1+2"] {
            let other = Package { architecture: "amd64".into(), ..lock.packages[name].clone() };
            lock.packages.insert(other.key(), other);
        }
        assert_eq!(Lock::parse(&lock.to_text()).unwrap(), lock);
        assert_eq!(lock.kernel_version().unwrap(), "6.1+2-arm64");
        let left_out = |host: &str| {
            let of_host = lock.for_host(host).packages;
            let left_out = lock.packages.keys().filter(|&it| !of_host.contains_key(it));
            left_out.cloned().collect::<Vec<_>>()
        };
        assert_eq!(left_out("amd64"), ["linux-kbuild-6.1+2"]);
        assert_eq!(left_out("arm64"), ["libc6:amd64", "linux-kbuild-6.1+2:amd64"]);
        lock.packages.remove("linux-image-6.1+2-arm64");
        assert!(lock.kernel_version().is_err());
    }

    #[test]
    fn what_cannot_be_read_is_named_with_its_line() {
        let good = lock(&[("kernel", "6.12-1", '1')]).to_text();
        for (from, to, what) in [
            (" 7 ", " seven ", "the size \"seven\""),
            ("1111", "xxxx", "is not a SHA-256"),
            ("debian/pool", "elsewhere/pool", "is not the place of a package"),
            ("main/x", "main/../x", "is not the place of a package"),
            ("arm64 ", "", "six words are expected, and there are 5"),
        ] {
            let error = format!("{:#}", Lock::parse(&good.replace(from, to)).unwrap_err());
            assert!(error.contains(what) && error.contains("line 5"), "{error}");
            assert!(error.contains(UPDATE), "{error}");
        }
        assert!(Lock::parse("").is_err());
        assert!(Lock::parse(&good.replace("date", "# date")).is_err());
    }

    #[test]
    fn each_difference_is_told() {
        let old = lock(&[("a", "1", '1'), ("b", "1", '1'), ("c", "1", '1'), ("d", "1", '1')]);
        let new = lock(&[("a", "1", '1'), ("b", "2", '2'), ("c", "1", '2'), ("e", "1", '1')]);
        let [one, two] = ["1", "2"].map(|digit| digit.repeat(64));
        let told = [
            "b 1: now 2".to_owned(),
            format!("c 1: the same version with another checksum, {one} and now {two}"),
            "d 1: no longer needed".to_owned(),
            "e 1: new".to_owned(),
        ];
        assert_eq!(old.differences(&new), told);
        assert!(old.differences(&old).is_empty());
    }
}
