//! Frames appended to a file, as they would go over a serial line.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::Counts;

/// A file that grows by one frame per packet, each with one write, so that a
/// power cut costs the last packet at most.
#[derive(Debug)]
pub struct FileLink {
    file: File,
    path: PathBuf,
    /// The last frame was cut short (the disk was full): the next begins with a
    /// delimiter, so that only one is lost.
    cut_short: bool,
    /// The first fault.
    fault: Option<String>,
    counts: Counts,
}

impl FileLink {
    /// Appends to `path`. If it does not exist it is created, to be read by its owner alone: it is
    /// what a person's body did.
    ///
    /// # Errors
    /// When the file cannot be opened for writing.
    pub fn open(path: &Path) -> Result<Self> {
        let mut options = OpenOptions::new();
        options.append(true).create(true).mode(0o600);
        let file = options.open(path).with_context(|| {
            format!(
                "the packet file {} cannot be written: check the directory and its permissions",
                path.display()
            )
        })?;
        let path = path.into();
        Ok(Self { file, path, cut_short: false, fault: None, counts: Counts::default() })
    }

    /// Appends one frame.
    pub fn send(&mut self, frame: &[u8]) {
        match self.append(frame) {
            Ok(()) => self.counts.sent += 1,
            Err(error) => {
                self.counts.dropped += 1;
                if self.fault.is_none() {
                    let fault = format!(
                        "the packet file {} cannot be written: {error}: make room, or give \
                         --record another place",
                        self.path.display()
                    );
                    log::error!("{fault}");
                    self.fault = Some(fault);
                }
            }
        }
    }

    fn append(&mut self, frame: &[u8]) -> std::io::Result<()> {
        if self.cut_short {
            self.file.write_all(&[0])?;
        }
        let written = self.file.write_all(frame);
        self.cut_short = written.is_err();
        written
    }

    /// Why packets are missing in the file, with its name.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
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

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_new_file_is_its_owners_alone_and_an_old_one_stays_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let path = folder.path().join("packets.bin");
        FileLink::open(&path).unwrap().send(&[1, 0]);
        assert_eq!(mode(&path), 0o600);
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
        FileLink::open(&path).unwrap().send(&[2, 0]);
        assert_eq!((mode(&path), std::fs::read(&path).unwrap()), (0o640, vec![1, 0, 2, 0]));
    }
}
