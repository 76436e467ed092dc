//! The Debian package, for Debian trixie and Raspberry Pi OS on arm64: the box's
//! program with libcamera, for cameras on a ribbon cable, and a systemd unit.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use anyhow::{Context, Result};

use super::{directory, initramfs, output};
use crate::command::root;
use crate::debian;

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
    let licence = [source("copyright")?, debian::expat()?.into_bytes()].concat();
    put("usr/share/doc/plumbline-board/copyright", 0o644, &licence)?;
    put("usr/share/doc/plumbline-board/README", 0o644, &source("README")?)?;
    for script in ["postinst", "prerm", "postrm"] {
        put(&format!("DEBIAN/{script}"), 0o755, &source(script)?)?;
    }
    // `deb-systemd-helper` and `systemd-sysusers`, for the scripts.
    let more = ["init-system-helpers", "systemd"];
    let depends = debian::depends("aarch64-linux-gnu-readelf", program, &more)?;
    let control = String::from_utf8(source("control")?)?
        .replace("@VERSION@", debian::VERSION)
        .replace("@INSTALLED_KIB@", &binary.len().div_ceil(1024).to_string())
        .replace("@DEPENDS@", &depends);
    put("DEBIAN/control", 0o644, control.as_bytes())?;

    output::file(out, |out| debian::pack(&tree, out, "0"))?;
    println!("\n{}: on the box, `sudo apt install ./{}`", out.display(), file_name(out));
    Ok(())
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
