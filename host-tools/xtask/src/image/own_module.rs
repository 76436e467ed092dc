//! The box's own kernel module, `board/image/tryboot`, compiled for the image's kernel.
//!
//! Debian's headers of exactly this kernel are fetched and unpacked below `target/image`. They were
//! made to be installed: the tools of the kernel's build in them are programs of the release, which
//! may need a newer C library than this machine has, and are therefore run by their own loader with
//! their own libraries. The compiler is this machine's. It may be older than the kernel's; what an
//! older one lacks is left out, here and in the module's own Makefile.
//!
//! The same sources and compiler give the same bytes in every directory.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::debian_root::{self, DebianRoot, RELEASE};
use super::here::{Here, write_script};
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
    let version = debian.kernel_version()?;
    let headers = Headers::fetch(&version)?;
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
    headers.build(&directory)?;
    let (built, module) =
        (directory.join(format!("{NAME}.ko")), directory.join(format!("stripped-{NAME}.ko")));
    Task::new("aarch64-linux-gnu-strip")
        .args(["--strip-debug", "-o"])
        .args([&module, &built])
        .output()?;
    Ok(module)
}

/// Debian's headers of a kernel, and the tools of its build.
struct Headers {
    path: PathBuf,
    version: String,
}

impl Headers {
    /// Fetches them, unless they are already there.
    fn fetch(version: &str) -> Result<Self> {
        let path = target_directory().join("image").join(format!("{RELEASE}-headers-{version}"));
        let headers = Self { path, version: version.to_owned() };
        if headers.path.exists() {
            return Ok(headers);
        }
        let here = Here::of_this_machine()?;
        let tools = tools_version(version);
        let architectures = match here.architecture {
            "arm64" => vec!["arm64"],
            other => vec![other, "arm64"],
        };
        let packages = [
            format!("linux-headers-{version}:arm64"),
            format!("linux-headers-{tools}-common"),
            format!("linux-kbuild-{tools}:{}", here.architecture),
            format!("libc6:{}", here.architecture),
        ];
        let unfinished = headers.path.with_extension("unfinished");
        debian_root::unpack_alone(&architectures, &packages, &unfinished).with_context(|| {
            format!(
                "the headers of the kernel {version} cannot be fetched. If Debian has a newer kernel \
                 by now, remove {} and make the image again",
                debian_root::path().display()
            )
        })?;
        let scripts = unfinished.join(format!("usr/lib/linux-kbuild-{tools}/scripts"));
        // The second is one of a family, of which a small program chooses.
        for (name, program) in
            [("basic/fixdep", None), ("mod/modpost", Some("modpost.real-lsb-64"))]
        {
            loaded(&scripts.join(name), program, &here)?;
        }
        fs::rename(&unfinished, &headers.path)?;
        Ok(headers)
    }

    /// Runs the kernel's build for the modules in a directory.
    fn build(&self, directory: &Path) -> Result<()> {
        let sources = self.path.join("usr/src");
        let tools = tools_version(&self.version);
        let common = sources.join(format!("linux-headers-{tools}-common/Makefile"));
        // Debian's own Makefile in that directory names this one by the path where it would be
        // installed.
        Task::new("make")
            .args(["--silent", "--directory"])
            .args([sources.join(format!("linux-headers-{}", self.version))])
            .args(["--file".as_ref(), common.as_os_str()])
            .args(SETTINGS)
            .args([format!("M={}", directory.display())])
            .args(["modules"])
            .run()
    }
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
