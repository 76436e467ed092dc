//! Programs of the release on this machine: Debian's own programs for its processor, run by their own
//! loader with their own libraries, whatever system this is. Nothing is installed.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use anyhow::{Context, Result, bail};

/// Debian's names for the processors of the machines that images are made on.
pub const HOSTS: [&str; 2] = ["amd64", "arm64"];

/// Debian's names for the machine that this program runs on.
pub struct Here {
    /// Of packages.
    pub architecture: &'static str,
    /// The directory of the libraries, below a root.
    pub libraries: &'static str,
    /// The program that loads other programs, below a root.
    pub loader: &'static str,
}

impl Here {
    /// The names, for the processors that Debian's programs are fetched for.
    pub fn of_this_machine() -> Result<Self> {
        let (architecture, libraries, loader) = match std::env::consts::ARCH {
            "x86_64" => ("amd64", "usr/lib/x86_64-linux-gnu", "usr/lib64/ld-linux-x86-64.so.2"),
            "aarch64" => ("arm64", "usr/lib/aarch64-linux-gnu", "usr/lib/ld-linux-aarch64.so.1"),
            other => bail!(
                "images are made on a computer with an x86-64 or a 64-bit ARM processor, and this one \
                 has {other}"
            ),
        };
        Ok(Self { architecture, libraries, loader })
    }
}

/// Writes a program for the shell.
pub fn write_script(path: &Path, text: &str) -> Result<()> {
    fs::write(path, text).with_context(|| path.display().to_string())?;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))?;
    Ok(())
}
