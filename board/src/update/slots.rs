//! The slots of this box's card: which one runs, whether it is on trial, and which one starts next.

// One call of the kernel has no safe wrapper.
#![allow(unsafe_code)]

use std::fs::{self, File};
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use nix::mount::{MsFlags, mount, umount};
use plumbline_update::card::{PARTITIONS, Partition, SECTOR_BYTES, Slot};
use plumbline_update::chooser;

use super::disk::{Block, Disk};
use crate::machine::read_only_partition::MOUNT_FLAGS;

/// Where the kernel tells of disks and partitions.
const BLOCK_DEVICES: &str = "/sys/class/block";

/// Where the boot firmware leaves its information.
const BOOT_LOADER: &str = "/proc/device-tree/chosen/bootloader";

/// Where the chooser is mounted while its file is looked up.
const PLACE: &str = "/chooser";

/// From linux/fs.h: which block of its disk a file's block is.
mod ioctl {
    #![allow(missing_docs, reason = "the macro makes the function")]
    use nix::libc::c_int;

    nix::ioctl_readwrite_bad!(fibmap, 1, c_int);
}

/// The slots of a card that can be updated.
#[derive(Debug)]
pub struct Slots {
    /// The one that runs.
    pub running: Slot,
    /// Whether it runs for this one start only.
    pub is_on_trial: bool,
    /// The devices of both, slot A first.
    devices: [PathBuf; 2],
    chooser: ChooserSector,
}

impl Slots {
    /// The slots of the card whose partition `device` is, such as `mmcblk0p4`.
    ///
    /// # Errors
    /// Why the box cannot be updated over its link.
    pub fn of_card_with(device: &str) -> Result<Self> {
        let card = partitions(Path::new(BLOCK_DEVICES), device)?;
        let start = Start::read(Path::new(BOOT_LOADER))?;
        let [chooser, a, b, _] = card;
        let chooser = ChooserSector::find(&chooser)?;
        // A card that was copied or changed elsewhere is not guessed about.
        let chosen = chooser.read()?;
        let running = if start.is_try { chosen.other() } else { chosen };
        ensure!(
            start.slot == running,
            "the boot firmware says that it has started {}, and the chooser says {chosen}",
            start.slot
        );
        Ok(Self { running, is_on_trial: start.is_try, devices: [a, b], chooser })
    }

    /// Slots in files, the chooser's sector at the start of one.
    #[cfg(test)]
    pub fn in_files(running: Slot, is_on_trial: bool, devices: [PathBuf; 2], file: &Path) -> Self {
        let chooser = ChooserSector { device: file.to_owned(), at: 0 };
        Self { running, is_on_trial, devices, chooser }
    }

    /// The device of the slot that does not run.
    pub fn idle(&self) -> &Path {
        match self.running.other() {
            Slot::A => &self.devices[0],
            Slot::B => &self.devices[1],
        }
    }

    /// Makes the slot that runs the one that starts from now on.
    ///
    /// # Errors
    /// When the card does not take it, or does not give it back.
    pub fn commit(&self) -> Result<()> {
        self.chooser.write(self.running)?;
        let chosen = self.chooser.read()?;
        ensure!(chosen == self.running, "the card has not kept which slot is to start");
        Ok(())
    }
}

/// What the boot firmware says of this start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Start {
    slot: Slot,
    is_try: bool,
}

impl Start {
    fn read(boot_loader: &Path) -> Result<Self> {
        let cell = |name: &str| {
            let bytes = fs::read(boot_loader.join(name)).ok()?;
            Some(u32::from_be_bytes(bytes.try_into().ok()?))
        };
        let partition = cell("partition")
            .context("the boot firmware does not say which partition it has started")?;
        let slot = Slot::of_partition(partition)
            .with_context(|| format!("the box was started from partition {partition}, no slot"))?;
        Ok(Self { slot, is_try: cell("tryboot").is_some_and(|flag| flag != 0) })
    }
}

/// The devices of a card's partitions, if they are as they must be.
fn partitions(class: &Path, device: &str) -> Result<[PathBuf; 4]> {
    // A partition's directory is inside its disk's.
    let place = class.join(device).canonicalize().with_context(|| device.to_owned())?;
    let disk = place.parent().context("no disk")?;
    let mut found = [const { None }; 4];
    for entry in fs::read_dir(disk).with_context(|| disk.display().to_string())?.flatten() {
        let number = |name: &str| -> Option<u64> {
            fs::read_to_string(entry.path().join(name)).ok()?.trim().parse().ok()
        };
        let Some(index) = number("partition").and_then(|it| usize::try_from(it).ok()) else {
            continue;
        };
        let sectors = |bytes: u64| Some(bytes / SECTOR_BYTES as u64);
        let is_as_made = |it: &Partition| {
            number("start") == sectors(it.start_bytes) && number("size") == sectors(it.bytes)
        };
        let place = index.checked_sub(1);
        if let Some(place) = place.filter(|it| PARTITIONS.get(*it).is_some_and(is_as_made)) {
            found[place] = Some(Path::new("/dev").join(entry.file_name()));
        }
    }
    let [Some(a), Some(b), Some(c), Some(d)] = found else {
        anyhow::bail!(
            "its card has no second slot: write a card with a newer image, once, and put the \
             configuration and the key on it"
        );
    };
    Ok([a, b, c, d])
}

/// The sector of the chooser's file.
#[derive(Debug)]
struct ChooserSector {
    device: PathBuf,
    at: u64,
}

impl ChooserSector {
    /// Looks up where the file is: the file system is mounted for that, and no longer, because what
    /// is written later goes past it.
    fn find(device: &Path) -> Result<Self> {
        fs::create_dir_all(PLACE).with_context(|| format!("{PLACE} cannot be made"))?;
        let flags = MOUNT_FLAGS | MsFlags::MS_RDONLY | MsFlags::MS_SILENT;
        mount(Some(device), PLACE, Some("vfat"), flags, None::<&str>)
            .with_context(|| format!("{} has no file system", device.display()))?;
        let at = Self::position(&Path::new(PLACE).join(chooser::FILE_NAME));
        umount(PLACE).with_context(|| format!("{PLACE} stays mounted"))?;
        Ok(Self { device: device.to_owned(), at: at.context(chooser::FILE_NAME)? })
    }

    fn position(path: &Path) -> Result<u64> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        ensure!(length == SECTOR_BYTES as u64, "it has {length} bytes, and not {SECTOR_BYTES}");
        let mut block = 0;
        // SAFETY: `block` outlives the call, which reads and writes one integer.
        unsafe { ioctl::fibmap(file.as_raw_fd(), &raw mut block) }
            .context("the file system does not say where it is")?;
        let block = u64::try_from(block).ok().filter(|block| *block > 0);
        // FAT counts in sectors; those of other sizes are not made.
        Ok(block.context("it has no place")? * SECTOR_BYTES as u64)
    }

    fn read(&self) -> Result<Slot> {
        let mut block = Block::new();
        Disk::open(&self.device, false)?.read(self.at, &mut block, SECTOR_BYTES)?;
        chooser::chosen(&block.bytes()[..SECTOR_BYTES]).with_context(|| {
            format!("{} on {} is not a box's", chooser::FILE_NAME, self.device.display())
        })
    }

    fn write(&self, slot: Slot) -> Result<()> {
        let mut block = Block::new();
        block.bytes_mut()[..SECTOR_BYTES].copy_from_slice(&chooser::sector(slot));
        let disk = Disk::open(&self.device, true)?;
        disk.write(self.at, &block, SECTOR_BYTES)?;
        disk.sync()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk in a directory, as sysfs has it.
    fn sysfs(partitions: &[(u32, u64, u64)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let class = folder.path().join("class");
        fs::create_dir_all(&class).unwrap();
        for (number, start, size) in partitions {
            let place = folder.path().join(format!("mmcblk0/mmcblk0p{number}"));
            fs::create_dir_all(&place).unwrap();
            for (name, value) in
                [("partition", u64::from(*number)), ("start", *start), ("size", *size)]
            {
                fs::write(place.join(name), format!("{value}\n")).unwrap();
            }
            std::os::unix::fs::symlink(&place, class.join(format!("mmcblk0p{number}"))).unwrap();
        }
        fs::create_dir_all(folder.path().join("mmcblk0/queue")).unwrap();
        folder
    }

    fn as_made() -> Vec<(u32, u64, u64)> {
        let sectors = |bytes: u64| bytes / 512;
        PARTITIONS.map(|it| (it.number, sectors(it.start_bytes), sectors(it.bytes))).to_vec()
    }

    #[test]
    fn a_card_as_it_is_made_has_its_partitions_in_order() {
        let folder = sysfs(&as_made());
        let found = partitions(&folder.path().join("class"), "mmcblk0p4").unwrap();
        assert_eq!(found, [1, 2, 3, 4].map(|it| PathBuf::from(format!("/dev/mmcblk0p{it}"))));
    }

    #[test]
    fn a_card_of_another_make_cannot_be_updated() {
        let mut shifted = as_made();
        shifted[2].1 += 1;
        for card in [vec![(1, 8192, 262_144)], as_made()[..3].to_vec(), shifted] {
            let folder = sysfs(&card);
            let error = partitions(&folder.path().join("class"), "mmcblk0p1").unwrap_err();
            assert!(error.to_string().contains("no second slot"), "{error:#}");
        }
        assert!(partitions(Path::new("/nowhere"), "mmcblk0p1").is_err());
    }

    #[test]
    fn the_firmware_says_which_slot_it_has_started_and_whether_for_a_try() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, value: u32| {
            fs::write(folder.path().join(name), value.to_be_bytes()).unwrap();
        };
        assert!(Start::read(folder.path()).is_err());
        write("partition", 3);
        assert_eq!(Start::read(folder.path()).unwrap(), Start { slot: Slot::B, is_try: false });
        write("tryboot", 1);
        assert_eq!(Start::read(folder.path()).unwrap(), Start { slot: Slot::B, is_try: true });
        write("partition", 1);
        assert!(Start::read(folder.path()).is_err());
    }

    #[test]
    fn a_commit_rewrites_one_sector_and_nothing_else() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut before = vec![0xee; 4096];
        before[..SECTOR_BYTES].copy_from_slice(&chooser::sector(Slot::A));
        fs::write(file.path(), &before).unwrap();
        let slots = Slots::in_files(Slot::B, true, Default::default(), file.path());
        assert_eq!(slots.chooser.read().unwrap(), Slot::A);
        slots.commit().unwrap();
        let after = fs::read(file.path()).unwrap();
        assert_eq!(after[..SECTOR_BYTES], chooser::sector(Slot::B));
        assert_eq!(after[SECTOR_BYTES..], before[SECTOR_BYTES..]);
        fs::write(file.path(), [0; 4096]).unwrap();
        assert!(slots.chooser.read().is_err());
    }
}
