//! Frames appended to a file, as they would go over a serial line.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::Counts;

/// A file that grows by one frame per packet, each with one write, so that a
/// power cut costs the last packet at most.
#[derive(Debug)]
pub struct FileLink {
    file: File,
    path: PathBuf,
    /// A frame was cut short (the disk was full): the next begins with a
    /// delimiter, so that only the one is lost.
    cut_short: bool,
    counts: Counts,
}

impl FileLink {
    /// Appends to `path`, which is made when absent.
    ///
    /// # Errors
    /// When the file cannot be opened for writing.
    pub fn open(path: &Path) -> Result<Self> {
        let file = OpenOptions::new().append(true).create(true).open(path).with_context(|| {
            format!(
                "the packet file {} cannot be written: check the directory and its permissions",
                path.display()
            )
        })?;
        Ok(Self { file, path: path.into(), cut_short: false, counts: Counts::default() })
    }

    /// Appends one frame.
    pub fn send(&mut self, frame: &[u8]) {
        if self.cut_short && self.file.write_all(&[0]).is_err() {
            self.counts.dropped += 1;
            return;
        }
        self.cut_short = self.file.write_all(frame).is_err();
        if self.cut_short {
            self.counts.dropped += 1;
        } else {
            self.counts.sent += 1;
        }
    }

    /// What became of the packets so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

impl std::fmt::Display for FileLink {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "file {}", self.path.display())
    }
}
