//! The box's own kernel module, `board/image/tryboot`, compiled for the image's kernel.
//!
//! Debian's headers of exactly this kernel are in the lock and in the root beside it. They were made to
//! be installed: the tools of the kernel's build in them are programs of the release, which
//! may need a newer C library than this machine has, and are therefore run by their own loader with
//! their own libraries. The compiler is this machine's. It may be older than the kernel's; what an
//! older one lacks is left out, here and in the module's own Makefile.
//!
//! The same sources and compiler give the same bytes in every directory.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::debian_root::DebianRoot;
use super::here::{HOSTS, Here, write_script};
use super::lock::BOX;
use crate::command::{Task, root, target_directory};
use crate::setup::{Need, Probe};

/// Its name, as the lists of modules have it.
pub const NAME: &str = "plumbline_tryboot";

/// The additional tools needed.
pub const NEEDS: &[Need] = &[Need {
    probe: Probe::Program("make"),
    package: "make",
    why: "runs the kernel's own build for the box's kernel module",
}];

/// What the kernel's build is told beside where everything is.
///
/// No build id, which would be a hash of this machine's paths as well; no description of types
/// (BTF), which would need another tool; and no minimal alignment of functions, which compilers
/// before GCC 14 do not know, and which is for tracing.
const SETTINGS: [&str; 6] = [
    "ARCH=arm64",
    "CROSS_COMPILE=aarch64-linux-gnu-",
    "CC=aarch64-linux-gnu-gcc",
    "LDFLAGS_MODULE=--build-id=none",
    "CONFIG_DEBUG_INFO_BTF_MODULES=",
    "CONFIG_CC_HAS_MIN_FUNCTION_ALIGNMENT=",
];

/// Compiles the module for the kernel of the root; returns the path of its file.
pub fn make(debian: &DebianRoot) -> Result<PathBuf> {
    let directory = target_directory().join("image").join("own-module");
    if directory.exists() {
        fs::remove_dir_all(&directory).with_context(|| directory.display().to_string())?;
    }
    fs::create_dir_all(&directory).with_context(|| directory.display().to_string())?;
    let sources = root().join("board/image/tryboot");
    for entry in fs::read_dir(&sources).with_context(|| sources.display().to_string())? {
        let entry = entry?;
        fs::copy(entry.path(), directory.join(entry.file_name()))?;
    }
    build(debian, &directory)?;
    let (built, module) =
        (directory.join(format!("{NAME}.ko")), directory.join(format!("stripped-{NAME}.ko")));
    Task::new("aarch64-linux-gnu-strip")
        .args(["--strip-debug", "-o"])
        .args([&module, &built])
        .output()?;
    Ok(module)
}

/// The packages that it is compiled with, besides those of the box: the kernel's headers, the tools of its
/// build, and the C library with which those are run, for each kind of machine that images are made on.
/// Each is named as apt and the lock name it.
pub fn packages(kernel: &str) -> Vec<String> {
    let tools = tools_version(kernel);
    let headers =
        [format!("linux-headers-{kernel}"), format!("linux-headers-{tools}-common")].into_iter();
    let of_host = HOSTS.into_iter().flat_map(|host| {
        let suffix = if host == BOX { String::new() } else { format!(":{host}") };
        [format!("{TOOLS}{tools}{suffix}"), format!("libc6{suffix}")]
    });
    headers.chain(of_host).collect()
}

/// Whether this package is of programs that are run where images are made, even if its architecture is
/// the box's.
pub fn is_run_here(package: &str) -> bool {
    package.starts_with(TOOLS)
}

/// How the name of the package with the tools begins.
const TOOLS: &str = "linux-kbuild-";

/// Has the tools of the build below a root run by the C library in it.
pub fn prepare_tools(root: &Path, kernel: &str) -> Result<()> {
    let here = Here::of_this_machine()?;
    let scripts = root.join(format!("usr/lib/{TOOLS}{}/scripts", tools_version(kernel)));
    // The second is one of a family, of which a small program chooses.
    for (name, program) in [("basic/fixdep", None), ("mod/modpost", Some("modpost.real-lsb-64"))] {
        loaded(&scripts.join(name), program, &here)?;
    }
    Ok(())
}

/// Runs the kernel's build for the modules in a directory.
fn build(debian: &DebianRoot, directory: &Path) -> Result<()> {
    let kernel = debian.kernel_version()?;
    let sources = debian.path().join("usr/src");
    let common = sources.join(format!("linux-headers-{}-common/Makefile", tools_version(&kernel)));
    // Debian's own Makefile in that directory names this one by the path where it would be
    // installed.
    Task::new("make")
        .args(["--silent", "--directory"])
        .args([sources.join(format!("linux-headers-{kernel}"))])
        .args(["--file".as_ref(), common.as_os_str()])
        .args(SETTINGS)
        .args([format!("M={}", directory.display())])
        .args(["modules"])
        .run()
}

/// The version in the names of what all kinds of a kernel share: `6.12.118+deb13` of
/// `6.12.118+deb13-arm64`.
fn tools_version(kernel: &str) -> &str {
    kernel.strip_suffix("-arm64").unwrap_or(kernel)
}

/// Has a program in `scripts/*/` run by its own loader: itself, or `program` beside it.
fn loaded(path: &Path, program: Option<&str>, here: &Here) -> Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let program = match program {
        Some(program) => program.to_owned(),
        None => {
            let moved = format!("{name}.real");
            fs::rename(path, path.with_file_name(&moved))
                .with_context(|| path.display().to_string())?;
            moved
        }
    };
    // By names relative to itself, as what it lies in is moved.
    write_script(
        path,
        &format!(
            "#!/bin/sh\nhere=$(dirname \"$0\")\nroot=$here/../../../../..\n\
             exec \"$root/{}\" --library-path \"$root/{}\" \"$here/{program}\" \"$@\"\n",
            here.loader, here.libraries
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kinds_of_a_kernel_share_their_tools() {
        assert_eq!(tools_version("6.12.118+deb13-arm64"), "6.12.118+deb13");
    }

    #[test]
    fn every_kind_of_machine_has_its_tools() {
        let common = ["linux-headers-6.1+2-arm64", "linux-headers-6.1+2-common"];
        let of_hosts = ["linux-kbuild-6.1+2:amd64", "libc6:amd64", "linux-kbuild-6.1+2", "libc6"];
        let packages = packages("6.1+2-arm64");
        assert_eq!(packages, [&common[..], &of_hosts].concat());
        let run_here = packages.iter().filter(|&it| is_run_here(it));
        assert_eq!(run_here.collect::<Vec<_>>(), [of_hosts[0], of_hosts[2]]);
    }

    #[test]
    fn a_program_is_run_by_its_own_loader_wherever_it_has_been_moved_to() {
        let folder = tempfile::tempdir().unwrap();
        let before = folder.path().join("a root");
        let scripts = before.join("usr/lib/linux-kbuild-1/scripts/basic");
        fs::create_dir_all(&scripts).unwrap();
        fs::write(scripts.join("fixdep"), "the program").unwrap();
        // Plays the loader: tells what it is started with.
        let here = Here { architecture: "any", libraries: "usr/lib/any", loader: "usr/lib/loader" };
        write_script(&before.join(here.loader), "#!/bin/sh\nshift 2\ncat \"$1\"\necho \", $2\"\n")
            .unwrap();
        loaded(&scripts.join("fixdep"), None, &here).unwrap();
        let after = folder.path().join("another");
        fs::rename(&before, &after).unwrap();
        let moved = after.join("usr/lib/linux-kbuild-1/scripts/basic/fixdep");
        assert_eq!(
            Task::new(moved).args(["one word"]).output().unwrap(),
            "the program, one word\n"
        );
    }
}
