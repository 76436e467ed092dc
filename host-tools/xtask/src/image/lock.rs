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
//! <http://deb.debian.org/>, as an address.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};

use crate::command::root;

/// The file, relative to the root of the checkout.
pub const PLACE: &str = "board/image/packages.lock";

/// What writes it.
pub const UPDATE: &str = "cargo xtask image --update-lock";

const HEADER: &str = "\
# Debian's packages of which the box's images are made: name, version, architecture, bytes, SHA-256,
# and the place below http://deb.debian.org/. Written by `cargo xtask image --update-lock`.
";

/// The packages, by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lock {
    /// When Debian had all of them, as <http://snapshot.debian.org/> writes it.
    pub date: String,
    /// The packages that were asked for; the others are those that they depend on.
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
                    lock.packages.insert(package.name.clone(), package);
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

    /// The package of this name.
    pub fn package(&self, name: &str) -> Result<&Package> {
        self.packages.get(name).with_context(|| format!("{name} is not in {PLACE}"))
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
        let new = newer.packages.values().filter(|it| !self.packages.contains_key(&it.name));
        lines.extend(new.map(|package| format!("{} {}: new", package.name, package.version)));
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
        let is_inside = place.starts_with("debian") && !place.split('/').any(|it| it == "..");
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
