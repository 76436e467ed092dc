//! The image for QEMU's arm64 board `virt`: a directory with the kernel, the initramfs, a disk with
//! the settings partition, and a script that starts them.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use anyhow::Result;
use plumbline_update::card::SETTINGS_LABEL;

use super::config::Provided;
use super::fat::Fat;
use super::{Parts, output};
use crate::command::{quoted, unpacked_programs};

/// Enough space for the configuration and for notes.
const DISK_BYTES: u64 = 1 << 20;

/// Makes the image in `directory`.
pub fn make(parts: &Parts, provided: &Provided, directory: &Path) -> Result<()> {
    output::directory(directory, |directory| {
        parts.write_to(directory)?;
        let disk = directory.join("boot.img");
        File::create(&disk)?.set_len(DISK_BYTES)?;
        let fat = Fat::make(&disk, 0, DISK_BYTES, 12, SETTINGS_LABEL)?;
        provided.copy(&fat)?;
        write_run(&directory.join("run"), &unpacked_programs())
    })?;
    println!("\n{}: start it with {}", directory.display(), directory.join("run").display());
    provided.say_what_is_lacking(&directory.join("boot.img"));
    Ok(())
}

/// Writes the script that starts the image, wherever it is; QEMU may be in `programs`.
fn write_run(run: &Path, programs: &Path) -> Result<()> {
    let script = include_str!("../../../../board/image/virt/run");
    fs::write(run, script.replace("@PROGRAMS@", &quoted(programs.as_ref())))?;
    fs::set_permissions(run, fs::Permissions::from_mode(0o755))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn the_script_finds_qemu_beside_the_system_wherever_the_image_is() {
        let folder = tempfile::tempdir().unwrap();
        let (image, programs) =
            (folder.path().join("an image"), folder.path().join("the programs"));
        fs::create_dir(&image).unwrap();
        fs::create_dir(&programs).unwrap();
        let qemu = programs.join("qemu-system-aarch64");
        fs::write(&qemu, "#!/bin/sh\necho \"qemu in $PWD\"\n").unwrap();
        fs::set_permissions(&qemu, fs::Permissions::from_mode(0o755)).unwrap();
        write_run(&image.join("run"), &programs).unwrap();
        // A system that lacks QEMU.
        let system = folder.path().join("system");
        fs::create_dir(&system).unwrap();
        std::os::unix::fs::symlink("/usr/bin/dirname", system.join("dirname")).unwrap();
        let output = Command::new("/bin/sh")
            .arg(image.join("run"))
            .env("PATH", &system)
            .current_dir("/")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(said.trim(), format!("qemu in {}", image.display()), "{output:?}");
    }
}
