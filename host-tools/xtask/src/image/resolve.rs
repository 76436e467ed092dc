//! Which packages Debian has now: apt resolves what depends on what, from lists whose signatures it has
//! checked, for another processor and without installing anything.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

use super::archives::Sources;
use super::debian_root::{COMPONENTS, FIRMWARE_RELEASE, RELEASE};
use super::here::HOSTS;
use super::lock::{BOX, Lock, Package};
use super::own_module;
use crate::command::{Task, target_directory};

/// The keys with which Debian signs its lists.
pub const KEYS: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";

/// The newest versions of these packages, of what they depend on, and of what the box's own kernel module
/// is compiled with for the kernel among them.
pub fn newest(wanted: &[&str]) -> Result<Lock> {
    let directory = target_directory().join("image/apt");
    for name in ["state/lists/partial", "cache/archives/partial"] {
        let path = directory.join(name);
        fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    }
    let write = |name: &str, text: String| {
        let path = directory.join(name);
        fs::write(&path, text).with_context(|| path.display().to_string())
    };
    let sources = Sources::of_this_computer()?;
    write("status", String::new())?;
    write("sources.list", list(&sources))?;
    write("apt.conf", configuration(&directory))?;
    let apt = |arguments: &[&str]| {
        let configuration = directory.join("apt.conf");
        Task::new("apt-get").env("APT_CONFIG", &configuration.to_string_lossy()).args(arguments)
    };
    apt(&["update"]).run()?;
    let date = Task::new("date").args(["-u", "+%Y%m%dT%H%M%SZ"]).output()?.trim().to_owned();
    let install = ["install", "--print-uris", "--yes", "-qq"];
    let packages = packages(&apt(&install).args(wanted).output()?, &sources)?;
    let wanted = wanted.iter().map(|&name| name.to_owned()).collect();
    let mut lock = Lock { date, wanted, packages };
    // Without what they depend on, which is this computer's compiler and much more.
    let alone = own_module::packages(lock.kernel_version()?);
    let download = apt(&["download", "--print-uris", "-qq"]).args(alone).output()?;
    lock.packages.extend(self::packages(&download, &sources)?);
    fs::remove_dir_all(&directory).with_context(|| directory.display().to_string())?;
    Ok(lock)
}

/// apt's list of sources.
fn list(sources: &Sources) -> String {
    // Of the firmware's release nothing but what is not free. Its list of packages is signed like the
    // others, but has a date after which it is to be replaced, by which a mirror may be late.
    let suites = [
        ("debian", RELEASE.to_owned(), COMPONENTS, ""),
        ("debian", format!("{RELEASE}-updates"), COMPONENTS, ""),
        ("debian-security", format!("{RELEASE}-security"), COMPONENTS, ""),
        ("debian", FIRMWARE_RELEASE.to_owned(), "non-free-firmware", " check-valid-until=no"),
    ];
    let line = |(archive, suite, components, option): (&str, String, &str, &str)| {
        let address = sources.archive(archive).unwrap_or_default();
        let components = components.replace(',', " ");
        format!("deb [signed-by={KEYS}{option}] {address} {suite} {components}\n")
    };
    suites.map(line).concat()
}

/// What keeps apt away from the packages of this computer.
fn configuration(directory: &Path) -> String {
    let directory = directory.display();
    let hosts = HOSTS.map(|host| format!("\"{host}\"; ")).concat();
    format!(
        "\
Dir::State \"{directory}/state\";
Dir::State::status \"{directory}/status\";
Dir::Cache \"{directory}/cache\";
Dir::Etc::sourcelist \"{directory}/sources.list\";
Dir::Etc::sourceparts \"/dev/null\";
Dir::Etc::preferences \"/dev/null\";
Dir::Etc::preferencesparts \"/dev/null\";
APT::Architecture \"{BOX}\";
APT::Architectures {{ {hosts}}};
APT::Install-Recommends \"false\";
APT::Sandbox::User \"root\";
APT::Update::Error-Mode \"any\";
Acquire::Languages \"none\";
Acquire::ForceHash \"SHA256\";
pkgCacheGen::ForceEssential \",\";
"
    )
}

/// From apt's lines: `'address' name_version_architecture.deb bytes SHA256:sum`.
fn packages(lines: &str, sources: &Sources) -> Result<BTreeMap<String, Package>> {
    let mut packages = BTreeMap::new();
    for line in lines.lines().filter(|line| line.starts_with('\'')) {
        let package = package(line, sources).with_context(|| format!("apt-get's line {line:?}"))?;
        packages.insert(package.key(), package);
    }
    if packages.is_empty() {
        bail!("apt-get names no package");
    }
    Ok(packages)
}

fn package(line: &str, sources: &Sources) -> Result<Package> {
    let words: Vec<&str> = line.split(' ').collect();
    let [address, file, bytes, sum] = words[..] else { bail!("four words are expected") };
    let place = sources.place(address.trim_matches('\'')).context("another address")?;
    let parts: Vec<&str> = file.strip_suffix(".deb").context("no package")?.split('_').collect();
    let [name, version, architecture] = parts[..] else {
        bail!("three parts of a name are expected")
    };
    Ok(Package {
        name: name.to_owned(),
        // Of what is escaped in a file's name, a version can contain only this.
        version: version.replace("%3a", ":"),
        architecture: architecture.to_owned(),
        bytes: bytes.parse()?,
        sha256: sum.strip_prefix("SHA256:").context("another kind of checksum")?.to_owned(),
        place,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn apts_lines_are_read() {
        let sum = "cb".repeat(32);
        let sources = Sources::of_this_computer().unwrap();
        let address = sources.archive("debian").unwrap();
        let line = format!(
            "'{address}pool/main/a/attr/libattr1_2.5.2-3_arm64.deb' \
             libattr1_1%3a2.5.2-3_arm64.deb 22664 SHA256:{sum}"
        );
        let found = packages(&format!("Reading lists\n{line}\n"), &sources).unwrap();
        let package = Package {
            name: "libattr1".into(),
            version: "1:2.5.2-3".into(),
            architecture: "arm64".into(),
            bytes: 22664,
            sha256: sum.clone(),
            place: "debian/pool/main/a/attr/libattr1_2.5.2-3_arm64.deb".into(),
        };
        assert_eq!(found, BTreeMap::from([("libattr1".to_owned(), package)]));
        assert!(packages("nothing", &sources).is_err());
        for (from, to) in [("SHA256", "MD5Sum"), (address, "http://elsewhere/"), (".deb ", ".rpm ")]
        {
            let error = format!("{:#}", packages(&line.replace(from, to), &sources).unwrap_err());
            assert!(error.contains("apt-get's line"), "{error}");
        }
    }

    #[test]
    fn the_lists_are_debians_own_and_signed() {
        let list = list(&Sources::of_this_computer().unwrap());
        assert_eq!(list.lines().count(), 4);
        for line in list.lines() {
            assert!(line.contains(KEYS) && line.ends_with(" non-free-firmware"), "{line}");
            assert_eq!(line.contains(" main "), line.contains(RELEASE), "{line}");
        }
    }
}
