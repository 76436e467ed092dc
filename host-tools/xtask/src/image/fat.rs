//! FAT file systems in files, made with dosfstools and mtools, neither of which needs root. The
//! same content gives the same bytes.

use std::path::Path;

use anyhow::Result;

use crate::command::Task;
use crate::setup::{Need, Probe};

/// The tools needed to make them.
pub const NEEDS: &[Need] = &[
    Need {
        probe: Probe::File("/usr/sbin/mkfs.fat"),
        package: "dosfstools",
        why: "makes the settings partition's file system",
    },
    Need {
        probe: Probe::Program("mcopy"),
        package: "mtools",
        why: "copies files into it without mounting it",
    },
];

const SECTOR_BYTES: u64 = 512;

/// A file system within a file: the whole of it, or a partition.
#[derive(Debug)]
pub struct Fat<'a> {
    file: &'a Path,
    start_bytes: u64,
}

impl<'a> Fat<'a> {
    /// Makes an empty file system of `size_bytes` at `start_bytes` of the file, which must be large
    /// enough. `bits` is 12, 16 or 32.
    pub fn make(
        file: &'a Path,
        start_bytes: u64,
        size_bytes: u64,
        bits: u8,
        label: &str,
    ) -> Result<Self> {
        // Clusters of one sector: otherwise a small file system has fewer than FAT32 must have, and
        // some take it for FAT16.
        Task::new("/usr/sbin/mkfs.fat")
            .args(["--invariant", "-n", label, "-F", &bits.to_string(), "-s", "1"])
            .args(["--offset", &(start_bytes / SECTOR_BYTES).to_string()])
            .args([file])
            .args([(size_bytes / 1024).to_string()])
            .output()?;
        Ok(Self { file, start_bytes })
    }

    /// Copies a file into the root directory under this name.
    pub fn copy(&self, from: &Path, name: &str) -> Result<()> {
        let image = format!("{}@@{}", self.file.display(), self.start_bytes);
        // mtools uses this as the date of the files it writes; otherwise the image would change
        // every day.
        Task::new("mcopy")
            .env("SOURCE_DATE_EPOCH", "0")
            .args(["-o", "-i", &image])
            .args([from])
            .args([format!("::{name}")])
            .output()?;
        Ok(())
    }
}
