//! A Debian for the test of the package: Debian's own init (systemd), device manager (udev), users and
//! groups, and the shared libraries of the packaged program, in an archive that the kernel unpacks.
//!
//! `/init` is systemd. The test adds the package's files, and the units that install it.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::archive::Archive;
use super::debian_root::DebianRoot;
use super::test_overlay::{LIBRARIES, libraries};

/// Programs, by their names below `usr/`.
const PROGRAMS: [&str; 7] = [
    "lib/systemd/systemd",
    "lib/systemd/systemd-executor",
    "bin/systemctl",
    "bin/systemd-sysusers",
    "bin/udevadm",
    "lib/udev/v4l_id",
    "bin/busybox",
];

/// What busybox is, besides itself.
const BUSYBOX: [&str; 6] = ["cp", "grep", "ls", "sh", "sleep", "touch"];

/// Directories whose files are taken: what udev does with a device, and Debian's users and groups.
const DIRECTORIES: [&str; 2] = ["lib/udev/rules.d", "lib/sysusers.d"];

/// The units between the kernel's start and the first service.
const UNITS: [&str; 15] = [
    "basic.target",
    "local-fs.target",
    "local-fs-pre.target",
    "paths.target",
    "shutdown.target",
    "slices.target",
    "sockets.target",
    "swap.target",
    "sysinit.target",
    "systemd-sysusers.service",
    "systemd-udev-trigger.service",
    "systemd-udevd-control.socket",
    "systemd-udevd-kernel.socket",
    "systemd-udevd.service",
    "timers.target",
];

/// Makes the archive, for this `program` of the package.
pub fn make(debian: &DebianRoot, program: &Path) -> Result<Vec<u8>> {
    let mut root = Archive::default();
    for (name, target) in [
        ("bin", "usr/bin"),
        ("sbin", "usr/bin"),
        ("lib", "usr/lib"),
        ("init", "usr/lib/systemd/systemd"),
        ("usr/lib/systemd/systemd-udevd", "../../bin/udevadm"),
    ] {
        root.link(name, target);
    }
    let mut needed = libraries(debian, program)?;
    for name in PROGRAMS.map(|name| format!("usr/{name}")) {
        needed.extend(libraries(debian, &debian.path().join(&name))?);
        root.program(&name, debian.read(&name)?);
    }
    for name in BUSYBOX {
        root.link(&format!("usr/bin/{name}"), "busybox");
    }
    let loader = "usr/lib/ld-linux-aarch64.so.1";
    root.program(loader, debian.read(loader)?);
    for library in needed {
        let name = format!("{LIBRARIES}/{library}");
        root.program(&name, debian.read(&name)?);
    }
    for directory in DIRECTORIES.map(|name| format!("usr/{name}")) {
        let place = debian.path().join(&directory);
        for entry in fs::read_dir(&place).with_context(|| place.display().to_string())? {
            let name = format!("{directory}/{}", entry?.file_name().to_string_lossy());
            root.file(&name, debian.read(&name)?);
        }
    }
    for unit in UNITS {
        let name = format!("usr/lib/systemd/system/{unit}");
        root.file(&name, debian.read(&name)?);
    }
    root.to_bytes()
}
