//! The SD card of a Raspberry Pi 4, a Pi 400 or a Compute Module 4, with the partitions of
//! [`plumbline_update::card`]: the Pi's own boot firmware reads which slot to start, and starts it; the
//! box reads its configuration and its key from the settings.

use std::fs::{self, File};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::Path;

use anyhow::{Context, Result};
use plumbline_update::card::{CARD_BYTES, CHOOSER, PARTITIONS, SETTINGS, Slot};
use plumbline_update::chooser;

use super::config::Provided;
use super::fat::Fat;
use super::{Parts, output, slot};
use crate::command::{Task, target_directory};
use crate::setup::{Need, Probe};

/// The additional tools needed.
pub const NEEDS: &[Need] = &[Need {
    probe: Probe::File("/usr/sbin/sfdisk"),
    package: "fdisk",
    why: "makes the SD card's partition table",
}];

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
    file.set_len(CARD_BYTES)?;
    partition(card)?;
    let slot_file = slot::make(parts)?;
    let system = fs::read(&slot_file).with_context(|| slot_file.display().to_string())?;
    for slot in Slot::ALL {
        (&file).seek(SeekFrom::Start(slot.partition().start_bytes))?;
        (&file).write_all(&system)?;
    }
    let make = |it: plumbline_update::card::Partition| {
        Fat::make(card, it.start_bytes, it.bytes, 32, it.label)
    };
    let sector = target_directory().join("image").join(chooser::FILE_NAME);
    fs::write(&sector, chooser::sector(Slot::A))?;
    make(CHOOSER)?.copy(&sector, chooser::FILE_NAME)?;
    provided.copy(&make(SETTINGS)?)
}

/// Writes the partition table.
fn partition(card: &Path) -> Result<()> {
    // Type c is the FAT32 that the firmware looks for; the label-id is the disk identifier, which
    // would otherwise be random.
    let mut table = "label: dos\nlabel-id: 0x504c4d42\nunit: sectors\n".to_owned();
    for it in PARTITIONS {
        let bootable = if it == CHOOSER { ", bootable" } else { "" };
        let (start, size) = (it.start_bytes / 512, it.bytes / 512);
        table += &format!("start={start}, size={size}, type=c{bootable}\n");
    }
    let script = target_directory().join("image/rpi4.sfdisk");
    fs::write(&script, table)?;
    Task::new("sh")
        .args(["-c", "/usr/sbin/sfdisk --quiet \"$1\" < \"$2\"", "sh"])
        .args([card, &script])
        .output()
        .map(drop)
}
