//! Lists of components (software bills of materials) in CycloneDX 1.5: what is in a deliverable, from
//! where, by which licence, and what uses what.
//!
//! The crates are those that cargo links into the program for its target, without what only builds or
//! tests it; of each the checksum of the registry. Debian packages are those of which files are on the
//! card, or of which the linker took parts; of each the version and the checksum. The same deliverable
//! gives the same list.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use anyhow::{Context, Result, bail};
use cyclonedx_bom::models::component::Classification;
use cyclonedx_bom::models::dependency::{Dependencies, Dependency};
use cyclonedx_bom::models::hash::{Hash, HashAlgorithm, HashValue, Hashes};
use cyclonedx_bom::models::license::{LicenseChoice, Licenses};
use cyclonedx_bom::models::property::{Properties, Property};
use cyclonedx_bom::models::tool::{Tool, Tools};
use cyclonedx_bom::prelude::{
    Bom, Component, Components, DateTime, Metadata, NormalizedString, Purl, SpecVersion, UrnUuid,
    Validate as _,
};
use toml::{Table, Value};

use super::linked::Installed;
use crate::command::{Task, root};
use crate::commit::Commit;
use crate::image::Package;
use crate::sums::sha256;

/// What is in a deliverable.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Contents {
    parts: BTreeMap<String, Part>,
    uses: BTreeMap<String, BTreeSet<String>>,
}

/// A component: a crate, a Debian package, a package of npm, the standard library.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    kind: &'static str,
    name: String,
    version: String,
    licence: Option<String>,
    sha256: Option<String>,
}

impl Part {
    /// Its address (a package URL), in which some letters have another meaning.
    fn reference(&self) -> String {
        let version = self.version.replace('+', "%2B").replace(':', "%3A");
        format!("pkg:{}/{}@{version}", self.kind, self.name)
    }

    /// What it is in the system.
    fn class(&self) -> Classification {
        match self.name.strip_prefix("debian/") {
            Some(name) if name.starts_with("linux-image-") => Classification::OperatingSystem,
            Some("raspi-firmware") => Classification::Firmware,
            Some("busybox-static") => Classification::Application,
            _ => Classification::Library,
        }
    }
}

impl Contents {
    /// The crates of a program of the workspace, for a target.
    pub fn of_crates(package: &str, triple: &str, features: &[&str]) -> Result<Self> {
        let tree = Task::cargo()
            .args(["tree", "--package", package, "--target", triple])
            .args(["--edges", "normal,no-proc-macro", "--prefix", "depth", "--format", " {p}|{l}"])
            .args(features.iter().flat_map(|feature| ["--features", feature]))
            .output()?;
        let lock = fs::read_to_string(root().join("Cargo.lock")).context("Cargo.lock")?;
        Self::parse(&tree, &checksums(&lock)?)
    }

    /// From the lines of `cargo tree`, and the checksums by name and version.
    fn parse(tree: &str, checksums: &BTreeMap<(String, String), String>) -> Result<Self> {
        let mut contents = Self::default();
        let mut above: Vec<String> = Vec::new();
        for line in tree.lines().filter(|line| !line.is_empty()) {
            let wrong = || format!("cargo tree: {line:?}");
            let (depth, rest) = line.split_once(' ').with_context(wrong)?;
            let depth: usize = depth.parse().with_context(wrong)?;
            let (package, licence) = rest.split_once('|').with_context(wrong)?;
            let mut words = package.split(' ');
            let name = words.next().with_context(wrong)?.to_owned();
            let version = words.next().and_then(|it| it.strip_prefix('v')).with_context(wrong)?;
            let version = version.to_owned();
            let licence = licence.trim_end_matches("(*)").trim().replace('/', " OR ");
            let sha256 = checksums.get(&(name.clone(), version.clone())).cloned();
            let licence = (!licence.is_empty()).then_some(licence);
            let reference = contents.add(Part { kind: "cargo", name, version, licence, sha256 });
            above.truncate(depth);
            if let Some(user) = above.last() {
                contents.uses.entry(user.clone()).or_default().insert(reference.clone());
            }
            above.push(reference);
        }
        if contents.parts.is_empty() {
            bail!("cargo tree names no crate");
        }
        Ok(contents)
    }

    /// Adds Rust's standard library of a compiler.
    pub fn with_standard_library(mut self, version: &str) -> Self {
        self.add(Part {
            kind: "generic",
            name: "rust-std".to_owned(),
            version: version.to_owned(),
            licence: Some("MIT OR Apache-2.0".to_owned()),
            sha256: None,
        });
        self
    }

    /// Adds Debian packages of which parts are in it.
    pub fn with_debian_packages(self, packages: &[Package]) -> Self {
        packages.iter().fold(self, |contents, package| {
            contents.with_debian(&package.name, &package.version, Some(package.sha256.clone()))
        })
    }

    /// Adds Debian packages of this computer, of which the linker took parts.
    pub fn with_linked(self, packages: &[Installed]) -> Self {
        packages.iter().fold(self, |contents, package| {
            contents.with_debian(&package.name, &package.version, package.sha256.clone())
        })
    }

    fn with_debian(mut self, name: &str, version: &str, sha256: Option<String>) -> Self {
        self.add(Part {
            kind: "deb",
            name: format!("debian/{name}"),
            version: version.to_owned(),
            licence: None,
            sha256,
        });
        self
    }

    /// Adds a file of a package of npm.
    pub fn with_npm_package(mut self, name: &str, version: &str, licence: &str, sum: &str) -> Self {
        self.add(Part {
            kind: "npm",
            name: name.to_owned(),
            version: version.to_owned(),
            licence: Some(licence.to_owned()),
            sha256: Some(sum.to_owned()),
        });
        self
    }

    /// Both together.
    pub fn and(mut self, other: Self) -> Self {
        self.parts.extend(other.parts);
        for (user, used) in other.uses {
            self.uses.entry(user).or_default().extend(used);
        }
        self
    }

    fn add(&mut self, part: Part) -> String {
        let reference = part.reference();
        self.parts.insert(reference.clone(), part);
        reference
    }

    /// The list for the deliverable of this name and these bytes.
    pub fn to_json(
        &self,
        name: &str,
        version: &str,
        bytes: &[u8],
        commit: &Commit,
    ) -> Result<Vec<u8>> {
        let sum = sha256(bytes);
        let mut own = Component::new(Classification::Application, name, version, Some(name.into()));
        own.hashes = Some(hashes(&sum));
        own.licenses = Some(licences("MIT OR Apache-2.0"));
        let mut components = Vec::new();
        for (reference, part) in &self.parts {
            let class = part.class();
            let mut it = Component::new(class, &part.name, &part.version, Some(reference.clone()));
            it.purl = Some(purl(part)?);
            it.licenses = part.licence.as_deref().map(licences);
            it.hashes = part.sha256.as_deref().map(hashes);
            components.push(it);
        }
        let used: BTreeSet<&String> = self.uses.values().flatten().collect();
        let roots = self.parts.keys().filter(|it| !used.contains(it)).cloned().collect();
        let mut dependencies = vec![dependency(name, roots)];
        for reference in self.parts.keys() {
            let used = self.uses.get(reference).into_iter().flatten().cloned().collect();
            dependencies.push(dependency(reference, used));
        }
        let tool = Tool {
            vendor: None,
            name: Some(NormalizedString::new("cargo xtask dist")),
            version: Some(NormalizedString::new(env!("CARGO_PKG_VERSION"))),
            hashes: None,
            external_references: None,
        };
        let metadata = Metadata {
            timestamp: Some(DateTime::try_from(commit.time.clone()).context("the commit's time")?),
            tools: Some(Tools::List(vec![tool])),
            component: Some(own),
            properties: Some(Properties(vec![Property::new("plumbline:commit", &commit.id)])),
            ..Metadata::default()
        };
        let bom = Bom {
            version: 1,
            serial_number: UrnUuid::new(uuid(&sum)).ok(),
            metadata: Some(metadata),
            components: Some(Components(components)),
            dependencies: Some(Dependencies(dependencies)),
            spec_version: SpecVersion::V1_5,
            ..Bom::default()
        };
        let verdict = bom.validate_version(SpecVersion::V1_5);
        if verdict.has_errors() {
            bail!("{name}: its list of components is not CycloneDX: {verdict:?}");
        }
        let mut json = Vec::new();
        bom.output_as_json(&mut json, SpecVersion::V1_5)?;
        json.push(b'\n');
        Ok(json)
    }
}

fn purl(part: &Part) -> Result<Purl> {
    // Debian's have their distribution as a name space, which the crate's own constructor escapes.
    part.reference().parse().map_err(|()| anyhow::anyhow!("no address for {}", part.name))
}

fn dependency(user: &str, used: Vec<String>) -> Dependency {
    Dependency { dependency_ref: user.to_owned(), dependencies: used }
}

fn hashes(sum: &str) -> Hashes {
    let content = HashValue(sum.to_owned());
    Hashes(vec![Hash { alg: HashAlgorithm::SHA_256, content }])
}

fn licences(expression: &str) -> Licenses {
    Licenses(vec![LicenseChoice::expression(expression)])
}

/// A UUID of the kind that an application computes in its own way (version 8), from a SHA-256.
fn uuid(sum: &str) -> String {
    let [a, b, c, d, e] = [&sum[..8], &sum[8..12], &sum[13..16], &sum[17..20], &sum[20..32]];
    format!("urn:uuid:{a}-{b}-8{c}-a{d}-{e}")
}

/// The registry's checksums in Cargo.lock, by name and version.
fn checksums(lock: &str) -> Result<BTreeMap<(String, String), String>> {
    let lock: Table = lock.parse().context("Cargo.lock")?;
    let packages =
        lock.get("package").and_then(Value::as_array).context("Cargo.lock: no package")?;
    let found = packages.iter().filter_map(|package| {
        let text = |key: &str| Some(package.get(key)?.as_str()?.to_owned());
        Some(((text("name")?, text("version")?), text("checksum")?))
    });
    Ok(found.collect())
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    const TREE: &str = "\
0 plumb v0.1.0 (/somewhere/plumb)|MIT OR Apache-2.0
1 clap v4.5.0|MIT OR Apache-2.0
2 clap_lex v0.7.0|MIT/Apache-2.0
1 libm v0.2.0|MIT
1 clap_lex v0.7.0|MIT/Apache-2.0 (*)
";

    fn commit() -> Commit {
        let time = "2026-01-31T12:00:00Z".to_owned();
        Commit { id: "abc".into(), seconds: 1_769_860_800, time, is_changed: false }
    }

    fn contents() -> Contents {
        let busybox = Package {
            name: "busybox-static".into(),
            version: "1:1.37.0-6".into(),
            architecture: "arm64".into(),
            bytes: 1,
            sha256: "cd".repeat(32),
            place: "debian/pool/main/b/busybox/busybox-static_1.37.0-6_arm64.deb".into(),
        };
        let lock = "[[package]]\nname = \"clap\"\nversion = \"4.5.0\"\nchecksum = \"".to_owned()
            + &"ab".repeat(32)
            + "\"\n[[package]]\nname = \"plumb\"\nversion = \"0.1.0\"\n";
        Contents::parse(TREE, &checksums(&lock).unwrap()).unwrap().with_debian_packages(&[busybox])
    }

    #[test]
    fn a_list_has_each_crate_once_with_its_licence_and_what_it_uses() {
        let json = contents().to_json("plumb.tar.gz", "0.1.0", b"bytes", &commit()).unwrap();
        let json: Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(
            (&json["bomFormat"], &json["specVersion"]),
            (&"CycloneDX".into(), &"1.5".into())
        );
        assert_eq!(json["metadata"]["timestamp"], "2026-01-31T12:00:00Z");
        assert_eq!(json["metadata"]["component"]["hashes"][0]["content"], sha256(b"bytes"));
        let names: Vec<_> =
            json["components"].as_array().unwrap().iter().map(|it| &it["name"]).collect();
        assert_eq!(names, ["clap", "clap_lex", "libm", "plumb", "debian/busybox-static"]);
        assert_eq!(json["components"][4]["purl"], "pkg:deb/debian/busybox-static@1%3A1.37.0-6");
        assert_eq!(json["components"][4]["hashes"][0]["content"], "cd".repeat(32));
        let clap = &json["components"][0];
        assert_eq!(clap["hashes"][0]["content"], "ab".repeat(32));
        assert_eq!(json["components"][1]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        let of = |user: &str| {
            let all = json["dependencies"].as_array().unwrap();
            all.iter().find(|it| it["ref"] == user).unwrap()["dependsOn"].clone()
        };
        assert_eq!(of("pkg:cargo/clap@4.5.0")[0], "pkg:cargo/clap_lex@0.7.0");
        assert_eq!(of("plumb.tar.gz").as_array().unwrap().len(), 2, "{json:#}");
    }

    #[test]
    fn the_same_deliverable_has_the_same_list() {
        let list = |bytes: &[u8]| contents().to_json("p", "1", bytes, &commit()).unwrap();
        assert_eq!(list(b"one"), list(b"one"));
        assert_ne!(list(b"one"), list(b"two"));
    }

    #[test]
    fn lines_that_are_not_understood_are_named() {
        let error = Contents::parse("plumb|MIT", &BTreeMap::new()).unwrap_err().to_string();
        assert!(error.contains("\"plumb|MIT\""), "{error}");
        assert!(Contents::parse("", &BTreeMap::new()).is_err());
    }
}
