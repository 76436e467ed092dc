//! Debian's newest packages, unpacked: programs that a test starts, of which nothing gets into an image.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::debian_root::{COMPONENTS, RELEASE};
use crate::command::Task;
use crate::setup::{Need, Probe};

/// The tools needed.
pub const NEEDS: &[Need] = &[
    Need {
        probe: Probe::Program("mmdebstrap"),
        package: "mmdebstrap",
        why: "fetches and unpacks Debian's packages for the tests",
    },
    Need {
        probe: Probe::Program("newuidmap"),
        package: "uidmap",
        why: "lets mmdebstrap work for somebody who is not root",
    },
];

/// Unpacks packages of the release and their dependencies into a new directory; nothing in them is
/// run.
pub fn unpack(architecture: &str, packages: &[&str], directory: &Path) -> Result<()> {
    if directory.exists() {
        fs::remove_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    let archive = directory.with_extension("tar");
    Task::new("mmdebstrap")
        .args(["--variant=extract".into(), format!("--architectures={architecture}")])
        .args([format!("--components={COMPONENTS}"), format!("--include={}", packages.join(","))])
        .args([RELEASE.as_ref(), archive.as_os_str()])
        .run()?;
    // Device files belong to a running system, and only root may create them.
    Task::new("tar")
        .args(["--extract", "--no-same-owner", "--exclude=./dev/*", "--file"])
        .args([&archive])
        .args(["--directory".as_ref(), directory.as_os_str()])
        .run()?;
    Ok(fs::remove_file(&archive)?)
}
