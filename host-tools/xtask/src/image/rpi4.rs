//! The SD card of a Raspberry Pi 4, a Pi 400 or a Compute Module 4: one FAT partition, from which
//! the Pi's own boot firmware boots and the box reads its configuration.
//!
//! | file | from | is |
//! |---|---|---|
//! | `start4.elf`, `fixup4.dat` | raspi-firmware | the firmware; the Pi 4 has its first stage in its own memory |
//! | [`DEVICE_TREES`] | linux-image-arm64 | what each board is made of; the firmware takes the one of its own |
//! | `vmlinuz`, `initramfs` | | the same as for `virt` |
//! | `config.txt`, `cmdline.txt` | `board/image/rpi4` | what the firmware and the kernel are told |
//! | `config.plb` | `--config` | the box's configuration |
//! | `box.key` | `--key`, or beside the configuration | the box's key |

use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result};

use super::config::Provided;
use super::fat::Fat;
use super::{Parts, output};
use crate::command::{Task, root, target_directory};
use crate::setup::{Need, Probe};

/// The additional tools needed.
pub const NEEDS: &[Need] = &[Need {
    probe: Probe::File("/usr/sbin/sfdisk"),
    package: "fdisk",
    why: "makes the SD card's partition table",
}];

/// Named as the firmware expects with `upstream_kernel=1`.
pub const DEVICE_TREES: [&str; 3] =
    ["bcm2711-rpi-4-b.dtb", "bcm2711-rpi-400.dtb", "bcm2711-rpi-cm4-io.dtb"];

/// The start of the partition: cards are written in blocks of this size or a fraction of it.
const START_BYTES: u64 = 4 << 20;

/// The size of the partition: twice its contents, so that the next kernel fits beside this one.
const PARTITION_BYTES: u64 = 128 << 20;

/// Makes the image `card`.
pub fn make(parts: &Parts, provided: &Provided, card: &Path) -> Result<()> {
    output::file(card, |card| write(parts, provided, card))?;
    println!("\n{}: write it to a card, see `cargo xtask image --help`", card.display());
    provided.say_what_is_lacking(card);
    Ok(())
}

fn write(parts: &Parts, provided: &Provided, card: &Path) -> Result<()> {
    // The remains of a killed run must not show through.
    let file = File::create(card).with_context(|| card.display().to_string())?;
    file.set_len(START_BYTES + PARTITION_BYTES)?;
    // Type c is the FAT32 that the firmware looks for; the label-id is the disk identifier, which
    // would otherwise be random.
    let table = format!(
        "label: dos\nlabel-id: 0x504c4d42\nunit: sectors\n\
         start={}, size={}, type=c, bootable\n",
        START_BYTES / 512,
        PARTITION_BYTES / 512
    );
    let script = target_directory().join("image/rpi4.sfdisk");
    fs::write(&script, table)?;
    Task::new("sh")
        .args(["-c", "/usr/sbin/sfdisk --quiet \"$1\" < \"$2\"", "sh"])
        .args([card, &script])
        .output()?;

    let fat = Fat::make(card, START_BYTES, PARTITION_BYTES, 32)?;
    let firmware = parts.debian.path().join("usr/lib/raspi-firmware");
    let device_trees = parts.debian.device_trees()?;
    fat.copy(&firmware.join("start4.elf"), "start4.elf")?;
    fat.copy(&firmware.join("fixup4.dat"), "fixup4.dat")?;
    for name in DEVICE_TREES {
        fat.copy(&device_trees.join(name), name)?;
    }
    fat.copy(&parts.debian.kernel_path()?, "vmlinuz")?;
    let initramfs = target_directory().join("image/initramfs");
    fs::write(&initramfs, &parts.initramfs)?;
    fat.copy(&initramfs, "initramfs")?;
    for name in ["config.txt", "cmdline.txt"] {
        fat.copy(&root().join("board/image/rpi4").join(name), name)?;
    }
    provided.copy(&fat)
}
