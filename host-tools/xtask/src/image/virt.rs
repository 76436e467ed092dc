//! The image for QEMU's arm64 board `virt`: a directory with the kernel, the
//! initramfs, a disk with the boot partition, and a script that starts it all.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use anyhow::{Context, Result};

use super::fat::Fat;
use super::{CONFIG_NAME, Parts};

/// Room for the configuration, and for a person's notes.
const DISK_BYTES: u64 = 1 << 20;

/// Makes the image in `directory`.
pub fn make(parts: &Parts, config: Option<&Path>, directory: &Path) -> Result<()> {
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    parts.write_to(directory)?;
    let disk = directory.join("boot.img");
    File::create(&disk)?.set_len(DISK_BYTES)?;
    let fat = Fat::make(&disk, 0, DISK_BYTES, 12)?;
    if let Some(config) = config {
        fat.copy(config, CONFIG_NAME)?;
    }
    let run = directory.join("run");
    fs::write(&run, include_str!("../../../../board/image/virt/run"))?;
    fs::set_permissions(&run, fs::Permissions::from_mode(0o755))?;
    println!("\n{}: start it with {}", directory.display(), run.display());
    if config.is_none() {
        println!(
            "It has no configuration yet, and will say so. Put one in with\n    \
             mcopy -i {} box.plb ::{CONFIG_NAME}",
            disk.display()
        );
    }
    Ok(())
}
