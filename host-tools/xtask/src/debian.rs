//! Debian packages: what they depend on, their licence, and how a tree becomes one.
//!
//! The dependencies follow from the programs themselves: the shared libraries that they name, and the
//! newest version of the C library from which they use a function.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

use crate::command::{Task, root};
use crate::setup::{Need, Probe};

/// The tools needed to make a package.
pub const NEEDS: &[Need] =
    &[Need { probe: Probe::Program("dpkg-deb"), package: "dpkg", why: "makes the Debian package" }];

/// The packages' version, which is that of the programs.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The package that contains a shared library; only for the C library with a version.
fn package_of(library: &str) -> Result<&'static str> {
    Ok(match library {
        "libcamera.so.0.4" | "libcamera-base.so.0.4" => "libcamera0.4",
        "libstdc++.so.6" => "libstdc++6",
        "libgcc_s.so.1" => "libgcc-s1",
        "libc.so.6"
        | "libm.so.6"
        | "libdl.so.2"
        | "libpthread.so.0"
        | "librt.so.1"
        | "libutil.so.1"
        | "ld-linux-aarch64.so.1"
        | "ld-linux-x86-64.so.2" => "libc6",
        _ => bail!("no package is known for {library}: add it in debian.rs"),
    })
}

/// The control file's `Depends`: what this program needs, read by this `readelf`, and `more`.
pub fn depends(readelf: &str, program: &Path, more: &[&'static str]) -> Result<String> {
    let read = |option: &str| Task::new(readelf).args(["--wide", option]).args([program]).output();
    listed(&read("--dynamic")?, &read("--version-info")?, more)
}

/// The newest version of the C library whose names a program uses: 28 for 2.28.
pub fn newest_c_library(program: &Path) -> Result<u32> {
    newest(&Task::new("readelf").args(["--wide", "--version-info"]).args([program]).output()?)
}

fn newest(versions: &str) -> Result<u32> {
    let minor = |word: &str| word.strip_prefix("GLIBC_2.")?.parse().ok();
    let newest = versions.split_whitespace().filter_map(minor).max();
    newest.context("readelf reports no version of the C library")
}

/// `Depends` from readelf's output.
fn listed(dynamic: &str, versions: &str, more: &[&'static str]) -> Result<String> {
    let mut packages = BTreeSet::new();
    for line in dynamic.lines().filter(|line| line.contains("(NEEDED)")) {
        let library = line.split(['[', ']']).nth(1).context("a NEEDED without a name")?;
        packages.insert(package_of(library)?);
    }
    let newest = newest(versions)?;
    let text = |package: &&str| match *package {
        "libc6" => format!("libc6 (>= 2.{newest})"),
        package => package.to_owned(),
    };
    packages.extend(more);
    Ok(packages.iter().map(text).collect::<Vec<_>>().join(", "))
}

/// Packs a tree with its control files in `DEBIAN`; `epoch` is the date of all files, in seconds since
/// 1970, without which every package would differ.
pub fn pack(tree: &Path, out: &Path, epoch: &str) -> Result<()> {
    Task::new("dpkg-deb")
        .env("SOURCE_DATE_EPOCH", epoch)
        // The compressor's output depends on whether it has one thread or more.
        .env("DPKG_DEB_THREADS_MAX", "1")
        .args(["--root-owner-group", "-Zxz", "--build"])
        .args([tree, out])
        .run()
}

/// The MIT licence in the format of Debian's copyright files: indented, with dots on empty lines.
pub fn expat() -> Result<String> {
    let text = fs::read_to_string(root().join("LICENSE-MIT")).context("LICENSE-MIT")?;
    let mut licence = "License: Expat\n".to_owned();
    for line in text.trim_end().lines() {
        licence += &if line.is_empty() { " .\n".to_owned() } else { format!(" {line}\n") };
    }
    Ok(licence)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DYNAMIC: &str = "\
 0x0000000000000001 (NEEDED)             Shared library: [libcamera.so.0.4]
 0x0000000000000001 (NEEDED)             Shared library: [libcamera-base.so.0.4]
 0x0000000000000001 (NEEDED)             Shared library: [libm.so.6]
 0x0000000000000001 (NEEDED)             Shared library: [libc.so.6]
 0x000000000000000c (INIT)               0x4a2e8
";

    #[test]
    fn each_package_is_named_once_with_the_c_library_that_is_needed() {
        let versions = "0x0010: Name: GLIBC_2.17 Flags: none\n0x0020: Name: GLIBC_2.34 GLIBC_2.4";
        assert_eq!(
            listed(DYNAMIC, versions, &["systemd", "init-system-helpers"]).unwrap(),
            "init-system-helpers, libc6 (>= 2.34), libcamera0.4, systemd"
        );
    }

    #[test]
    fn a_library_without_a_package_is_named() {
        let error =
            listed("(NEEDED) Shared library: [libnew.so.1]", "GLIBC_2.34", &[]).unwrap_err();
        assert!(error.to_string().contains("libnew.so.1"), "{error}");
        assert!(listed(DYNAMIC, "", &[]).is_err());
    }
}
