//! Which packages Debian has now: apt resolves what depends on what, from lists whose signatures it has
//! checked, for another processor and without installing anything.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

use super::lock::{Lock, Package};
use crate::command::{Task, target_directory};

/// The keys with which Debian signs its lists.
pub const KEYS: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";

/// Where Debian's archives are; the places in a lock are below it.
pub const DEBIAN: &str = "http://deb.debian.org/";

/// The newest versions of these packages and of what they depend on.
pub fn newest(
    release: &str,
    components: &str,
    architecture: &str,
    wanted: &[&str],
) -> Result<Lock> {
    let directory = target_directory().join("image/apt");
    for name in ["state/lists/partial", "cache/archives/partial"] {
        let path = directory.join(name);
        fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    }
    let write = |name: &str, text: String| {
        let path = directory.join(name);
        fs::write(&path, text).with_context(|| path.display().to_string())
    };
    write("status", String::new())?;
    write("sources.list", sources(release, components))?;
    write("apt.conf", configuration(&directory, architecture))?;
    let apt = |arguments: &[&str]| {
        let configuration = directory.join("apt.conf");
        Task::new("apt-get").env("APT_CONFIG", &configuration.to_string_lossy()).args(arguments)
    };
    apt(&["update"]).run()?;
    let date = Task::new("date").args(["-u", "+%Y%m%dT%H%M%SZ"]).output()?.trim().to_owned();
    let install = ["install", "--print-uris", "--yes", "-qq"];
    let packages = packages(&apt(&install).args(wanted).output()?)?;
    fs::remove_dir_all(&directory).with_context(|| directory.display().to_string())?;
    let wanted = wanted.iter().map(|&name| name.to_owned()).collect();
    Ok(Lock { date, wanted, packages })
}

fn sources(release: &str, components: &str) -> String {
    let suites = [
        ("debian", release.to_owned()),
        ("debian", format!("{release}-updates")),
        ("debian-security", format!("{release}-security")),
    ];
    let line = |(archive, suite): (&str, String)| {
        format!(
            "deb [signed-by={KEYS}] {DEBIAN}{archive} {suite} {}\n",
            components.replace(',', " ")
        )
    };
    suites.map(line).concat()
}

/// What keeps apt away from the packages of this computer.
fn configuration(directory: &Path, architecture: &str) -> String {
    let directory = directory.display();
    format!(
        "\
Dir::State \"{directory}/state\";
Dir::State::status \"{directory}/status\";
Dir::Cache \"{directory}/cache\";
Dir::Etc::sourcelist \"{directory}/sources.list\";
Dir::Etc::sourceparts \"/dev/null\";
Dir::Etc::preferences \"/dev/null\";
Dir::Etc::preferencesparts \"/dev/null\";
APT::Architecture \"{architecture}\";
APT::Architectures {{ \"{architecture}\"; }};
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
fn packages(lines: &str) -> Result<BTreeMap<String, Package>> {
    let mut packages = BTreeMap::new();
    for line in lines.lines().filter(|line| line.starts_with('\'')) {
        let package = package(line).with_context(|| format!("apt-get's line {line:?}"))?;
        packages.insert(package.name.clone(), package);
    }
    if packages.is_empty() {
        bail!("apt-get names no package");
    }
    Ok(packages)
}

fn package(line: &str) -> Result<Package> {
    let words: Vec<&str> = line.split(' ').collect();
    let [address, file, bytes, sum] = words[..] else { bail!("four words are expected") };
    let place = address.trim_matches('\'').strip_prefix(DEBIAN).context("another address")?;
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
        place: place.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn apts_lines_are_read() {
        let sum = "cb".repeat(32);
        let line = format!(
            "'http://deb.debian.org/debian/pool/main/a/attr/libattr1_2.5.2-3_arm64.deb' \
             libattr1_1%3a2.5.2-3_arm64.deb 22664 SHA256:{sum}"
        );
        let found = packages(&format!("Reading lists\n{line}\n")).unwrap();
        let package = Package {
            name: "libattr1".into(),
            version: "1:2.5.2-3".into(),
            architecture: "arm64".into(),
            bytes: 22664,
            sha256: sum.clone(),
            place: "debian/pool/main/a/attr/libattr1_2.5.2-3_arm64.deb".into(),
        };
        assert_eq!(found, BTreeMap::from([("libattr1".to_owned(), package)]));
        assert!(packages("nothing").is_err());
        for (from, to) in
            [("SHA256", "MD5Sum"), ("deb.debian.org", "elsewhere"), (".deb ", ".rpm ")]
        {
            let error = format!("{:#}", packages(&line.replace(from, to)).unwrap_err());
            assert!(error.contains("apt-get's line"), "{error}");
        }
    }

    #[test]
    fn the_lists_are_debians_own_and_signed() {
        let sources = sources("trixie", "main,non-free-firmware");
        assert_eq!(sources.lines().count(), 3);
        for line in sources.lines() {
            assert!(line.contains(KEYS) && line.ends_with(" main non-free-firmware"), "{line}");
        }
    }
}
