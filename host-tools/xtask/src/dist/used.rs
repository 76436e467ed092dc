//! What people download, used where they use it: in a fresh Debian without Rust, and under Wine.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::{What, make};
use crate::command::{Task, root};
use crate::image::DebianRoot;
use crate::setup::{self, Need, Probe};

/// The variable that tells the tests in `host-tools/xtask/tests/dist` where the files are.
pub const VARIABLE: &str = "PLUMBLINE_DIST";

/// The release in which the package and the wheel are installed.
const RELEASE: &str = "bookworm";

/// What a person has there who uses them: Python with NumPy, the reader of pages, and three shells.
const PACKAGES: &[&str] = &[
    "apt-utils",
    "bash-completion",
    "fish",
    "gawk",
    "man-db",
    "python3-numpy",
    "python3-pip",
    "python3-venv",
    "zsh",
];

/// What is done there.
const SCRIPT: &str = "host-tools/xtask/tests/dist/debian.sh";

const WINE: &[Need] = &[
    Need {
        probe: Probe::Program("wine"),
        package: "wine",
        why: "runs the Windows program as Windows does",
    },
    Need { probe: Probe::Package("wine64"), package: "wine64", why: "64-bit Windows for it" },
    Need { probe: Probe::Program("unzip"), package: "unzip", why: "unpacks its archive" },
];

/// Installs what the tests need.
pub fn prepare_for_tests() -> Result<()> {
    setup::ensure(&[WINE])?;
    DebianRoot::prepare()
}

/// Makes what the tests use.
pub fn make_for_tests(out: &Path) -> Result<()> {
    let what = [What::LinuxX86_64, What::DebAmd64, What::WheelLinuxX86_64, What::WindowsX86_64];
    make(&what, out)
}

/// Installs the package and the wheel in a fresh Debian, and uses both there; what is done is in
/// [`SCRIPT`].
pub fn use_in_debian(out: &Path) -> Result<()> {
    let bring = out.join("to-debian");
    if bring.exists() {
        fs::remove_dir_all(&bring).with_context(|| bring.display().to_string())?;
    }
    fs::create_dir_all(&bring).with_context(|| bring.display().to_string())?;
    for entry in fs::read_dir(out).with_context(|| out.display().to_string())? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with("_amd64.deb") || name.ends_with("x86_64.whl") {
            fs::copy(entry.path(), bring.join(&name)).with_context(|| name.clone())?;
        }
    }
    let script = bring.join("debian.sh");
    fs::copy(root().join(SCRIPT), &script).context(SCRIPT)?;
    // Pages for man are left out of the smallest Debians, unless one says otherwise.
    Task::new("mmdebstrap")
        .args(["--variant=minbase", "--format=null"])
        .args([format!("--include={}", PACKAGES.join(","))])
        .args(["--customize-hook=mkdir \"$1\"/root/dist".to_owned()])
        .args([format!("--customize-hook=sync-in {} /root/dist", bring.display())])
        .args(["--customize-hook=chroot \"$1\" sh /root/dist/debian.sh"])
        .args([RELEASE, "/dev/null"])
        .run()
}
