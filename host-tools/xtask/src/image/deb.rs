//! The Debian package, for Debian trixie and Raspberry Pi OS on arm64: the box's
//! program with libcamera, for cameras on a ribbon cable, and a systemd unit.
//!
//! Its dependencies follow from the program itself: the shared libraries that it names, and the
//! newest version of the C library from which it uses a function.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use anyhow::{Context, Result, bail};

use super::{directory, initramfs, output};
use crate::command::{Task, root};
use crate::setup::{Need, Probe};

/// The tools needed to make the package.
pub const NEEDS: &[Need] =
    &[Need { probe: Probe::Program("dpkg-deb"), package: "dpkg", why: "makes the Debian package" }];

/// The package's version, which is that of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The package that contains a shared library; only for the C library with a version.
fn package_of(library: &str) -> Result<&'static str> {
    Ok(match library {
        "libcamera.so.0.4" | "libcamera-base.so.0.4" => "libcamera0.4",
        "libstdc++.so.6" => "libstdc++6",
        "libgcc_s.so.1" => "libgcc-s1",
        "libc.so.6" | "libm.so.6" | "ld-linux-aarch64.so.1" => "libc6",
        _ => bail!("no package is known for {library}: add it in image/deb.rs"),
    })
}

/// The control file's `Depends`, from readelf's output for the program.
fn depends(dynamic: &str, versions: &str) -> Result<String> {
    let mut packages = BTreeSet::new();
    for line in dynamic.lines().filter(|line| line.contains("(NEEDED)")) {
        let library = line.split(['[', ']']).nth(1).context("a NEEDED without a name")?;
        packages.insert(package_of(library)?);
    }
    let minor = |word: &str| word.strip_prefix("GLIBC_2.")?.parse::<u32>().ok();
    let newest = versions.split_whitespace().filter_map(minor).max();
    let newest = newest.context("readelf reports no version of the C library")?;
    let text = |package: &&str| match *package {
        "libc6" => format!("libc6 (>= 2.{newest})"),
        package => package.to_owned(),
    };
    // `deb-systemd-helper` and `systemd-sysusers`, for the scripts.
    packages.extend(["init-system-helpers", "systemd"]);
    Ok(packages.iter().map(text).collect::<Vec<_>>().join(", "))
}

/// Makes the package `out` from the program.
pub fn make(program: &Path, out: &Path) -> Result<()> {
    let tree = directory().join("deb");
    if tree.exists() {
        fs::remove_dir_all(&tree)?;
    }
    let sources = root().join("board/image/deb");
    let source = |name: &str| {
        let path = sources.join(name);
        fs::read(&path).with_context(|| path.display().to_string())
    };
    let put = |name: &str, mode: u32, bytes: &[u8]| -> Result<()> {
        let path = tree.join(name);
        fs::create_dir_all(path.parent().context("a name without a directory")?)?;
        fs::write(&path, bytes)?;
        fs::set_permissions(&path, fs::Permissions::from_mode(mode))?;
        Ok(())
    };
    let binary = initramfs::stripped(program)?;
    put("usr/bin/plumbline-board", 0o755, &binary)?;
    let unit = "plumbline-board.service";
    put(&format!("usr/lib/systemd/system/{unit}"), 0o644, &source(unit)?)?;
    let groups = source("plumbline-board.sysusers")?;
    put("usr/lib/sysusers.d/plumbline-board.conf", 0o644, &groups)?;
    let rules = source("plumbline-board.rules")?;
    put("usr/lib/udev/rules.d/60-plumbline-board.rules", 0o644, &rules)?;
    let licence = [source("copyright")?, expat()?.into_bytes()].concat();
    put("usr/share/doc/plumbline-board/copyright", 0o644, &licence)?;
    put("usr/share/doc/plumbline-board/README", 0o644, &source("README")?)?;
    for script in ["postinst", "prerm", "postrm"] {
        put(&format!("DEBIAN/{script}"), 0o755, &source(script)?)?;
    }
    let readelf = |option: &str| {
        Task::new("aarch64-linux-gnu-readelf").args(["--wide", option]).args([program]).output()
    };
    let control = String::from_utf8(source("control")?)?
        .replace("@VERSION@", VERSION)
        .replace("@INSTALLED_KIB@", &binary.len().div_ceil(1024).to_string())
        .replace("@DEPENDS@", &depends(&readelf("--dynamic")?, &readelf("--version-info")?)?);
    put("DEBIAN/control", 0o644, control.as_bytes())?;

    output::file(out, |out| {
        // The date of the files, without which every package would differ.
        Task::new("dpkg-deb")
            .env("SOURCE_DATE_EPOCH", "0")
            .args(["--root-owner-group", "-Zxz", "--build"])
            .args([&tree, out])
            .run()
    })?;
    println!("\n{}: on the box, `sudo apt install ./{}`", out.display(), file_name(out));
    Ok(())
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The MIT licence in the format of Debian's copyright files: indented, with dots on empty lines.
fn expat() -> Result<String> {
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
            depends(DYNAMIC, versions).unwrap(),
            "init-system-helpers, libc6 (>= 2.34), libcamera0.4, systemd"
        );
    }

    #[test]
    fn a_library_without_a_package_is_named() {
        let error = depends("(NEEDED) Shared library: [libnew.so.1]", "GLIBC_2.34").unwrap_err();
        assert!(error.to_string().contains("libnew.so.1"), "{error}");
        assert!(depends(DYNAMIC, "").is_err());
    }
}
