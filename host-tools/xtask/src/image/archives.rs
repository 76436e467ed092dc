//! Fetches the packages of a lock: from Debian or, where Debian has replaced one, from its archive of
//! everything that it ever had. Each is compared with its checksum, wherever it came from.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::lock::{ARCHIVES, Lock, PLACE, Package, UPDATE};
use crate::command::Task;
use crate::sums::sha256;

/// apt's program that fetches single files, with its proxies.
pub const FETCHER: &str = "/usr/lib/apt/apt-helper";

/// Where packages are fetched from.
#[derive(Debug)]
pub struct Sources {
    /// What Debian has now: the address of each of the [`ARCHIVES`], with a slash at its end.
    current: [String; ARCHIVES.len()],
    /// What Debian had at a date: `ARCHIVE/DATE/pool/...` is below it.
    snapshots: String,
}

impl Sources {
    /// Those that apt has on this computer, if it is a Debian; else Debian's public ones.
    pub fn of_this_computer() -> Result<Self> {
        let format = "$(ORIGIN) $(LABEL) $(REPO_URI)";
        let told = Task::new("apt-get").args(["indextargets", "--format", format]).output()?;
        Ok(Self {
            current: ARCHIVES.map(|archive| current(&told, archive)),
            snapshots: "http://snapshot.debian.org/archive/".into(),
        })
    }

    /// The address of one of the [`ARCHIVES`].
    pub fn archive(&self, archive: &str) -> Option<&str> {
        self.known().find_map(|(name, address)| (name == archive).then_some(address))
    }

    /// The place of a package with this address.
    pub fn place(&self, address: &str) -> Option<String> {
        self.known().find_map(|(name, own)| Some(format!("{name}/{}", address.strip_prefix(own)?)))
    }

    fn known(&self) -> impl Iterator<Item = (&'static str, &str)> {
        ARCHIVES.into_iter().zip(self.current.iter().map(String::as_str))
    }
}

/// The address of an archive: of those that apt told, the first that calls itself so.
fn current(told: &str, archive: &str) -> String {
    let lists = told.lines().filter_map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        let ["Debian", label, address] = words[..] else { return None };
        (label.eq_ignore_ascii_case(archive) && address.starts_with("http")).then_some(address)
    });
    let own = lists.map(str::to_owned).next();
    own.unwrap_or_else(|| format!("http://deb.debian.org/{archive}/"))
}

/// What a lock names and nobody has any more.
#[derive(Debug, PartialEq, Eq)]
pub struct Gone(Vec<String>);

impl Gone {
    /// The error, with the remedy.
    pub fn into_error(self) -> anyhow::Error {
        anyhow::anyhow!(
            "{PLACE} names packages that Debian no longer has, and its archive (snapshot.debian.org) \
             could not be reached: {}. Run `{UPDATE}`, which says what has changed; then \
             `cargo xtask test boot`, and commit the file",
            self.0.join(", ")
        )
    }
}

/// Fetches the packages into a directory, in which some may already be; returns their files in the
/// lock's order, or what cannot be had. A file with another checksum is an error.
pub fn fetch(
    lock: &Lock,
    directory: &Path,
    sources: &Sources,
) -> Result<std::result::Result<Vec<PathBuf>, Gone>> {
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    let all: Vec<&Package> = lock.packages.values().collect();
    let mut missing = missing(&all, directory)?;
    if !missing.is_empty() {
        let bytes: u64 = missing.iter().map(|package| package.bytes).sum();
        println!("Fetching {} of Debian's packages, {} MB", missing.len(), bytes / 1_000_000);
        let address = |package: &Package| {
            let (archive, place) = package.archive_and_place();
            format!("{}{place}", sources.archive(archive).unwrap_or_default())
        };
        missing = download(missing, directory, address)?;
    }
    // If the archive cannot be reached, it is asked for one package only.
    if let [first, others @ ..] = &missing[..] {
        println!("{} {} is no longer at Debian: looking in its archive", first.name, first.version);
        let address = |package: &Package| {
            let (archive, place) = package.archive_and_place();
            format!("{}{archive}/{}/{place}", sources.snapshots, lock.date)
        };
        let mut left = download(vec![first], directory, address)?;
        if left.is_empty() {
            left = download(others.to_vec(), directory, address)?;
        } else {
            left.extend(others);
        }
        missing = left;
    }
    if !missing.is_empty() {
        let names = missing.iter().map(|it| format!("{} {}", it.name, it.version));
        return Ok(Err(Gone(names.collect())));
    }
    Ok(Ok(all.iter().map(|package| directory.join(package.file_name())).collect()))
}

/// Those whose files are not in the directory. What is there incomplete, or of another version that has
/// the same name, counts as missing.
fn missing<'a>(packages: &[&'a Package], directory: &Path) -> Result<Vec<&'a Package>> {
    let mut missing = Vec::new();
    for &package in packages {
        let file = directory.join(package.file_name());
        if !file.exists() {
            missing.push(package);
        } else if sum(&file)? != package.sha256 {
            fs::remove_file(&file).with_context(|| file.display().to_string())?;
            missing.push(package);
        }
    }
    Ok(missing)
}

/// Has apt download packages; returns those that it did not find.
fn download<'a>(
    packages: Vec<&'a Package>,
    directory: &Path,
    address: impl Fn(&Package) -> String,
) -> Result<Vec<&'a Package>> {
    if packages.is_empty() {
        return Ok(packages);
    }
    let file = |package: &Package| directory.join(package.file_name());
    let mut arguments: Vec<OsString> = ["-oAcquire::http::Timeout=20", "-oAPT::Sandbox::User=root"]
        .map(OsString::from)
        .into_iter()
        .chain(["download-file".into()])
        .collect();
    for package in &packages {
        let sum = format!("SHA256:{}", package.sha256);
        arguments.extend([address(package).into(), file(package).into(), sum.into()]);
    }
    // What it says of a file that is not there is not of interest: the file is not there.
    let (said, _) = Task::new(FETCHER).args(arguments).capture().context(FETCHER)?;
    for package in &packages {
        let refused = directory.join(format!("{}.FAILED", package.file_name()));
        if !refused.exists() {
            continue;
        }
        let found = sum(&refused)?;
        fs::remove_file(&refused).with_context(|| refused.display().to_string())?;
        if found != package.sha256 {
            let Package { name, version, sha256, .. } = package;
            bail!(
                "{}: refused. Its SHA-256 is {found}, and {PLACE} says {sha256} for {name} {version}. \
                 Debian never changes a file of the same name: find out who did before you use it",
                address(package)
            );
        }
    }
    let left = missing(&packages, directory)?;
    if !left.is_empty() {
        let errors = said.lines().filter(|line| line.starts_with("E:"));
        errors.take(5).for_each(|line| println!("{line}"));
    }
    Ok(left)
}

fn sum(file: &Path) -> Result<String> {
    Ok(sha256(&fs::read(file).with_context(|| file.display().to_string())?))
}

#[cfg(test)]
mod tests {
    use plumbline_test_support::{Absent, skip};

    use super::super::lock::tests::lock;
    use super::*;

    /// A Debian in a directory, which apt copies from.
    struct Debian {
        folder: tempfile::TempDir,
    }

    impl Debian {
        /// `None` where there is no apt.
        fn new() -> Option<Self> {
            if !Path::new(FETCHER).exists() {
                skip(Absent::Machine, "there is no apt here");
                return None;
            }
            Some(Self { folder: tempfile::tempdir().unwrap() })
        }

        fn sources(&self) -> Sources {
            let below = |name: &str| format!("copy:{}/{name}/", self.folder.path().display());
            Sources {
                current: ARCHIVES.map(|archive| below(&format!("current/{archive}"))),
                snapshots: below("snapshots"),
            }
        }

        fn put(&self, place: &str, content: &str) {
            let path = self.folder.path().join(place);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }

        fn cache(&self) -> PathBuf {
            self.folder.path().join("cache")
        }
    }

    /// A lock of two packages whose files contain their names.
    fn two() -> Lock {
        let mut lock = lock(&[("kernel", "6.12-1", '1'), ("libc6", "2.41-1", '2')]);
        for package in lock.packages.values_mut() {
            package.sha256 = sha256(package.name.as_bytes());
        }
        lock
    }

    #[test]
    fn the_archives_are_those_of_this_computer_or_debians_public_ones() {
        let told = "\
Debian Backports http://one/debian/
 cloud http://elsewhere/apt/
Raspberry Foundation http://two/debian/
Debian Debian cdrom:[Debian]/
Debian Debian https://near/mirror/
Debian Debian http://far/debian/
";
        assert_eq!(current(told, "debian"), "https://near/mirror/");
        let public = "http://deb.debian.org/debian-security/";
        assert_eq!(current(told, "debian-security"), public);
        let own = "http://near/security/";
        let told = format!("{told}Debian Debian-Security {own}\n");
        assert_eq!(current(&told, "debian-security"), own);
        let sources =
            Sources { current: ARCHIVES.map(|it| current(&told, it)), snapshots: "".into() };
        assert_eq!(
            sources.place("http://near/security/pool/a.deb").unwrap(),
            "debian-security/pool/a.deb"
        );
        assert_eq!(sources.archive("debian-security"), Some(own));
        assert_eq!(sources.place("http://far/debian/pool/a.deb"), None);
    }

    #[test]
    fn packages_come_from_debian_and_what_it_has_replaced_from_its_archive() {
        let (Some(debian), lock) = (Debian::new(), two()) else { return };
        let place = |name: &str| lock.packages[name].place.clone();
        debian.put(&format!("current/{}", place("libc6")), "libc6");
        let gone = fetch(&lock, &debian.cache(), &debian.sources()).unwrap().unwrap_err();
        assert_eq!(gone, Gone(vec!["kernel 6.12-1".into()]));
        let error = gone.into_error().to_string();
        assert!(error.contains("kernel 6.12-1") && error.contains(UPDATE), "{error}");
        let old = place("kernel").replace("debian/", "debian/20260131T120000Z/");
        debian.put(&format!("snapshots/{old}"), "kernel");
        let files = fetch(&lock, &debian.cache(), &debian.sources()).unwrap().unwrap();
        let content = files.iter().map(|file| fs::read_to_string(file).unwrap());
        assert_eq!(content.collect::<Vec<_>>(), ["kernel", "libc6"]);
        // What is there is not fetched again, unless it is damaged.
        fs::remove_dir_all(debian.folder.path().join("current")).unwrap();
        fetch(&lock, &debian.cache(), &debian.sources()).unwrap().unwrap();
        fs::write(&files[1], "lib").unwrap();
        fetch(&lock, &debian.cache(), &debian.sources()).unwrap().unwrap_err();
    }

    #[test]
    fn a_package_with_another_checksum_is_refused() {
        let (Some(debian), lock) = (Debian::new(), two()) else { return };
        for (name, content) in [("kernel", "kernel"), ("libc6", "forged")] {
            debian.put(&format!("current/{}", lock.packages[name].place), content);
        }
        let error = fetch(&lock, &debian.cache(), &debian.sources()).unwrap_err().to_string();
        for part in ["libc6 2.41-1", "refused", &sha256(b"forged"), &sha256(b"libc6"), PLACE] {
            assert!(error.contains(part), "{part}: {error}");
        }
        assert!(!debian.cache().join("libc6_2.41-1_arm64.deb").exists());
    }
}
