//! A slot of a card that can be updated: everything that the Pi's own boot firmware needs to start a
//! box, in a file system of its own.
//!
//! | file | from | is |
//! |---|---|---|
//! | `start4.elf`, `fixup4.dat` | raspi-firmware | the firmware; the Pi 4 has its first stage in its own memory |
//! | [`DEVICE_TREES`] | linux-image-arm64 | what each board is made of; the firmware takes the one of its own |
//! | `vmlinuz` | linux-image-arm64 | the kernel, compressed: the firmware unpacks it, and an update is half as long |
//! | `initramfs` | | the same as for `virt` |
//! | `config.txt`, `cmdline.txt` | `board/image/rpi4` | what the firmware and the kernel are told |
//!
//! Both slots of a new card have the same bytes, and so has an update.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use plumbline_update::card::{SLOT_BYTES, Slot};

use super::fat::Fat;
use super::{Parts, initramfs};
use crate::command::{root, target_directory};

/// Named as the firmware expects with `upstream_kernel=1`.
pub const DEVICE_TREES: [&str; 3] =
    ["bcm2711-rpi-4-b.dtb", "bcm2711-rpi-400.dtb", "bcm2711-rpi-cm4-io.dtb"];

/// Makes a slot's file system; returns the file that holds it.
pub fn make(parts: &Parts) -> Result<PathBuf> {
    let file = target_directory().join("image/slot.img");
    // The remains of a killed run must not show through.
    File::create(&file).and_then(|it| it.set_len(SLOT_BYTES)).context("the slot")?;
    let fat = Fat::make(&file, 0, SLOT_BYTES, 32, Slot::A.partition().label)?;
    let firmware = parts.debian.path().join("usr/lib/raspi-firmware");
    for name in ["start4.elf", "fixup4.dat"] {
        fat.copy(&firmware.join(name), name)?;
    }
    let device_trees = parts.debian.device_trees()?;
    for name in DEVICE_TREES {
        fat.copy(&device_trees.join(name), name)?;
    }
    let kernel = initramfs::compressed(&read(&parts.debian.kernel_path()?)?)?;
    for (name, bytes) in [("vmlinuz", &kernel), ("initramfs", &parts.initramfs)] {
        let place = target_directory().join("image").join(name);
        fs::write(&place, bytes).with_context(|| place.display().to_string())?;
        fat.copy(&place, name)?;
    }
    for name in ["config.txt", "cmdline.txt"] {
        fat.copy(&root().join("board/image/rpi4").join(name), name)?;
    }
    Ok(file)
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| path.display().to_string())
}
