//! The settings partition: the first FAT file system that has a configuration.
//!
//! Disks appear once their drivers have found them, so all of them are searched
//! repeatedly for a while. Partitions are mounted read-only.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nix::mount::{MsFlags, mount, umount};
use plumbline::config::FILE_NAME;
use plumbline_update::card::{SECTOR_BYTES, SETTINGS_LABEL};

use crate::config_store::ConfigStore;
use crate::machine::read_only_partition::{MOUNT_FLAGS, ReadOnlyPartition};
use crate::stored_file::is_absent;

/// Where the partition is mounted.
const PLACE: &str = "/boot";

const BLOCK_DEVICES: &str = "/sys/class/block";

/// A USB disk takes a few seconds to appear.
const PATIENCE: Duration = Duration::from_secs(10);

/// The pause between two searches.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// What was found on the disks.
#[derive(Debug)]
pub struct Found {
    /// Where the configuration is stored, or can be, and on which device that is; `None` if there is
    /// no FAT file system.
    pub partition: Option<(ReadOnlyPartition, String)>,
    /// The configuration's bytes and the device they are on, or why they could not be read:
    /// [`Absent`] if no disk has a configuration.
    pub config: Result<(Vec<u8>, String)>,
}

/// There is no configuration on any disk.
#[derive(Debug)]
pub struct Absent {
    /// The disks and partitions that were found.
    devices: Vec<String>,
}

impl std::fmt::Display for Absent {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let seconds = PATIENCE.as_secs();
        let looked =
            if self.devices.is_empty() { "no disk".into() } else { self.devices.join(" ") };
        write!(
            formatter,
            "no {FILE_NAME} in {seconds} s on a FAT partition ({looked}): send one with `plumb \
             provision`, or copy it to the settings partition"
        )
    }
}

impl std::error::Error for Absent {}

/// Searches for the configuration until it is found, or for [`PATIENCE`].
pub fn find() -> Found {
    let config = find_config();
    let mounted = match &config {
        Ok((_, device)) => Some(device.clone()),
        Err(_) => mount_one(),
    };
    Found { partition: mounted.map(|device| (partition(), device)), config }
}

fn partition() -> ReadOnlyPartition {
    ReadOnlyPartition::at(Path::new(PLACE))
}

fn find_config() -> Result<(Vec<u8>, String)> {
    std::fs::create_dir_all(PLACE).with_context(|| format!("{PLACE} cannot be made"))?;
    let give_up = Instant::now() + PATIENCE;
    loop {
        let devices = devices(Path::new(BLOCK_DEVICES))?;
        for device in &devices {
            if let Some(blob) = config_of(device)? {
                return Ok((blob, device.clone()));
            }
        }
        if Instant::now() >= give_up {
            return Err(Absent { devices }.into());
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Mounts the FAT file system that is for settings, or else the first; returns its device.
fn mount_one() -> Option<String> {
    let devices = devices(Path::new(BLOCK_DEVICES)).ok()?;
    let (settings, others): (Vec<_>, Vec<_>) =
        devices.into_iter().partition(|it| is_for_settings(&Path::new("/dev").join(it)));
    settings.into_iter().chain(others).find(|it| mount_at(it))
}

/// Whether a device begins with a FAT32 file system that has the settings' label.
fn is_for_settings(device: &Path) -> bool {
    // By Microsoft's specification of FAT: the label's place in the boot sector, padded with spaces.
    const LABEL: std::ops::Range<usize> = 71..82;
    let mut sector = [0; SECTOR_BYTES];
    let read = File::open(device).and_then(|mut file| file.read_exact(&mut sector));
    read.is_ok() && sector[LABEL].trim_ascii_end() == SETTINGS_LABEL.as_bytes()
}

/// The disks and partitions that are not empty, in the order of their names.
fn devices(class: &Path) -> Result<Vec<String>> {
    let listed = std::fs::read_dir(class)
        .with_context(|| format!("the disks in {} cannot be listed", class.display()))?;
    let mut names: Vec<String> = listed
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| {
            let sectors = std::fs::read_to_string(class.join(name).join("size"));
            sectors.is_ok_and(|text| text.trim().parse().is_ok_and(|count: u64| count > 0))
        })
        .collect();
    names.sort();
    Ok(names)
}

/// The configuration on a device, if it has a FAT file system with one.
fn config_of(device: &str) -> Result<Option<Vec<u8>>> {
    if !mount_at(device) {
        return Ok(None);
    }
    match ConfigStore::on_partition(&partition(), FILE_NAME).read() {
        Ok(blob) => Ok(Some(blob)),
        Err(error) if is_absent(&error) => {
            umount(PLACE).with_context(|| format!("{device} cannot be unmounted"))?;
            Ok(None)
        }
        Err(error) => Err(error).with_context(|| format!("{device}: {FILE_NAME} cannot be read")),
    }
}

/// Mounts a device's FAT file system, if it has one.
fn mount_at(device: &str) -> bool {
    let node = format!("/dev/{device}");
    // Silent, because disks with other contents are nothing unusual.
    let flags = MOUNT_FLAGS | MsFlags::MS_RDONLY | MsFlags::MS_SILENT;
    mount(Some(node.as_str()), PLACE, Some("vfat"), flags, None::<&str>).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_settings_are_told_by_their_label() {
        let device = tempfile::NamedTempFile::new().unwrap();
        for (label, is_one) in [("PLUMBLINE  ", true), ("PL-SLOT    ", false)] {
            let mut sector = [0; SECTOR_BYTES];
            sector[71..82].copy_from_slice(label.as_bytes());
            std::fs::write(device.path(), sector).unwrap();
            assert_eq!(is_for_settings(device.path()), is_one, "{label}");
        }
        std::fs::write(device.path(), [0; 100]).unwrap();
        assert!(!is_for_settings(device.path()));
    }

    #[test]
    fn disks_without_a_medium_are_skipped() {
        let class = tempfile::tempdir().unwrap();
        for (name, size) in
            [("vda1", "2048\n"), ("vda", "4096\n"), ("loop0", "0\n"), ("mmcblk0p1", "8192\n")]
        {
            std::fs::create_dir(class.path().join(name)).unwrap();
            std::fs::write(class.path().join(name).join("size"), size).unwrap();
        }
        // A device that vanishes while it is looked at.
        std::fs::create_dir(class.path().join("sda")).unwrap();
        assert_eq!(devices(class.path()).unwrap(), ["mmcblk0p1", "vda", "vda1"]);
        assert!(devices(&class.path().join("absent")).is_err());
    }
}
