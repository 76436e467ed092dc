//! What people download, used where they use it: in a fresh Debian without Rust, and under Wine.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::{What, make};
use crate::command::{Task, root};
use crate::image;
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

const ARCHIVES: &[Need] = &[Need {
    probe: Probe::Program("unzip"),
    package: "unzip",
    why: "unpacks the Windows program's archive",
}];

/// The variable that tells them where the Debian with Wine is.
pub const WINE_VARIABLE: &str = "PLUMBLINE_WINE";

/// The release whose Wine has all of Windows that Rust's programs need: older ones lack
/// `bcryptprimitives.dll`.
const WINE_RELEASE: &str = "trixie";

/// Installs what the tests need.
pub fn prepare_for_tests() -> Result<()> {
    setup::ensure(&[ARCHIVES, image::UNPACKING])
}

/// Makes a Debian with Wine, in which the tests run Windows' program; the directory it is in.
pub fn make_wine() -> Result<PathBuf> {
    let path = super::platform::work().join("wine");
    // Written last, so that an interrupted installation starts again.
    let made = path.join("made");
    if made.exists() {
        println!("Wine is in {}", path.display());
        return Ok(path);
    }
    if path.exists() {
        fs::remove_dir_all(&path).with_context(|| path.display().to_string())?;
    }
    Task::new("mmdebstrap")
        .args(["--variant=minbase", "--include=wine64,wine", WINE_RELEASE])
        .args([&path])
        .run()?;
    fs::write(&made, WINE_RELEASE).with_context(|| made.display().to_string())?;
    Ok(path)
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
        .args(["--customize-hook=mkdir \"$1\"/srv/dist".to_owned()])
        .args([format!("--customize-hook=sync-in {} /srv/dist", bring.display())])
        .args(["--customize-hook=chroot \"$1\" sh /srv/dist/debian.sh"])
        .args([RELEASE, "/dev/null"])
        .run()
}
